"""Filter masks for ROS 2 Nav2, with the parameters and the launch file to use them.

The formats follow ros-navigation/navigation2, branches humble to main (2026-08):
keepout_filter.cpp, speed_filter.cpp and the documentation of their servers.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.checks import check_number
from locplan._support.files import write_text
from locplan.errors import LocplanError
from locplan.export.behavior_trees import add_behavior_tree
from locplan.export.masks import (
    CostmapInflation,
    MaskConversion,
    PlannedPath,
    compute_follower_room,
    compute_keepout_mask,
    find_planner,
)
from locplan.export.parameters import (
    Nav2Robot,
    ParameterFiles,
    add_filters,
    add_planner,
    describe_differences,
    dump_parameters,
    list_filter_topics,
    make_filter_law,
    make_parameter_files,
)
from locplan.export.planned_paths import (
    check_paths,
    close_narrow_gaps,
    compare_nav2_paths,
    note_narrow_places,
    suggest_inflation,
)
from locplan.export.registry import (
    DEFAULT_DISTRO,
    DEFAULT_LEAD,
    DEFAULT_SLOWEST,
    create_export_folder,
)
from locplan.export.servers import LifecycleNode, write_servers
from locplan.export.values import compute_speed_mask, drop_costmap_yaw, write_map_values
from locplan.maps.zones import FILE as ZONES, Zones
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.metrics import format_costs_caption
from locplan.planning.path import Path as Route
from locplan.robots.parameters import GLOBAL_COSTMAP, Nav2Parameters

if TYPE_CHECKING:
    from locplan.simulation.recommendation import Recommendation


class MaskWarning(UserWarning):
    """A warning that a mask has little effect."""


def nav2_keepout(
    folder: str | Path,
    costs: Costmap | Recommendation,
    *,
    planner: str | None = None,
    planner_param: float | None = None,
    distro: str = DEFAULT_DISTRO,
    params: ParameterFiles = None,
    tree: str | Path | None = None,
    paths: Mapping[str, Route] | None = None,
    force: bool = False,
) -> MaskConversion:
    """Write a mask for Nav2's KeepoutFilter that makes a planner's costs the costmap's J.

    Parameters
    ----------
    folder : path
        The folder, which need not exist; an earlier export of this kind is replaced.
    costs : Costmap or Recommendation
        The mask's values 0..99 stand for weight * u in every free cell, also close to walls:
        Nav2's inflation keeps the robot away from walls. Nav2 ignores a map's yaw, so the mask
        has none either. For a recommendation, the mask has `Recommendation.costmap`, its path is
        added to `paths`, and README.md begins with its advice.
        Zones are also written to zones.geojson. Slow zones are written to speed_mask.yaml; their
        limits begin as far before a zone as the robot drives in a second. From lyrical on,
        vector_objects.yaml has the no-go zones for Nav2's vector object server.
    planner : str, optional
        The planner that plans on the mask: "smac2d", "smac-hybrid", "navfn" or "thetastar". By
        default the first of these in `params`, except "navfn", which does not follow masks. If
        there is none, "smac2d" up to a million cells, and "thetastar" on larger maps.
    planner_param : float, optional
        Value of the planner's parameter for costs, above 0: cost_travel_multiplier, cost_penalty
        or w_traversal_cost. Set it to keep the robot's value. By default the lowest value that can
        charge u = 1. "navfn" has no such parameter.
    distro : str, default "jazzy"
        The robot's distribution of ROS 2: "humble", "jazzy", "kilted", "lyrical" or "rolling".
    params : path or sequence of path, optional
        The robot's Nav2 parameter files; nav2.yaml is a copy with the export's parameters merged
        in. Without files, nav2.yaml has only the export's parameters. With several files, nav2.yaml
        is a copy of the one with the global costmap and the planner, and merged.yaml combines all.
        The mask includes the inflation of the global costmap, because Nav2 takes the larger value
        of mask and costmap, not their sum. The inflation stays unchanged. If it hides the mask from
        the planner on `paths`, a `RobotWarning` and README.md name a ``cost_scaling_factor`` that
        does not. If the export changes a value of the file, a `ParametersChanged` warning and
        README.md name it. The planner gets ``allow_unknown: false``, since J is infinite in unknown
        space.
    tree : path, optional
        The robot's behaviour tree. The export writes a copy that uses the mask's planner, and sets
        it in the parameters. The copy smooths the paths of Theta*, since they zigzag.
    paths : dict of Path, optional
        Recommended paths by name. The export computes the paths of Nav2's planners between the
        same ends, by the planners' formulas, and compares them. Paths that the mask's planner does
        not take are written as a route graph next to the folder, see `nav2_routes`. If the planner
        passes a gap that is too narrow for a path follower, and a wider detour costs at most 5 %
        more, the mask closes the gap. A `RobotWarning` names the narrowest remaining place.
    force : bool, default False
        True overwrites files of the same names in the folder.

    Returns
    -------
    MaskConversion
        The accuracy of the mask; its positions ignore the map's yaw, like the mask.

    Raises
    ------
    LocplanError
        If the folder cannot be written, or a setting is out of range.
    """
    robot, paths, recommendation = Nav2Robot.from_files(params, distro, tree), paths or {}, None
    if not isinstance(costs, Costmap):
        recommendation, costs = costs, costs.costmap()
        if recommendation.best == 0 and not costs.zones:
            text = "the recommended path is the shortest, so the mask only charges cells near walls"
            warnings.warn(MaskWarning(text), stacklevel=2)
        paths = {
            candidate.name: candidate.path
            for candidate in [recommendation.recommended_candidate]
            if candidate
        } | {**paths}
    planner = planner or robot.select_planner(costs.grid.free.size)
    caveat = find_planner(planner, None).caveat
    layer = CostmapInflation.from_parameters(robot.parameters)
    inflation = None if caveat else CostmapInflation.choose_for_mask(costs, layer)
    values, conversion = compute_keepout_mask(
        costs, planner=planner, inflation=inflation, planner_param=planner_param
    )
    check_paths(costs, paths)
    if not caveat:
        values, gaps = close_narrow_gaps(costs, values, conversion, paths, layer)
        conversion = dataclasses.replace(conversion, closed_gaps=tuple(gaps))
    masks, lead = {"keepout": values}, costs.robot.kinematics.speed if costs.robot else DEFAULT_LEAD
    if costs.zones.has_kind("slow"):
        masks["speed"] = _compute_speed_values(costs, 1.0, lead, robot)
        robot.warn(robot.note_speed_filters("localizability_speed_filter"))
    merged, planner_name = add_planner(robot, add_filters(robot, *masks, lead=lead), conversion)
    merged, edited = add_behavior_tree(
        robot, merged, planner_name, conversion.planner, Path(folder)
    )
    robot.warn(robot.note_other_planners(planner_name))
    if caveat:
        robot.warn(iter([f"{planner} does not follow a mask: {caveat}"]))
    compared = compare_nav2_paths(costs, values, conversion, paths, layer)
    conversion = dataclasses.replace(conversion, paths=tuple(compared))
    if costs.grid.origin[2]:
        conversion = conversion.drop_yaw(costs.grid)
    title = f"Localizability mask for {conversion.planner.plugin} ({planner_name})"
    metadata: dict[str, Any] = {
        "planner_id": planner_name,
        "conversion": conversion.summarize().values,
    }
    if "speed" in masks:
        metadata["lead"] = lead
    if recommendation:
        metadata["choice"] = {
            "recommended_name": recommendation.recommended_name,
            "answer": recommendation.answer,
        }
    planning = _MaskPlanner(conversion, planner_name, edited, bool(inflation), recommendation)
    if layer and planning.untaken_paths:
        inflation_advice = suggest_inflation(
            costs, values, robot, planning.untaken_paths, conversion, paths, layer
        )
        planning = dataclasses.replace(planning, inflation_advice=inflation_advice)
    robot.warn(note_narrow_places(planning.mask_paths, costs.robot_radius))
    _write_mask(folder, title, costs, masks, robot, merged, metadata, planning, force=force)
    _write_untaken_paths(Path(folder), costs, robot, planning, paths, force=force)
    return conversion


def nav2_speed(
    folder: str | Path,
    costs: Costmap,
    *,
    slowest: float = DEFAULT_SLOWEST,
    lead: float = DEFAULT_LEAD,
    distro: str = DEFAULT_DISTRO,
    params: ParameterFiles = None,
    force: bool = False,
) -> int:
    """Write a mask for Nav2's SpeedFilter, which slows the robot in degenerate cells.

    Parameters
    ----------
    folder : path
        The folder, which need not exist; an earlier export of this kind is replaced.
    costs : Costmap
        A costmap with a covariance field. In slow zones the lower of both limits applies.
    slowest : float, default 0.3
        Share of the robot's speed at u = 1, 0.01 to 1; linear in u up to full speed. A lower share
        gives the filter more scans per metre in degenerate places.
    lead : float, default 0.5
        Distance before a place at which its limit begins [m]. Nav2 applies limits up to a second
        late, at the rate of the global costmap. From lyrical on, Nav2's filter looks ahead along
        the plan, by this distance or by its braking distance. Otherwise, the mask is widened.
    distro : str, default "jazzy"
        The distribution of ROS 2, as for `nav2_keepout`.
    params : path or sequence of path, optional
        The robot's Nav2 parameter files, as for `nav2_keepout`.
    force : bool, default False
        True overwrites files of the same names in the folder.

    Returns
    -------
    int
        The speed at the most degenerate cell of the map, in per cent of the robot's speed.

    Raises
    ------
    LocplanError
        If the folder cannot be written, a setting is out of range, or there is no field.
    """
    robot = Nav2Robot.from_files(params, distro)
    values = _compute_speed_values(costs, slowest, lead, robot)
    min_percent = 100 - int(values.max())
    title = f"Speed mask: the robot keeps {min_percent} % of its speed or more"
    metadata = {"slowest": slowest, "lead": lead, "min_percent": min_percent}
    robot.warn(robot.note_speed_filters("localizability_speed_filter"))
    merged = add_filters(robot, "speed", lead=lead)
    masks = {"speed": values}
    _write_mask(folder, title, costs, masks, robot, merged, metadata, force=force)
    return min_percent


def _compute_speed_values(
    costs: Costmap, slowest: float, lead: float, robot: Nav2Robot
) -> NDArray[np.int8]:
    """Return a speed mask whose limits begin at their places if the filter looks ahead."""
    check_number("lead", lead, 0)
    mask_lead = 0.0 if robot.distribution.has_speed_lookahead else lead
    return compute_speed_mask(costs, slowest, mask_lead)


def _write_untaken_paths(
    folder: Path,
    costs: Costmap,
    robot: Nav2Robot,
    planning: _MaskPlanner,
    paths: Mapping[str, Route],
    *,
    force: bool,
) -> None:
    """Write the paths that the mask's planner does not take as a route graph, and warn."""
    from locplan.export.recommended_routes import nav2_routes

    if not planning.untaken_paths:
        return
    routes = folder.with_name(f"{folder.name}-routes")
    untaken_paths = {nav2_path.name: paths[nav2_path.name] for nav2_path in planning.untaken_paths}
    try:
        nav2_routes(
            routes,
            costs,
            untaken_paths,
            distro=robot.distribution.name,
            params=robot.files,
            force=force,
        )
        route_text = f"{routes} has it as a route graph"
    except LocplanError as error:  # the mask still works for other paths
        route_text = f"it has no route graph: {error}"
    robot.warn(
        f"{nav2_path.planner} does not take {nav2_path.name} ({nav2_path.verdict_text});"
        f" {route_text}"
        for nav2_path in planning.untaken_paths
    )
    if planning.inflation_advice:
        robot.warn(iter([planning.inflation_advice]))


@dataclass(frozen=True)
class _MaskPlanner:
    """The planner that plans on a mask, as README.md describes it."""

    conversion: MaskConversion
    planner_name: str
    tree_text: str | None
    has_inflation: bool
    recommendation: Recommendation | None = None
    inflation_advice: str = ""
    """Advice to change the inflation so that the planner takes more of the paths; may be empty."""

    @property
    def mask_paths(self) -> list[PlannedPath]:
        """The paths that the mask's planner takes."""
        planner_name = self.conversion.planner.name
        return [
            nav2_path for nav2_path in self.conversion.paths if nav2_path.planner == planner_name
        ]

    @property
    def untaken_paths(self) -> list[PlannedPath]:
        """The planner's paths that differ from the recommended ones."""
        return [nav2_path for nav2_path in self.mask_paths if not nav2_path.is_equivalent]


def _write_mask(
    folder: str | Path,
    title: str,
    costs: Costmap,
    masks: Mapping[str, NDArray[np.int8]],
    robot: Nav2Robot,
    merged: Nav2Parameters,
    metadata: dict[str, Any],
    planning: _MaskPlanner | None = None,
    *,
    force: bool,
) -> None:
    """Write the folder of a mask, for a planner or for the speed filter, with its zones.

    The first mask decides the kind of the folder; the second, if any, has the slow zones.
    """
    from locplan.export import figures as _figures

    changed, added = describe_differences(robot.parameters.content, merged.content)
    robot.warn_changed(merged)
    kind, values = next(iter(masks.items()))
    base = f"localizability_{kind}"
    stems = {mask_kind: "mask" if mask_kind == kind else f"{mask_kind}_mask" for mask_kind in masks}
    servers = [
        server
        for mask_kind, stem in stems.items()
        for server in _make_mask_servers(mask_kind, stem)
    ]
    metadata = {"kind": f"nav2-{kind}", **summarize_costs(costs), **metadata}
    metadata |= {"distro": robot.distribution.name, "changed_parameters": changed}
    unturned, file = drop_costmap_yaw(costs), robot.main_file and robot.main_file.name
    grid = unturned.grid
    template_values: dict[str, Any] = {
        "title": title,
        "costs": costs,
        "kind": kind,
        "file": file,
        "planning": planning,
        "changed": changed,
        "added": added,
        "others": robot.other_files,
        "before": next(iter(robot.planners), ""),
        "namespace": robot.parameters.namespace,
        "lead": metadata.get("lead"),
        "base": base,
        "room": compute_follower_room(costs.robot_radius),
        "stems": stems,
        "runs": robot.distribution,
        "has_other_filter": any(
            f"localizability_{other_kind}_filter"
            in robot.parameters.read_names(GLOBAL_COSTMAP, "filters")
            for other_kind in {"keepout", "speed"} - set(masks)
        ),
        "replaced": [
            f"{name} ({costmap.partition('/')[0]})"
            for mask_kind in masks
            for costmap, name in robot.list_replaced_filters(mask_kind)
        ],
    }
    has_objects = robot.distribution.has_vector_objects and kind == "keepout"
    shapes = _make_no_go_shapes(unturned.zones) if has_objects else {}
    template_values["shapes"] = len(shapes)
    parameters, template_values["comments"] = make_parameter_files(robot.parameters, merged)
    with create_export_folder(
        folder, "nav2-mask.md", metadata, template_values, force=force
    ) as temporary:
        for name, content in parameters.items():
            (temporary / name).write_bytes(content)
        if planning and planning.tree_text is not None:
            write_text(temporary / "tree.xml", planning.tree_text)
        for mask_kind, stem in stems.items():
            write_map_values(temporary / stem, masks[mask_kind], grid)
        if costs.zones:
            costs.zones.save(temporary / ZONES)
        if shapes:
            _write_vector_objects(temporary, shapes, grid.resolution)
        write_servers(temporary, servers, f"lifecycle_manager_{base}")
        is_speed = kind == "speed"
        label = (
            "speed limit [% of the robot's speed]"
            if is_speed
            else "added cost [mask value, 0 to 100]"
        )
        effect = (
            "the robot drives slowly" if is_speed else "Nav2's planner pays more and keeps away"
        )
        above = f"{grid.name or 'map'}. Dark: {effect}{format_costs_caption(costs)}"
        figure = _figures.values_figure(grid, values, label, above, is_speed, unturned.zones)
        _figures.save_preview(temporary, figure, dpi=90)


def _make_mask_servers(kind: str, stem: str) -> list[LifecycleNode]:
    """Return the nodes that publish a mask and the meaning of its values."""
    base = f"localizability_{kind}"
    topic = {"topic_name": list_filter_topics(kind)["mask_topic"], "frame_id": "map"}
    files = {"yaml_filename": f"{stem}.yaml"}
    law = list_filter_topics(kind) | make_filter_law(kind)
    return [
        LifecycleNode("nav2_map_server", "map_server", f"{base}_mask_server", topic, files),
        LifecycleNode("nav2_map_server", "costmap_filter_info_server", f"{base}_info_server", law),
    ]


VECTOR_OBJECTS = "vector_objects.yaml"
"""The file of no-go zones for Nav2's vector object server."""


def _make_no_go_shapes(zones: Zones) -> dict[str, Any]:
    """Return the no-go zones' polygons by name, in the parameters of the vector object server."""
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
    write_text(folder / VECTOR_OBJECTS, dump_parameters(content))
