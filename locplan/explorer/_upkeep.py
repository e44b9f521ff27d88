"""Keeping the field of a session up to date in the background: nearest to an edit first."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads
from locplan._util.progress import ProgressCallback
from locplan.costs import CellWindow, Costmap, changed_window, joined_windows
from locplan.errors import one_line
from locplan.explorer._scene import Busy, Opening, Scene
from locplan.explorer._wire import Cancel, Cancelled
from locplan.field import (
    CovarianceField,
    FieldConfig,
    finished_chunks,
    load_or_compute,
    untouched_points,
)
from locplan.maps import OccupancyGrid

FIRST_SECONDS = 0.06
"""Time that the points nearest to an edit may take by the estimator's own estimate [s]."""
GROWTH = 4
"""Ratio of the numbers of points from one repainting to the next."""
MIN_POINTS = 64
"""Least number of points that are computed at once."""


@dataclass(frozen=True, eq=False)
class Patchwork:
    """A field of which some values may be those from before an edit."""

    field: CovarianceField
    """The field on the map of the last repainting."""
    fresh: NDArray[np.bool_]
    """Mask of the lattice points whose values are those of this map, (h, w)."""
    costs: Costmap
    """The costmap that was shown last."""
    stale: CellWindow | None = None
    """Window of it that was read from a field with values from before an edit; None without one."""

    def updated(
        self, field: CovarianceField, fresh: NDArray[np.bool_], *, whole: bool
    ) -> Patchwork:
        """The same with a field whose values are newer, and all up to date if it is whole."""
        edited = changed_window(self.costs.grid, field, self.costs.robot_radius)
        stale = joined_windows(self.stale, edited)
        costs = self.costs.updated(field, window=stale)
        return Patchwork(field, fresh, costs, None if whole else stale)


class Host(Protocol):
    """A session, as far as its upkeep knows it."""

    @property
    def opening(self) -> Opening:
        """What the session began with."""

    grid: OccupancyGrid
    config: FieldConfig
    busy: Busy | None
    scene: Scene

    def costmap_of(self, field: CovarianceField) -> Costmap:
        """The costmap of a field."""

    def show(self, costs: Costmap, field: CovarianceField | None, *, whole: bool) -> None:
        """Replace what is shown."""

    def make_room(self) -> None:
        """Drop what is kept of a scene that is replaced next."""

    def tell(self, event: dict[str, Any]) -> None:
        """Tell all pages of an event."""


class Upkeep:
    """A thread that computes what a session's map and settings ask for, the newest only."""

    def __init__(self, session: Host) -> None:
        self.session = session
        self._lane = ThreadPoolExecutor(1, "field")
        self._tiles = ThreadPoolExecutor(check_threads(session.opening.threads), "tiles")
        self._beginning = threading.Lock()
        self._cancel = Cancel()
        self._known: Patchwork | None = None
        self._latest: Future[None] | None = None
        self._closed = False
        self.listener: ProgressCallback | None = None

    def begin(self, known: CovarianceField | None = None) -> Future[None]:
        """Bring the field up to date; what is computed for an older state ends early."""
        with self._beginning:  # edits and settings come from threads of their own
            if self._closed:
                raise Cancelled
            self._cancel.cancel()
            self._cancel = cancel = Cancel()
            self._latest = self._lane.submit(self._work, cancel, known)
            return self._latest

    @property
    def latest(self) -> Future[None] | None:
        """The work that was begun last; None before any."""
        with self._beginning:
            return self._latest

    def close(self) -> None:
        """End the thread after its present step."""
        with self._beginning:
            self._closed = True
            self._cancel.cancel()
            for pool in (self._lane, self._tiles):
                pool.shutdown(wait=False, cancel_futures=True)

    def _work(self, cancel: Cancel, given: CovarianceField | None) -> None:
        session = self.session
        cancel.check()
        grid, config = session.grid, session.config
        known = None if self._known is None else self._known.field
        session.busy = Busy("field")
        try:
            if known is None:
                self._show_floor(grid)
            elif known.config == config or known.grid.digest != grid.digest:
                self._repaint(grid, cancel)  # an old field follows the map, too
            if known is None or known.config != config:
                self._whole(grid, config, cancel, given)
        except Cancelled:
            raise
        except Exception as error:
            if cancel.cancelled:  # such as a pool that was closed meanwhile
                raise Cancelled from None
            session.tell({"event": "error", "error": _in_one_line(error)})
            raise
        finally:
            if not cancel.cancelled:
                session.busy = None
                session.tell({"event": "state"})

    def _show_floor(self, grid: OccupancyGrid) -> None:
        """Show an edited map before there is a field."""
        session = self.session
        if session.scene.costs.grid.digest != grid.digest:
            radius = session.opening.robot.radius
            session.show(Costmap.blank(grid, robot_radius=radius), None, whole=True)

    def _repaint(self, grid: OccupancyGrid, cancel: Cancel) -> None:
        """Bring the known field up to date with an edited map, and show it again and again.

        Of large maps no more costmaps than the one that is shown and the next one have room.
        """
        session = self.session
        assert self._known is not None
        repainted = self._repainted(self._known.field, self._known.fresh, grid, cancel)
        for field, fresh, done in repainted:
            session.make_room()
            self._known = self._known.updated(field, fresh, whole=done)
            if done and field.config == session.config:
                session.busy = None
            session.show(self._known.costs, field, whole=done)

    def _whole(
        self,
        grid: OccupancyGrid,
        config: FieldConfig,
        cancel: Cancel,
        given: CovarianceField | None,
    ) -> None:
        session, opening = self.session, self.session.opening
        field = given
        if field is None:
            progress = cancel.watching(self._tell)
            field = load_or_compute(
                grid,
                config,
                cache_dir=opening.cache_dir,
                threads=opening.threads,
                progress=progress,
            )
        costs = session.costmap_of(field)
        cancel.check()
        self._known = Patchwork(field, field.evaluated | field.lacking, costs)
        session.busy = None
        session.show(costs, field, whole=True)

    def _repainted(
        self,
        known: CovarianceField,
        fresh: NDArray[np.bool_],
        grid: OccupancyGrid,
        cancel: Cancel,
    ) -> Iterator[tuple[CovarianceField, NDArray[np.bool_], bool]]:
        """The field on a new map, again and again while its values are computed.

        With each comes the mask of its points that are up to date, and whether all of them are.
        """
        config, threads = known.config, check_threads(self.session.opening.threads)
        before = known.grid
        fresh = fresh & untouched_points(before, grid, config)
        evaluated = config.lattice_points(grid)
        values = {name: array.copy() for name, array in known.values.items()}
        for array in values.values():
            array[~evaluated] = np.nan
        unknown = evaluated & ~known.evaluated
        due = evaluated & ~fresh
        if not due.any():
            yield CovarianceField.of(values, grid, config), fresh, True
            return
        order = nearest_first(due, unknown, before.cells != grid.cells, known.stride)
        seconds = config.headings * config.estimator.seconds(grid.resolution)
        size, at = max(MIN_POINTS, int(FIRST_SECONDS * threads / seconds)), 0
        size = max(size, int(unknown.sum()))
        while at < len(order):
            batch = np.zeros_like(due)
            batch.flat[order[at : at + size]] = True
            values = {name: array.copy() for name, array in values.items()}
            for array in values.values():
                array[batch] = np.nan
            progress = cancel.watching(_shifted(self._tell, at, len(order)))
            # Of a few points a part of the map is prepared, which their threads do by themselves.
            made = grid, config, threads, self._tiles if at == 0 else None, progress
            for _ in finished_chunks(values, *made, batch):
                cancel.check()
            fresh, at, size = fresh | batch, at + size, size * GROWTH
            field = CovarianceField.of(values, grid, config)
            yield field, fresh, at >= len(order)

    def _tell(self, done: int, total: int) -> None:
        busy = self.session.busy
        if busy is not None:
            busy.done, busy.total = done, total
        self.session.tell({"event": "progress", "do": "field", "done": done, "total": total})
        listener = self.listener
        if listener is not None:
            listener(done, total)


def nearest_first(
    due: NDArray[np.bool_], first: NDArray[np.bool_], changed: NDArray[np.bool_], stride: int
) -> NDArray[np.int64]:
    """Flat indices of the due lattice points (h, w): some first, then by distance to an edit.

    The edit is a mask of the map's cells (H, W).
    """
    import cv2

    rows, cols = np.nonzero(changed)
    apart = np.zeros(due.shape)
    if rows.size:
        far = np.ones(due.shape, np.uint8)
        at = ((index + stride // 2) // stride for index in (rows, cols))
        far[tuple(np.minimum(i, n - 1) for i, n in zip(at, due.shape, strict=True))] = 0
        apart = np.asarray(cv2.distanceTransform(far, cv2.DIST_L2, cv2.DIST_MASK_5), float)
    apart[first] = -1.0
    flat = np.flatnonzero(due)
    return flat[np.argsort(apart.flat[flat], kind="stable")]


def _shifted(progress: ProgressCallback, before: int, total: int) -> ProgressCallback:
    """A callback for a part of some work."""

    def update(done: int, _: int) -> None:
        progress(min(before + done, total), total)

    return update


def _in_one_line(error: Exception) -> str:
    return one_line(" ".join(str(error).split()) or type(error).__name__)
