"""Edits of a robot's behaviour tree that select the planner of an export."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from locplan._support.reading import read_text
from locplan.errors import LocplanError
from locplan.export.masks import NavPlanner
from locplan.export.parameters import Nav2Robot
from locplan.robots.parameters import Nav2Parameters

SMOOTHER = "simple_smoother"


def edit_behavior_tree(path: str | Path, planner_name: str, *, smooth: bool) -> str:
    """Return the text of a behaviour tree, edited to plan with the named planner.

    Parameters
    ----------
    path : path
        The tree's file; the rest of it stays unchanged.
    planner_name : str
        Name of the planner.
    smooth : bool
        Whether the tree smooths the paths.

    Raises
    ------
    LocplanError
        If the file cannot be read, or the tree computes no path.
    """
    text = read_text(Path(path), 2**20)
    # With a PlannerSelector, a name between braces is the variable that holds its selection.
    selector_guard = r"(?!\{)" if "<PlannerSelector" in text else ""
    planner_id_pattern = rf"planner_id=([\"']){selector_guard}.*?\1"

    def edit_node(node: re.Match[str]) -> str:
        node_text = node[0]
        if "planner_id=" not in node_text:
            node_text = f'{node_text[:-2].rstrip()} planner_id="{planner_name}"/>'
        node_text = re.sub(planner_id_pattern, f'planner_id="{planner_name}"', node_text)
        out = re.search(r"\bpath=[\"'](\{.*?\})[\"']", node_text)
        if not (smooth and out) or "<SmoothPath" in text:
            return node_text
        path = f'unsmoothed_path="{out[1]}" smoothed_path="{out[1]}"'
        return f'<Sequence>{node_text}<SmoothPath {path} smoother_id="{SMOOTHER}"/></Sequence>'

    edited_text, count = re.subn(r"<ComputePath(?:ToPose|ThroughPoses)\b[^>]*/>", edit_node, text)
    if not count:
        raise LocplanError(
            f"{path}: has no ComputePathToPose or ComputePathThroughPoses; give the behaviour tree"
            " that the robot navigates with"
        )
    selected = r"(<PlannerSelector\b[^>]*\bdefault_planner=)([\"']).*?\2"
    return re.sub(selected, rf'\g<1>"{planner_name}"', edited_text)


def add_behavior_tree(
    robot: Nav2Robot, merged: Nav2Parameters, planner_name: str, planner: NavPlanner, folder: Path
) -> tuple[Nav2Parameters, str | None]:
    """Return parameters that select the edited tree in a folder, and its text; None without a tree.

    Any-angle paths are smoothed. If the robot lacks the smoother, nav2_bringup's is added.
    """
    if robot.tree is None:
        return merged, None
    text = edit_behavior_tree(robot.tree, planner_name, smooth=planner.any_angle)
    file = str(folder.resolve() / "tree.xml")
    kinds = {"ToPose": "to_pose", "ThroughPoses": "through_poses"}
    tree_parameters = {
        f"default_nav_{name}_bt_xml": file
        for kind, name in kinds.items()
        if f"<ComputePath{kind}" in text
    }
    merged = merged.with_values("bt_navigator", tree_parameters)
    server = merged.read_node_parameters(node := "smoother_server")
    names = merged.read_names(node, "smoother_plugins", [SMOOTHER] if server else [])
    if planner.any_angle and SMOOTHER not in names:
        smoother: dict[str, Any] = {"plugin": "nav2_smoother::SimpleSmoother", "tolerance": 1e-10}
        smoother |= {"max_its": 1000, "do_refinement": True}
        settings = {f"{SMOOTHER}.{name}": value for name, value in smoother.items()}
        merged = merged.with_values(node, {"smoother_plugins": [*names, SMOOTHER], **settings})
    return merged, text
