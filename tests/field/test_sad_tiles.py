from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from support import oracles
from support.cases import sample_cases
from support.maps import random_rooms
from support.sad import PlainSad, count_mismatches

from locplan._support.kernels import simd
from locplan.field import OffsetLattice, Sad, SearchWindow
from locplan.field.estimator import MapPart
from locplan.field.kernels import bitplanes
from locplan.field.sad import Exponential, InverseSquare
from locplan.field.sad_tiles import (
    MapLayout,
    compute_short_scaling,
    find_disc_blocks,
    find_kept_lines,
)
from locplan.field.templates import make_disc_mask
from locplan.maps import FREE, load_map


def kept(layout, negligible):
    """The lines that are kept at all cells, (theta, n, dx)."""
    groups = layout.groups()
    cells, offsets = len(layout.part.rows), 2 * layout.window.half_steps + 1
    result = np.zeros((layout.window.angles.size, cells, offsets), bool)
    lines = find_kept_lines(layout, groups, negligible)
    for group, some in zip(groups, lines, strict=True):
        result[:, group.cells] = some
    return result


def write_cost_planes(cells, rows, cols, radius, window):
    part = MapPart.from_map(cells, np.array(rows), np.array(cols), window.resolution)
    return MapLayout.from_part(part, radius, window)


@pytest.mark.parametrize(
    ("radius", "edges", "step", "half_steps"),
    [(40, (32, 16), 2, 16), (61, (32, 16), 4, 3), (90, (32, 16), 3, 2), (181, (64, 32), 8, 2)],
)
@pytest.mark.parametrize("shift", sample_cases([1, 0]))
def test_kept_lines_equal_plain_loops(monkeypatch, radius, edges, step, half_steps, shift):
    cells = random_rooms((220, 190), seed=radius)
    window = OffsetLattice(0.05, step, half_steps, np.radians(25), 1)
    rows, cols = [110, 7, 113], [100, 180, 102]
    layout = write_cost_planes(cells, rows, cols, radius, window)
    exact = count_mismatches(layout)
    limit = int(np.quantile(exact.min(axis=2), 0.15)) >> shift
    monkeypatch.setattr("locplan.field.sad_tiles.compute_short_scaling", lambda _: (limit, shift))
    found = kept(layout, limit << shift)
    sizes = [
        [(*at, edge) for at in zip(*find_disc_blocks(radius, edge), strict=True)] for edge in edges
    ]
    for n in range(len(rows)):
        place = cells, rows[n], cols[n], radius, step, half_steps, window.angles
        np.testing.assert_array_equal(
            found[:, n], oracles.sad.keep_lines(*place, sizes, limit, shift)
        )
    assert 0 < found.mean() < 1


def compare_with_plain_sums(cells, rows, cols, radius, window, negligible):
    """Return the share of lines kept, having held the bound against the sums of all offsets."""
    layout = write_cost_planes(cells, rows, cols, radius, window)
    lines = kept(layout, negligible)
    exact = count_mismatches(layout)
    least = exact.min(axis=2).transpose(2, 0, 1)
    assert (least[~lines] > negligible).all()
    np.testing.assert_array_equal(
        count_mismatches(layout, kept=lines),
        np.where(lines.transpose(1, 2, 0)[:, :, None], exact, -1),
    )
    assert lines[window.half_rotations, :, window.half_steps].all()  # the zero lag's
    return lines.mean()


@pytest.mark.parametrize("seed", sample_cases(range(3)))
@pytest.mark.parametrize(("radius", "step"), [(60, 2), (120, 4), (200, 3)])
def test_rejection_respects_limit_on_random_maps(radius, step, seed):
    cells = random_rooms((300, 260), seed=seed, blocks=40)
    window = OffsetLattice(0.05, step, 6, np.radians(20), 2)
    rows, cols = np.random.default_rng(seed).integers(0, 260, (2, 6))
    shares = [
        compare_with_plain_sums(cells, rows, cols, radius, window, negligible)
        for negligible in (0, 1500, 10**6)
    ]
    assert shares == sorted(shares)
    assert shares[-1] == 1


REAL = [("nav2_depot", 10.0), ("willow_full_stage", 30.0), ("f1tenth_gym_stata_basement", 20.0)]


@pytest.mark.parametrize(
    ("name", "reach"), [*REAL[:2], pytest.param(*REAL[2], marks=pytest.mark.long)]
)
@pytest.mark.filterwarnings("ignore::locplan.maps.files.MapWarning")
def test_rejection_respects_limit_on_real_maps(real_maps, name, reach):
    grid = load_map(next((real_maps / name).glob("*.yaml")))
    estimator = Sad(range=reach)
    window, negligible = (
        estimator.window.to_lattice(grid.resolution),
        estimator.negligible_mismatch(grid.resolution),
    )
    free = np.argwhere(grid.free)
    rows, cols = free[np.random.default_rng(1).integers(len(free), size=6)].T
    radius = round(reach / grid.resolution - 0.5)
    share = compare_with_plain_sums(grid.cells, rows, cols, radius, window, negligible)
    assert share < 0.6
    part = MapPart.from_map(grid.cells, rows, cols, grid.resolution)
    compare_covariances(estimator, part)


def compare_covariances(estimator, part):
    found = estimator.covariances(part)["covariance"]
    plain = PlainSad(**{name: getattr(estimator, name) for name in ("range", "window", "weights")})
    expected = plain.covariances(part)["covariance"]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("resolution", "reach", "tau"),
    [
        *((0.1, 10.0, 0.57), (0.05, 10.0, 0.2), (0.02, 10.0, 0.57), (0.1, 12.0, 1e4)),
        (0.089, 10.0, 0.2),  # offsets lie between the lines that are counted
    ],
)
def test_rejection_does_not_change_covariance(resolution, reach, tau):
    cells = random_rooms((400, 380), seed=int(tau), blocks=60)
    window = SearchWindow(half_width=1.0, half_rotation_deg=20.0)
    estimator = Sad(range=reach, window=window, weights=Exponential(tau))
    limit = estimator.negligible_mismatch(resolution)
    assert (limit > simd.MAX_SHORT) == (resolution == 0.02 or tau > 1)
    rows, cols = np.array([200, 40, 207]), np.array([180, 370, 111])
    part = MapPart.from_map(cells, rows, cols, resolution)
    compare_covariances(estimator, part)
    together = estimator.covariances(part)["covariance"]
    for n in range(3):
        alone = replace(part, rows=rows[n : n + 1], cols=cols[n : n + 1])
        np.testing.assert_array_equal(estimator.covariances(alone)["covariance"][0], together[n])


def test_map_part_gives_same_covariance():
    cells = random_rooms((330, 340), seed=5, blocks=40)
    estimator = Sad(range=10.0, window=SearchWindow(half_width=0.4, step=0.1))
    reach = estimator.halo(0.1, cells.shape)
    rows, cols = np.array([160, 164]), np.array([170, 158])
    whole = MapPart.from_map(cells, rows, cols, 0.1)
    part = cells[160 - reach : 165 + reach, 158 - reach : 171 + reach]
    assert part.size < cells.size
    cut = replace(whole, levels=part, corner=(160 - reach, 158 - reach))
    found, expected = (estimator.covariances(each)["covariance"] for each in (cut, whole))
    np.testing.assert_array_equal(found, expected)


def test_rejection_depends_on_settings_and_resolution():
    assert Sad(range=10.0).negligible_mismatch(0.05) == int(40 * 0.57 * 2 / 0.05**2)
    for other in (
        Sad(range=9.99),
        Sad(range=10.0, template="visible"),
        Sad(range=10.0, weights=InverseSquare()),
        Sad.paper(range=20.0),
    ):
        assert other.negligible_mismatch(0.05) is None
    assert Sad(range=10.0).negligible_mismatch(0.2) is None  # a disc of few cells
    wide = Sad(range=10.0, window=SearchWindow(half_width=20.0))
    assert wide.negligible_mismatch(0.05) > Sad(range=10.0).negligible_mismatch(0.05)


def test_limits_are_scaled_to_16_bits():
    assert compute_short_scaling(18240) == (18240, 0)
    assert compute_short_scaling(65534) == (65534, 0)
    assert compute_short_scaling(65535) == (32767, 1)
    assert compute_short_scaling(131071) == (32767, 2)
    assert compute_short_scaling(10**9) == (10**9 >> 14, 14)
    for greatest in (2**16, 2**20 - 1, 2**20, 123456789):
        limit, shift = compute_short_scaling(greatest)
        assert limit < simd.MAX_SHORT
        assert limit << shift <= greatest < (limit + 1) << shift


@njit
def lanes_of_distances(counts, values, shift, limit):
    total = simd.zero_shorts()
    for value in values:
        total = simd.add_distances(total, counts, 3, value, shift)
    return simd.flag_small_lanes(total, limit)


@pytest.mark.parametrize("shift", [0, 3])
@pytest.mark.parametrize("number", [1, 7, 40])
def test_distance_sums_saturate_at_maximum(shift, number):
    rng = np.random.default_rng(number)
    counts = rng.integers(0, 2**16, 40).astype(np.uint16)
    values = rng.integers(0, 2**16, number).astype(np.uint16)
    distances = np.abs(counts[3:35].astype(int) - values[:, None].astype(int)) >> shift
    sums = np.minimum(distances.sum(axis=0), simd.MAX_SHORT)
    for limit in (0, int(np.median(sums)) - 1, int(np.median(sums)), 65534):
        found = lanes_of_distances(counts, values, shift, limit)
        assert [found >> lane & 1 for lane in range(64)] == [*(sums <= limit), *[0] * 32]


@pytest.mark.parametrize(("radius", "edge"), [(60, 16), (60, 32), (300, 64), (10, 64)])
def test_blocks_are_disjoint_inside_disc(radius, edge):
    rows, cols = find_disc_blocks(radius, edge)
    times = np.zeros((2 * radius + 1, 2 * radius + 1), int)
    for row, col in zip(rows, cols, strict=True):
        assert row % 8 == col % 8 == 0
        times[row : row + edge, col : col + edge] += 1
    assert times.sum() == len(rows) * edge**2
    assert times.max(initial=0) <= 1
    assert not times[~make_disc_mask(radius)].any()
    if radius > 4 * edge:
        assert times.sum() > 0.7 * make_disc_mask(radius).sum()


def test_block_counts_equal_plain_loops():
    plane = (random_rooms((50, 47), seed=9) == FREE).astype(np.uint8)
    octets = np.stack([plane | 128, (1 - plane) | 2])  # only the first bit counts
    table = np.full((2, 51, 48), 77, np.uint16)
    bitplanes.fill_summed_table(octets, table)
    counts = np.full((2, 12, 3, 6), 99, np.uint16)
    bitplanes.count_blocks(table, 5, 2, 16, 2, counts)
    for q, rest, p in np.ndindex(12, 3, 6):
        at = 5 + 2 * (3 * p + rest), 2 + 2 * q
        assert counts[0, q, rest, p] == oracles.sad.block_counts(plane, 16, *at)
        assert counts[1, q, rest, p] == oracles.sad.block_counts(1 - plane, 16, *at)


def test_block_counts_survive_table_overflow():
    """Sums of more than 16 bits wrap around."""
    octets = np.ones((2, 300, 300), np.uint8)
    table = np.empty((2, 301, 301), np.uint16)
    bitplanes.fill_summed_table(octets, table)
    assert table[0, 300, 300] == 90000 % 2**16
    counts = np.empty((2, 1, 1, 40), np.uint16)
    bitplanes.count_blocks(table, 0, 200, 64, 8, counts)
    assert counts[0, 0, 0, :30].tolist() == [64 * 64] * 30


def test_cells_are_nan_after_stop():
    cells = random_rooms((100, 100), seed=3)
    part = MapPart.from_map(cells, np.array([50, 54]), np.array([30, 30]), 0.1)
    stopped = replace(part, control=np.array([1, 0]))
    assert np.isnan(Sad(range=10.0).covariances(stopped)["covariance"]).all()
    assert kept(
        MapLayout.from_part(stopped, 100, Sad().window.to_lattice(0.1)), 0
    ).all()  # not asked at all
    control = np.zeros(2, np.int64)
    Sad(range=10.0).covariances(replace(part, control=control))
    assert control.tolist() == [0, 2]
