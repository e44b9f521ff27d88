"""Show why AMCL gets lost on a map with solid walls: the weights of a right and a wrong pose.

Run: python examples/solid_walls.py [FOLDER [MAP.yaml]]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import locplan
from locplan._support import drawing as style
from locplan._support.drawing import MAP_COLOURS, NotebookFigure, save_figure
from locplan.maps import FREE, OCCUPIED, hollow_walls
from locplan.maps.figures import draw_cells, draw_map

LIDAR = locplan.Lidar(range=6.0, beams=60)
ROBOT = locplan.Robot(LIDAR, disturbances=locplan.robots.Disturbances(outliers=0.1))
SIGMA = 0.2
"""AMCL's sigma_hit by default [m]."""
LABELS = (
    "beam ends at black cells: a match",
    "beam ends away from black cells: no match",
    "pose of the robot",
)
AROUND = 4.0
"""Half the side of the drawn part of the map [m]."""


def main(folder: str = "solid_walls", map_file: str | Path = "") -> None:
    solid = locplan.load_map(map_file) if map_file else racks()
    check = locplan.maps.measure_solidity(solid)
    print(
        f"a wrong pose wins: {check.wrong_pose_share:.0%} of scans, hollowed"
        f" {check.hollowed_wrong_pose_share:.0%}"
    )
    drive, field = scans(solid), Field(solid)
    chosen, wrong = misleading(drive, field)
    on_robot, true = drive.ends_on_robot()[chosen], drive.poses[chosen]
    figure = NotebookFigure(figsize=(11, 4.9), layout="constrained")
    panels = (
        ("solid walls, true pose", field, true),
        ("solid walls, wrong pose", field, wrong),
        ("hollowed walls, wrong pose", Field(hollow_walls(solid)), wrong),
    )
    weights = []
    for axes, (title, each, pose) in zip(figure.subplots(1, 3), panels, strict=True):
        share = each.weight(on_robot, pose) / each.weight(on_robot, true)
        weights.append(share)
        draw_map(axes, each.grid)
        # Here all occupied cells are black. Other pictures show only their rim.
        draw_cells(axes, each.grid, each.grid.cells // 127, cmap=MAP_COLOURS, vmin=0, vmax=3)
        ends = on_map(on_robot, pose)
        near = each.distances(ends) < 2 * SIGMA
        marks = [
            *axes.plot(*ends[near].T, "o", color=style.GREEN, markersize=5),
            *axes.plot(*ends[~near].T, "x", color=style.VERMILION, markersize=6),
            *axes.plot(*pose[:2], "D", color=style.PURPLE, markersize=10),
        ]
        for mark, label in zip(marks, LABELS, strict=True):
            mark.set(label=label, markeredgecolor="white")
        marks[1].set(markeredgecolor=style.VERMILION, markeredgewidth=2)
        axes.set_title(f"{title}\nweight {share:.2f}", fontsize="large")
        for limits, middle in zip((axes.set_xlim, axes.set_ylim), true[:2], strict=True):
            limits(middle - AROUND, middle + AROUND)
        print(f"{title}: weight {share:.2f}, {near.mean():.0%} of the beams at black cells")
    figure.key(marks, ncols=3)
    winner = "wins" if weights[1] > weights[0] else "scores nearly as high"
    figure.title(f"With solid walls a wrong pose {winner}. With hollowed walls it loses.")
    target = Path(folder) / "solid_walls.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, target)
    print(f"wrote {target}")


def racks() -> locplan.OccupancyGrid:
    """Return a map with rows of solid racks between aisles of 1.5 m."""
    cells = np.full((250, 330), FREE, np.uint8)
    cells[:40] = cells[-40:] = cells[:, :40] = cells[:, -40:] = OCCUPIED
    for row in range(70, 200, 60):
        for col in range(70, 250, 65):
            cells[row : row + 30, col : col + 35] = OCCUPIED
    return locplan.OccupancyGrid(cells, 0.05, name="racks")


def scans(grid: locplan.OccupancyGrid) -> locplan.recordings.Recording:
    """Return a simulated recording along a path across the map."""
    costs = locplan.Costmap.blank(grid, robot=ROBOT)
    (query,) = locplan.planning.random_queries(costs, 1, 3, min_distance=8.0)
    path = locplan.plan(costs, query.start, query.goal).path
    assert path is not None
    return locplan.recordings.record_drive(grid, path, ROBOT, spacing=0.2)


class Field:
    """AMCL's likelihood field of a map, with Nav2's defaults."""

    def __init__(self, grid: locplan.OccupancyGrid) -> None:
        self.grid, clear = grid, (grid.cells != OCCUPIED).astype(np.uint8)
        far = cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        self.far = np.minimum(grid.resolution * far, 2.0)

    def distances(self, ends: NDArray[Any]) -> NDArray[Any]:
        """Return the distances of points from the nearest occupied cell [m]."""
        rows, cols = (np.floor(each).astype(int) for each in self.grid.world_to_grid(*ends.T))
        inside = (rows >= 0) & (rows < len(self.far)) & (cols >= 0) & (cols < self.far.shape[1])
        return np.where(inside, self.far[rows * inside, cols * inside], 2.0)

    def weight(self, on_robot: NDArray[Any], pose: NDArray[Any]) -> float:
        """Return the weight of a particle: 1 plus the sum of the cubed beam likelihoods."""
        distance = self.distances(on_map(on_robot, pose))
        likelihood = 0.5 * np.exp(-(distance**2) / (2 * SIGMA**2)) + 0.5 / LIDAR.range
        return 1 + float((likelihood**3).sum())


def misleading(drive: locplan.recordings.Recording, field: Field) -> tuple[int, NDArray[Any]]:
    """Return the scan for which a wrong pose outweighs the true one most, and that pose."""
    random, count, found = np.random.default_rng(1), 300, []
    for n, (ends, true) in enumerate(zip(drive.ends_on_robot(), drive.poses, strict=True)):
        away, bearing = random.uniform(0.5, 2.5, count), random.uniform(-np.pi, np.pi, count)
        moves = np.column_stack([away * np.cos(bearing), away * np.sin(bearing), np.zeros(count)])
        weights = [field.weight(ends, true + move) for move in moves]
        best = int(np.argmax(weights))
        found.append((weights[best] / field.weight(ends, true), n, true + moves[best]))
    _, chosen, wrong = max(found, key=lambda each: each[0])
    return chosen, wrong


def on_map(on_robot: NDArray[Any], pose: NDArray[Any]) -> NDArray[Any]:
    """Return the end points of the beams on the map for a pose, (k, 2) [m]."""
    ends = on_robot[np.isfinite(on_robot[:, 0])]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(pose[:2] + ends @ [[cos, sin], [-sin, cos]])


if __name__ == "__main__":
    main(*sys.argv[1:])
