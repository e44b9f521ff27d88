"""Changes to the map: strokes that are drawn, undone, redone, and saved."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import number
from locplan._util.files import make_folder
from locplan._util.poses import window_around
from locplan.errors import ConfigError
from locplan.explorer._session import Session
from locplan.explorer._wire import Ask
from locplan.landmarks import Box, Pole, cells_under
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, save_map

if TYPE_CHECKING:
    from locplan.explorer._asks import Work

TOOLS = ("wall", "erase", "pole", "box")
MAX_STROKES, MAX_POINTS = 500, 5000
MAX_WIDTH = 20.0
"""Greatest breadth of a stroke [m]."""
MAX_UNDO = 200
"""Greatest number of edits that can be undone."""
UNDO_BYTES = 64e6
"""Bytes of cells that are kept for undoing; the last edit can be undone whatever it takes."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A window of the map before and after an edit."""

    rows: slice
    """Rows of the window."""
    cols: slice
    """Columns of the window."""
    before: NDArray[np.uint8]
    """Its cells before."""
    after: NDArray[np.uint8]
    """Its cells after."""

    @property
    def bytes(self) -> int:
        """Bytes of its cells."""
        return self.before.nbytes + self.after.nbytes

    def limits(self, grid: OccupancyGrid) -> list[float]:
        """Least and greatest x and y of the window in the world, x0, y0, x1, y1 [m]."""
        rows = [self.rows.start, self.rows.stop, self.rows.start, self.rows.stop]
        cols = [self.cols.start, self.cols.start, self.cols.stop, self.cols.stop]
        x, y = grid.grid_to_world(rows, cols)
        return [float(x.min()), float(y.min()), float(x.max()), float(y.max())]


@dataclass(frozen=True)
class Stroke:
    """One use of a tool."""

    tool: str
    """The tool: "wall" and "erase" follow the points, "pole" and "box" stand at the first one."""
    points: Sequence[tuple[float, float]]
    """Positions in the world [m]."""
    size: tuple[float, float]
    """Breadth of a line, or diameter of a pole, twice; length and breadth of a box [m]."""
    heading: float = 0.0
    """Heading of a box, counter-clockwise from x [rad]."""

    @classmethod
    def read(cls, ask: Ask) -> Stroke:
        """Read a stroke from its message."""
        tool = ask.one_of("tool", TOOLS)
        points = ask.positions("points", MAX_POINTS)
        if tool is None or not points:
            raise ConfigError("a stroke needs a tool and at least one point")
        given = ask.values.get("width")
        both = given if isinstance(given, list) and len(given) == 2 else [given, given]
        length, breadth = (number("width", each, 0.001, MAX_WIDTH) for each in both)
        turn = ask.number("heading", -1e3, 1e3, 0.0) or 0.0
        return cls(tool, tuple(points), (length, breadth), turn)


def edit(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Draw strokes into the map, as one change to undo."""
    strokes = [Stroke.read(each) for each in ask.items("strokes", MAX_STROKES)]
    with session.changing:
        patch = drawn(session.grid, strokes)
        if patch is None:
            return {"changed": []}
        history = session.history
        history.before = last_ones([*history.before, patch])
        history.undone = []
        _apply(session, patch, patch.after)
    return {"changed": [patch.limits(session.grid)]}


def last_ones(patches: list[Patch]) -> list[Patch]:
    """The last of some changes: as many as can be undone."""
    first, left = len(patches) - 1, UNDO_BYTES - patches[-1].bytes
    while first > 0 and len(patches) - first < MAX_UNDO and patches[first - 1].bytes <= left:
        first -= 1
        left -= patches[first].bytes
    return patches[first:]


def undo(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Take the last change back."""
    with session.changing:
        return _step(session, session.history.before, session.history.undone, "undo")


def redo(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Make the last change again that was undone."""
    with session.changing:
        return _step(session, session.history.undone, session.history.before, "redo")


def _step(session: Session, taken: list[Any], given: list[Any], do: str) -> dict[str, Any]:
    """Move the last change from one list of changes to the other, and apply it."""
    if not taken:
        raise ConfigError(f"there is no edit to {do}")
    patch = taken.pop()
    given.append(patch)
    _apply(session, patch, patch.before if do == "undo" else patch.after)
    return {"changed": [patch.limits(session.grid)]}


def save(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Save the map under the session's folder, which the command line names."""
    name = ask.text("name")
    if session.folder is None:
        raise ConfigError("name a folder for files with --folder, then maps can be saved")
    stem = "" if name is None else name.strip().removesuffix(".yaml").strip()
    plain = all(c.isalnum() or c in "-_. " for c in stem)
    if not plain or stem.startswith(".") or not stem.strip(". "):
        raise ConfigError("a map's name has letters, digits, spaces, - and _ only")
    target = session.folder / f"{stem}.yaml"
    with session.changing:  # two pages may save one name at once
        for file in (target, target.with_suffix(".pgm")):
            if os.path.lexists(file) and not session.force and target not in session.written:
                raise ConfigError(f"{file.name} is there already; choose another name")
        make_folder(session.folder)
        grid = session.grid
        save_map(grid, target)
        session.saved, session.saved_as = grid, str(target)
        session.written.add(target)
    session.tell({"event": "state"})
    return {"name": target.name, "folder": str(session.folder)}


def drawn(grid: OccupancyGrid, strokes: Sequence[Stroke]) -> Patch | None:
    """The change that strokes make to a map; None if they change no cell."""
    cells = grid.cells.copy()
    for stroke in strokes:
        if stroke.tool in ("pole", "box"):
            kind: Pole | Box = Pole(stroke.size[0]) if stroke.tool == "pole" else Box(*stroke.size)
            pose = np.array([*stroke.points[0], stroke.heading])
            cells[cells_under(grid, kind, pose)] = OCCUPIED
        else:
            _draw_line(cells, grid, stroke)
    changed = cells != grid.cells
    if not changed.any():
        return None
    rows, cols = (
        slice(int(at[0]), int(at[-1]) + 1)
        for at in (np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0)))
    )
    return Patch(rows, cols, grid.cells[rows, cols].copy(), cells[rows, cols].copy())


def _draw_line(cells: NDArray[np.uint8], grid: OccupancyGrid, stroke: Stroke) -> None:
    """Fill the cells whose centres a line covers, or those that it crosses where it is thin."""
    level = OCCUPIED if stroke.tool == "wall" else FREE
    rows, cols = grid.world_to_grid(*np.array(stroke.points).T)
    half = max(stroke.size[0] / 2 / grid.resolution, math.sqrt(0.5))
    ends = list(zip(rows.tolist(), cols.tolist(), strict=True))
    for (row0, col0), (row1, col1) in zip(ends, ends[1:] or ends, strict=False):
        middle = (row0 + row1) / 2, (col0 + col1) / 2
        reach = half + math.hypot(row1 - row0, col1 - col0) / 2 + 1
        window = window_around(*middle, reach, grid.shape)
        y = np.arange(window[0].start, window[0].stop)[:, None] + 0.5 - row0
        x = np.arange(window[1].start, window[1].stop) + 0.5 - col0
        dy, dx = row1 - row0, col1 - col0
        long = dx * dx + dy * dy
        share = np.clip((x * dx + y * dy) / long, 0.0, 1.0) if long else 0.0
        near = np.hypot(x - share * dx, y - share * dy) <= half + 1e-9
        cells[window][near] = level


def _apply(session: Session, patch: Patch, window: NDArray[np.uint8]) -> None:
    """Put a window's cells into the session's map, and bring its field up to date."""
    cells = session.grid.cells.copy()
    cells[patch.rows, patch.cols] = window
    grid = session.grid
    session.replace_grid(OccupancyGrid(cells, grid.resolution, grid.origin, grid.name))
    session.tell({"event": "state"})
    session.upkeep.begin()
