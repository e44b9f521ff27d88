"""A robot: all settings of its planning and localization, in one object."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from locplan._support.checks import (
    Settings,
    check_file_path,
    check_instance,
    check_number,
    checked_setting,
    describe_changed_settings,
    format_suggestion,
    is_number,
    set_frozen_fields,
    short_repr,
)
from locplan._support.files import check_writable_file, write_text
from locplan._support.output import replace_file
from locplan._support.public import read_field_docs
from locplan._support.reading import dump_yaml, make_file_stamp
from locplan._support.records import Table, TableColumn
from locplan.errors import ConfigError
from locplan.robots.amcl import Amcl, Filter
from locplan.robots.files import (
    PARTS,
    ROBOT_SETTINGS,
    VERSION,
    build_robot_parts,
    footprint_from_corners,
    list_setting_names,
    read_robot_parts,
)
from locplan.robots.lidar import Lidar
from locplan.robots.nav2 import name_file_in_errors
from locplan.robots.parts import Disturbances, Footprint, Inflation, Kinematics, Odometry


@dataclass(frozen=True, repr=False)
class Robot(Settings):
    """A robot with a 2D lidar: its outline, kinematics, filter and odometry.

    Every part may be left out; a robot is known when its lidar is.

    Raises
    ------
    ConfigError
        If a part is of the wrong kind, or a value out of its range.

    Examples
    --------
    >>> robot = Robot("turtlebot4", footprint=0.18)
    >>> robot.lidar.range, round(robot.radius, 2)
    (12.0, 0.23)
    >>> robot.with_settings({"alpha1": 0.05}).filter
    Amcl(alpha1=0.05)
    """

    lidar: Lidar | None = None
    """The lidar, or its name, one of `LIDARS`; None where it is not known."""
    _: KW_ONLY
    footprint: Footprint | float = 0.2
    """The true outline, or its radius, >= 0 [m]."""
    margin: float = checked_setting(0.05, 0.0)
    """What planning adds to the outline, >= 0 [m]; Nav2's footprint_padding."""
    kinematics: Kinematics = field(default=Kinematics())
    """How the robot moves."""
    goal_tolerance: float = checked_setting(0.25, 0.0)
    """Distance from the goal at which the robot stops, >= 0 [m]."""
    inflation: Inflation | None = None
    """Inflation of the costmap that the robot's navigation plans on; None without one."""
    filter: Amcl | Filter = field(default=Amcl())
    """The filter that localizes the robot, with its parameters: Nav2's, or one of your own."""
    odometry: Odometry = field(default=Odometry())
    """Errors of the odometry."""
    disturbances: Disturbances = field(default=Disturbances())
    """Noise, and how the worlds differ from the map."""

    if TYPE_CHECKING:  # a lidar may be given by its name, but is kept as one

        def __init__(
            self,
            lidar: Lidar | str | None = None,
            *,
            footprint: Footprint | float = ...,
            margin: float = ...,
            kinematics: Kinematics = ...,
            goal_tolerance: float = ...,
            inflation: Inflation | None = None,
            filter: Amcl | Filter = ...,
            odometry: Odometry = ...,
            disturbances: Disturbances = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        if isinstance(self.lidar, str):
            set_frozen_fields(self, lidar=Lidar.preset(self.lidar))
        for name, kind in PARTS.items():
            part = getattr(self, name)
            follows = hasattr(part, "start") and name == "filter"  # the protocol of filters
            if not follows and (part is not None or name not in ("lidar", "inflation")):
                check_instance(name, part, kind)
        if not isinstance(self.footprint, Footprint):
            set_frozen_fields(self, footprint=check_number("footprint", self.footprint, 0.0))
        super().__post_init__()

    @classmethod
    def load(
        cls,
        *paths: str | os.PathLike[str],
        lidar: Lidar | str | None = None,
        planner: str | None = None,
    ) -> Robot:
        """Read a robot from one or more files; later files replace single settings of earlier ones.

        Parameters
        ----------
        *paths : path
            Files that `save` or ``locplan recording`` wrote, parameters of Nav2, or a URDF or SDF
            with the lidar. Of a file with several robots the namespace of one follows, as in
            "nav2.yaml:robot1". Nav2's parameters give amcl's filter; footprint or robot_radius,
            footprint_padding and inflation of the global costmap (of the local one if the global
            one has no size); and the drive of the planner in use. If the planner has none, the
            robot moves sideways if amcl's motion model does.
        lidar : Lidar or str, optional
            The lidar, or its name, in place of the files'. A URDF or SDF then needs no sensor.
            If the lidar has no mount, it gets the mount of the file's sensor, or of the only link
            that is named like a scanner's frame, such as laser_frame or base_scan.
        planner : str, optional
            Name of the planner in Nav2's parameters that decides the robot's drive; by default
            GridBased, which Nav2's default tree uses, or the first one.

        Raises
        ------
        LocplanError
            If a file cannot be read or has no settings of a robot, or a value is out of its range.

        Warns
        -----
        ParameterWarning
            If parameters are not simulated, or a URDF or SDF does not have the lidar's mount.
        """
        robot = cls(lidar)
        for path, parts in read_robot_parts(*paths, lidar=robot.lidar, planner=planner):
            with name_file_in_errors(path):
                robot = cls(**parts)
        return robot

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the robot as YAML, for `load` and every command's ``--robot``.

        Parameters
        ----------
        path : path
            The file, named ``*.yaml``. An existing file is replaced.

        Raises
        ------
        LocplanError
            If the file cannot be written, or its name does not end in .yaml.
        """
        target = check_file_path("a robot's file", path)
        check_writable_file(target, ".yaml")
        _ = self.amcl  # a file cannot hold the code of another filter
        content = {**make_file_stamp("robot", VERSION), "robot": self.summary()}
        with replace_file(target) as temporary:
            write_text(temporary, dump_yaml(content, default_flow_style=None))

    def summary(self) -> dict[str, Any]:
        """Return all settings by the names of the fields, fit for JSON and YAML."""
        is_custom_filter = not isinstance(
            self.filter, Amcl
        )  # a filter of one's own, which may hold anything
        settings = asdict(replace(self, filter=Amcl()) if is_custom_filter else self)
        if is_custom_filter:
            settings["filter"] = {"title": self.filter.title, "settings": repr(self.filter)}
        if self.outline:
            settings["footprint"] = self.outline.vertices.tolist()
        return settings

    @classmethod
    def from_summary(cls, settings: Mapping[str, Any]) -> Robot:
        """Build a robot from the result of `summary`; missing settings have their defaults.

        Parameters
        ----------
        settings : mapping
            Settings by the names of the fields.

        Raises
        ------
        ConfigError
            If there is no such setting, or a value is out of its range.
        """
        return cls(**build_robot_parts(settings))

    @property
    def digest(self) -> str:
        """Digest of all settings, 16 hexadecimal digits; the same for equal robots."""
        lidar = self.lidar and replace(self.lidar, model="")  # a name, and no setting
        text = json.dumps(replace(self, lidar=lidar).summary(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def title(self) -> str:
        """The lidar, the size, and all settings that differ from the defaults, in one line for
        people.
        """
        lidar = self.lidar.title if self.lidar else "no lidar named"
        outline = self.outline
        size = f"{len(outline.vertices)} corners" if outline else f"radius {self.footprint:g} m"
        differences = [
            *describe_changed_settings(self.odometry),
            *describe_changed_settings(self.disturbances),
        ]
        changed = f", {', '.join(differences)}" if differences else ""
        margin = f", margin {self.margin:g} m" if self.margin else ""
        return f"{lidar}; {size}{margin}; {self.filter.title}{changed}"

    @property
    def known_lidar(self) -> Lidar:
        """The lidar; a ConfigError if it is not known."""
        if self.lidar is None:
            raise ConfigError('the lidar is not known; name it, as in Robot("turtlebot4")')
        return self.lidar

    @property
    def amcl(self) -> Amcl:
        """The filter if it is AMCL; otherwise a ConfigError."""
        if not isinstance(self.filter, Amcl):
            raise ConfigError(f"{self.filter.title} is not AMCL, whose parameters are read here")
        return self.filter

    @property
    def outline(self) -> Footprint | None:
        """The footprint; None for a circle."""
        return self.footprint if isinstance(self.footprint, Footprint) else None

    @property
    def radius(self) -> float:
        """Radius of the largest circle in the outline, with the margin [m]."""
        inner = self.footprint
        return (inner.inscribed_radius if isinstance(inner, Footprint) else inner) + self.margin

    def with_settings(self, changes: Mapping[str, Any]) -> Robot:
        """Return the robot with some settings of any part replaced.

        A setting of a lidar that is not known makes one, of 12 m that sees all round by default.

        Parameters
        ----------
        changes : mapping of str to value
            Values by the names of the settings, such as ``{"alpha1": 0.05, "margin": 0.1}``.

        Raises
        ------
        ConfigError
            If there is no such setting, or a value is out of its range.
        """
        of_part = {name: part for part, kind in PARTS.items() for name in list_setting_names(kind)}
        parts: dict[str, dict[str, Any]] = {}
        robot_settings: dict[str, Any] = {}
        for name, value in changes.items():
            if name in of_part:
                parts.setdefault(of_part[name], {})[name] = value
            elif name in ROBOT_SETTINGS:
                robot_settings[name] = (
                    footprint_from_corners(value) if name == "footprint" else value
                )
            else:
                setting_names = (*ROBOT_SETTINGS, *of_part)
                names = f"{', '.join(setting_names)}{format_suggestion(name, setting_names)}"
                raise ConfigError(f"a robot has no setting {short_repr(name)}; it has {names}")
        for part, part_changes in parts.items():
            before = self.amcl if part == "filter" else getattr(self, part) or PARTS[part]()
            robot_settings[part] = replace(before, **part_changes)
        return replace(self, **robot_settings)


def planning_radius(robot: Robot | float) -> float:
    """Return the radius for planning [m].

    Parameters
    ----------
    robot : Robot, or float
        The robot, or the radius itself, 0 to 1e9 [m].

    Raises
    ------
    ConfigError
        If it is neither.
    """
    if isinstance(robot, Robot):
        return robot.radius
    if not is_number(robot):
        check_instance("robot", robot, Robot, 'such as locplan.Robot("turtlebot4")')
    return check_number("robot", robot, 0.0, 1e9)


def format_radius(robot: Robot | None, radius: float) -> str:
    """Return the radius of a robot for people, with its margin separately.

    Parameters
    ----------
    robot : Robot or None
        The robot, if it is known.
    radius : float
        The radius that is planned with [m].

    Examples
    --------
    >>> robot = Robot(footprint=0.3)
    >>> format_radius(robot, robot.radius)
    '0.3 m + 0.05 m margin'
    """
    if robot is None or not robot.margin or abs(robot.radius - radius) > 1e-9:
        return f"{radius:g} m"
    return f"{radius - robot.margin:.3g} m + {robot.margin:g} m margin"


def list_settings(robot: Robot) -> Table:
    """Return a table of the settings that `Robot.with_settings` changes, with values and meanings.

    Parameters
    ----------
    robot : Robot
        The robot.

    Examples
    --------
    >>> rows = list_settings(Robot("turtlebot4")).rows
    >>> [row[:4] for row in rows if row[1] == "update_min_d"]
    [('filter', 'update_min_d', 'm', '0.25')]
    """
    docs = read_field_docs(Robot)
    rows = [_format_setting("robot", name, robot, docs[name]) for name in ROBOT_SETTINGS]
    for part, kind in PARTS.items():
        settings = robot.amcl if part == "filter" else getattr(robot, part)
        for name, text in read_field_docs(kind).items():
            rows.append(_format_setting(part, name, settings, text))
    names = "part", "setting", "unit", "value", "meaning"
    return Table(tuple(TableColumn(name, title=name) for name in names), tuple(rows))


def _format_setting(part: str, name: str, settings: object, text: str) -> tuple[str, ...]:
    """Return part, name, unit, value and meaning of a setting; its docstring has the unit."""
    value = getattr(settings, name, "-")
    if isinstance(value, Footprint):
        value = json.dumps(value.vertices.tolist())
    unit = re.search(r"\[(?!1\])([^\]]+)\]", text)
    meaning = text.partition(". ")[0].rstrip(".")
    return part, name, unit[1] if unit else "", str(value), meaning
