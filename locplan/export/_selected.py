"""What makes Nav2 plan with the planner of an export: a robot's own behaviour tree, edited."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from locplan._util.reading import read_text
from locplan.errors import LocplanError

MAX_BYTES = 2**20
"""Maximum size of a behaviour tree."""
COMPUTES = re.compile(r"<ComputePath(?:ToPose|ThroughPoses)\b[^>]*/>")
SELECTS = re.compile(r'(<PlannerSelector\b[^>]*\bdefault_planner=")[^"]*(")')
SMOOTHER = "simple_smoother"


def edited_tree(path: str | Path, called: str, *, smooth: bool) -> str:
    """The text of a behaviour tree of Nav2 that plans with the planner that is called so.

    Parameters
    ----------
    path : path
        The tree's file; all else in it stays.
    called : str
        Name of the planner.
    smooth : bool
        Whether its paths are smoothed.

    Raises
    ------
    LocplanError
        If the file cannot be read, or computes no path.
    """
    text = read_text(Path(path), MAX_BYTES)

    def planning(node: re.Match[str]) -> str:
        own = node[0]
        if "planner_id=" not in own:
            own = f'{own[:-2].rstrip()} planner_id="{called}"/>'
        own = re.sub(r'planner_id="(?!\{)[^"]*"', f'planner_id="{called}"', own)
        out = re.search(r'\bpath="(\{[^"]*\})"', own)
        if not (smooth and out) or "<SmoothPath" in text:
            return own
        path = f'unsmoothed_path="{out[1]}" smoothed_path="{out[1]}"'
        return f'<Sequence>{own}<SmoothPath {path} smoother_id="{SMOOTHER}"/></Sequence>'

    made, count = COMPUTES.subn(planning, text)
    if not count:
        raise LocplanError(
            f"{path}: has no ComputePathToPose or ComputePathThroughPoses; give the behaviour tree"
            " by which the robot navigates"
        )
    return SELECTS.sub(rf"\g<1>{called}\g<2>", made)


def tree_parameters(text: str, file: Path) -> dict[str, Any]:
    """The parameters of bt_navigator by which Nav2 takes a tree, which lies in that file."""
    kinds = {"ToPose": "to_pose", "ThroughPoses": "through_poses"}
    return {
        f"default_nav_{name}_bt_xml": str(file)
        for kind, name in kinds.items()
        if f"<ComputePath{kind}" in text
    }


def smoothing() -> dict[str, Any]:
    """The parameters of smoother_server that the edited tree needs, as nav2_bringup has them."""
    own = {"plugin": "nav2_smoother::SimpleSmoother", "tolerance": 1e-10, "max_its": 1000}
    own["do_refinement"] = True
    return {"smoother_plugins": [SMOOTHER]} | {f"{SMOOTHER}.{k}": v for k, v in own.items()}
