"""The method from a map to a path, step by step, with the equations of the paper.

"Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10 (2023).
Run: python examples/method.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import locplan
from locplan.field import figures as field_figures
from locplan.paper import template_matching
from locplan.planning import figures

MAP = Path(__file__).resolve().parent.parent / "maps" / "two_corridors.yaml"
PLACES = {"bare corridor": (20.05, 3.05), "corridor with landmarks": (20.05, 11.05)}
START, GOAL = (2.0, 3.0), (38.0, 3.0)


def main(folder: str = "method") -> None:
    grid = locplan.load_map(MAP)
    estimator = locplan.Sad.paper()
    window = estimator.lattice(grid.resolution)
    offsets = np.meshgrid(window.offsets, window.offsets, window.angles, indexing="ij")
    figure = Figure((10, 8), layout="constrained")
    above, below = figure.subfigures(2, 1)

    # At one place: match the map around it with the map itself, at every offset (dx, dy, theta).
    for (name, (x, y)), axes in zip(PLACES.items(), above.subplots(1, 2), strict=True):
        area = template_matching.compute_mismatch_areas(
            grid, x, y, estimator
        )  # Eq. 2: S, as an area [m^2]
        weights = 1 / np.maximum(area, grid.resolution**2 / 2) ** 2  # Eq. 9
        poses = [part.ravel() for part in offsets]
        covariance = np.cov(poses, aweights=weights.ravel(), ddof=0)  # Eq. 8, with k = 1
        e = np.sqrt(np.linalg.det(covariance))  # Eq. 10
        std = np.sqrt(np.diag(covariance)[:2])
        print(f"{name}: std {std[0]:.2f} m along, {std[1]:.2f} m across, e {e:.2g} m² rad")
        unturned = area[:, :, len(window.angles) // 2]
        extent = (-window.offsets[-1], window.offsets[-1]) * 2
        image = axes.imshow(unturned.T, origin="lower", extent=extent)
        axes.set(title=f"{name}: e = {e:.2g} m² rad", xlabel="dx [m]", ylabel="dy [m]")
        above.colorbar(image, ax=axes, label="mismatch S [m²]")

    # Everywhere: the covariance field, with the same e, and u, its logarithm scaled to 0 to 1.
    field = locplan.load_or_compute(grid, locplan.FieldConfig(estimator, stride=0.4))
    costs = locplan.Costmap.from_field(field)  # density 1 + weight * u

    # The path of least J, the integral of the density, next to the shortest one.
    axes = below.subplots()
    axes.set_title("paths on the field of e")
    axes.plot(*np.transpose(list(PLACES.values())), "D", color="tab:blue", label="places above")
    below.colorbar(field_figures.draw_field(axes, field), ax=axes, label="e [m² rad]")
    for name, weight, style in (("shortest", 0.0, "--"), ("localizable", costs.weight, "-")):
        path = locplan.plan(costs.with_weight(weight), START, GOAL).path
        metrics = locplan.planning.path_metrics(costs, path)
        print(f"{name} path: {metrics.length:.1f} m long, {metrics.integrated_u:.1f} m degenerate")
        label = f"{name}: {metrics.length:.1f} m, {metrics.integrated_u:.1f} m degenerate"
        figures.draw_path(axes, path, color="black", linestyle=style, label=label)
    figures.draw_start_and_goal(axes, START, GOAL)
    axes.legend(loc="center")
    Path(folder).mkdir(parents=True, exist_ok=True)
    figure.savefig(Path(folder) / "method.png")


if __name__ == "__main__":
    main(*sys.argv[1:2])
