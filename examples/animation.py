"""Animation of closed-loop drives on the shortest and on the recommended path.

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
from locplan._support.drawing import BLUE
from locplan.maps.figures import draw_map
from locplan.planning.figures import draw_start_and_goal
from locplan.simulation import Arrivals, Simulator, drive_closed

MAP = Path(__file__).resolve().parent.parent / "maps" / "hall.yaml"
START, GOAL = (32.2, 16.0), (4.3, 15.0)
DRIVES = 60
COLOURS = {"shortest": "black", "recommended": BLUE}
TICK = 0.1
"""Time between two poses of a drive [s]."""


def main(folder: str = "animation", step: float = 1.0, drives: int = DRIVES) -> None:
    """Write FOLDER/drives.gif with a frame every `step` seconds."""
    grid, robot = locplan.load_map(MAP), locplan.Robot("turtlebot4")
    choice = locplan.recommend_path(grid, START, GOAL, robot)
    paths = {"shortest": choice.shortest.path, "recommended": choice.path}
    driven = drive_closed(Simulator(grid, robot, seed=1001), paths, range(drives))
    for name, arrivals in driven.items():
        print(f"{name}: {paths[name].length:.1f} m, {arrivals.arrivals_text} arrive")

    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(7, 3))
    draw_map(above, grid)
    draw_start_and_goal(above, START, GOAL)
    crowds = [
        RobotCrowd(name, paths[name], arrivals, above, below) for name, arrivals in driven.items()
    ]
    arrival_texts = [f"{arrivals.n_reached} of {drives}" for arrivals in driven.values()]
    above.set_title(
        f"{drives} robots steered by AMCL (Nav2's defaults, lidar of TurtleBot 4):\n"
        f"{arrival_texts[0]} arrive on the shortest, {arrival_texts[1]} on the recommended path",
        fontsize=10,
    )
    above.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    longest = max(drive.seconds for drive in driven["recommended"].drives) + 5.0
    below.set(xlim=(0, longest), xlabel="time [s]", ylabel="position error [m]")
    below.legend(loc="upper left", frameon=False, fontsize=9)

    at = np.append(np.arange(0.0, longest, step), [longest] * 12)  # repeats the last frame
    film = FuncAnimation(figure, lambda s: [crowd.show(s) for crowd in crowds], at)
    target = Path(folder) / "drives.gif"
    target.parent.mkdir(parents=True, exist_ok=True)
    film.save(target, PillowWriter(fps=10), dpi=100)
    print(f"wrote {target}")


class RobotCrowd:
    """Robots on one path, with the median of their errors over time."""

    def __init__(
        self, name: str, path: locplan.Path, arrivals: Arrivals, above: Axes, below: Axes
    ) -> None:
        ticks = max(len(drive.truth) for drive in arrivals.drives)

        def pad_positions(poses: np.ndarray) -> np.ndarray:
            """Return the positions at each tick. A robot stays where its drive ended."""
            return np.pad(poses[:, :2], ((0, ticks - len(poses)), (0, 0)), mode="edge")

        self.truth = np.array([pad_positions(drive.truth) for drive in arrivals.drives])
        believed = np.array([pad_positions(drive.believed) for drive in arrivals.drives])
        self.error = np.median(np.hypot(*(believed - self.truth).transpose(2, 0, 1)), axis=0)
        colour = COLOURS[name]
        above.plot(*path.xy.T, linewidth=1.2, color=colour)
        self.robots = above.plot([], [], "o", color=colour, ms=4, mec="white", mew=0.5, label=name)[
            0
        ]
        self.median = below.plot([], [], linewidth=2, color=colour, label=f"{name}: median")[0]
        below.set_ylim(0, max(below.get_ylim()[1], 1.1 * float(self.error.max())))

    def show(self, seconds: float) -> None:
        """Draw the state after a time [s]."""
        n = min(round(seconds / TICK), len(self.error) - 1)
        self.robots.set_data(*self.truth[:, n].T)
        self.median.set_data(TICK * np.arange(n + 1), self.error[: n + 1])


if __name__ == "__main__":
    main(*sys.argv[1:2])
