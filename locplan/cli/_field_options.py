"""Options of the covariance field, and the settings made of them."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan.cli._groups import INPUT, option_group
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import check_has, field_names, flag, given_of
from locplan.errors import ConfigError
from locplan.field import ESTIMATORS

if TYPE_CHECKING:
    from locplan import FieldConfig, Lidar, Robot
    from locplan.field import Estimator


@option_group("Field")
class FieldOptions:
    """The settings of the covariance field."""

    config: Annotated[Path | None, INPUT, Parameter(metavar="FILE.json")] = None
    """All settings of the field, as calibrate wrote them, in place of the options below."""
    estimator: Annotated[str | None, Parameter(choices=tuple(ESTIMATORS))] = None
    """Estimator of the covariance; fused by default where the lidar is known, else the paper's
    sad."""
    preset: Literal["default", "paper"] | None = None
    """Settings of sad: the default ones, or Eq. 8-10 of the paper as printed."""
    disc: Annotated[float | None, Parameter(metavar="METRES")] = None
    """Radius of sad's template, in metres; 6 by default, or the lidar's range."""
    headings: int | None = None
    """Number of headings; 1 by default where the lidar sees all round, else 8."""
    template: Literal["disc", "visible"] | None = None
    """Template of sad: the paper's disc, or the part of it seen from its centre."""
    stride: float | None = None
    """Spacing of the evaluated cells, in metres; 0.2 by default. Where it is not given and a
    lidar is simulated, plan takes twice as much away from its paths."""

    def with_robot(self, given: RobotOptions) -> tuple[Robot, FieldConfig]:
        """The robot, which has the lidar of the file of settings if no other, and the settings."""
        read = self._read()
        robot = given.load(getattr(read.estimator, "lidar", None) if read else None)
        return robot, _seen_by(read, robot.lidar) if read else self._made(robot.lidar)

    def simulated(self, given: RobotOptions) -> tuple[Robot, FieldConfig]:
        """The robot, which has the field's lidar if no other, and the field's settings.

        Warns of settings of the robot's filter that work badly with the lidar.
        """
        robot, config = self.with_robot(given)
        robot = locplan.field.equipped(robot, config)
        given.warn(robot)
        return robot, config

    def of_drive(self, lidar: Lidar) -> FieldConfig:
        """The settings of a field for a recorded drive; an estimator that casts rays has its lidar.

        Without an estimator it is fused.
        """
        read = self._read()
        config = _seen_by(read, lidar) if read else self._made(lidar)
        return config if config.estimator.casts_rays else read or self._made(None)

    def to_configs(
        self, given: RobotOptions, ranges: tuple[float, ...] | None
    ) -> tuple[Robot, list[FieldConfig]]:
        """The robot, and the settings with each of the ranges [m], if there are any."""
        robot, config = self.with_robot(given)
        if ranges is None:
            return robot, [config]
        return robot, [_reaching(config, reach) for reach in ranges]

    def _read(self) -> FieldConfig | None:
        """The settings in the file, if one was given."""
        if self.config is None:
            return None
        others = [flag(name) for name in given_of(self) if name != "config"]
        if others:
            raise ConfigError(
                f"--config has all settings of the field; leave out {', '.join(others)}"
            )
        return locplan.load_config(self.config)

    def _made(self, lidar: Lidar | None) -> FieldConfig:
        """The settings that were asked for; `lidar` is the robot's, where it is known."""
        given = given_of(self)
        kinds = [locplan.field.estimator_class(name) for name in ESTIMATORS]
        kind: Any = locplan.field.estimator_class(
            given.pop("estimator", "fused" if lidar else "sad")
        )
        for name in given:
            having = [each.name for each in kinds if _takes(each, name)]
            check_has(name, "--estimator", kind.name, having)
        others = {name: given.pop(name) for name in ("stride", "headings") if name in given}
        if kind.casts_rays:
            short, what = locplan.field.SHORT_LIDAR, "no lidar named, one assumed"
            assumed = dataclasses.replace(short, model=what)
            return locplan.FieldConfig(kind.of(lidar or assumed), **others)
        return locplan.FieldConfig(_with_template(kind, lidar, given), **others)


def _with_template(kind: Any, lidar: Lidar | None, given: dict[str, Any]) -> Estimator:
    """The estimator that compares a template with the map, of the options given."""
    made = kind.paper() if given.pop("preset", None) == "paper" else kind()
    if "disc" in given:
        given["range"] = given.pop("disc")
    made = made.with_lidar(lidar) if lidar else made
    changed: Estimator = dataclasses.replace(made, **given)
    return changed


def _takes(kind: type[Estimator], option: str) -> bool:
    """True if an option of `FieldOptions` is for this estimator."""
    if option == "headings":
        return kind.casts_rays
    if option in ("stride", "preset"):
        return option == "stride" or hasattr(kind, "paper")
    return {"disc": "range"}.get(option, option) in field_names(kind)


def _seen_by(config: FieldConfig, lidar: Lidar | None) -> FieldConfig:
    """Settings with another lidar; the number of headings by default is that of the new one."""
    if lidar is None or lidar == getattr(config.estimator, "lidar", None):
        return config
    by_default = config.headings == config.estimator.headings
    return dataclasses.replace(
        config,
        estimator=config.estimator.with_lidar(lidar),
        headings=0 if by_default else config.headings,
    )


def _reaching(config: FieldConfig, reach: float) -> FieldConfig:
    """Settings with another range of the lidar, or of the template [m]."""
    lidar = getattr(config.estimator, "lidar", None)
    if lidar:
        return _seen_by(config, dataclasses.replace(lidar, range=reach))
    estimator: Any = config.estimator
    return dataclasses.replace(config, estimator=dataclasses.replace(estimator, range=reach))
