import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import oracles
from support.cases import sample_cases
from support.maps import random_rooms
from support.sad import count_mismatches

from locplan.field import OffsetLattice, Sad, SearchWindow, sad
from locplan.field.estimator import MapPart
from locplan.field.kernels import bitplanes, sad as kernel
from locplan.field.sad import Exponential, InverseSquare
from locplan.field.sad_tiles import MapLayout
from locplan.field.templates import cut_template, make_disc_mask, read_levels
from locplan.maps import FREE, OCCUPIED, UNKNOWN, load_map
from locplan.paper.template_matching import compute_sad_distribution


def compare(cells, rows, cols, radius, window, *, visible=False):
    rows, cols = np.array(rows), np.array(cols)
    part = MapPart.from_map(cells, rows, cols, window.resolution)
    result = sad.LEVEL_STEP * count_mismatches(
        MapLayout.from_part(part, radius, window), visible=visible
    )
    for n in range(len(rows)):
        expected = compute_sad_distribution(
            cells, rows[n], cols[n], radius, window, visible=visible
        )
        np.testing.assert_array_equal(result[n], expected)


@pytest.mark.parametrize("step", [1, 2, 3, 4, 5, 7, 8, 10])
@pytest.mark.parametrize("radius", [1, 4, 13, 32])
def test_kernel_equals_reference(step, radius):
    cells = random_rooms((90, 71), seed=step * 100 + radius)
    half_steps = 12 // step + 1
    window = OffsetLattice(0.05, step, half_steps, np.radians(20), 2)
    compare(cells, [45, 0, 89, 20, 46], [30, 0, 70, 69, 31], radius, window)


@pytest.mark.parametrize("step", [1, 3, 4])
@pytest.mark.parametrize("radius", [1, 13, 32])
def test_kernel_equals_reference_for_visible_templates(step, radius):
    cells = random_rooms((90, 71), seed=step * 100 + radius)
    window = OffsetLattice(0.05, step, 12 // step + 1, np.radians(20), 2)
    compare(cells, [45, 0, 89, 20, 46], [30, 0, 70, 69, 31], radius, window, visible=True)


@pytest.mark.parametrize("level", [FREE, OCCUPIED])
def test_kernel_equals_reference_for_large_disc(level):
    """The disc has more than 64 squares."""
    cells = random_rooms((700, 640), seed=17)
    cells[:, 300:420] = level  # runs that are longer than a word of bits
    window = OffsetLattice(0.05, 7, 1, np.radians(15), 1)
    compare(cells, [350, 357], [320, 334], 300, window)


@pytest.mark.parametrize("half_steps", [1, 11, 12, 13])
def test_kernel_supports_any_offset_count(half_steps):
    """The count need not be a multiple of the vector's length."""
    window = OffsetLattice(0.05, 2, half_steps, np.radians(45), 1)
    compare(random_rooms((64, 64), seed=7), [30, 34, 38], [10, 14, 22], 9, window)


@pytest.mark.parametrize("level", [FREE, UNKNOWN, OCCUPIED])
def test_kernel_equals_reference_on_uniform_maps(level):
    """The discs are larger than the map."""
    window = OffsetLattice(0.05, 2, 3, np.radians(30), 2)
    compare(np.full((5, 9), level, np.uint8), [0, 4], [0, 8], 20, window)
    compare(np.full((1, 1), level, np.uint8), [0], [0], 3, window)


@pytest.mark.parametrize("template", ["disc", "visible"])
def test_map_part_gives_same_covariance(template):
    cells = random_rooms((120, 130), seed=5)
    window = SearchWindow(half_width=0.4, step=0.1)
    estimator = Sad(range=0.6, window=window, template=template)
    reach = estimator.halo(0.05, cells.shape)
    rows, cols = np.array([60, 64]), np.array([70, 58])
    whole = MapPart.from_map(cells, rows, cols, 0.05)
    part = cells[60 - reach : 65 + reach, 58 - reach : 71 + reach]
    corner = (60 - reach, 58 - reach)
    cut = replace(whole, levels=part, corner=corner)
    found, expected = (estimator.covariances(each)["covariance"] for each in (cut, whole))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", ["nav2_depot", "willow_full_stage", "webots_tb3_example"])
@pytest.mark.filterwarnings("ignore::locplan.maps.files.MapWarning")
def test_kernel_equals_reference_on_real_maps(real_maps, name):
    grid = load_map(next((real_maps / name).glob("*.yaml")))
    window = Sad().window.to_lattice(grid.resolution)
    free = np.argwhere(grid.free)
    chosen = free[np.random.default_rng(0).integers(len(free), size=3)]
    radius = Sad(range=6.0).template_radius(grid.resolution, grid.shape)
    compare(grid.cells, *chosen.T, radius, window)
    compare(grid.cells, *chosen[:1].T, radius, window, visible=True)


def weighted_covariance(counts, weight_of_count, kept, places):
    """Covariance of counts (dx, theta, dy rounded up) by the kernel."""
    result = np.empty((3, 3))
    given = counts.reshape(-1), weight_of_count, np.array(places, float), len(counts), kept
    kernel.write_covariance(*given, result)
    return result


@pytest.mark.parametrize("places", [range(5), (0.25, 1.125, 2, 2.875, 3.75), (0.5, 2, 3.5)])
def test_weighted_covariance_equals_plain_loops(places):
    rng = np.random.default_rng(4)
    counts = rng.integers(0, 50, (5, 3, 24))
    weights = np.exp(-np.arange(50) / 7.0)
    for kept in (np.ones((3, 5), bool), rng.random((3, 5)) < 0.6):
        kept[1, 2] = True  # the zero lag's
        np.testing.assert_allclose(
            weighted_covariance(counts, weights, kept, places),
            oracles.sad.weighted_covariance(counts, weights, kept, places),
            rtol=1e-12,
        )


def turned_about_itself(cells, row, col, radius, theta):
    """The template of the definition: turned about its own cell."""
    cos, sin = math.cos(theta), math.sin(theta)
    u = np.arange(-radius, radius + 1)
    v = u[:, None]
    rows = np.floor(row + cos * v - sin * u + 0.5).astype(int)
    return read_levels(cells, rows, np.floor(col + sin * v + cos * u + 0.5).astype(int))


def e_by_definition(estimator, cells, row, col, resolution):
    """The scalar e of a cell, from templates turned about it, at offsets rounded one by one."""
    window, radius = estimator.window, math.floor(estimator.range / resolution + 1e-9)
    steps = round(window.half_width / window.step)
    offsets = window.step * np.arange(-steps, steps + 1)
    angles = np.radians(np.arange(-60.0, 61.0, 10.0))
    shifts = np.rint(offsets / resolution).astype(int)
    reach, size, mask = shifts[-1], 2 * radius + 1, make_disc_mask(radius).astype(np.uint8)
    around = cut_template(cells, row, col, radius + reach)
    sums = np.empty((len(offsets), len(offsets), len(angles)))
    for k, angle in enumerate(angles):
        template = turned_about_itself(cells, row, col, radius, angle)
        for i, j in np.ndindex(sums.shape[:2]):
            top, left = reach + shifts[j], reach + shifts[i]
            there = around[top : top + size, left : left + size]
            sums[i, j, k] = cv2.norm(template, there, cv2.NORM_L1, mask)
    poses = np.meshgrid(offsets, offsets, angles, indexing="ij")
    weights = estimator.offset_weights(sums, resolution).ravel()
    covariance = np.cov(np.reshape(poses, (3, -1)), aweights=weights, ddof=0)
    if estimator.quantisation:
        covariance += np.diag([window.step**2, window.step**2, np.radians(10.0) ** 2]) / 12
    return math.sqrt(np.linalg.det(covariance))


@pytest.mark.parametrize(
    "estimator", [Sad(range=3.0), Sad.paper(range=3.0)], ids=["default", "paper"]
)
@pytest.mark.parametrize("resolution", [0.089, 0.07, *sample_cases([0.0333, 0.05, 0.12], 0)])
def test_e_follows_definition_at_any_resolution(resolution, estimator):
    shape = round(14 / resolution), round(13 / resolution)
    cells = random_rooms(shape, seed=3, blocks=14)
    free = np.argwhere(cells == FREE)
    rows, cols = free[np.random.default_rng(2).integers(len(free), size=9)].T
    part = MapPart.from_map(cells, rows, cols, resolution)
    found = np.sqrt(np.linalg.det(estimator.covariances(part)["covariance"]))
    places = zip(rows.tolist(), cols.tolist(), strict=True)
    expected = [e_by_definition(estimator, cells, *place, resolution) for place in places]
    off = np.log(found / expected)
    assert np.median(np.abs(off)) < 0.02
    assert abs(np.median(off)) < 0.02  # and with no sign


def test_covariance_vanishes_with_single_weight():
    """Only the centre of the window has weight."""
    counts, kept = np.ones((5, 3, 24), np.int64), np.ones((3, 5), bool)
    counts[2, 1, 2] = 0
    covariance = weighted_covariance(counts, np.array([1.0, 0.0]), kept, range(5))
    assert (covariance == 0).all()
    tiny = np.array([1.0, 1e-200])
    np.testing.assert_allclose(
        weighted_covariance(counts, tiny, kept, range(5)),
        oracles.sad.weighted_covariance(counts, tiny, kept, range(5)),
        rtol=1e-12,
        atol=1e-300,
    )


def test_disc_sums_equal_plain_loops():
    plane = (random_rooms((50, 47), seed=9) == FREE).astype(np.uint8)
    octets = np.stack([plane, 1 - plane])
    result = np.full((2, 8, 12), -1)
    bitplanes.fill_disc_sums(octets, 3, 2, 6, 3, 10, result)
    assert (result[:, :, 10:] == -1).all()
    result = result[:, :, :10]
    np.testing.assert_array_equal(result[0], oracles.sad.disc_sums(plane[2:, 3:], 6, 3, 10, 8))
    np.testing.assert_array_equal(result[1], oracles.sad.disc_sums(1 - plane[2:, 3:], 6, 3, 10, 8))


def test_covariance_follows_paper_formula():
    cells = random_rooms((80, 80), seed=11, blocks=5)
    small = SearchWindow(half_width=0.5, step=0.1)
    for estimator in (
        Sad(range=1.0, window=small, noise_level=2.0),
        Sad.paper(range=1.0),
        Sad(range=1.0, window=replace(small, half_rotation_deg=0)),
    ):
        window = estimator.window.to_lattice(0.05)
        mismatch = compute_sad_distribution(cells, 40, 36, 20, window)
        area = mismatch / 254 * 0.05**2
        if isinstance(estimator.weights, Exponential):
            weights = np.exp(-area / estimator.tau)
        else:
            weights = 1 / np.maximum(area, 0.05**2 / 2) ** 2
        axes = np.meshgrid(window.offsets, window.offsets, window.angles, indexing="ij")
        poses = np.stack(axes[: window.dimension]).reshape(window.dimension, -1)
        expected = estimator.noise_level * np.cov(poses, aweights=weights.ravel(), ddof=0)
        if estimator.quantisation:
            expected = expected + window.quantisation
        at = MapPart.from_map(cells, np.array([40]), np.array([36]), 0.05)
        result = estimator.covariances(at)["covariance"][0]
        np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-12)


def test_disc_beyond_map_changes_nothing():
    cells = random_rooms((21, 30), seed=6)
    at = MapPart.from_map(cells, np.array([10]), np.array([12]), 0.05)
    assert Sad(range=4.75).template_radius(0.05, cells.shape) == 95
    compared = [Sad(range=reach).covariances(at)["covariance"] for reach in (50.0, 4.75)]
    np.testing.assert_allclose(compared[0], compared[1], rtol=1e-12)


def test_inverse_square_weights_use_floor():
    areas = np.array([0.0, 127.0, 254.0, 2540.0])
    floor = offset_ratio(Sad(weights=InverseSquare(0.01)), areas)
    np.testing.assert_allclose(floor, [1, 1, 1, (0.01 / 0.025) ** 2])
    default = offset_ratio(Sad(weights=InverseSquare()), areas)
    np.testing.assert_allclose(default, [1, 1, 1 / 4, 1 / 400])


def offset_ratio(estimator, mismatch):
    """Weights of the mismatches, in units of that at zero lag."""
    weights = estimator.offset_weights(mismatch, 0.05)
    return weights / weights[0]


def test_cells_are_nan_after_stop():
    cells = random_rooms((60, 60), seed=3)
    control = np.array([1, 0])
    rows = np.array([30, 34])
    part = replace(MapPart.from_map(cells, rows, rows, 0.05), control=control)
    stopped = Sad(range=0.5).covariances(part)
    assert np.isnan(stopped["covariance"]).all()
    assert control.tolist() == [1, 0]


def test_rotated_strips_equal_plain_loops():
    cells = random_rooms((23, 31), seed=10)
    angles = np.array([0.0, 0.4, -2.0])
    cos, sin, firsts = np.cos(angles), np.sin(angles), np.array([-3, 2, 5])
    strips = np.full((3, 2, 25, 20), 77, np.uint8)
    bitplanes.cut_rotated_strips(cells, 0, 0, 11.0, 15.0, cos, sin, firsts, firsts + 1, strips)
    for k in range(3):
        first = firsts[k], firsts[k] + 1
        expected = oracles.sad.cut_strips(cells, cos[k], sin[k], *first, 20, 25)
        np.testing.assert_array_equal(strips[k], expected)
