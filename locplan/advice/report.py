"""The report of a check: one HTML page that needs nothing else, made of `templates`."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from locplan._support.intervals import Interval, format_rate
from locplan._support.output import replacing
from locplan._support.public import load_templates
from locplan.advice.check_result import Check
from locplan.advice.figures import SIZE, caption, crop_to_free, place_labels
from locplan.advice.next_step import next_action, remaining_text
from locplan.advice.text import (
    fix_rows,
    headline,
    passage_text,
    problem_text,
    settings_texts,
    spot_text,
)
from locplan.maps.figures import downsample
from locplan.maps.grid import OccupancyGrid
from locplan.simulation.drives import OFF

GREYS = np.array([40, 190, 255], np.uint8)
"""Shades of occupied, unknown and free."""


class MapDrawing(NamedTuple):
    """The part of the map that is drawn as an image, and where positions lie on it."""

    data: str
    """The image as a URL."""
    width: float
    """Width [units of the drawing]."""
    height: float
    """Height."""
    grid: OccupancyGrid
    """The part of the map."""
    scale: float
    """Units of the drawing in a cell."""

    @classmethod
    def from_map(cls, grid: OccupancyGrid) -> MapDrawing:
        """Draw what is known of a map in its own axes, without the origin's yaw."""
        import cv2

        grid = crop_to_free(grid)
        image = GREYS[downsample(grid.cells)[::-1] // 127]
        data = base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()
        scale = 900 / max(grid.shape)  # the longer side in the drawing's units
        size = grid.shape[1] * scale, grid.shape[0] * scale
        return cls(f"data:image/png;base64,{data}", *size, grid, scale)

    @property
    def label(self) -> float:
        """Size of a label [m]."""
        return SIZE * max(self.grid.shape) * self.grid.resolution

    def points(self, xy: Any) -> str:
        """Positions (n, 2) [m] as the points of a line in SVG."""
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in self.at(xy))

    def at(self, xy: Any) -> list[list[float]]:
        """Positions (n, 2) [m] in the drawing, whose y goes down."""
        rows, cols = self.grid.world_to_grid(*np.reshape(xy, (-1, 2)).T)
        positions = np.column_stack([cols * self.scale, self.height - rows * self.scale])
        return [[x, y] for x, y in positions.round(1).tolist()]


def bar(rate: Interval) -> dict[str, float]:
    """Both ends of an interval and its value, in per cent of a bar."""
    value, low, high = (100 * (bound if math.isfinite(bound) else 0.0) for bound in rate)
    return {"value": value, "low": low, "width": high - low}


def write_report(path: Path, check: Check, *related: Any) -> None:
    """Write the report, whole or not at all.

    Parameters
    ----------
    path : Path
        The file.
    check : Check
        The check; its names may hold any text.
    *about
        The folder of the files and the user's parameters, see `next_action`.
    """
    environment = load_templates("locplan.advice", autoescape=True, lstrip_blocks=True)
    environment.filters |= {"share": format_rate, "bar": bar, "problem": problem_text}
    n_routes = len(check.routes)
    text = environment.get_template("report.html").render(
        check=check,
        off=OFF,
        headline=headline(check),
        spots=[spot_text(spot, n_routes) for spot in check.spots if spot.letter],
        passage=passage_text(check.passage) if check.passage else "",
        fixes=fix_rows(check),
        settings=settings_texts(check),
        remaining=remaining_text(check),
        caption=caption(check),
        action=next_action(check, *related),
        drawing=(drawing := MapDrawing.from_map(check.site.world)),
        labels=place_labels(check, drawing.label),
        lost=[xy for route in check.routes for xy in drawing.at(route.lost_at)],
        stopped=[xy for route in check.routes for xy in drawing.at(route.stopped_at)],
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")
