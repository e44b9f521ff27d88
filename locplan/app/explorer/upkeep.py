"""Keeping the field of a session up to date in the background: nearest to an edit first."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from locplan._support.checks import check_threads
from locplan._support.kernels.arrays import Bools, Ints
from locplan._support.progress import ProgressCallback
from locplan.app.explorer.requests import Cancel, Cancelled
from locplan.app.explorer.scene import Opening, Scene
from locplan.app.explorer.searches import Kept
from locplan.errors import one_line
from locplan.field.compute import finished_chunks
from locplan.field.config import FieldConfig
from locplan.field.field import CovarianceField
from locplan.field.store import load_or_compute
from locplan.field.tiles import untouched_points
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import CellWindow, Costmap, changed_window, joined_windows


class Upkeep:
    """A map with its field and costs, and a thread that brings them up to date, the newest only.

    A scene is replaced as a whole, so that what works on one has it from the beginning to the end.
    """

    def __init__(self, grid: OccupancyGrid, opening: Opening) -> None:
        self.opening = opening
        self.original = self.grid = grid
        self.config = opening.config
        self.kept = Kept(opening.limits.kept_bytes)
        self.busy: tuple[int, int] | None = None
        """Steps done and all steps of the field that is computed; 0 of 0 before they are known."""
        self.changing = threading.RLock()
        self.listeners: list[Callable[[dict[str, Any]], None]] = []
        self.scene = Scene(Costmap.blank(grid, robot=opening.robot), None, True, 0)
        self._lane = ThreadPoolExecutor(1, "field")
        self._tiles = ThreadPoolExecutor(check_threads(opening.threads), "tiles")
        self._beginning = threading.Lock()
        self._cancel = Cancel()
        self._known: CovarianceField | None = None
        self._fresh = np.zeros((0, 0), bool)
        """Mask of the known field's points whose values are those of its map, (h, w)."""
        self._stale: CellWindow | None = None
        """Window of the costmap that was read from values of before an edit; None without one."""
        self._latest: Future[None] | None = None
        self._closed = False
        self.listener: ProgressCallback | None = None

    def begin(self, known: CovarianceField | None = None) -> Future[None]:
        """Bring the field up to date; what is computed for an older state ends early.

        Parameters
        ----------
        known : CovarianceField, optional
            A field of the map and the settings that is there already.
        """
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

    def show(self, costs: Costmap, field: CovarianceField | None, *, whole: bool) -> None:
        """Replace the scene, and tell all pages.

        Parameters
        ----------
        costs : Costmap
            The costs that pages show.
        field : CovarianceField or None
            The field that they are made of; None before there is one.
        whole : bool
            Whether the field has all its places.
        """
        with self.changing:
            serial = self.scene.serial + 1
            self.scene = Scene(costs, field, whole, serial)
        self.kept.forget(lambda key: key[1] == serial)
        self.tell({"event": "state"})

    def tell(self, event: dict[str, Any]) -> None:
        """Tell all pages of an event.

        Parameters
        ----------
        event : dict
            The event, fit for JSON.
        """
        for listener in list(self.listeners):
            listener(event)

    def _work(self, cancel: Cancel, given: CovarianceField | None) -> None:
        cancel.check()
        grid, config = self.grid, self.config
        known = self._known
        self.busy = 0, 0
        try:
            if known is None:
                if self.scene.costs.grid.digest != grid.digest:
                    self.show(Costmap.blank(grid, robot=self.opening.robot), None, whole=True)
            elif known.config == config or known.grid.digest != grid.digest:
                self._repaint(known, grid, cancel)  # an old field follows the map, too
            if known is None or known.config != config:
                self._whole(grid, config, cancel, given)
        except Cancelled:
            raise
        except Exception as error:
            if cancel.cancelled:  # such as a pool that was closed meanwhile
                raise Cancelled from None
            text = one_line(" ".join(str(error).split()) or type(error).__name__)
            self.tell({"event": "error", "error": text})
            raise
        finally:
            if not cancel.cancelled:
                self.busy = None
                self.tell({"event": "state"})

    def _whole(
        self,
        grid: OccupancyGrid,
        config: FieldConfig,
        cancel: Cancel,
        given: CovarianceField | None,
    ) -> None:
        """Compute the field with other settings, unless it is given, and show it."""
        opening, field = self.opening, given
        if field is None:
            how: Any = {"cache_dir": opening.cache_dir, "threads": opening.threads}
            field = load_or_compute(grid, config, progress=cancel.watching(self._tell), **how)
        settings: Any = {"criterion": opening.criterion, "weight": opening.weight}
        costs = Costmap.from_field(field.grid, field, robot=opening.robot, **settings)
        cancel.check()
        self._known, self._fresh, self._stale = field, field.evaluated | field.lacking, None
        self.busy = None
        self.show(costs, field, whole=True)

    def _repaint(self, known: CovarianceField, grid: OccupancyGrid, cancel: Cancel) -> None:
        """Bring the known field up to date with an edited map, and show it again and again.

        Of large maps no more costmaps than the one that is shown and the next one have room.
        """
        opening, config, before = self.opening, known.config, known.grid
        threads = check_threads(opening.threads)
        fresh = self._fresh & untouched_points(before, grid, config)
        evaluated, values = config.lattice_points(grid), known.values
        due, unknown = evaluated & ~fresh, evaluated & ~known.evaluated
        order = nearest_first(due, unknown, before.cells != grid.cells, known.stride)
        seconds = config.headings * config.estimator.seconds(grid.resolution)
        first = int(opening.limits.first_seconds * threads / seconds)
        size, at = max(opening.limits.min_points, first, int(unknown.sum())), 0
        while True:
            batch = np.zeros_like(evaluated)
            batch.flat[order[at : at + size]] = True
            values = {name: array.copy() for name, array in values.items()}
            for array in values.values():
                array[batch | ~evaluated] = np.nan

            def shifted(done: int, _: int, at: int = at) -> None:
                self._tell(min(at + done, len(order)), len(order))

            progress = cancel.watching(shifted)
            # Of a few points a part of the map is prepared, which their threads do by themselves.
            made = grid, config, threads, self._tiles if at == 0 else None, progress
            for _ in finished_chunks(values, *made, batch):
                cancel.check()
            fresh, at, size = fresh | batch, at + size, 4 * size
            whole = at >= len(order)
            field = CovarianceField.of(values, grid, config)
            self.kept.forget()  # the new costmap needs the room
            costs = self.scene.costs
            edited = changed_window(costs.grid, field, costs.robot_radius)
            stale = joined_windows(self._stale, edited)
            costs = costs.updated(field, window=stale)
            self._known, self._fresh, self._stale = field, fresh, None if whole else stale
            if whole and config == self.config:
                self.busy = None
            self.show(costs, field, whole=whole)
            if whole:
                return

    def _tell(self, done: int, total: int) -> None:
        if self.busy is not None:
            self.busy = done, total
        self.tell({"event": "progress", "do": "field", "done": done, "total": total})
        if (listener := self.listener) is not None:
            listener(done, total)


def nearest_first(due: Bools, first: Bools, changed: Bools, stride: int) -> Ints:
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
