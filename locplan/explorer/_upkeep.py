"""Keeping the field of a session up to date in the background: nearest to an edit first."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads
from locplan._util.progress import ProgressCallback
from locplan.costs import CellWindow, Costmap, changed_window, joined_windows
from locplan.errors import one_line
from locplan.explorer._asks import Cancel, Cancelled
from locplan.explorer._scene import Opening, Scene
from locplan.explorer._searches import Kept
from locplan.field import (
    CovarianceField,
    FieldConfig,
    finished_chunks,
    load_or_compute,
    untouched_points,
)
from locplan.maps import OccupancyGrid


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
        self.scene = Scene(self._floor(grid), None, True, 0)
        self._lane = ThreadPoolExecutor(1, "field")
        self._tiles = ThreadPoolExecutor(check_threads(opening.threads), "tiles")
        self._beginning = threading.Lock()
        self._cancel = Cancel()
        self._known: Patchwork | None = None
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

    def _floor(self, grid: OccupancyGrid) -> Costmap:
        """The blank costmap of a map, before there is a field."""
        return Costmap.blank(grid, robot=self.opening.robot)

    def _costmap_of(self, field: CovarianceField) -> Costmap:
        """The costmap of a field with the session's settings."""
        given = {"criterion": self.opening.criterion, "weight": self.opening.weight}
        radius = self.opening.robot.radius
        options: dict[str, Any] = {name: v for name, v in given.items() if v is not None}
        return Costmap.from_field(field.grid, field, robot=radius, **options)

    def _work(self, cancel: Cancel, given: CovarianceField | None) -> None:
        cancel.check()
        grid, config = self.grid, self.config
        known = None if self._known is None else self._known.field
        self.busy = 0, 0
        try:
            if known is None:
                if self.scene.costs.grid.digest != grid.digest:
                    self.show(self._floor(grid), None, whole=True)
            elif known.config == config or known.grid.digest != grid.digest:
                self._repaint(grid, cancel)  # an old field follows the map, too
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

    def _repaint(self, grid: OccupancyGrid, cancel: Cancel) -> None:
        """Bring the known field up to date with an edited map, and show it again and again.

        Of large maps no more costmaps than the one that is shown and the next one have room.
        """
        assert self._known is not None
        repainted = self._repainted(self._known.field, self._known.fresh, grid, cancel)
        for field, fresh, done in repainted:
            self.kept.forget()  # the new costmap needs the room
            self._known = self._known.updated(field, fresh, whole=done)
            if done and field.config == self.config:
                self.busy = None
            self.show(self._known.costs, field, whole=done)

    def _whole(
        self,
        grid: OccupancyGrid,
        config: FieldConfig,
        cancel: Cancel,
        given: CovarianceField | None,
    ) -> None:
        opening = self.opening
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
        costs = self._costmap_of(field)
        cancel.check()
        self._known = Patchwork(field, field.evaluated | field.lacking, costs)
        self.busy = None
        self.show(costs, field, whole=True)

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
        opening, config, before = self.opening, known.config, known.grid
        threads = check_threads(opening.threads)
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
        first = int(opening.limits.first_seconds * threads / seconds)
        size, at = max(opening.limits.min_points, first, int(unknown.sum())), 0
        while at < len(order):
            batch = np.zeros_like(due)
            batch.flat[order[at : at + size]] = True
            values = {name: array.copy() for name, array in values.items()}
            for array in values.values():
                array[batch] = np.nan

            def shifted(done: int, _: int, at: int = at) -> None:
                self._tell(min(at + done, len(order)), len(order))

            progress = cancel.watching(shifted)
            # Of a few points a part of the map is prepared, which their threads do by themselves.
            made = grid, config, threads, self._tiles if at == 0 else None, progress
            for _ in finished_chunks(values, *made, batch):
                cancel.check()
            fresh, at, size = fresh | batch, at + size, 4 * size
            field = CovarianceField.of(values, grid, config)
            yield field, fresh, at >= len(order)

    def _tell(self, done: int, total: int) -> None:
        if self.busy is not None:
            self.busy = done, total
        self.tell({"event": "progress", "do": "field", "done": done, "total": total})
        if (listener := self.listener) is not None:
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
