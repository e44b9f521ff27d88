"""Nav2 parameters merged with the parameters of an export, and distributions of ROS 2."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from locplan._support.checks import check_choice
from locplan._support.files import write_text
from locplan._support.reading import ROS_BOOLEANS, ROS_NUMBER, format_yaml_scalar
from locplan.errors import LocplanError
from locplan.export.masks import PLANNERS, MaskConversion
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
    """Return parameters as YAML in which ROS reads every string as a string."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """A dumper that quotes strings that ROS would read as another type."""

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
    """Return the content of the merged parameter files, and whether nav2.yaml keeps its comments.

    nav2.yaml is a copy of the only file that changes. If several files change, it combines all,
    without comments. It also loses the comments if an anchor or alias stands for a changed value.
    With several files, merged.yaml combines all of them.

    Parameters
    ----------
    before, after : Nav2Parameters
        The robot's parameters before and after the merge.
    """
    text, has_comments = _make_nav2_yaml(before, after)
    files = {"nav2.yaml": text}
    if len(before.files) > 1:
        files["merged.yaml"] = dump_parameters(after.merge_files().content).encode()
    return files, has_comments


def _make_nav2_yaml(before: Nav2Parameters, after: Nav2Parameters) -> tuple[bytes, bool]:
    """Return the only changed file, or all in one, and whether it keeps its comments."""
    pairs = list(zip(before.files, after.files, strict=False))
    changed = [new for old, new in pairs if old.content != new.content] or [*after.files][:1]
    path = changed[0].path if len(changed) == 1 else None
    if path is None:
        return dump_parameters(after.merge_files().content).encode(), False
    try:
        return edit_files(before, after).get(path) or path.read_bytes(), True
    except LocplanError:
        return dump_parameters(changed[0].content).encode(), False


def write_merged_parameters(target: Path, paths: Sequence[str | Path]) -> None:
    """Write the parameters of several Nav2 files as one file, for nav2_bringup.

    Parameters
    ----------
    target : Path
        The file.
    paths : sequence of path
        The files; parameters of later files replace earlier ones.

    Raises
    ------
    LocplanError
        If a file cannot be read.
    """
    write_text(target, dump_parameters(read_parameters(*paths).merge_files().content))


def describe_differences(before: Any, merged: Any) -> tuple[list[str], list[str]]:
    """Return a text for each changed value of a robot's parameters, and for each added one."""
    changed, added = [], []
    for name, old_value, value in _iterate_values(before, merged):
        if isinstance(value, list):  # of names, with those of the export added
            new = [str(list_name) for list_name in value if list_name not in (old_value or [])]
            if removed_names := [
                str(list_name) for list_name in old_value or [] if list_name not in value
            ]:
                changed.append(f"{name}: without {', '.join(removed_names)}")
            if new:
                added.append(f"{name}: {', '.join(new)}")
        elif old_value is None:
            added.append(f"{name}: {format_yaml_scalar(value)}")
        elif old_value != value:
            changed.append(
                f"{name}: {format_yaml_scalar(value)} (was {format_yaml_scalar(old_value)})"
            )
    return changed, added


def _iterate_values(before: Any, merged: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the name, old value and new value of each parameter, without the levels of nodes."""
    if not isinstance(merged, dict):
        yield name, before, merged
        return
    old_values = before if isinstance(before, dict) else {}
    for key, value in merged.items():
        inner = name if key in ("ros__parameters", name) else f"{name}.{key}".strip(".")
        yield from _iterate_values(old_values.get(key), value, inner)


ParameterFiles: TypeAlias = str | Path | Sequence[str | Path] | None
"""A Nav2 parameter file, or several; parameters of later files replace earlier ones."""


class DistroWarning(UserWarning):
    """A warning that a distribution of ROS 2 has a fault that affects localization."""


ROS_DISTRIBUTION_NAMES = "humble", "jazzy", "kilted", "lyrical", "rolling"
"""The supported distributions of ROS 2, the oldest first."""


@dataclass(frozen=True)
class RosDistribution:
    """A distribution of ROS 2 with the properties that exports depend on.

    The properties follow the branches of ros-navigation/navigation2 (2026-08): humble 1.1.20,
    jazzy 1.3.13, kilted 1.4.2, lyrical 1.5.1 and main.
    """

    name: str
    """The name, such as jazzy."""

    def _is_from(self, first: str) -> bool:
        """True if this is the named distribution or a later one."""
        names = ROS_DISTRIBUTION_NAMES
        return names.index(self.name) >= names.index(first)

    @property
    def has_slashed_plugins(self) -> bool:
        """True if names of planner plugins have / instead of ::, up to iron (such as in
        nav2_smac_planner/smac_plugin_2d.xml)."""
        return not self._is_from("jazzy")

    @property
    def has_quadratic_penalty(self) -> bool:
        """True if SmacPlannerHybrid has `use_quadratic_cost_penalty`."""
        return self._is_from("jazzy")

    @property
    def graph_source(self) -> Literal["launch", "parameters", "argument"]:
        """The way in which the route server gets its graph (nav2_bringup/launch).

        In humble, bringup starts no route server, so the exported launch file does. In jazzy, the
        parameter graph_filepath names the graph. From kilted on, the argument ``graph:=`` replaces
        it.
        """
        if self._is_from("kilted"):
            return "argument"
        return "parameters" if self._is_from("jazzy") else "launch"

    @property
    def has_faulty_likelihood_field(self) -> bool:
        """True if AMCL's likelihood field starts from an uninitialised variable (`CellData cell` in
        nav2_amcl/src/map/map_cspace.cpp)."""
        return self._is_from("kilted")

    @property
    def has_mask_arguments(self) -> bool:
        """True if bringup_launch.py publishes masks (``keepout_mask:=`` and ``speed_mask:=``), from
        1.4.0 on."""
        return self._is_from("kilted")

    @property
    def has_vector_objects(self) -> bool:
        """True if nav2_map_server has a vector_object_server."""
        return self._is_from("lyrical")

    @property
    def has_speed_lookahead(self) -> bool:
        """True if the speed filter looks ahead along the plan (`enable_path_lookahead` in
        speed_filter.cpp), from 1.5.0 on."""
        return self._is_from("lyrical")

    @property
    def has_cycles_factor(self) -> bool:
        """True if NavFn has `max_cycles_factor` (nav2_navfn_planner/src/parameter_handler.cpp),
        from 1.5.1 on."""
        return self._is_from("lyrical")

    def warn(self) -> None:
        """Warn of the distribution's faults."""
        if self.has_faulty_likelihood_field:
            warnings.warn(
                DistroWarning(
                    f"{self.name}: AMCL's likelihood field may be wrong, since it starts from an"
                    " uninitialised variable (map_cspace.cpp, CellData cell); build nav2_amcl"
                    " with its occ_dist set to 0"
                ),
                stacklevel=2,
            )


ROS_DISTRIBUTIONS = {name: RosDistribution(name) for name in ROS_DISTRIBUTION_NAMES}
"""The supported distributions by name."""


def find_ros_distribution(name: str) -> RosDistribution:
    """Return the distribution of ROS 2 with a name.

    Parameters
    ----------
    name : str
        One of `ROS_DISTRIBUTIONS`.

    Raises
    ------
    ConfigError
        If there is no distribution with this name.
    """
    check_choice("distro", name, ROS_DISTRIBUTIONS)
    return ROS_DISTRIBUTIONS[name]


MIN_CYCLES_FACTOR = 16
"""Minimum `max_cycles_factor` of NavFn. Its paths then have up to 8 times the map's longer side, 2
times with Nav2's default of 4. A mask makes paths longer."""


class ParametersChanged(UserWarning):
    """A warning that an export changes values of the robot's parameters."""


class RobotWarning(UserWarning):
    """A warning that the robot's parameters do not fit an export."""


@dataclass(frozen=True)
class Nav2Robot:
    """A robot's Nav2 parameters, into which an export merges its parameters."""

    distribution: RosDistribution
    """The robot's distribution of ROS 2."""
    files: tuple[Path, ...]
    """The parameter files; parameters of later files replace earlier ones."""
    parameters: Nav2Parameters
    """The parameters in the files; empty without a file."""
    tree: Path | None = None
    """The file of the robot's behaviour tree, if any."""

    @classmethod
    def from_files(
        cls, params: ParameterFiles, distro: str, tree: str | Path | None = None
    ) -> Nav2Robot:
        """Read the parameter files, and warn of the distribution's faults."""
        paths = [params] if isinstance(params, (str, os.PathLike)) else params or ()
        files = tuple(map(Path, paths))
        tree_path = Path(tree) if tree else None
        robot = cls(find_ros_distribution(distro), files, read_parameters(*files), tree_path)
        robot.distribution.warn()
        robot.warn(robot._note_misspelt_plugins())
        return robot

    @property
    def main_file(self) -> Path | None:
        """The file with the global costmap or the planners, or the first; None without files."""
        nodes = GLOBAL_COSTMAP, PLANNER_SERVER
        having = (self.parameters.find_file_index(node) for node in nodes)
        at = next((at for at in having if at is not None), 0)
        return self.files[at] if self.files else None

    @property
    def other_files(self) -> list[str]:
        """Names of the files except the main one."""
        return [
            parameter_file.name for parameter_file in self.files if parameter_file != self.main_file
        ]

    @property
    def planners(self) -> dict[str, str]:
        """The plugin of each planner by the planner's name, spelled as from Jazzy on."""
        types = read_planner_types(self.parameters)
        return {name: plugin.replace("/", "::") for name, plugin in types.items()}

    def select_planner(self, n_cells: int) -> str:
        """Return the robot's first planner that follows masks, otherwise one for the map's size.

        Nav2 plans once a second; Smac 2D manages that only on small maps.
        """
        supported_planners = {
            nav_planner.plugin: name
            for name, nav_planner in PLANNERS.items()
            if not nav_planner.caveat
        }
        added = "smac2d" if n_cells <= 1_000_000 else "thetastar"
        return next(
            (
                supported_planners[nav_planner]
                for nav_planner in self.planners.values()
                if nav_planner in supported_planners
            ),
            added,
        )

    def warn(self, notes: Iterator[str]) -> None:
        """Issue a RobotWarning for each note, with the name of the file."""
        for note in notes:
            name = f"{self.main_file.name}: " if self.main_file else ""
            warnings.warn(RobotWarning(f"{name}{note}"), stacklevel=4)

    def warn_changed(self, merged: Nav2Parameters) -> None:
        """Warn of values of the robot's file that an export changes."""
        changed, _ = describe_differences(self.parameters.content, merged.content)
        if self.main_file and changed:
            sentence = f"the exported nav2.yaml changes values of {self.main_file.name}"
            warnings.warn(ParametersChanged(f"{sentence}: {'; '.join(changed)}"), stacklevel=5)

    def note_other_planners(self, planner_name: str) -> Iterator[str]:
        """Yield a note if the export adds a planner to the robot's planners, with the reason."""
        caveats = {nav_planner.plugin: nav_planner.caveat for nav_planner in PLANNERS.values()}
        other_planners = [
            f"{name} ({plugin})" for name, plugin in self.planners.items() if name != planner_name
        ]
        if other_planners and planner_name not in self.planners:
            reason = next((f": {caveats[p]}" for p in self.planners.values() if caveats.get(p)), "")
            yield (
                f"its planners are {', '.join(other_planners)}{reason}; the export adds"
                f" {planner_name} for the mask. Select it as described in the folder's README.md"
            )

    def resolve_topic(self, topic: str) -> str:
        """Return the absolute name of a topic in the robot's namespace."""
        return topic if topic.startswith("/") else f"{self.parameters.namespace}/{topic}"

    def list_replaced_filters(self, kind: str) -> Iterator[tuple[str, str]]:
        """Yield costmap and name of each filter whose mask an export's mask replaces.

        From kilted on, bringup_launch.py publishes one mask of each kind, to the filters that
        listen to its server.
        """
        _, server = make_bringup_servers(kind)
        topic = self.parameters.read_node_parameters(server).get("filter_info_topic")
        if not self.distribution.has_mask_arguments or not isinstance(topic, str):
            return
        for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
            costmap_parameters = self.parameters.read_node_parameters(costmap)
            for name in self.parameters.read_names(costmap, "filters"):
                filter_topic = costmap_parameters.get(f"{name}.filter_info_topic")
                is_fed = self.resolve_topic(str(filter_topic)) == self.resolve_topic(topic)
                if is_fed and not name.startswith("localizability_"):
                    yield costmap, name

    def note_speed_filters(self, filter_name: str) -> Iterator[str]:
        """Yield a note for each speed filter that stays active next to the export's filter."""
        advice = "both publish limits, and the last one applies; merge the masks, or remove one"
        replaced = set(self.list_replaced_filters("speed"))
        for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
            for name, value in self.parameters.read_node_parameters(costmap).items():
                layer, _, last = name.rpartition(".")
                if (costmap, layer) in replaced:
                    continue
                if last == "plugin" and layer != filter_name and str(value).endswith("SpeedFilter"):
                    costmap_name = costmap.partition("/")[0]
                    yield f"{costmap_name} has a speed filter, {layer}; {advice}"

    def note_larger_radius(self, radius: float) -> Iterator[str]:
        """Yield a note if the robot is larger than the radius that routes are planned for."""
        robot_radius = self.parameters.read_node_parameters(GLOBAL_COSTMAP).get("robot_radius")
        if (
            isinstance(robot_radius, (int, float))
            and robot_radius > radius + 1e-9
            and math.isfinite(robot_radius)
        ):
            yield (
                f"its robot_radius is {robot_radius:g} m, but the routes are for {radius:g} m; give"
                f" --set footprint={robot_radius:g}"
            )

    def _note_misspelt_plugins(self) -> Iterator[str]:
        """Yield a note for each planner whose plugin is spelled as in another distribution."""
        server = self.parameters.read_node_parameters(PLANNER_SERVER)
        for name in self.planners:
            plugin = str(server.get(f"{name}.plugin", ""))
            if "/" in plugin and not self.distribution.has_slashed_plugins:
                yield f"{name} is {plugin}, as in humble; give --distro humble if the robot runs it"
            elif "::" in plugin and self.distribution.has_slashed_plugins:
                yield f"{name} is {plugin}, as from jazzy on, but humble needs / instead of ::"


def list_filter_topics(kind: str) -> dict[str, str]:
    """Return the topics of an export's mask: of the filter's information, and of the values.

    They are absolute, because only from Kilted on do filters resolve others against the robot's
    namespace.

    Parameters
    ----------
    kind : str
        "keepout" or "speed".
    """
    base = f"/localizability_{kind}"
    return {"filter_info_topic": f"{base}_info", "mask_topic": f"{base}_mask"}


def make_filter_law(kind: str) -> dict[str, Any]:
    """Return the linear map from a mask's values to costs, or to speeds in per cent."""
    laws = {"keepout": (0, 0.0, 1.0), "speed": (1, 100.0, -1.0)}
    return dict(zip(("type", "base", "multiplier"), laws[kind], strict=True))


def add_filters(robot: Nav2Robot, *kinds: str, lead: float = 0.0) -> Nav2Parameters:
    """Return the robot's parameters with the export's filters in the global costmap.

    Parameters
    ----------
    robot : Nav2Robot
        The robot.
    *kinds : str
        "keepout", "speed", or both.
    lead : float, default 0
        Distance that the speed filter looks ahead along the plan [m]; 0 if the mask has the lead.
    """
    merged = robot.parameters
    names = merged.read_names(GLOBAL_COSTMAP, "filters")
    changes: dict[str, Any] = {}
    for kind in kinds:
        plugin, topics = f"localizability_{kind}_filter", list_filter_topics(kind)
        filter_settings = {"plugin": f"nav2_costmap_2d::{kind.title()}Filter", "enabled": True}
        filter_settings |= {"filter_info_topic": topics["filter_info_topic"]}
        if kind == "speed":
            # The controller server listens to this topic.
            filter_settings |= {"speed_limit_topic": f"{robot.parameters.namespace}/speed_limit"}
            filter_settings |= _make_lookahead(robot, lead)
        names = names if plugin in names else [*names, plugin]
        changes |= _prefix_settings(plugin, filter_settings)
        if robot.distribution.has_mask_arguments:
            for costmap, name in robot.list_replaced_filters(kind):
                merged = merged.with_values(costmap, {f"{name}.enabled": False})
            mask, info = make_bringup_servers(kind)
            merged = merged.with_values(mask, {"topic_name": topics["mask_topic"]})
            merged = merged.with_values(info, topics | make_filter_law(kind))
    return merged.with_values(GLOBAL_COSTMAP, {"filters": names, **changes})


def make_bringup_servers(kind: str) -> tuple[str, str]:
    """Return the names of the nodes by which bringup_launch.py publishes a mask of a kind."""
    return f"{kind}_filter_mask_server", f"{kind}_costmap_filter_info_server"


def _make_lookahead(robot: Nav2Robot, lead: float) -> dict[str, Any]:
    """Return settings with which a speed filter looks ahead along the plan.

    It looks ahead by `lead`, or by its braking distance if that is longer. The odometry's topic is
    absolute, because the filter resolves others against the costmap's namespace.
    """
    if not robot.distribution.has_speed_lookahead:
        return {}
    topic = str(robot.parameters.read_node_parameters("bt_navigator").get("odom_topic", "odom"))
    return {
        "enable_path_lookahead": lead > 0,
        "min_lookahead": float(lead),
        "odom_topic": robot.resolve_topic(topic),
    }


def add_planner(
    robot: Nav2Robot, merged: Nav2Parameters, conversion: MaskConversion
) -> tuple[Nav2Parameters, str]:
    """Return parameters with the planner of a mask, and the planner's name.

    An existing planner of the same type keeps its name and its other settings, including a longer
    planning time. Next to planners of other types, the planner is named Localizability.
    """
    planner, runs = conversion.planner, robot.distribution
    server, names = merged.read_node_parameters(PLANNER_SERVER), list(robot.planners)
    same_type = [name for name, plugin in robot.planners.items() if plugin == planner.plugin]
    name = same_type[0] if same_type else "Localizability" if names else "GridBased"
    plugin = planner.plugin.replace("::", "/") if runs.has_slashed_plugins else planner.plugin
    planner_settings: dict[str, Any] = {
        "plugin": plugin,
        "allow_unknown": False,
        **planner.fixed_parameters,
    }
    if not runs.has_quadratic_penalty:
        planner_settings.pop("use_quadratic_cost_penalty", None)
    if planner.parameter is not None:
        planner_settings[planner.parameter] = float(conversion.parameter_value)
    if planner.planning_time is not None:
        user_time = server.get(f"{name}.max_planning_time") if same_type else None
        longer = float(user_time) if isinstance(user_time, (int, float)) else 0.0
        planner_settings["max_planning_time"] = max(longer, planner.planning_time)
    if same_type:
        del planner_settings["plugin"]
    planner_list = names if name in names else [*names, name]
    changes = {"planner_plugins": planner_list, **_prefix_settings(name, planner_settings)}
    navfn = PLANNERS["navfn"].plugin
    for other, other_type in (robot.planners | {name: planner.plugin}).items():
        if runs.has_cycles_factor and other_type == navfn:
            factor = server.get(f"{other}.max_cycles_factor")
            is_enough = isinstance(factor, int) and factor >= MIN_CYCLES_FACTOR
            changes[f"{other}.max_cycles_factor"] = factor if is_enough else MIN_CYCLES_FACTOR
    for (
        other,
        other_type,
    ) in robot.planners.items():  # Nav2 fills in types only for its default list
        if planner_list != names and other_type and f"{other}.plugin" not in server:
            changes[f"{other}.plugin"] = other_type.replace(
                "::", "/" if runs.has_slashed_plugins else "::"
            )
    return merged.with_values(PLANNER_SERVER, changes), name


def _prefix_settings(name: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of a plugin by their ROS parameter names."""
    return {f"{name}.{key}": value for key, value in settings.items()}
