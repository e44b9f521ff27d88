"""Where sixty robots believe to be, on the shortest path and on the aware one, as an animation.

Run: python examples/animation.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import locplan
from locplan.robots import Robot
from locplan.simulation import Drives, simulate

MAP = Path(__file__).resolve().parent.parent / "maps" / "two_corridors.yaml"
START, GOAL = (2.0, 3.0), (38.0, 3.0)
DRIVES = 60
STYLES = {"shortest": {"color": "#2b2b33", "linestyle": "--"}, "aware": {"color": "#00857c"}}

BELIEF = {"markersize": 4, "color": "white", "markeredgecolor": "#0072b2", "markeredgewidth": 0.8}
ROBOT = {"markersize": 7, "markeredgecolor": "white"}


def main(folder: str = "animation", step: float = 0.5, drives: int = DRIVES) -> None:
    """Write FOLDER/drives.gif with a frame every `step` metres of the way."""
    grid, lidar = locplan.load_map(MAP), locplan.Lidar.preset("turtlebot4")
    field = locplan.load_or_compute(grid, locplan.Fused.of(lidar))
    costs = locplan.Costmap.from_field(grid, field)
    paths = {
        "shortest": locplan.plan(costs.with_weight(0.0), START, GOAL).path,
        "aware": locplan.plan(costs, START, GOAL).path,
    }
    driven = simulate(grid, paths, robot=Robot(lidar), drives=drives).drives
    for name, each in driven.items():
        print(f"{name}: {each.distance[-1]:.1f} m, {each.lost_rate.value:.0%} of the drives lost")

    figure = Figure(figsize=(8.8, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(7, 3))
    image = locplan.plotting.draw_field(above, field)
    image.set_alpha(0.55)
    locplan.plotting.draw_ends(above, START, GOAL)
    moving = {name: _Moving(name, each, above, below) for name, each in driven.items()}
    lost = driven["shortest"].lost_rate.value, driven["aware"].lost_rate.value
    above.set_title(
        f"Where {drives} robots believe to be (AMCL with Nav2's defaults, lidar of TurtleBot 4):\n"
        f"{lost[0]:.0%} get lost on the shortest path, {lost[1]:.0%} on the aware one",
        fontsize=10,
    )
    longest = max(each.distance[-1] for each in driven.values())
    below.set(xlim=(0, longest), ylim=(0, 1.5))
    below.set(xlabel="distance driven [m]", ylabel="position error [m]")
    below.axhline(1.0, color="0.6", linewidth=0.8)
    below.text(0.3, 1.03, "lost", color="0.4", fontsize=8)
    below.legend(loc="upper right", frameon=False, fontsize=9)
    marks = [moving["aware"].robot, moving["aware"].beliefs]
    names = ["the robots", "where each believes to be"]
    above.legend(marks, names, loc="center", bbox_to_anchor=(0.5, 0.5), fontsize=9)
    above.set(xlim=(-0.5, 40.5), ylim=(-0.5, 15.2))

    at = np.append(np.arange(0.0, longest, step), [longest] * 12)  # the last frame rests
    film = FuncAnimation(figure, lambda s: [each.show(s) for each in moving.values()], at)
    target = Path(folder) / "drives.gif"
    target.parent.mkdir(parents=True, exist_ok=True)
    film.save(target, PillowWriter(fps=10), dpi=100)
    print(f"wrote {target}")


class _Moving:
    """A robot, what its filters believe, and the median and 90 % of their errors so far."""

    def __init__(self, name: str, drives: Drives, above: Axes, below: Axes) -> None:
        self.drives, style = drives, STYLES[name]
        self.error = np.percentile(drives.position_error, (50, 90), axis=0)
        above.plot(*drives.poses[:, :2].T, linewidth=1.2, **style)
        self.beliefs = above.plot([], [], "o", zorder=5, **BELIEF)[0]
        self.robot = above.plot([], [], "D", zorder=6, color=style["color"], **ROBOT)[0]
        self.median = below.plot([], [], linewidth=2, label=f"{name}: median", **style)[0]
        self.most = below.plot([], [], linewidth=1, alpha=0.6, label="90 % are below", **style)[0]

    def show(self, distance: float) -> None:
        """Draw the state after a distance [m]."""
        n = min(int(np.searchsorted(self.drives.distance, distance)), len(self.drives.poses) - 1)
        here = self.drives.poses[n, :2]
        self.robot.set_data(*here[:, None])
        self.beliefs.set_data(*(here + self.drives.errors[:, n, :2]).T)
        self.median.set_data(self.drives.distance[: n + 1], self.error[0, : n + 1])
        self.most.set_data(self.drives.distance[: n + 1], self.error[1, : n + 1])


if __name__ == "__main__":
    main(*sys.argv[1:2])
