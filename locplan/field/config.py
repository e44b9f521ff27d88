"""The settings of a covariance field, checked when they are made, in JSON files, options and code.

Every command accepts such a file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import (
    Settings,
    check_file_path,
    check_instance,
    check_integer,
    check_positive,
    parse_poses,
    set_frozen_fields,
    short_repr,
)
from locplan._support.files import check_writable_file, write_text
from locplan._support.kernels.arrays import Bools, Floats
from locplan._support.output import replace_file
from locplan._support.reading import (
    MAX_JSON_BYTES,
    check_file_stamp,
    make_file_stamp,
    parse_json,
    read_text,
)
from locplan.errors import ConfigError, LocplanError
from locplan.field.estimator import Estimator, build_settings, dict_from_settings
from locplan.field.estimators import estimator_class
from locplan.field.lattice import select_evaluated_points, stride_cells
from locplan.field.poses import LatticeCorners
from locplan.field.sad import PAPER_RANGE, Sad
from locplan.maps.grid import OccupancyGrid
from locplan.robots.lidar import Lidar
from locplan.robots.robot import Robot

KIND, VERSION = "settings", 1
STRIDE = 0.2
"""Spacing of the evaluated cells by default [m]."""
COARSE_STRIDE = 0.4
"""Spacing that shows weak spots, which are metres large, in a quarter of the time [m]."""
SHORT_LIDAR = Lidar(range=PAPER_RANGE, range_sigma=0.025)
"""Lidar that is simulated where none is named; its range is that of the paper's disc."""


@dataclass(frozen=True, repr=False)
class FieldConfig(Settings):
    """Settings of a covariance field: its estimator, spacing and headings.

    Functions that take a FieldConfig also take an estimator, for ``FieldConfig(estimator)``.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> FieldConfig(Sad(range=8.0), stride=0.4).estimator.reach
    8.0
    >>> FieldConfig(stride=-1.0)
    Traceback (most recent call last):
    locplan.errors.ConfigError: stride must be a positive number of m, not -1.0
    """

    estimator: Estimator = field(default_factory=Sad)
    """Estimator of the covariance at a pose: `Sad`, `Fisher`, `Scan`, `Fused`, or your own."""
    stride: float = field(default=STRIDE, kw_only=True)
    """Spacing of the evaluated cells [m], above 0 up to the estimator's range.

    It is rounded to whole cells, at least one. Twice as much takes a quarter of the time, but
    misses what changes from one cell to the next.
    """
    headings: int = field(default=0, kw_only=True)
    """Number of headings of the robot, evenly spaced from 0 on, that have covariances, up to 360.

    0 becomes 1 where the estimator sees the same in all headings, and 8 otherwise. The time grows
    with the number; more of them suit a lidar with a narrow field of view.
    """

    def __post_init__(self) -> None:
        check_instance("estimator", self.estimator, Estimator, "such as locplan.Sad(range=6.0)")
        set_frozen_fields(self, stride=check_positive("stride", self.stride, "m"))
        if self.stride > self.estimator.reach:
            raise ConfigError(
                f"stride ({self.stride} m) must not exceed the range ({self.estimator.reach} m)"
            )
        headings = check_integer("headings", self.headings, 0, 360) or self.estimator.headings
        if self.estimator.headings == 1 < headings and not self.estimator.casts_rays:
            raise ConfigError(
                f"estimator {short_repr(self.estimator.name)} is the same for all headings"
            )
        if headings == 1 < self.estimator.headings:
            raise ConfigError(
                "the view of this lidar depends on the heading; set headings above 1, or to 0"
            )
        set_frozen_fields(self, headings=headings)

    @property
    def heading_angles(self) -> Floats:
        """Headings in the world that a field has covariances for, (headings,) [rad]."""
        return 2 * np.pi * np.arange(self.headings) / self.headings

    @property
    def title(self) -> str:
        """The estimator with its most important settings, and the number of several headings."""
        several = f", mean of {self.headings} headings" if self.headings != 1 else ""
        return f"{self.estimator.title}{several}"

    def stride_cells(self, resolution: float) -> int:
        """Return the spacing of the evaluated cells, at least 1 [cells].

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        """
        return stride_cells(self.stride, resolution)

    def lattice_points(self, grid: OccupancyGrid, poses: ArrayLike | None = None) -> Bools:
        """Return the mask of the lattice points that a field of a map has values at, (h, w).

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        poses : (n, 2) or (n, 3) array, optional
            Poses in the world [m, m, rad]: only the points that `CovarianceField.at` reads there.
        """
        stride = self.stride_cells(grid.resolution)
        points = select_evaluated_points(grid.free, stride)
        if poses is None:
            return points
        xy = parse_poses(poses)[0][:, :2]
        corners = LatticeCorners.from_positions(
            grid, stride, points, np.zeros_like(points), xy
        ).points
        near = np.zeros_like(points)
        near[tuple(corners.T)] = True
        return near

    def to_json(self) -> dict[str, object]:
        """Return all settings, fit for JSON."""
        return dict_from_settings(self)

    @classmethod
    def from_json(cls, settings: Mapping[str, object]) -> FieldConfig:
        """Make a config from the result of `to_json`.

        Parameters
        ----------
        settings : mapping
            Settings by name; missing ones take their defaults. "estimator" is a mapping with the
            estimator's "name" and settings.

        Raises
        ------
        ConfigError
            If a setting is unknown or out of its range.
        """
        described = settings.get("estimator", {"name": Sad.name})
        if not isinstance(described, Mapping):
            raise ConfigError(
                f"estimator must be an object with a name, not {short_repr(described)}"
            )
        estimator = build_settings(estimator_class(str(described.get("name"))), described)
        field_settings = {name: value for name, value in settings.items() if name != "estimator"}
        return build_settings(cls, {**field_settings, "estimator": estimator})


def config_from_settings(settings: FieldConfig | Estimator | None) -> FieldConfig:
    """Return the settings of a field from any form that functions accept.

    Parameters
    ----------
    settings : FieldConfig, Estimator or None
        The settings, an estimator alone, or None for the default ones.

    Raises
    ------
    ConfigError
        If the form is unknown.
    """
    if settings is None or isinstance(settings, Estimator):
        return FieldConfig() if settings is None else FieldConfig(settings)
    remedy = "give an estimator, such as locplan.Sad(range=6.0), or a FieldConfig of one"
    check_instance("config", settings, FieldConfig, remedy)
    return settings


def lidar_from_config(config: FieldConfig | None) -> Lidar:
    """Return the lidar of a field's settings, or a short one with the range of its estimator.

    Parameters
    ----------
    config : FieldConfig or None
        The settings; without them the lidar is the short one of 6 m, the range of the paper's disc.
    """
    if config is None:
        return SHORT_LIDAR
    estimator_lidar: Lidar | None = getattr(config.estimator, "lidar", None)
    return estimator_lidar or replace(SHORT_LIDAR, range=config.estimator.reach)


def equip_robot(robot: Robot | None, config: FieldConfig | None = None) -> Robot:
    """Return the robot, or a default one, with the lidar of a field's settings if it has none.

    Parameters
    ----------
    robot : Robot or None
        The robot.
    config : FieldConfig, optional
        The field's settings, see `lidar_from_config`.

    Raises
    ------
    ConfigError
        If it is no robot.
    """
    robot = Robot() if robot is None else robot
    check_instance("robot", robot, Robot, 'such as locplan.Robot("turtlebot4")')
    return robot if robot.lidar else replace(robot, lidar=lidar_from_config(config))


def save_config(config: FieldConfig, path: str | os.PathLike[str]) -> None:
    """Write the settings of a field as JSON, for `load_config` and the option ``--field``.

    Parameters
    ----------
    config : FieldConfig
        The settings.
    path : path
        The file, named ``*.json``. An existing file is replaced.

    Raises
    ------
    LocplanError
        If the file cannot be written, or its name does not end in .json.
    """
    check_instance("config", config, FieldConfig)
    target = check_file_path("a file of settings", path)
    check_writable_file(target, ".json")
    content = {**make_file_stamp(KIND, VERSION), "config": config.to_json()}
    with replace_file(target) as temporary:
        write_text(temporary, json.dumps(content, indent=2) + "\n")


def load_config(path: str | os.PathLike[str]) -> FieldConfig:
    """Read the settings of a field from a JSON file.

    They are the file's "config", as `save_config` writes it, or the whole file.
    Missing settings take their defaults.

    Parameters
    ----------
    path : path
        The JSON file.

    Raises
    ------
    ConfigError
        If the file cannot be read, or a setting or value is unknown.
    """
    try:
        content = parse_json(read_text(check_file_path("a file of settings", path), MAX_JSON_BYTES))
        if isinstance(content, dict) and {"config", "version"} <= content.keys():
            check_file_stamp(path, content, KIND, VERSION)  # older files have no version
    except LocplanError as error:
        raise ConfigError(str(error)) from None
    except ValueError:
        raise ConfigError(f"{path}: is no JSON; locplan.save_config writes such a file") from None
    settings = content.get("config", content) if isinstance(content, dict) else None
    if not isinstance(settings, dict):
        raise ConfigError(f'{path}: must hold settings of a field, or them as its "config"')
    try:
        return FieldConfig.from_json(settings)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
