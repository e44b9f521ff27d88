"""What the README.md of a mask's folder says: how to launch it, and what it needs in Nav2."""

from __future__ import annotations

from collections.abc import Sequence

from locplan.costs import Costmap
from locplan.export._distros import BRINGUP, LAUNCH, SERVERS
from locplan.export._folders import about_map
from locplan.export._robots import SPEED_TOPIC, Robot
from locplan.export._travel_costs import NO_LIMIT, Conversion


def mask_readme(
    costs: Costmap,
    robot: Robot,
    needs: Sequence[str],
    added: Sequence[str],
    changed: Sequence[str],
    *,
    params: str,
    preview: str,
) -> list[str]:
    """Lines on the files, the commands, the needs of a mask, and the parameters that are ours."""
    own = f"all of {robot.file.name} (but its comments), with ours" if robot.file else "ours alone"
    merging = "" if robot.file else "; merge them into the robot's own, as `--robot` does"
    file = f"$PWD/{params}" if robot.file else "PARAMS.yaml"
    lines = [
        f"- mask.yaml, mask.pgm: the mask of {costs.grid.name or 'the map'} (grey 0-100 as it"
        f" is, not 0-255); {SERVERS} and {LAUNCH} publish it.",
        f"- {params}: Nav2's parameters, {own}{merging}; {preview}; export.json: the input.",
        f"- `ros2 launch ./{LAUNCH}` (in this folder)",
        f"- `{BRINGUP.replace('PARAMS.yaml', file)}`",
        *needs,
        f"- Another mask goes beside this one with `locplan export ... --robot {params}`.",
        *about_map(costs),
    ]
    if robot.file and changed:
        lines += ["", f"{params} has other values than {robot.file.name} here:", ""]
        lines += [f"- {each}" for each in changed]
    if robot.file and added:
        lines += ["", f"{params} has these beside:", "", *(f"- {each}" for each in added)]
    return lines


def needs_of_planner(conversion: Conversion, called: str) -> list[str]:
    """Lines that say which parameters of a planner a mask needs, and why."""
    planner = conversion.planner
    lines = [
        f"- All planners of Nav2 charge the mask, but only `{called}` so that J comes out: name it"
        " as the planner_id in the behaviour tree (ComputePathToPose), or by a PlannerSelector."
    ]
    if planner.parameter:
        lines.append(
            f"- The mask changes little without `{planner.parameter}: {conversion.param:g}` (Nav2's"
            f" own default is {planner.default:g}). It raises the price of inflated cells as well."
        )
    lines.append("- `allow_unknown: false`: the mask says nothing of unknown space.")
    if planner.planning_time is not None:
        lines.append(
            "- A mask can make the search expand several times as many cells, hence"
            f" `max_iterations: {NO_LIMIT}` (no limit; the default of 1,000,000 ends it without a"
            f" path on large maps) and `max_planning_time: {planner.planning_time:g}` [s] or more,"
            " for which the planner server is busy at worst."
        )
    return lines


def needs_of_layer(shared: Sequence[str]) -> list[str]:
    """A line on the parameters that a static layer shares with the robot's own."""
    return [f"- {', '.join(f'`{each}`' for each in shared)} hold for all static layers."]


def needs_of_speed() -> list[str]:
    """A line on who obeys the limits."""
    return [
        f"- The controller server obeys the limits on {SPEED_TOPIC}; with a namespace set the topic"
        " on both sides (speed_limit_topic)."
    ]
