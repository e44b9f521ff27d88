"""Nav2's parameters with those of an export: distributions, merged files and differences."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from locplan._support.checks import check_choice
from locplan._support.reading import ROS_BOOLEANS, ROS_NUMBER, scalar_text
from locplan.errors import LocplanError
from locplan.export.masks import PLANNERS, Conversion
from locplan.robots.nav2 import read_planner_types
from locplan.robots.parameter_edits import edit_files
from locplan.robots.parameters import (
    GLOBAL_COSTMAP,
    LOCAL_COSTMAP,
    PLANNER_SERVER,
    Nav2Parameters,
    read_parameters,
)


def dump_parameters(content: Mapping[str, Any]) -> str:
    """Parameters as YAML, in which ROS reads each text as a text."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """A dumper that quotes what is a text to PyYAML only."""

    def represent(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
        # libyaml below 0.2.2 fails on an unquoted :: between braces.
        plain = text in ROS_BOOLEANS or ROS_NUMBER.fullmatch(text) or "::" in text
        return dumper.represent_scalar("tag:yaml.org,2002:str", text, '"' if plain else None)

    Dumper.add_representer(str, represent)
    text: str = yaml.dump(dict(content), Dumper=Dumper, sort_keys=False, allow_unicode=True)
    return text


def make_parameter_files(
    before: Nav2Parameters, after: Nav2Parameters
) -> tuple[dict[str, bytes], bool]:
    """Return the files of a robot's parameters with ours, and whether nav2.yaml has its comments.

    nav2.yaml is a copy of the robot's file that has what is changed; a merger if several files
    have, and, without comments, where anchors and aliases stand for what has to be changed. Of
    several files merged.yaml has all.

    Parameters
    ----------
    before, after : Nav2Parameters
        The robot's own parameters, and the same with ours.
    """
    text, has_comments = _make_nav2_yaml(before, after)
    files = {"nav2.yaml": text}
    if len(before.files) > 1:
        files["merged.yaml"] = dump_parameters(after.merge_files().content).encode()
    return files, has_comments


def _make_nav2_yaml(before: Nav2Parameters, after: Nav2Parameters) -> tuple[bytes, bool]:
    """Text of the only file that is changed, or of all in one, and whether comments are in it."""
    pairs = list(zip(before.files, after.files, strict=False))
    changed = [new for old, new in pairs if old.content != new.content] or [*after.files][:1]
    path = changed[0].path if len(changed) == 1 else None
    if path is None:
        return dump_parameters(after.merge_files().content).encode(), False
    try:
        return edit_files(before, after).get(path) or path.read_bytes(), True
    except LocplanError:
        return dump_parameters(changed[0].content).encode(), False


def write_merged(target: Path, paths: Sequence[str | Path]) -> None:
    """Write the parameters of several files of Nav2 as one, as nav2_bringup takes them.

    Parameters
    ----------
    target : Path
        The file.
    paths : sequence of path
        The files, of which later ones replace single parameters of earlier ones.

    Raises
    ------
    LocplanError
        If a file cannot be read.
    """
    target.write_text(dump_parameters(read_parameters(*paths).merge_files().content), "utf-8")


def describe_differences(before: Any, merged: Any) -> tuple[list[str], list[str]]:
    """A sentence's part for each of a robot's own values that is another, and for each new one."""
    changed, added = [], []
    for name, old_value, value in _iterate_values(before, merged):
        if isinstance(value, list):  # of names, to which ours are added
            new = [str(list_name) for list_name in value if list_name not in (old_value or [])]
            if removed_names := [
                str(list_name) for list_name in old_value or [] if list_name not in value
            ]:
                changed.append(f"{name}: without {', '.join(removed_names)}")
            if new:
                added.append(f"{name}: {', '.join(new)}")
        elif old_value is None:
            added.append(f"{name}: {scalar_text(value)}")
        elif old_value != value:
            changed.append(f"{name}: {scalar_text(value)} (was {scalar_text(old_value)})")
    return changed, added


def _iterate_values(before: Any, merged: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Name, value before and value after of each parameter; nodes' own levels are left out."""
    if not isinstance(merged, dict):
        yield name, before, merged
        return
    old_values = before if isinstance(before, dict) else {}
    for key, value in merged.items():
        inner = name if key in ("ros__parameters", name) else f"{name}.{key}".strip(".")
        yield from _iterate_values(old_values.get(key), value, inner)


Params: TypeAlias = str | Path | Sequence[str | Path] | None
"""A parameter file of Nav2, or several, of which later ones replace single parameters."""


class DistroWarning(UserWarning):
    """A distribution of ROS 2 has a fault that concerns the localization."""


@dataclass(frozen=True)
class Distribution:
    """A distribution of ROS 2, as far as exports depend on it."""

    name: str
    """The name, such as jazzy."""
    slashes: bool = False
    """Whether planners' plugins are named with / for :: (nav2_smac_planner/smac_plugin_2d.xml and
    its like), up to iron."""
    quadratic_penalty: bool = True
    """Whether SmacPlannerHybrid has `use_quadratic_cost_penalty`, from jazzy on."""
    graph_by: Literal["launch", "parameters", "argument"] = "argument"
    """How the route server gets its graph (nav2_bringup/launch): bringup starts none in humble, so
    that our launch file does; one with graph_filepath of its parameters in jazzy; and one with the
    argument ``graph:=``, which replaces graph_filepath, from kilted on."""
    unsure_field: bool = True
    """Whether AMCL's likelihood field is made from an uninitialised variable (`CellData cell` in
    nav2_amcl/src/map/map_cspace.cpp), from kilted on."""
    vector_objects: bool = False
    """Whether nav2_map_server has a vector_object_server, from lyrical on."""

    def warn(self) -> None:
        """Warn of what a user of this distribution should know."""
        if self.unsure_field:
            warnings.warn(
                DistroWarning(
                    f"{self.name}: AMCL's likelihood field may be wrong there, since it starts from"
                    " an uninitialised variable (map_cspace.cpp, CellData cell); build nav2_amcl"
                    " with its occ_dist set to 0"
                ),
                stacklevel=2,
            )


DISTRIBUTIONS = {
    distro.name: distro
    for distro in (
        Distribution("humble", True, False, "launch", unsure_field=False),
        Distribution("jazzy", graph_by="parameters", unsure_field=False),
        Distribution("kilted"),
        Distribution("lyrical", vector_objects=True),
        Distribution("rolling", vector_objects=True),
    )
}
"""Distributions that exports are made for, by name."""


def find_distribution(name: str) -> Distribution:
    """A distribution of ROS 2 by its name.

    Parameters
    ----------
    name : str
        One of `DISTRIBUTIONS`.

    Raises
    ------
    ConfigError
        If there is none of this name.
    """
    check_choice("distro", name, DISTRIBUTIONS)
    return DISTRIBUTIONS[name]


class ParametersChanged(UserWarning):
    """Values of a robot's own parameters are others in an export."""


class RobotWarning(UserWarning):
    """A robot's own parameters do not go with an export."""


@dataclass(frozen=True)
class Nav2Robot:
    """A robot's own parameters of Nav2, into which ours are merged."""

    distribution: Distribution
    """The distribution of ROS 2 that it runs."""
    files: tuple[Path, ...]
    """The files of its parameters, of which later ones replace single ones of earlier ones."""
    parameters: Nav2Parameters
    """The parameters in the files; none without a file."""
    tree: Path | None = None
    """The file of its behaviour tree, if it is given."""

    @classmethod
    def from_files(cls, params: Params, distro: str, tree: str | Path | None = None) -> Nav2Robot:
        """Read the files and warn of the distribution's faults; a LocplanError where it cannot."""
        paths = [params] if isinstance(params, (str, os.PathLike)) else params or ()
        files = tuple(map(Path, paths))
        tree_path = Path(tree) if tree else None
        robot = cls(find_distribution(distro), files, read_parameters(*files), tree_path)
        robot.distribution.warn()
        robot.warn(robot._note_misspelt_plugins())
        return robot

    @property
    def file(self) -> Path | None:
        """The file with its global costmap or planners, or the first one; None without a file."""
        nodes = GLOBAL_COSTMAP, PLANNER_SERVER
        having = (self.parameters.find_file_index(node) for node in nodes)
        at = next((at for at in having if at is not None), 0)
        return self.files[at] if self.files else None

    @property
    def other_files(self) -> list[str]:
        """Names of its other files."""
        return [parameter_file.name for parameter_file in self.files if parameter_file != self.file]

    @property
    def planners(self) -> dict[str, str]:
        """The plugin of each of its planners by name, as it is written from Jazzy on."""
        types = read_planner_types(self.parameters)
        return {name: plugin.replace("/", "::") for name, plugin in types.items()}

    def planner(self, cells: int) -> str:
        """Its first planner that follows masks, as `PLANNERS` names it, or one for that many cells.

        Nav2 plans once a second, which Smac 2D does on small maps only.
        """
        supported_planners = {
            nav_planner.plugin: name
            for name, nav_planner in PLANNERS.items()
            if not nav_planner.caveat
        }
        added = "smac2d" if cells <= 1_000_000 else "thetastar"
        return next(
            (
                supported_planners[nav_planner]
                for nav_planner in self.planners.values()
                if nav_planner in supported_planners
            ),
            added,
        )

    def warn(self, notes: Iterator[str]) -> None:
        """Warn of what does not go together."""
        for note in notes:
            name = f"{self.file.name}: " if self.file else ""
            warnings.warn(RobotWarning(f"{name}{note}"), stacklevel=4)

    def warn_changed(self, merged: Nav2Parameters) -> None:
        """Warn of values of its file that are others in an export."""
        changed, _ = describe_differences(self.parameters.content, merged.content)
        if self.file and changed:
            sentence = f"the exported nav2.yaml has other values than {self.file.name}"
            warnings.warn(ParametersChanged(f"{sentence}: {'; '.join(changed)}"), stacklevel=5)

    def note_other_planners(self, planner_name: str) -> Iterator[str]:
        """That ours stands beside its own planners, and why."""
        caveats = {nav_planner.plugin: nav_planner.caveat for nav_planner in PLANNERS.values()}
        other_planners = [
            f"{name} ({plugin})" for name, plugin in self.planners.items() if name != planner_name
        ]
        if other_planners and planner_name not in self.planners:
            reason = next((f": {caveats[p]}" for p in self.planners.values() if caveats.get(p)), "")
            yield (
                f"its planners are {', '.join(other_planners)}{reason}; {planner_name} is added"
                " for the mask, and"
                " plans only where it is selected, as the folder's README.md says"
            )

    def note_speed_filters(self, filter_name: str) -> Iterator[str]:
        """That another speed filter limits the same robot."""
        advice = "both publish limits, and the one that came last counts: merge the masks, or leave"
        for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
            for name, value in self.parameters.read_node_parameters(costmap).items():
                layer, _, last = name.rpartition(".")
                if last == "plugin" and layer != filter_name and str(value).endswith("SpeedFilter"):
                    costmap_name = costmap.partition("/")[0]
                    yield f"{costmap_name} has a speed filter, {layer}; {advice} one out"

    def note_larger_radius(self, radius: float) -> Iterator[str]:
        """That it is larger than the robot that lanes were made for."""
        robot_radius = self.parameters.read_node_parameters(GLOBAL_COSTMAP).get("robot_radius")
        if (
            isinstance(robot_radius, (int, float))
            and robot_radius > radius + 1e-9
            and math.isfinite(robot_radius)
        ):
            yield (
                f"its robot_radius is {robot_radius:g} m, but the ways are for {radius:g} m; give"
                f" --set footprint={robot_radius:g}"
            )

    def _note_misspelt_plugins(self) -> Iterator[str]:
        """That its planners are written as in another distribution."""
        server = self.parameters.read_node_parameters(PLANNER_SERVER)
        for name in self.planners:
            plugin = str(server.get(f"{name}.plugin", ""))
            if "/" in plugin and not self.distribution.slashes:
                yield f"{name} is {plugin}, as in humble; give --distro humble if that runs there"
            elif "::" in plugin and self.distribution.slashes:
                yield f"{name} is {plugin}, as from jazzy on, but humble has / for ::"


def add_filter(robot: Nav2Robot, *kinds: str) -> Nav2Parameters:
    """Parameters with our filters in the global costmap, and in its list of them."""
    names = robot.parameters.read_names(GLOBAL_COSTMAP, "filters")
    changes: dict[str, Any] = {}
    for kind in kinds:
        base = f"localizability_{kind}"  # topics are absolute: Kilted first resolves others
        plugin = f"{base}_filter"
        filter_settings = {"plugin": f"nav2_costmap_2d::{kind.title()}Filter", "enabled": True}
        filter_settings |= {"filter_info_topic": f"/{base}_info"}
        if kind == "speed":
            # The controller server obeys this one.
            filter_settings |= {"speed_limit_topic": f"{robot.parameters.namespace}/speed_limit"}
        names = names if plugin in names else [*names, plugin]
        changes |= _prefix_settings(plugin, filter_settings)
    return robot.parameters.with_values(GLOBAL_COSTMAP, {"filters": names, **changes})


def add_planner(
    robot: Nav2Robot, merged: Nav2Parameters, conversion: Conversion
) -> tuple[Nav2Parameters, str]:
    """Parameters with the planner that a conversion is for, and the planner's name.

    A planner of the same kind that is there keeps its name and its other settings, also a longer
    time for planning; besides others ours gets a name of its own.
    """
    planner, runs = conversion.planner, robot.distribution
    server, names = merged.read_node_parameters(PLANNER_SERVER), list(robot.planners)
    same_type = [name for name, plugin in robot.planners.items() if plugin == planner.plugin]
    name = same_type[0] if same_type else "Localizability" if names else "GridBased"
    plugin = planner.plugin.replace("::", "/") if runs.slashes else planner.plugin
    planner_settings: dict[str, Any] = {"plugin": plugin, "allow_unknown": False, **planner.assumed}
    if not runs.quadratic_penalty:
        planner_settings.pop("use_quadratic_cost_penalty", None)
    if planner.parameter is not None:
        planner_settings[planner.parameter] = float(conversion.param)
    if planner.planning_time is not None:
        user_time = server.get(f"{name}.max_planning_time") if same_type else None
        longer = float(user_time) if isinstance(user_time, (int, float)) else 0.0
        planner_settings["max_planning_time"] = max(longer, planner.planning_time)
    if same_type:
        del planner_settings["plugin"]
    planner_list = names if name in names else [*names, name]
    changes = {"planner_plugins": planner_list, **_prefix_settings(name, planner_settings)}
    for other, other_type in robot.planners.items():  # Nav2 fills in a type of its own list only
        if planner_list != names and other_type and f"{other}.plugin" not in server:
            changes[f"{other}.plugin"] = other_type.replace("::", "/" if runs.slashes else "::")
    return merged.with_values(PLANNER_SERVER, changes), name


def _prefix_settings(name: str, settings: dict[str, Any]) -> dict[str, Any]:
    """The settings of a plugin by their names in ROS."""
    return {f"{name}.{key}": value for key, value in settings.items()}
