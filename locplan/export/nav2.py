"""Filter masks for ROS 2 Nav2, with the parameters and the launch file to use them.

Formats read from ros-navigation/navigation2, branches humble to main (2026-08): keepout_filter.cpp,
speed_filter.cpp and the documentation of their servers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan.errors import LocplanError
from locplan.export.behavior_trees import merge_tree
from locplan.export.masks import (
    Conversion,
    CostmapInflation,
    PlannedPath,
    find_planner,
    follower_room,
    keepout_mask,
)
from locplan.export.parameters import (
    Nav2Robot,
    Params,
    add_filter,
    add_planner,
    describe_differences,
    dump_parameters,
    make_parameter_files,
)
from locplan.export.planned_paths import (
    check_paths,
    close_gaps,
    compare_nav2_paths,
    note_narrow_places,
    suggest_inflation,
)
from locplan.export.registry import DISTRO, LEAD, SLOWEST, export_folder
from locplan.export.servers import LifecycleNode, write_servers
from locplan.export.values import compute_speed_mask, unturn, write_values
from locplan.maps.zones import FILE as ZONES, Zones
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.metrics import format_costs_caption
from locplan.planning.path import Path as Route
from locplan.robots.parameters import Nav2Parameters

if TYPE_CHECKING:
    from locplan.simulation.recommendation import Recommendation


def nav2_keepout(
    folder: str | Path,
    costs: Costmap | Recommendation,
    *,
    planner: str | None = None,
    planner_param: float | None = None,
    distro: str = DISTRO,
    params: Params = None,
    tree: str | Path | None = None,
    paths: Mapping[str, Route] | None = None,
    force: bool = False,
) -> Conversion:
    """Write a mask for Nav2's KeepoutFilter that makes a planner's costs the costmap's J.

    Parameters
    ----------
    folder : path
        The folder, which need not exist; an earlier export of this kind is replaced.
    costs : Costmap or Recommendation
        The mask's 0..99 stand for weight u in every free cell, whether or not the robot fits
        there: what is too close to a wall is for Nav2's own inflation to say, and its robot may
        fit where this costmap's does not. Nav2 ignores a map's yaw, so that the mask has none
        either. Of a recommendation it is `Recommendation.costmap`, whose path is one of
        `paths`; the folder's README.md begins with its advice to tune first.
        A costmap with zones makes a zones.geojson. If a zone is slow, there is a speed_mask.yaml
        as well, whose limits begin as far before a zone as the robot drives in a second. From
        lyrical on, vector_objects.yaml has the no-go zones for Nav2's vector object server.
    planner : str, optional
        "smac2d", "smac-hybrid", "navfn" or "thetastar": the one that plans. By default the first
        of these that `params` has, except "navfn", which does not follow masks; else "smac2d" up
        to a million cells, and "thetastar" on larger maps.
    planner_param : float, optional
        The planner's own parameter, above 0: cost_travel_multiplier, cost_penalty or
        w_traversal_cost. Give it where the robot's must stay. By default it is such that u = 1
        just fits, whatever the map. "navfn" has none.
    distro : str, default "jazzy"
        The robot's distribution of ROS 2: "humble", "jazzy", "kilted", "lyrical" or "rolling".
    params : path or sequence of path, optional
        A Nav2 parameter file to merge ours into; by default nav2.yaml holds ours alone. Of several
        files nav2.yaml is the one with the global costmap and the planner, and merged.yaml has all
        of them in one. The mask
        carries the inflation of its global costmap, too: Nav2 takes the larger one of mask and
        costmap, not their sum. The inflation itself stays. If it hides the mask from the planner of
        `paths`, a `RobotWarning` and the folder's README.md name a ``cost_scaling_factor`` that
        does not. Where a value of the file has to be another one, a `ParametersChanged` warning and
        the README.md name it. The planner gets ``allow_unknown: false``, since J knows no way
        through unknown space.
    tree : path, optional
        The robot's behaviour tree, which the folder then holds with our planner's name in it, and
        which the parameters name; paths of Theta* are smoothed in it, since they zigzag.
    paths : dict of Path, optional
        Recommended paths by name, with which those that Nav2's planners take between their ends are
        compared, by the planners' formulas. Those that the mask's planner does not take are written
        as a route graph beside the folder, see `nav2_routes`. If the planner passes a gap that is
        too narrow for a path follower, and a wider way costs at most 5 % more, the mask closes the
        gap. A `RobotWarning` names the narrowest place that is left.
    force : bool, default False
        True overwrites files of the same names in the folder; others stay.

    Returns
    -------
    Conversion
        Where the planner saturates, and how exact the mask is.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or a setting is out of its range.
    """
    robot, paths, recommendation = Nav2Robot.from_files(params, distro, tree), paths or {}, None
    if not isinstance(costs, Costmap):
        recommendation, costs = costs, costs.costmap()
        paths = {
            candidate.name: candidate.path
            for candidate in [recommendation.recommended_candidate]
            if candidate
        } | {**paths}
    planner = planner or robot.planner(costs.grid.free.size)
    caveat = find_planner(planner, None).caveat
    layer = CostmapInflation.from_parameters(robot.parameters)
    inflation = None if caveat else CostmapInflation.for_mask(costs, layer)
    values, conversion = keepout_mask(
        costs, planner=planner, inflation=inflation, planner_param=planner_param
    )
    check_paths(costs, paths)
    if not caveat:
        values, gaps = close_gaps(costs, values, conversion, paths, layer)
        conversion = dataclasses.replace(conversion, closed=tuple(gaps))
    masks, lead = {"keepout": values}, costs.robot.kinematics.speed if costs.robot else LEAD
    if costs.zones.has_kind("slow"):
        masks["speed"] = compute_speed_mask(costs, 1.0, lead)
        robot.warn(robot.note_speed_filters("localizability_speed_filter"))
    merged, planner_name = add_planner(robot, add_filter(robot, *masks), conversion)
    merged, edited = merge_tree(robot, merged, planner_name, conversion.planner, Path(folder))
    robot.warn(robot.note_other_planners(planner_name))
    if caveat:
        robot.warn(iter([f"{planner} does not follow a mask: {caveat}"]))
    compared = compare_nav2_paths(costs, values, conversion, paths, layer)
    conversion = dataclasses.replace(conversion, paths=tuple(compared))
    title = f"Localizability mask for {conversion.planner.plugin} ({planner_name})"
    metadata: dict[str, Any] = {"planner_id": planner_name, "conversion": conversion.facts().values}
    if "speed" in masks:
        metadata["lead"] = lead
    if recommendation:
        metadata["choice"] = {
            "recommended_name": recommendation.recommended_name,
            "answer": recommendation.answer,
        }
    planning = _MaskPlanning(conversion, planner_name, edited, bool(inflation), recommendation)
    if layer and planning.untaken_paths:
        option = suggest_inflation(
            costs, values, robot, planning.untaken_paths, conversion, paths, layer
        )
        planning = dataclasses.replace(planning, option=option)
    robot.warn(note_narrow_places(planning.mask_paths, costs.robot_radius))
    _write_mask(folder, title, costs, masks, robot, merged, metadata, planning, force=force)
    _write_untaken_paths(Path(folder), costs, robot, planning, paths, force=force)
    return conversion


def nav2_speed(
    folder: str | Path,
    costs: Costmap,
    *,
    slowest: float = SLOWEST,
    lead: float = LEAD,
    distro: str = DISTRO,
    params: Params = None,
    force: bool = False,
) -> int:
    """Write a mask for Nav2's SpeedFilter: the more degenerate a cell, the slower.

    Parameters
    ----------
    folder : path
        The folder, which need not exist; an earlier export of this kind is replaced.
    costs : Costmap
        A costmap that was made of a field. In its slow zones the lower of both limits counts.
    slowest : float, default 0.3
        Share of the robot's speed left where u is 1, 0.01 to 1; linear in u up to full speed. A
        lower share gives the filter more scans a metre there.
    lead : float, default 0.5
        Distance before a place at which its limit holds already [m]: limits come up to a second
        late, at the rate of the global costmap.
    distro : str, default "jazzy"
        The distribution of ROS 2, as for `nav2_keepout`.
    params : path or sequence of path, optional
        Nav2's parameters to merge ours into, as for `nav2_keepout`.
    force : bool, default False
        True overwrites files of the same names in the folder; others stay.

    Returns
    -------
    int
        The speed left at the most degenerate cell of the map, in per cent of the robot's own.

    Raises
    ------
    LocplanError
        If the folder cannot be written, a setting is out of its range, or there is no field.
    """
    values = compute_speed_mask(costs, slowest, lead)
    robot = Nav2Robot.from_files(params, distro)
    min_percent = 100 - int(values.max())
    title = f"Speed mask: the robot keeps {min_percent} % of its speed or more"
    metadata = {"slowest": slowest, "lead": lead, "min_percent": min_percent}
    robot.warn(robot.note_speed_filters("localizability_speed_filter"))
    merged = add_filter(robot, "speed")
    masks = {"speed": values}
    _write_mask(folder, title, costs, masks, robot, merged, metadata, force=force)
    return min_percent


def _write_untaken_paths(
    folder: Path,
    costs: Costmap,
    robot: Nav2Robot,
    planning: _MaskPlanning,
    paths: Mapping[str, Route],
    *,
    force: bool,
) -> None:
    """Write the paths that the mask's planner does not take as a route graph, and say so."""
    from locplan.export.recommended_ways import nav2_routes

    if not planning.untaken_paths:
        return
    routes = folder.with_name(f"{folder.name}-routes")
    untaken_paths = {nav2_path.name: paths[nav2_path.name] for nav2_path in planning.untaken_paths}
    route_options: Any = {"distro": robot.distribution.name, "params": robot.files}
    try:
        nav2_routes(routes, costs, untaken_paths, **route_options, force=force)
        route_text = f"{routes} has it as a route graph"
    except LocplanError as error:  # the mask is there, and of use for other paths
        route_text = f"it has no route graph: {error}"
    robot.warn(
        f"{nav2_path.planner} would not take {nav2_path.name} ({nav2_path.text}); {route_text}"
        for nav2_path in planning.untaken_paths
    )
    if planning.option:
        robot.warn(iter([planning.option]))


@dataclass(frozen=True)
class _MaskPlanning:
    """What an export says of the planner of a mask."""

    conversion: Conversion
    called: str
    tree: str | None
    inflated: bool
    recommendation: Recommendation | None = None
    option: str = ""
    """A change of the inflation with which the planner takes more of the paths; empty without."""

    @property
    def mask_paths(self) -> list[PlannedPath]:
        """The paths that the mask's planner takes."""
        planner_name = self.conversion.planner.name
        return [
            nav2_path for nav2_path in self.conversion.paths if nav2_path.planner == planner_name
        ]

    @property
    def untaken_paths(self) -> list[PlannedPath]:
        """What the mask's planner takes in place of recommended paths."""
        return [nav2_path for nav2_path in self.mask_paths if not nav2_path.follows]


def _write_mask(
    folder: str | Path,
    title: str,
    costs: Costmap,
    masks: Mapping[str, NDArray[np.int8]],
    robot: Nav2Robot,
    merged: Nav2Parameters,
    metadata: dict[str, Any],
    planning: _MaskPlanning | None = None,
    *,
    force: bool,
) -> None:
    """Write the folder of a mask, for a planner or for the speed filter, and of zones.

    The first mask gives the folder its kind; a second one is that of slow zones.
    """
    from locplan.export import figures as _figures

    changed, added = describe_differences(robot.parameters.content, merged.content)
    robot.warn_changed(merged)
    kind, values = next(iter(masks.items()))
    base = f"localizability_{kind}"
    stems = {mask_kind: "mask" if mask_kind == kind else f"{mask_kind}_mask" for mask_kind in masks}
    servers = [
        server for mask_kind, stem in stems.items() for server in _mask_servers(mask_kind, stem)
    ]
    metadata = {"kind": f"nav2-{kind}", **summarize_costs(costs), **metadata}
    metadata |= {"distro": robot.distribution.name, "changed_parameters": changed}
    unturned, file = unturn(costs), robot.file and robot.file.name
    grid = unturned.grid
    template_values: dict[str, Any] = {
        "title": title,
        "costs": costs,
        "kind": kind,
        "file": file,
        "planning": planning,
    }
    template_values |= {"changed": changed, "added": added, "others": robot.other_files}
    template_values |= {"distro": robot.distribution.name, "before": next(iter(robot.planners), "")}
    template_values |= {
        "namespace": robot.parameters.namespace,
        "lead": metadata.get("lead"),
        "base": base,
    }
    template_values |= {"room": follower_room(costs.robot_radius), "masks": list(masks)}
    has_objects = robot.distribution.vector_objects and kind == "keepout"
    shapes = _no_go_shapes(unturned.zones) if has_objects else {}
    template_values["shapes"] = len(shapes)
    parameters, template_values["comments"] = make_parameter_files(robot.parameters, merged)
    with export_folder(folder, "nav2-mask.md", metadata, force, **template_values) as temporary:
        for name, content in parameters.items():
            (temporary / name).write_bytes(content)
        if planning and planning.tree is not None:
            (temporary / "tree.xml").write_text(planning.tree, "utf-8")
        for mask_kind, stem in stems.items():
            write_values(temporary / stem, masks[mask_kind], grid)
        if costs.zones:
            costs.zones.save(temporary / ZONES)
        if shapes:
            _write_vector_objects(temporary, shapes, grid.resolution)
        write_servers(temporary, servers, f"lifecycle_manager_{base}")
        is_speed = kind == "speed"
        label = "speed limit [% of the robot's own]" if is_speed else f"{kind} mask [0-100]"
        above = f"{grid.name or 'map'}: {title}{format_costs_caption(costs)}"
        figure = _figures.values_figure(grid, values, label, above, is_speed, unturned.zones)
        _figures.save_preview(temporary, figure, dpi=90)


def _mask_servers(kind: str, stem: str) -> list[LifecycleNode]:
    """The nodes that publish a mask and the meaning of its values."""
    base = f"localizability_{kind}"
    topic = {"topic_name": f"/{base}_mask", "frame_id": "map"}
    files = {"yaml_filename": f"{stem}.yaml"}
    # The linear map from the mask's values to costs, or to speeds in per cent.
    laws = {"keepout": (0, 0.0, 1.0), "speed": (1, 100.0, -1.0)}
    topics = {"filter_info_topic": f"/{base}_info", "mask_topic": f"/{base}_mask"}
    law = topics | dict(zip(("type", "base", "multiplier"), laws[kind], strict=True))
    return [
        LifecycleNode("nav2_map_server", "map_server", f"{base}_mask_server", topic, files),
        LifecycleNode("nav2_map_server", "costmap_filter_info_server", f"{base}_info_server", law),
    ]


VECTOR_OBJECTS = "vector_objects.yaml"
"""The file of no-go zones for Nav2's vector object server."""


def _no_go_shapes(zones: Zones) -> dict[str, Any]:
    """Polygons of the no-go zones by name, as the vector object server's parameters have them."""
    shapes = {}
    for number, zone in enumerate(zones.no_go_zones, 1):
        points = zone.polygon.round(6).ravel().tolist()
        shape = {"type": "polygon", "frame_id": "map", "closed": True, "value": 100}
        shapes[f"no_go_{number}"] = {**shape, "points": points}
    return shapes


def _write_vector_objects(folder: Path, shapes: Mapping[str, Any], resolution: float) -> None:
    """Write the parameters of the nodes that vector_object_server.launch.py starts."""
    topics = {"filter_info_topic": "/localizability_zones_info", "mask_topic": "/vo_map"}
    # In nav2_map_server/src/vo_server of lyrical and main, -1 changes nothing, 100 is lethal.
    server = {"map_topic": "/vo_map", "global_frame_id": "map", "resolution": resolution}
    server |= {"default_value": -1, "overlay_type": 0, "update_frequency": 1.0}
    content = {
        "vector_object_server": {"ros__parameters": server | {"shapes": [*shapes], **shapes}},
        "costmap_filter_info_server": {
            "ros__parameters": {"type": 0, **topics, "base": 0.0, "multiplier": 1.0}
        },
    }
    (folder / VECTOR_OBJECTS).write_text(dump_parameters(content), "utf-8")
