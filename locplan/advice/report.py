"""Report of a check: one self-contained HTML page, rendered from `templates`."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from locplan._support.files import write_text
from locplan._support.intervals import Interval, format_rate
from locplan._support.output import replace_file
from locplan._support.public import load_templates
from locplan.advice.check_result import Check
from locplan.advice.figures import SIZE, caption_text, crop_to_free, place_labels
from locplan.advice.next_step import choose_next_action, describe_remaining_failures
from locplan.advice.text import (
    headline_sentences,
    make_fix_rows,
    passage_text,
    problem_text,
    settings_sentences,
    spot_text,
)
from locplan.maps.figures import downsample
from locplan.maps.grid import OccupancyGrid
from locplan.simulation.drives import LOST_TEXT

GREYS = np.array([40, 190, 255], np.uint8)
"""Shades of occupied, unknown and free."""


class MapDrawing(NamedTuple):
    """The map as an image, with the transform of positions onto it."""

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
        """Draw the known part of a map along its rows and columns."""
        import cv2

        grid = crop_to_free(grid)
        image = GREYS[downsample(grid.cells)[::-1] // 127]
        data = base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()
        scale = 900 / max(grid.shape)  # the longer side in the drawing's units
        size = grid.shape[1] * scale, grid.shape[0] * scale
        return cls(f"data:image/png;base64,{data}", *size, grid, scale)

    @property
    def label_size(self) -> float:
        """Size of a label [m]."""
        return SIZE * max(self.grid.shape) * self.grid.resolution

    def format_points(self, xy: Any) -> str:
        """Return positions (n, 2) [m] as the points of an SVG polyline."""
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in self.convert_to_drawing(xy))

    def convert_to_drawing(self, xy: Any) -> list[list[float]]:
        """Return positions (n, 2) [m] in units of the drawing, y downwards."""
        rows, cols = self.grid.world_to_grid(*np.reshape(xy, (-1, 2)).T)
        positions = np.column_stack([cols * self.scale, self.height - rows * self.scale])
        return [[x, y] for x, y in positions.round(1).tolist()]


def compute_bar_percentages(rate: Interval) -> dict[str, float]:
    """Return value, lower end and width of an interval in per cent, for a bar."""
    value, low, high = (100 * (bound if math.isfinite(bound) else 0.0) for bound in rate)
    return {"value": value, "low": low, "width": high - low}


def write_report(path: Path, check: Check, *related_results: Any) -> None:
    """Write the report, whole or not at all.

    Parameters
    ----------
    path : Path
        The file.
    check : Check
        The check.
    *related_results
        The folder of the files and the user's parameters, see `choose_next_action`.
    """
    environment = load_templates("locplan.advice", autoescape=True, lstrip_blocks=True)
    environment.filters |= {
        "share": format_rate,
        "bar": compute_bar_percentages,
        "problem": problem_text,
    }
    text = environment.get_template("report.html").render(
        check=check,
        off=LOST_TEXT,
        headline=headline_sentences(check),
        spots=[spot_text(spot) for spot in check.spots if spot.letter],
        passage=passage_text(check.passage) if check.passage else "",
        fixes=make_fix_rows(check),
        settings=settings_sentences(check),
        remaining=describe_remaining_failures(check),
        caption=caption_text(check),
        action=choose_next_action(check, *related_results),
        drawing=(drawing := MapDrawing.from_map(check.scenario.world)),
        labels=place_labels(check, drawing.label_size),
        lost=[xy for route in check.routes for xy in drawing.convert_to_drawing(route.lost_at)],
        stopped=[
            xy for route in check.routes for xy in drawing.convert_to_drawing(route.stopped_at)
        ],
    )
    with replace_file(path) as temporary:
        write_text(temporary, text, errors="replace")
