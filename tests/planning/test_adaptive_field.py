"""Fields that are fine near the paths planned on them, and coarse elsewhere."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from support.maps import random_rooms

from locplan.errors import ConfigError, FieldError
from locplan.field import CovarianceField, FieldConfig, Fisher, covariance_field, load_or_compute
from locplan.field.cache import format_cache_table, list_cache_entries
from locplan.field.lattice import fill_lacking_points, find_near_points, select_every_second_point
from locplan.maps import OccupancyGrid, environments, save_map
from locplan.planning import Costmap, path_metrics, plan
from locplan.planning.plans import plan_with_adaptive_field
from locplan.robots import Lidar

CONFIG = FieldConfig(Fisher(Lidar(range=3.0, beams=90, field_of_view_deg=270.0)), headings=4)
ENDS = (2.0, 3.0), (38.0, 3.0)


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def whole(grid) -> CovarianceField:
    return covariance_field(grid, CONFIG)


@pytest.fixture(scope="module")
def coarse(grid, whole) -> CovarianceField:
    return covariance_field(grid, CONFIG, points=select_every_second_point(whole.is_evaluated))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("stride", [1, 2, 3])
def test_skipped_lattice_points_have_selected_neighbour(seed, stride):
    grid = OccupancyGrid(random_rooms((61, 50), seed=seed), 0.1)
    needed = FieldConfig(stride=stride * 0.1).lattice_points(grid)
    chosen = select_every_second_point(needed)
    assert not (chosen & ~needed).any()
    rows, cols = np.nonzero(needed & ~chosen)
    around = np.pad(chosen, 1)
    assert all(around[r : r + 3, c : c + 3].any() for r, c in zip(rows, cols, strict=True))
    assert chosen[::2, ::2].sum() == needed[::2, ::2].sum()


def test_selection_keeps_quarter_of_open_space():
    assert select_every_second_point(np.ones((40, 60), bool)).sum() == 600


def test_lacking_points_are_read_bilinearly():
    row, col = np.mgrid[:9, :11].astype(float)
    plane = 3 * row - 2 * col + 0.5 * row * col
    known = np.zeros(plane.shape, bool)
    known[::2, ::2] = True
    read = fill_lacking_points(np.where(known, plane, np.nan), known, ~known)
    np.testing.assert_allclose(read, plane, atol=1e-12)


def test_near_points_equal_points_within_distance():
    points = np.random.default_rng(5).random((30, 40)) < 0.7
    cells = np.array([[12.0, 30.0], [70.0, 100.0]])
    rows, cols = 3 * np.mgrid[:30, :40]
    away = np.min([np.hypot(rows - r, cols - c) for r, c in np.rint(cells / 3) * 3], axis=0)
    np.testing.assert_array_equal(find_near_points(points, 3, cells, 14.0), points & (away <= 14.0))


def test_coarse_field_interpolates_skipped_points(grid, whole, coarse):
    """Evaluated points keep the values of the whole field."""
    points = select_every_second_point(whole.is_evaluated)
    np.testing.assert_array_equal(coarse.is_evaluated, points)
    np.testing.assert_array_equal(coarse.covariance[points], whole.covariance[points])
    np.testing.assert_array_equal(coarse.is_interpolated, whole.is_evaluated & ~points)
    read, known = coarse.e_map(), whole.e_map()
    np.testing.assert_array_equal(np.isnan(read), np.isnan(known))
    off = np.abs(np.log(read / known))[grid.free[:, :, None] & ~np.isnan(known)]
    assert np.median(off) < 0.1


def test_coarse_field_at_equals_e_map(grid, coarse):
    e_map = coarse.e_map()[:, :, 1]
    for row, col in np.argwhere(grid.free)[:: grid.free.sum() // 60]:
        x, y = grid.position(int(row), int(col))
        e = coarse.at((x, y, CONFIG.heading_angles[1]), "e")
        assert e == pytest.approx(e_map[row, col], rel=1e-6)


def test_whole_field_has_no_interpolated_points(whole):
    assert not whole.is_interpolated.any()


def test_saturated_share_ignores_point_density(grid, whole, coarse):
    points = coarse.is_evaluated.copy()
    points[:, : points.shape[1] // 3] |= whole.is_evaluated[:, : points.shape[1] // 3]
    finer = covariance_field(grid, CONFIG, points=points)
    assert 0 < coarse.saturated_share < 1
    assert finer.saturated_share == coarse.saturated_share


def test_adaptive_plan_matches_whole_field_plan(grid, whole):
    """The field has all points within 3 m of the path."""
    asked = []

    def field_of(points):
        asked.append(points)
        return covariance_field(grid, CONFIG, points=points)

    def planned(field):
        return plan(Costmap.from_field(field), *ENDS)

    field, found = plan_with_adaptive_field(
        grid, CONFIG, field_of, planned, lambda each: [each.path]
    )
    assert all((before <= after).all() for before, after in itertools.pairwise(asked))
    assert 2 <= len(asked) <= 4
    assert field.is_evaluated.sum() < 0.8 * whole.is_evaluated.sum()
    cells = np.stack(grid.world_to_grid(*found.path.resample(0.1).xy.T), axis=1) - 0.5
    beside = find_near_points(whole.is_evaluated, whole.stride, cells, 3.0)
    assert not (beside & ~field.is_evaluated).any()
    costs = Costmap.from_field(whole)
    best = plan(costs, *ENDS).metrics.cost
    assert path_metrics(costs, found.path).cost == pytest.approx(best, rel=0.01)


def test_adaptive_plan_stops_if_unreachable(grid, whole):
    """Without a path, there is nothing to refine."""
    fields = []

    def field_of(points):
        fields.append(covariance_field(grid, CONFIG, points=points))
        return fields[-1]

    field, _ = plan_with_adaptive_field(grid, CONFIG, field_of, lambda _: None, lambda _: [])
    assert len(fields) == 1
    assert field is fields[0]


def test_cache_computes_only_missing_points(grid, whole, coarse, tmp_path):
    """Cached values equal those of a fresh computation."""
    points, done = coarse.is_evaluated, []

    def count(now, total):
        done.append(total)

    first = load_or_compute(grid, CONFIG, points=points, cache_dir=tmp_path, progress=count)
    assert done[-1] == points.sum()
    more = points.copy()
    more[: len(more) // 2] |= whole.is_evaluated[: len(more) // 2]
    wider = load_or_compute(grid, CONFIG, points=more, cache_dir=tmp_path, progress=count)
    assert done[-1] == (more & ~points).sum()
    all_of_it = load_or_compute(grid, CONFIG, cache_dir=tmp_path, progress=count)
    assert done[-1] == (whole.is_evaluated & ~more).sum()
    again = load_or_compute(grid, CONFIG, points=points, cache_dir=tmp_path)
    for found, expected in ((first, coarse), (again, coarse), (all_of_it, whole)):
        np.testing.assert_array_equal(found.covariance, expected.covariance)
    np.testing.assert_array_equal(wider.is_evaluated, more)


def test_cache_lists_finished_share_of_field(grid, whole, coarse, tmp_path):
    load_or_compute(grid, CONFIG, points=coarse.is_evaluated, cache_dir=tmp_path)
    (entry,) = list_cache_entries(tmp_path)
    assert entry.finished_share == coarse.is_evaluated.sum() / whole.is_evaluated.sum()
    assert f" {entry.finished_share:.0%} " in format_cache_table([entry], tmp_path)
    load_or_compute(grid, CONFIG, cache_dir=tmp_path)
    assert [each.finished_share for each in list_cache_entries(tmp_path)] == [1.0]


def test_save_rejects_coarse_field(coarse, tmp_path):
    with pytest.raises(FieldError, match="some of its points only; compute all"):
        coarse.save(tmp_path / "part.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("points", [np.ones((3, 3), bool), np.ones((30, 200)), [[True]]])
def test_covariance_field_rejects_malformed_points_mask(grid, points):
    with pytest.raises(ConfigError, match="points must be an array of bool of the lattice's shape"):
        covariance_field(grid, CONFIG, points=points)


@pytest.mark.parametrize(
    ("options", "is_whole"),
    [
        ((), False),
        (("--planner", "RRTConnect:space=SE2,iterations=500"), False),
        (("--stride", 0.2), True),
    ],
)
def test_plan_stride_computes_whole_field(run, grid, tmp_path, monkeypatch, options, is_whole):
    """Without a stride, `plan` computes only the points near its paths."""
    save_map(grid, tmp_path / "map.yaml")
    heading = ",0" if "--planner" in options else ""
    ends = "--start", f"2,3{heading}", "--goal", f"38,3{heading}"
    lidar = "--lidar", "rplidar-a1", "--set", "range=3", "--field", "fisher", "--drives", 0
    monkeypatch.setenv("LOCPLAN_CACHE", str(tmp_path / "cache"))
    code, _, err = run("plan", tmp_path / "map.yaml", *ends, *lidar, *options)
    assert code == 0, err
    (entry,) = list_cache_entries(tmp_path / "cache")
    assert (entry.finished_share == 1.0) == is_whole
