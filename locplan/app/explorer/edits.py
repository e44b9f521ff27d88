"""Changes to the map by strokes, and to the settings of its field."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
from collections.abc import Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.checks import MAX_RANGE, number
from locplan._support.files import make_folder
from locplan._support.kernels.arrays import Octets
from locplan.advice.landmark_objects import Pole, Shape, cells_under
from locplan.app.explorer.requests import Ask, Cancelled
from locplan.app.explorer.scene import Limits
from locplan.app.explorer.session import Session
from locplan.errors import ConfigError
from locplan.field.config import SHORT_LIDAR, FieldConfig
from locplan.maps.files import save_map
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.robots.lidar import LIDARS, Lidar

if TYPE_CHECKING:
    from locplan.app.explorer.requests import Work


@dataclass(frozen=True, eq=False)
class Patch:
    """A window of the map before and after an edit."""

    rows: slice
    """Rows of the window."""
    cols: slice
    """Columns of the window."""
    before: Octets
    """Its cells before."""
    after: Octets
    """Its cells after."""

    @property
    def bytes(self) -> int:
        """Bytes of its cells."""
        return self.before.nbytes + self.after.nbytes


@dataclass(frozen=True)
class Stroke:
    """One use of a tool."""

    tool: str
    """The tool: "wall" and "erase" follow the points, a "pole" stands at the first one."""
    points: Sequence[tuple[float, float]]
    """Positions in the world [m]."""
    width: float
    """Breadth of a line, or diameter of a pole [m]."""

    @classmethod
    def read(cls, ask: Ask) -> Stroke:
        """Read a stroke from its message."""
        tool = ask.one_of("tool", ("wall", "erase", "pole"), None)
        points = ask.positions("points", 5000)
        if tool is None or not points:
            raise ConfigError("a stroke needs a tool and at least one point")
        return cls(tool, tuple(points), number("width", ask.values.get("width"), 0.001, 20.0))


def edit(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Draw strokes into the map, as one change to undo."""
    strokes = [Stroke.read(each) for each in ask.items("strokes", 500)]
    with session.changing:
        patch = drawn(session.grid, strokes)
        if patch is not None:
            session.edits = last_ones([*session.edits, patch], session.opening.limits)
            session.undone = []
            _apply(session, patch, patch.after)
    return {"changed": patch is not None}


def last_ones(patches: list[Patch], limits: Limits) -> list[Patch]:
    """The last of some changes: as many as can be undone."""
    sizes = itertools.accumulate(patch.bytes for patch in reversed(patches))
    count = sum(size <= limits.undo_bytes for size in sizes)
    return patches[-min(max(count, 1), limits.undo) :]


def step(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Undo the last change, or redo the one that was undone last."""
    back = ask.do == "undo"
    with session.changing:
        taken, given = (session.edits, session.undone)[:: 1 if back else -1]
        if not taken:
            raise ConfigError(f"there is no edit to {ask.do}")
        patch = taken.pop()
        given.append(patch)
        _apply(session, patch, patch.before if back else patch.after)
    return {"changed": True}


def save(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Save the map under the session's folder, which the command line names."""
    name, folder = ask.text("name", ""), session.opening.folder
    if folder is None:
        raise ConfigError("name a folder for files with --output, then maps can be saved")
    stem = name.strip().removesuffix(".yaml").strip()
    plain = all(c.isalnum() or c in "-_. " for c in stem)
    if not plain or stem.startswith(".") or not stem.strip(". "):
        raise ConfigError("a map's name has letters, digits, spaces, - and _ only")
    target = folder / f"{stem}.yaml"
    with session.changing:  # two pages may save one name at once
        for file in (target, target.with_suffix(".pgm")):
            if os.path.lexists(file) and not (session.opening.force or target in session.written):
                raise ConfigError(f"{file.name} is there already; choose another name")
        make_folder(folder)
        grid = session.grid
        save_map(grid, target)
        session.saved = grid
        session.written.add(target)
    session.tell({"event": "state"})
    return {"name": target.name, "folder": str(folder)}


def drawn(grid: OccupancyGrid, strokes: Sequence[Stroke]) -> Patch | None:
    """The change that strokes make to a map; None if they change no cell."""
    cells = grid.cells.copy()
    for stroke in strokes:
        if stroke.tool == "pole":
            pose = np.array([*stroke.points[0], 0.0])
            cells[cells_under(grid, Pole(stroke.width), pose)] = OCCUPIED
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


def _draw_line(cells: Octets, grid: OccupancyGrid, stroke: Stroke) -> None:
    """Fill the cells whose centres a line covers, or those that it crosses where it is thin."""
    level = OCCUPIED if stroke.tool == "wall" else FREE
    half = max(stroke.width / 2, math.sqrt(0.5) * grid.resolution)
    ends = np.column_stack(grid.world_to_grid(*np.array(stroke.points).T))
    for one, other in itertools.pairwise(ends if len(ends) > 1 else [*ends, *ends]):
        middle, way = (one + other) / 2, other - one
        line = Shape(grid.resolution * float(np.hypot(*way)) / 2, 0.0, is_round=False)
        window, apart = line.distances(grid, np.array([*middle, math.atan2(*way)]), half)
        cells[window][apart <= half + 1e-9] = level


def _apply(session: Session, patch: Patch, window: Octets) -> None:
    """Put a window's cells into the session's map, and bring its field up to date."""
    cells = session.grid.cells.copy()
    cells[patch.rows, patch.cols] = window
    session.grid = dataclasses.replace(session.grid, cells=cells)
    session.tell({"event": "state"})
    session.begin()


def config_of(session: Session, ask: Ask) -> FieldConfig:
    """The settings of a field that are asked for; what is not given stays as it is.

    Raises
    ------
    ConfigError
        If a value is unknown or out of its range.
    """
    now = session.config
    preset = ask.one_of("lidar", LIDARS, None)
    reach = ask.number("range", 0.1, MAX_RANGE, None)
    # Where none is named the present lidar stays; null says that there is none.
    present = None if "lidar" in ask.values else session.lidar
    lidar = Lidar.preset(preset) if preset else present
    estimator: Any = now.estimator
    asked: dict[str, Any] = {} if reach is None else {"range": reach}
    if estimator.casts_rays:
        lidar = lidar or dataclasses.replace(SHORT_LIDAR, model="no lidar named, one assumed")
        estimator = estimator.with_lidar(dataclasses.replace(lidar, **asked))
    elif lidar is None:
        estimator = dataclasses.replace(estimator, **asked)
    elif preset or asked:
        estimator = estimator.with_lidar(dataclasses.replace(lidar, **asked))
    return FieldConfig(estimator, stride=now.stride, headings=now.headings)


def configure(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Compute the field with other settings; the old one stays until it is there."""
    config, before = config_of(session, ask), session.config
    work.cancel.check()
    session.config = config
    try:
        _await_field(session, work)
    except BaseException:
        session.config = before
        session.begin()
        raise
    return {"ok": True}


def _await_field(session: Session, work: Work) -> None:
    """Begin to compute the field, and wait for it, also where edits begin that anew."""
    session.listener = work.progress
    try:
        task = session.begin()
        while True:
            try:
                return task.result()
            except (Cancelled, CancelledError):
                latest = session.latest
                if work.cancel.cancelled or latest is None or latest is task:
                    raise Cancelled from None
                task = latest  # an edit came in between
    finally:
        session.listener = None
