"""Posteriors of simulated scans."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage, stats
from support import oracles
from support.cases import sample_cases
from support.maps import corridor, random_rooms

from locplan._support.kernels import likelihood, posterior as scan
from locplan._support.kernels.lidar import LidarBeams, write_scan_ends
from locplan._support.kernels.likelihood import TOP
from locplan._support.kernels.rays import compute_empty_squares
from locplan.field import FieldConfig, OffsetLattice, Sad, Scan, SearchWindow
from locplan.field.beams import find_wall_surface_cells
from locplan.field.estimator import MapPart
from locplan.field.scan import make_likelihood_field
from locplan.maps import FREE, OCCUPIED, UNKNOWN
from locplan.robots import Lidar as Settings

SIGMA_HIT, Z_RAND, TEMPERATURE = 0.1, 0.05, 0.1


def all_round(beams):
    return 2 * np.pi * (np.arange(beams) + 0.5) / beams


def cast_ends(levels, row, col, angles, reach):
    """Where beams from a cell's centre end, (beam, 2) [cells]."""
    ends = np.empty((len(angles), 2))
    all_of_them = LidarBeams(np.asarray(angles, float), 0.0, 0.0, 0.0, 0.03, 0.0, float(reach))
    squares = compute_empty_squares(levels == OCCUPIED)
    write_scan_ends(squares, 1.0, row + 0.5, col + 0.5, 0.0, all_of_them, ends)
    return ends


def scans(levels, rows, cols, angles, reach):
    """The same from many cells, (n, beam, 2)."""
    return np.array([cast_ends(levels, *at, angles, reach) for at in zip(rows, cols, strict=True)])


def run(levels, resolution, window, rows, cols, ends, *, temperature=TEMPERATURE, **of_field):
    """Posteriors of the scans with ends (n, beam, 2)."""
    field = make_likelihood_field(
        levels, resolution, window.step_cells, window.half_steps, **of_field
    )
    lattice = likelihood.make_scan_lattice(window.half_steps, window.angles)
    weights = likelihood.make_weight_tables(temperature * field.nats, ends.shape[1] * TOP)
    shape = len(rows), 1
    result = scan.LatticePosteriors(
        np.empty((*shape, 3)), np.empty((*shape, 3, 3)), np.empty(shape), np.empty(shape)
    )
    costs = np.empty_like(lattice.empty)
    for n, at in enumerate(zip(rows, cols, strict=True)):
        moments = result.mean[n, 0], result.covariance[n, 0]
        result.entropy[n, 0], result.ambiguity[n, 0] = scan.compute_posterior(
            field, lattice, weights, *at, ends[n], costs, *moments
        )
    return result


def kernel_costs(field, window, row, col, ends):
    """Costs of one scan, (theta, dy, dx)."""
    lattice = likelihood.make_scan_lattice(window.half_steps, window.angles)
    costs = lattice.empty.copy()
    scan.score_scan(field, lattice, row, col, ends, costs)
    planes = costs.reshape(len(window.angles), -1, lattice.width)
    assert (planes[:, lattice.offsets :] >= likelihood.NOWHERE).all()
    assert (planes[:, :, lattice.offsets :] >= likelihood.NOWHERE).all()
    return planes[:, : lattice.offsets, : lattice.offsets]


def lattice_costs(values, half_steps):
    """Costs (theta, dy, dx) as the kernel has them, with the lattice they belong to."""
    lattice = likelihood.make_scan_lattice(half_steps, np.zeros(len(values)))
    costs = lattice.empty.copy()
    costs.reshape(len(values), -1, lattice.width)[:, : lattice.offsets, : lattice.offsets] = values
    return lattice, costs


def mode_of(lattice, costs, excess):
    words = costs.size // 64
    bits = np.empty((4, words + 2 * (lattice.plane // 64 + 2)), np.uint64)
    mode = scan.find_central_mode(lattice, costs, excess, bits)[:words]
    inside = np.unpackbits(mode.view(np.uint8), bitorder="little").astype(bool)
    planes = inside.reshape(lattice.cos.size, -1, lattice.width)
    return planes[:, : lattice.offsets, : lattice.offsets]


@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.25])
def test_likelihood_costs_follow_wall_distances(resolution):
    levels, step = random_rooms((23, 31), seed=3, blocks=6), 3
    field = make_likelihood_field(levels, resolution, step, 2)
    planes = field.costs[: step * step * field.plane].reshape(step, step, -1, field.width)
    rows, cols = step * planes.shape[2], step * planes.shape[3]
    margins = [
        (-field.first, size + field.first - n)
        for size, n in zip((rows, cols), levels.shape, strict=True)
    ]
    solid = find_wall_surface_cells(levels == OCCUPIED)
    squared = ndimage.distance_transform_edt(np.pad(1 - solid, margins, constant_values=1)) ** 2
    exact = -np.log((1 - Z_RAND) * np.exp(-squared * resolution**2 / 0.02) + Z_RAND) / field.nats
    costs = planes.transpose(2, 0, 3, 1).reshape(rows, cols)
    assert abs(costs - exact).max() <= 0.5 + 1e-6
    assert (costs == 0).sum() == solid.sum()
    edges, window = costs.copy(), 2 * 2 * step + 1  # of all offsets of an endpoint
    edges[window:-window, window:-window] = TOP
    assert (edges == TOP).all()


@pytest.mark.parametrize("level", [FREE, OCCUPIED, UNKNOWN])
def test_wall_surface_cells_equal_oracle(level):
    levels = random_rooms((23, 31), seed=4, blocks=6)
    levels[5:13, 20:28] = level
    assert [
        tuple(at) for at in np.argwhere(find_wall_surface_cells(levels == OCCUPIED))
    ] == oracles.scan.walls(levels)


def test_unknown_space_painted_black_changes_little():
    levels = np.full((200, 200), UNKNOWN, np.uint8)
    closed_bay(levels, 80, 90)
    window = FieldConfig().estimator.window.to_lattice(0.05)
    ends = cast_ends(levels, 95, 103, all_round(180), 120)[None]
    thin = run(levels, 0.05, window, [95], [103], ends)
    thick = run(np.where(levels == FREE, FREE, OCCUPIED), 0.05, window, [95], [103], ends)
    np.testing.assert_allclose(thick.covariance, thin.covariance, rtol=0.05, atol=1e-3)


@pytest.mark.parametrize(
    ("step", "half_steps", "rotations", "beams"),
    [(1, 1, 0, 3), (1, 5, 1, 40), (3, 2, 2, 17), (4, 10, 1, 16), (7, 16, 0, 9), (2, 20, 0, 7)],
)
def test_scan_costs_equal_plain_loops(step, half_steps, rotations, beams):
    rng = np.random.default_rng(step * 100 + half_steps)
    levels = random_rooms((19, 26), seed=step, blocks=9)
    window = OffsetLattice(0.05, step, half_steps, math.radians(35), rotations)
    field = make_likelihood_field(levels, 0.05, step, half_steps)
    ends = rng.normal(0, 12, (beams, 2))
    ends[::5] = np.nan
    ends[1] = 900.0, -1e5  # far off the map
    table = likelihood.tabulate_costs(0.05, SIGMA_HIT, Z_RAND)

    def cost(squared):
        return table[int(min(squared, table.size - 1))]

    for row, col in ((0, 0), (18, 3), (9, 25)):
        expected = oracles.scan.score(levels, row, col, ends, step, half_steps, window.angles, cost)
        np.testing.assert_array_equal(kernel_costs(field, window, row, col, ends), expected)


def test_posterior_approximates_exact_likelihood():
    """Costs are rounded to whole steps."""
    window = OffsetLattice(0.05, 2, 3, math.radians(20), 2)
    field = make_likelihood_field(levels := random_rooms((40, 50), seed=8), 0.05, 2, 3)
    row, col = np.argwhere(levels == FREE)[300]
    ends = np.random.default_rng(8).normal(0, 15, (40, 2))
    beams = len(ends)
    losses = oracles.scan.score(
        levels, row, col, ends, 2, 3, window.angles,
        lambda squared: oracles.scan.loss(squared, 0.05, SIGMA_HIT, Z_RAND),
    )  # fmt: skip
    costs = kernel_costs(field, window, row, col, ends)
    assert abs(costs * field.nats - losses).max() <= beams * field.nats / 2
    mode = oracles.scan.find_central_mode(losses * TEMPERATURE, -math.log(scan.CONNECTED))
    expected = oracles.scan.moments(losses * TEMPERATURE, mode)
    result = run(levels, 0.05, window, [row], [col], ends[None])
    for name, value in zip(scan.LatticePosteriors._fields, expected, strict=True):
        np.testing.assert_allclose(getattr(result, name)[0, 0], value, rtol=0.01, atol=0.01)


@pytest.mark.parametrize("temperature", [0.001, 0.1, 1.0, 30.0])
@pytest.mark.parametrize(("headings", "half_steps"), [(1, 1), (3, 5), (13, 10), (5, 20)])
def test_posterior_moments_equal_plain_loops(temperature, headings, half_steps):
    rng = np.random.default_rng(headings)
    offsets = 2 * half_steps + 1
    values = rng.integers(0, 9000, (headings, offsets, offsets), np.uint32)
    values[0, 0, 0] = 8_000_000  # 2,000 beams without a match
    lattice, costs = lattice_costs(values, half_steps)
    nats = temperature * -math.log(Z_RAND) / TOP
    weights = likelihood.make_weight_tables(nats, 8_190_000)
    mode = np.zeros(costs.size // 64 + 1, np.uint64)
    mean, covariance = np.empty(3), np.empty((3, 3))
    entropy, outside = scan.compute_moments(lattice, weights, costs, mode, mean, covariance)
    expected = oracles.scan.moments(values * nats, np.zeros(values.shape, bool))
    np.testing.assert_allclose(mean, expected[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(covariance, expected[1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(entropy, expected[2], rtol=1e-9, atol=1e-9)
    assert outside == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(("headings", "half_steps"), [(1, 1), (1, 16), (3, 5), (13, 10), (5, 20)])
@pytest.mark.parametrize("share", sample_cases([0.2, 0.5, 0.1, 1.0], 2))
def test_central_mode_equals_plain_search(headings, half_steps, share):
    rng = np.random.default_rng(headings + half_steps)
    offsets = 2 * half_steps + 1
    high = rng.random((headings, offsets, offsets)) > share
    values = np.where(high, 700, 600).astype(np.uint32)
    lattice, costs = lattice_costs(values, half_steps)
    excess = 650.0 - values[headings // 2, half_steps, half_steps]
    excess = max(excess, 0.0)
    expected = oracles.scan.find_central_mode(values.astype(float), excess)
    np.testing.assert_array_equal(mode_of(lattice, costs, excess), expected)


def test_posterior_is_uniform_without_returns():
    for config in (FieldConfig(), FieldConfig(Sad(window=SearchWindow(half_rotation_deg=0.0)))):
        window = config.estimator.window.to_lattice(0.05)
        ends = np.full((1, 180, 2), np.nan)
        result = run(np.full((9, 9), FREE, np.uint8), 0.05, window, [4], [4], ends)
        steps = np.array([window.step, window.step, window.rotation_step])
        covariance = result.covariance[0, 0] * np.outer(steps, steps)
        uniform = np.zeros((3, 3))
        uniform[: window.dimension, : window.dimension] = window.uniform_covariance
        np.testing.assert_allclose(covariance, uniform, rtol=1e-15)
        assert (result.mean == 0).all()
        assert result.entropy[0, 0] == math.log(21 * 21 * window.angles.size)
        assert result.ambiguity[0, 0] == 0


def test_posterior_is_uniform_without_walls():
    window = FieldConfig().estimator.window.to_lattice(0.05)
    ends = np.random.default_rng(0).normal(0, 50, (1, 2000, 2))
    result = run(np.full((9, 9), FREE, np.uint8), 0.05, window, [4], [4], ends)
    assert result.entropy[0, 0] == math.log(5733)
    assert result.ambiguity[0, 0] == 0


def test_quarter_turn_turns_posterior():
    levels = random_rooms((120, 120), seed=21)
    window = OffsetLattice(0.05, 4, 6, math.radians(10), 3)
    row, col = next(at for at in np.argwhere(levels == FREE) if abs(at - 60).max() < 15)
    ends = cast_ends(levels, row, col, all_round(24), 60)
    # x, y becomes -y, x; rows are y, so that numpy's quarter turn has the other sense.
    turned = np.ascontiguousarray(np.rot90(levels, -1))
    turned_ends = np.stack([-ends[:, 1], ends[:, 0]], axis=1)
    before = run(levels, 0.05, window, [row], [col], ends[None])
    after = run(turned, 0.05, window, [col], [119 - row], turned_ends[None])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    expected = turn @ before.covariance[0, 0] @ turn.T
    np.testing.assert_allclose(after.covariance[0, 0], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(after.mean[0, 0], turn @ before.mean[0, 0], atol=1e-9)
    np.testing.assert_allclose(after.entropy, before.entropy, rtol=1e-12)
    np.testing.assert_allclose(after.ambiguity, before.ambiguity, atol=1e-12)
    assert np.linalg.det(expected) > 0


def test_corridor_has_single_mode_along_axis():
    grid = corridor(30.0, 2.0, resolution=0.05)
    window = FieldConfig().estimator.window.to_lattice(0.05)
    row, col = grid.cell((0.0, 0.0))
    ends = cast_ends(grid.cells, row, col, all_round(180), 6.0 / 0.05)
    result = run(grid.cells, 0.05, window, [row], [col], ends[None])
    along, across, heading = np.diag(result.covariance[0, 0])
    assert along == pytest.approx((21**2 - 1) / 12, rel=0.01)
    assert across < 0.01
    assert heading < 0.01
    assert result.ambiguity[0, 0] < 1e-4


def closed_bay(levels, row, col):
    """A room of 1.2 m x 1.4 m with a corner of its own, drawn at 0.05 m."""
    levels[row - 1 : row + 29, col - 1 : col + 25] = OCCUPIED
    levels[row : row + 28, col : col + 24] = FREE
    levels[row : row + 9, col : col + 5] = OCCUPIED


def test_identical_bays_share_probability():
    window = FieldConfig().estimator.window.to_lattice(0.05)
    levels, entropies = np.full((150, 250), UNKNOWN, np.uint8), []
    for bays, offset in ((1, 0), (2, 32), (3, -32)):  # 1.6 m apart
        closed_bay(levels, 60, 100 + offset)
        ends = cast_ends(levels, 75, 113, all_round(180), 120)
        assert np.isfinite(ends).all()
        result = run(levels, 0.05, window, [75], [113], ends[None])
        assert result.ambiguity[0, 0] == pytest.approx(1 - 1 / bays, abs=0.001)
        entropies.append(result.entropy[0, 0])
    np.testing.assert_allclose(np.subtract(entropies, entropies[0]), np.log([1, 2, 3]), atol=0.01)


def test_peak_tail_is_not_ambiguous():
    k, j, i = np.mgrid[-6:7, -10:11, -10:11]
    for deviation in (0.3, 1.0, 1.5):
        losses = (i**2 + j**2 + k**2) / (2 * deviation**2)
        mode = oracles.scan.find_central_mode(losses, -math.log(scan.CONNECTED))
        assert oracles.scan.moments(losses, mode)[3] < 0.005


def asymmetric_room():
    """5 m x 3 m at 0.01 m, with a corner of its own and a pillar; walls 0.01 m thick."""
    solid = np.full((360, 560), OCCUPIED, np.uint8)
    solid[30:330, 30:530] = FREE
    solid[30:110, 30:90] = OCCUPIED
    solid[230:260, 390:430] = OCCUPIED
    behind = ~ndimage.binary_dilation(solid == FREE, np.ones((3, 3)))
    return np.where(behind, UNKNOWN, solid).astype(np.uint8)


@pytest.mark.parametrize(("x", "y"), [(150, 160), (280, 120), (460, 180)])
def test_posterior_predicts_error_of_scan_matching(x, y):
    levels, beams, sigma = asymmetric_room(), 32, 0.02
    window = OffsetLattice(0.01, 1, 12, math.radians(0.5), 6)
    angles = all_round(beams)
    ends = cast_ends(levels, y, x, angles, 200)
    field = make_likelihood_field(levels, 0.01, 1, 12, sigma_hit=sigma)
    # Of the noise that there is, and without a temperature: what it says is the whole truth.
    result = run(levels, 0.01, window, [y], [x], ends[None], temperature=1.0, sigma_hit=sigma)
    rng, matched = np.random.default_rng(1), []
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for _ in range(300):
        noisy = ends + along * rng.normal(0, sigma / 0.01, (beams, 1))
        costs = kernel_costs(field, window, y, x, noisy)
        k, j, i = np.unravel_index(costs.argmin(), costs.shape)
        matched.append((i - 12, j - 12, k - 6))
    ratio = np.sqrt(np.diag(result.covariance[0, 0])) / np.std(matched, axis=0)
    assert (ratio > 0.8).all()
    assert (ratio < 1.4).all()


def test_map_part_gives_same_posterior():
    levels = random_rooms((300, 320), seed=5)
    config = FieldConfig(Sad(range=1.5, window=SearchWindow(half_width=0.8)))
    window = config.estimator.window.to_lattice(0.05)
    rows, cols = np.array([150, 156, 160]), np.array([150, 171, 159])
    halo = 30 + 16 + likelihood.compute_likelihood_reach(0.05, SIGMA_HIT, Z_RAND) + 1
    ends = scans(levels, rows, cols, all_round(60), 30)
    whole = run(levels, 0.05, window, rows, cols, ends)
    top, left = 150 - halo, 150 - halo
    part = levels[top : 161 + halo, left : 172 + halo]
    cut = run(np.ascontiguousarray(part), 0.05, window, rows - top, cols - left, ends)
    for one, other in zip(whole, cut, strict=True):
        np.testing.assert_array_equal(one, other)


def test_many_beams_do_not_overflow():
    levels = np.full((60, 60), FREE, np.uint8)
    levels[30, 30] = OCCUPIED
    window = OffsetLattice(0.05, 1, 2, math.radians(10), 1)
    field = make_likelihood_field(levels, 0.05, 1, 2)
    ends = np.full((2000, 2), 25.0)  # as far from the only occupied cell as may be
    assert (kernel_costs(field, window, 30, 30, ends) == 2000 * TOP).all()


def test_end_noise_follows_van_der_corput():
    quantiles = [oracles.beams.radical_inverse(b + 1) for b in range(90)]
    assert quantiles[:5] == [1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8]
    halton = stats.qmc.Halton(1, scramble=False).random(91)[1:, 0]
    np.testing.assert_array_equal(halton, quantiles)
    ahead = Settings(range=5.0, field_of_view_deg=180.0, beams=180)
    left = Scan(ahead).end_deviations[90:]
    np.testing.assert_allclose(left, stats.norm.ppf(quantiles), rtol=1e-12, atol=1e-15)
    few = Scan(ahead, max_beams=41).end_deviations[20:]
    np.testing.assert_array_equal(few, left[:20])
    own = Scan(replace(ahead, beams=41)).end_deviations[
        20:
    ]  # 4.5 deg apart, which divide a quarter
    np.testing.assert_array_equal(own, left[:21])
    many = stats.norm.cdf(Scan(replace(ahead, beams=2046), max_beams=2046).end_deviations[1023:])
    np.testing.assert_allclose(np.sort(many), np.arange(1, 1024) / 1024, rtol=1e-9)


@pytest.mark.parametrize("beams", [180, 72, 44, 4, 3, 1])
def test_symmetric_beams_have_equal_noise(beams):
    """A mirror or a quarter turn exchanges these beams."""
    ahead = Scan(Settings(range=5.0, field_of_view_deg=200.0, beams=beams)).end_deviations
    np.testing.assert_array_equal(ahead, ahead[::-1])
    around = Scan(Settings(range=5.0, beams=beams)).end_deviations
    np.testing.assert_array_equal(around, around[::-1])
    if beams % 4 == 0:
        np.testing.assert_array_equal(around, np.roll(around, beams // 4))
        assert len(np.unique(around)) == math.ceil(beams / 8)


@pytest.mark.parametrize(("beams", "counted"), [(1600, 360), (360, 360), (90, 88), (4, 4), (3, 3)])
def test_all_round_lidar_compares_whole_quarters(beams, counted):
    """Then a quarter turn takes each beam to another."""
    assert Scan(Settings(range=5.0, beams=beams)).beams_compared == counted


BEAMS = Settings(
    range=1.6, min_range=0.25, field_of_view_deg=200.0, beams=47,
    mount_x=0.11, mount_y=-0.06, mount_yaw_deg=25.0,
)  # fmt: skip


def covariance_in_plain_loops(scan_, levels, resolution, row, col, heading):
    """Sigma + Q, ambiguity and entropy of one pose."""
    window, yaw, half = scan_.lattice(resolution), 25, 100  # [deg], of BEAMS
    pitch = 90 // (scan_.max_beams // 2)  # [deg]
    shift, growth = scan_.endpoint_noise
    angles, noise = [], []
    for side in (-1, 1):
        for number in range(1, 180 // pitch + 1):
            bearing = side * (number - 0.5) * pitch
            if abs(bearing - yaw) <= half:
                angles.append(math.radians(bearing - yaw))
                z = stats.norm.ppf(oracles.beams.radical_inverse(number))
                noise.append((shift * z, growth * z))
    assert len(angles) == scan_.beams_compared
    pose, sigma = (row + 0.5, col + 0.5, heading), max(scan_.sigma_hit, resolution)
    ends = oracles.beams.moved_ends(levels, resolution, *pose, scan_.lidar, angles, noise)
    table = likelihood.tabulate_costs(resolution, sigma, scan_.z_rand)
    nats = -math.log(scan_.z_rand) / TOP
    losses = oracles.scan.score(
        levels, row, col, ends, window.step_cells, window.half_steps, window.angles,
        lambda squared: nats * table[int(min(squared, table.size - 1))],
    ) * (scan_.effective_beams * pitch / 180)  # fmt: skip
    mode = oracles.scan.find_central_mode(losses, -math.log(scan.CONNECTED))
    _, in_steps, entropy, ambiguity = oracles.scan.moments(losses, mode)
    covariance = scan_.noise_level * in_steps * np.outer(window.steps, window.steps)
    covariance += np.diag(window.steps**2 / 12)
    return covariance[: window.dimension, : window.dimension], ambiguity, entropy


@pytest.mark.parametrize("resolution", [0.05, 0.15])
@pytest.mark.parametrize("noise", [(0.0, 0.0), (0.06, 0.02)])
@pytest.mark.parametrize("half_rotation_deg", [20.0, 0.0])
def test_scan_covariance_equals_plain_loops(resolution, noise, half_rotation_deg):
    """On coarse maps sigma is a cell, and the steps are whole cells."""
    window = SearchWindow(half_width=0.3, step=0.1, half_rotation_deg=half_rotation_deg)
    scan_ = Scan(
        BEAMS, window=window, endpoint_noise=noise, max_beams=31, effective_beams=8.0,
        sigma_hit=0.08, noise_level=1.3, z_rand=0.1,
    )  # fmt: skip
    levels, headings = random_rooms((22, 26), seed=9), np.array([0.4, 2.9])
    rows, cols = np.argwhere(levels == FREE)[[90, 150]].T
    part = MapPart(levels, rows, cols, resolution, (22, 26), headings=headings)
    found = scan_.covariances(part)
    for n, k in np.ndindex(2, 2):
        expected = covariance_in_plain_loops(
            scan_, levels, resolution, rows[n], cols[n], headings[k]
        )
        assert found["covariance"][n, k] == pytest.approx(expected[0], rel=1e-9, abs=1e-12)
        assert found["ambiguity"][n, k] == pytest.approx(expected[1], abs=1e-9)
        assert found["entropy"][n, k] == pytest.approx(expected[2], rel=1e-9)
    assert np.ptp(found["entropy"]) > 0.1  # the poses see something, and not the same


def test_compared_beams_span_field_of_view():
    for beams, in_quarter in ((10, 4), (180, 81), (361, 90), (1081, 90)):
        lidar = Settings(range=5.0, field_of_view_deg=200.0, beams=beams, mount_yaw_deg=10.0)
        settings, pitch = Scan(lidar), 90 / in_quarter
        bearings = np.degrees(
            settings.make_kernel_lidar().angles + settings.make_kernel_lidar().yaw
        )
        np.testing.assert_allclose(np.diff(bearings), pitch, rtol=1e-9)
        assert bearings[0] - pitch < -90.0 <= bearings[0] + 1e-6
        assert bearings[-1] - 1e-6 <= 110.0 < bearings[-1] + pitch
        own = np.degrees(lidar.angles[settings.nearest_beam_indices]) + 10.0
        assert abs(own - bearings).max() <= np.degrees(np.diff(lidar.angles)[0]) / 2 + 1e-5


def test_scan_keeps_widely_spaced_beams():
    """`Scan` compares all beams that are at least 1 deg apart."""
    for width, beams in ((179.0, 180), (180.0, 181), (180.0, 61)):
        lidar = Settings(range=5.0, field_of_view_deg=width, beams=beams, mount_yaw_deg=-0.5)
        settings = Scan(lidar)
        np.testing.assert_array_equal(settings.nearest_beam_indices, np.arange(beams))
        np.testing.assert_array_equal(settings.make_kernel_lidar().angles, lidar.angles)
        assert settings.temperature == pytest.approx(min(1.0, 12.6 / 180 * width / (beams - 1)))
