"""The settings of a field as options of the commands, and as code."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from locplan._util.runs import Spelled, number_text
from locplan.field._config import FieldConfig
from locplan.field.estimators._sad import Sad

if TYPE_CHECKING:
    from locplan.field._estimator import Estimator
    from locplan.robots import Lidar

SETTINGS = "settings.json"
"""File of a field's settings, where the commands' options cannot say them."""


def config_spelled(config: FieldConfig, lidar: Lidar | None, *, whole: bool = True) -> Spelled:
    """Options and code that make the settings of a field.

    Where options cannot say them, the code writes them to a file, settings.json, which --config
    reads.

    Parameters
    ----------
    config : FieldConfig
        The settings.
    lidar : Lidar or None
        Lidar of the robot, which is named robot in the code; None where it is not known.
    whole : bool, default True
        Whether `locplan plan` is to evaluate it everywhere, not only near its paths.
    """
    words = _options(config, lidar, whole)
    saved = [] if words is not None else [f"locplan.save_config({SETTINGS!r}, config)"]
    return Spelled(["--config", SETTINGS] if words is None else words, _code(config, lidar), saved)


def _options(config: FieldConfig, lidar: Lidar | None, whole: bool) -> list[str] | None:
    """Options of the commands that make these settings of a field; None if none do."""
    estimator: Any = config.estimator
    words = []
    if estimator.name != ("fused" if lidar else "sad"):
        words += ["--estimator", estimator.name]
    makes = _made(type(estimator), lidar, estimator.reach)
    fitting = [more for more, made in makes if made == estimator]
    if not fitting:
        return None
    words += fitting[0]
    if (whole and estimator.casts_rays) or config.stride != FieldConfig.stride:
        words += ["--stride", number_text(config.stride)]
    if config.headings != estimator.headings:
        words += ["--headings", str(config.headings)]
    return words


def _made(
    kind: type[Estimator], lidar: Lidar | None, reach: float
) -> Iterator[tuple[list[str], Estimator]]:
    """Further options, and the estimator that the commands make with each of them."""
    if kind.casts_rays and lidar:
        yield [], kind.of(lidar)
    elif kind is Sad:
        disc = ["--disc", number_text(reach)] if lidar or reach != Sad.range else []
        for preset, made in (([], Sad()), (["--preset", "paper"], Sad.paper())):
            yield disc + preset, dataclasses.replace(made, range=reach)
            seen = dataclasses.replace(made, range=reach, template="visible")
            yield [*disc, *preset, "--template", "visible"], seen


def _code(config: FieldConfig, lidar: Lidar | None) -> str:
    """Code that makes these settings, with robot.lidar for the lidar."""
    if not type(config.estimator).__module__.startswith("locplan."):
        # The user's own, which is registered by its name.
        return f"locplan.FieldConfig.from_json({json.loads(json.dumps(config.to_json()))!r})"
    text = repr(config).replace(repr(lidar), "robot.lidar") if lidar else repr(config)
    text = re.sub(r"\b(Exponential|InverseSquare)\(", r"field.\1(", text)
    return re.sub(r"\b(?=(field\.)?[A-Z]\w+\()(?<!\.)", "locplan.", text)
