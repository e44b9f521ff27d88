"""OMPL's bindings, its planners and their settings by name, and its log as a log of Python."""

from __future__ import annotations

import logging
import math
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from locplan._support.checks import check_number, format_suggestion, short_repr
from locplan._support.output import temporary_folder
from locplan.errors import ConfigError, LocplanError

try:
    from ompl import base as base, geometric as geometric, util as util
    from ompl.base import Cost as Cost
except ModuleNotFoundError:
    alternatives = {"Windows": "WSL"} if sys.platform == "win32" else {}
    if sys.platform == "darwin" and int(platform.mac_ver()[0].partition(".")[0] or 15) < 15:
        alternatives["macOS 14 and earlier"] = "macOS 15"
    if sys.version_info >= (3, 14):
        alternatives["Python 3.14 and later"] = "Python 3.13"
    raise LocplanError(
        f"OMPL's planners are not available on {' with '.join(alternatives)}: ompl has no wheels"
        " for it;"
        f" use grid or any-angle, or {' with '.join(alternatives.values())}"
        if alternatives
        else "OMPL's planners need ompl: pip install 'locplan[ompl]', or use grid or any-angle"
    ) from None


LOG = logging.getLogger("locplan.ompl")
_LINE = re.compile(r"(Debug|Info|Warning|Error):\s*(.*)")
_HARMLESS = "Random number generation already started"
"""OMPL warns so at every seed but the first, although what is built afterwards obeys it."""

_LEVELS = (
    (logging.DEBUG, util.LogLevel.LOG_DEBUG),
    (logging.INFO, util.LogLevel.LOG_INFO),
    (logging.WARNING, util.LogLevel.LOG_WARN),
    (math.inf, util.LogLevel.LOG_ERROR),
)
"""The greatest levels of Python's log at which OMPL's levels are wanted."""
_NO_PLAIN_VALUE = (
    *("setName", "setProblemDefinition", "setProjectionEvaluator"),
    *("setDefaultConnectionStrategy", "setup"),
)
"""Setters that take no plain value."""
_CRASH = ("setOrderedSampling", "setFocusSearch", "setInformedSampling", "setNearestK")
"""Setters that end the process at another value than the planner's own."""


def make_ompl_planner(
    name: str, information: base.SpaceInformation, settings: Mapping[str, Any]
) -> base.Planner:
    """Return an OMPL planner with our defaults and these settings; a ConfigError if invalid."""
    kind = getattr(geometric, name)
    planner = kind(information)
    if issubclass(kind, geometric.RRTstar):
        planner.setRewireFactor(0.25)  # fewer neighbours, more iterations, a better J
    if kind is geometric.BITstar and information.getStateDimension() == 2:
        planner.setSamplesPerBatch(1000)  # more than its own 100: a better J on large maps
    setters = find_setters(name)
    for setting, value in settings.items():
        try:
            getattr(planner, setters[setting])(value)
        except (TypeError, RuntimeError) as error:
            signature = getattr(kind, setters[setting]).__doc__.strip().splitlines()[0]
            expected = signature.rpartition(": ")[2].partition(")")[0]
            reason = f"it must be {expected}" if isinstance(error, TypeError) else error
            raise ConfigError(
                f"{name} does not take {setting}={short_repr(value)}: {reason}"
            ) from None
    return planner


def check_settings(planner: str, settings: Mapping[str, Any]) -> None:
    """Raise a ConfigError unless the planner has all these settings."""
    setters = find_setters(planner)
    if not isinstance(settings, Mapping):
        raise ConfigError(
            f"settings must be a dict, such as {{'range': 2.0}}, not {short_repr(settings)}"
        )
    for name, value in settings.items():
        if name not in setters:
            names = f"{', '.join(setters)}{format_suggestion(name, setters)}"
            raise ConfigError(f"{planner} has no setting {short_repr(name)}; it has: {names}")
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            check_number(f"{planner}'s setting {name}", value, 1 if isinstance(value, int) else 0)


def find_setters(planner: str) -> dict[str, str]:
    """Return the names of a planner's setters by the settings' names, such as "goal_bias"."""
    setters = {}
    for name in dir(getattr(geometric, planner)):
        if name.startswith("set") and name not in _NO_PLAIN_VALUE + _CRASH:
            setters[re.sub("(?<=[a-z])(?=[A-Z])", "_", name[3:]).lower()] = name
    return setters


@contextmanager
def log_messages() -> Iterator[None]:
    """Pass OMPL's messages of this block to the logger "locplan.ompl" at its end.

    OMPL takes no Python function for this, and writes its messages to standard output.
    """
    with temporary_folder() as folder:
        file = folder / "ompl.log"
        handler = util.OutputHandlerFile(str(file))
        level = util.getLogLevel()
        util.useOutputHandler(handler)
        util.setLogLevel(
            next(
                ompl_level
                for max_level, ompl_level in _LEVELS
                if LOG.getEffectiveLevel() <= max_level
            )
        )
        try:
            yield
        finally:
            util.setLogLevel(level)
            util.restorePreviousOutputHandler()
            for line in file.read_text("utf-8", errors="replace").splitlines():
                line_match = _LINE.match(line)
                if line_match and not line_match[2].startswith(_HARMLESS):
                    LOG.log(logging.getLevelName(line_match[1].upper()), line_match[2])
