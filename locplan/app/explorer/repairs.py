"""Computation of scenes. After a change, the points nearest to it are computed first."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import Executor

import numpy as np

from locplan._support.checks import check_threads
from locplan._support.kernels.arrays import Bools, Ints
from locplan._support.progress import ProgressCallback
from locplan.app.explorer.scene import MapScene, StartSettings
from locplan.app.explorer.sites import ExploredSite
from locplan.field.compute import compute_missing_chunks
from locplan.field.field import CovarianceField
from locplan.field.store import load_or_compute
from locplan.field.tiles import find_unchanged_points
from locplan.planning.costmap import Costmap, find_changed_window, join_windows

STEPS = itertools.count(1)
"""Counter of repair steps."""


def make_blank_scene(site: ExploredSite) -> MapScene:
    """Return the scene of a site without a field."""
    return MapScene(site, Costmap.blank(site.grid, robot=site.robot, zones=site.zones))


def compute_scene(
    site: ExploredSite,
    start_settings: StartSettings,
    progress: ProgressCallback,
    field: CovarianceField | None = None,
) -> MapScene:
    """Return the scene of a site, with its field computed or read from the cache.

    Parameters
    ----------
    site : Site
        The site.
    start_settings : Opening
        The settings of the session.
    progress : callable
        Called with (done, total) points.
    field : CovarianceField, optional
        Field of the site, if it is already known.
    """
    if field is None:
        field = load_or_compute(
            site.grid,
            site.config,
            cache_dir=start_settings.cache_dir,
            threads=start_settings.threads,
            progress=progress,
        )
    return MapScene(
        site,
        _make_costs(site, field, start_settings),
        field,
        field.is_evaluated | field.is_interpolated,
    )


def repair_scene(
    scene: MapScene,
    site: ExploredSite,
    start_settings: StartSettings,
    pool: Executor,
    progress: ProgressCallback,
    free_memory: Callable[[], None],
) -> Iterator[MapScene]:
    """Yield scenes of a changed site, each with more updated values, until all are.

    Parameters
    ----------
    scene : Scene
        A scene before the change, with a field of the same settings.
    site : Site
        The changed site.
    start_settings : Opening
        The settings of the session.
    pool : Executor
        Threads of the first step, which must be fast.
    progress : callable
        Called with (done, total) points.
    free_memory : callable
        Called before each new costmap: large maps have room for only two costmaps.
    """
    before, fresh = scene.field, scene.fresh
    assert before is not None
    assert fresh is not None
    grid, config = site.grid, site.config
    threads = check_threads(start_settings.threads)
    evaluated, values = config.lattice_points(grid), before.values
    fresh = fresh & find_unchanged_points(before.grid, grid, config)
    unknown = evaluated & ~before.is_evaluated
    changed = before.grid.cells != grid.cells
    order = sort_nearest_first(evaluated & ~fresh, unknown, changed, before.stride)
    seconds = config.headings * config.estimator.seconds(grid.resolution)
    first = int(start_settings.limits.first_seconds * threads / seconds)
    size, at = max(start_settings.limits.min_points, first, int(unknown.sum())), 0
    while True:
        batch = np.zeros_like(evaluated)
        batch.flat[order[at : at + size]] = True
        values = {name: array.copy() for name, array in values.items()}
        for array in values.values():
            array[batch | ~evaluated] = np.nan

        def report(n_done: int, _: int, at: int = at) -> None:
            progress(min(at + n_done, len(order)), len(order))

        # A few points need only a part of the map, which their threads prepare.
        executor = pool if at == 0 else None
        for _ in compute_missing_chunks(values, grid, config, threads, executor, report, batch):
            pass
        fresh, at, size = fresh | batch, at + size, 4 * size
        is_last = at >= len(order)
        field = CovarianceField.from_values(values, grid, config)
        free_memory()
        stale = join_windows(
            scene.stale, find_changed_window(scene.costs.grid, field, scene.costs.robot_radius)
        )
        if scene.site.zones == site.zones:
            costs = scene.costs.update(field, window=stale)
        else:
            costs = _make_costs(site, field, start_settings)
        step = 0 if is_last else next(STEPS)
        scene = MapScene(site, costs, field, fresh, step, None if is_last else stale)
        yield scene
        if is_last:
            return


def _make_costs(
    site: ExploredSite, field: CovarianceField, start_settings: StartSettings
) -> Costmap:
    return Costmap.from_field(
        field, weight=start_settings.weight, robot=site.robot, zones=site.zones
    )


def sort_nearest_first(is_due: Bools, is_urgent: Bools, is_changed: Bools, stride: int) -> Ints:
    """Return the flat indices of due lattice points, those nearest to changed cells first.

    Parameters
    ----------
    is_due : (h, w) array of bool
        Lattice points to sort.
    is_urgent : (h, w) array of bool
        Points that come before all others.
    is_changed : (H, W) array of bool
        The changed cells of the map.
    stride : int
        Cells between two lattice points.
    """
    import cv2

    rows, cols = np.nonzero(is_changed)
    distance = np.zeros(is_due.shape)
    if rows.size:
        far = np.ones(is_due.shape, np.uint8)
        at = ((index + stride // 2) // stride for index in (rows, cols))
        far[tuple(np.minimum(i, n - 1) for i, n in zip(at, is_due.shape, strict=True))] = 0
        distance = np.asarray(cv2.distanceTransform(far, cv2.DIST_L2, cv2.DIST_MASK_5), float)
    distance[is_urgent] = -1.0
    flat = np.flatnonzero(is_due)
    return flat[np.argsort(distance.flat[flat], kind="stable")]
