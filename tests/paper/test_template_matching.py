import cv2
import numpy as np
import pytest
from support import oracles
from support.maps import random_rooms

from locplan.errors import LocplanError
from locplan.field import FieldConfig, Sad, SearchWindow
from locplan.field.templates import (
    BEHIND,
    count_template_rays,
    cut_rotated_template,
    cut_template,
    make_disc_mask,
    mark_visible_part,
)
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.paper.template_matching import (
    MODELS,
    compare_models_along_axis,
    compare_models_along_strip,
    compute_mismatch_areas,
    compute_sad_distribution,
    compute_similarities,
)


def test_sad_distribution_equals_plain_loops():
    cells = random_rooms((31, 38), seed=3)
    config = FieldConfig(
        Sad(
            window=SearchWindow(
                half_width=0.3, step=0.1, half_rotation_deg=60, rotation_step_deg=30
            )
        )
    )
    window = config.estimator.window.to_lattice(0.05)
    for row, col in ((15, 19), (0, 0), (30, 5)):
        expected = oracles.sad.mismatch_counts(cells, row, col, 7, 2, 3, window.angles)
        result = compute_sad_distribution(cells, row, col, 7, window)
        np.testing.assert_array_equal(result, 127 * expected.transpose(0, 2, 1))


def test_template_turns_counter_clockwise():
    cells = np.full((21, 21), FREE, np.uint8)
    cells[10, 16] = OCCUPIED  # six cells along +x
    template = cut_rotated_template(cells, 10, 10, 8, np.pi / 2)
    assert np.argwhere(template == OCCUPIED).tolist() == [[14, 8]]  # six cells along +y


def test_unturned_template_equals_local_map():
    cells = random_rooms((40, 40), seed=1)
    np.testing.assert_array_equal(
        cut_rotated_template(cells, 3, 38, 9, 0.0), cut_template(cells, 3, 38, 9)
    )


def test_template_outside_map_is_unknown():
    around = cut_template(np.full((2, 2), FREE, np.uint8), 0, 0, 1)
    assert around.tolist() == [[UNKNOWN] * 3, [UNKNOWN, FREE, FREE], [UNKNOWN, FREE, FREE]]


@pytest.mark.parametrize("radius", [0, 1, 5, 40])
def test_disc_is_symmetric_and_touches_radius(radius):
    mask = make_disc_mask(radius)
    assert (mask == mask.T).all()
    assert (mask == mask[::-1]).all()
    assert mask[radius].all()
    assert mask[0].sum() == 1


def test_mismatch_is_zero_at_zero_lag():
    cells = random_rooms((60, 60), seed=2)
    window = FieldConfig(Sad(window=SearchWindow(half_width=0.4))).estimator.window.to_lattice(0.1)
    assert compute_sad_distribution(cells, 30, 30, 12, window)[2, 2, 6] == 0


def test_visible_part_ends_behind_wall():
    cells = np.full((41, 41), FREE, np.uint8)
    cells[:, 28] = OCCUPIED  # a wall eight cells to the right
    seen = mark_visible_part(cells, 20, 20, 15, 0.0)
    assert seen[15, :26].all()  # up to the wall and two cells behind
    assert not seen[15, 26:].any()
    assert seen[:, 15].all()  # along the wall nothing hides anything
    turned = mark_visible_part(cells, 20, 20, 15, np.pi / 2)
    np.testing.assert_array_equal(turned, np.rot90(seen, -1))


def test_open_space_is_fully_visible():
    seen = mark_visible_part(np.full((41, 41), FREE, np.uint8), 20, 20, 12, 0.3)
    np.testing.assert_array_equal(seen, make_disc_mask(12))


def test_visible_part_equals_plain_loops():
    cells = random_rooms((50, 60), seed=13, blocks=20)
    for row, col, theta in ((25, 30, 0.0), (0, 0, 0.5), (40, 10, -1.0)):
        expected = oracles.sad.visible_part(
            cells, row, col, 18, theta, count_template_rays(18), BEHIND
        )
        np.testing.assert_array_equal(mark_visible_part(cells, row, col, 18, theta), expected)


OPENCV = {
    "SSD": cv2.TM_SQDIFF,
    "NSSD": cv2.TM_SQDIFF_NORMED,
    "NCC": cv2.TM_CCORR_NORMED,
    "ZNCC": cv2.TM_CCOEFF_NORMED,
    "ZCC": cv2.TM_CCOEFF,
    "CC": cv2.TM_CCORR,
}


@pytest.mark.parametrize("model", OPENCV)
def test_models_equal_opencv(model):
    cells = random_rooms((24, 60), seed=5, blocks=40)
    template = cells[:, 21:39]
    expected = cv2.matchTemplate(cells, template, OPENCV[model])
    found = compare_models_along_strip(template, cells)[model]
    scale = abs(expected).max()
    np.testing.assert_allclose(found, expected[0], rtol=1e-5, atol=1e-5 * scale)


def test_models_equal_plain_loops():
    rng = np.random.default_rng(4)
    for size in (1, 2, 9, 30):
        template, levels = rng.choice([OCCUPIED, UNKNOWN, FREE], (2, size, size))
        found, expected = (
            compute_similarities(template, levels),
            oracles.sad.similarities(template, levels),
        )
        assert list(found) == list(MODELS) == list(expected)
        for name in MODELS:
            assert found[name] == pytest.approx(expected[name], rel=1e-9, abs=1e-6, nan_ok=True)


def test_models_reject_mismatched_shapes():
    with pytest.raises(LocplanError, match="one shape"):
        compute_similarities(np.zeros((2, 3)), np.zeros((3, 2)))
    with pytest.raises(LocplanError, match="one shape"):
        compute_similarities(np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(LocplanError, match="cannot slide"):
        compare_models_along_strip(np.zeros((2, 3), np.uint8), np.zeros((2, 2), np.uint8))


def test_turned_map_exchanges_axis_curves():
    cells = random_rooms((81, 81), seed=8)
    estimator = Sad(range=1.5, window=SearchWindow(half_width=0.5))
    grid, turned = OccupancyGrid(cells, 0.1), OccupancyGrid(np.rot90(cells, -1), 0.1)
    x, y = 3.05, 5.05
    offsets, curves = compare_models_along_axis(grid, x, y, "x", estimator)
    # Row 0 is at the lowest y: rot90 by -1 turns the world counter-clockwise.
    turned_offsets, turned_curves = compare_models_along_axis(turned, 8.1 - y, x, "y", estimator)
    np.testing.assert_array_equal(offsets, turned_offsets)
    assert offsets[[0, -1]].tolist() == pytest.approx([-0.4, 0.4])
    for name in MODELS:
        np.testing.assert_allclose(curves[name], turned_curves[name], rtol=1e-12, err_msg=name)


def test_best_match_along_theta_is_zero():
    grid = OccupancyGrid(random_rooms((81, 81), seed=8), 0.1)
    angles, curves = compare_models_along_axis(grid, 4.0, 4.0, "theta", Sad(range=2.0))
    np.testing.assert_allclose(np.degrees(angles), np.arange(-60, 61))
    assert curves["SAD"][60] == 0
    assert (np.delete(curves["SAD"], [59, 60, 61]) > 0).all()  # a degree may move no cell
    assert curves["ZNCC"][60] == pytest.approx(1)


def test_axis_curve_of_sad_equals_distribution():
    grid = OccupancyGrid(random_rooms((81, 81), seed=9), 0.1)
    estimator = Sad(range=1.5)
    area = compute_mismatch_areas(grid, 4.0, 4.0, estimator)
    assert area.shape == (21, 21, 13)
    offsets, curves = compare_models_along_axis(grid, 4.0, 4.0, "y", estimator)
    np.testing.assert_allclose(offsets[::2], np.arange(-10, 11) * 0.2)
    np.testing.assert_allclose(curves["SAD"][::2] * (0.01 / 254), area[10, :, 6])


def test_comparison_rejects_invalid_place_and_axis():
    grid = OccupancyGrid(random_rooms((30, 30), seed=9), 0.1)
    with pytest.raises(LocplanError, match="free space"):
        compute_mismatch_areas(grid, 9.0, 1.0, Sad())
    with pytest.raises(LocplanError, match="axis must be"):
        compare_models_along_axis(grid, 1.0, 1.0, "z", Sad())
    with pytest.raises(LocplanError, match="axis must be"):
        compare_models_along_axis(
            grid, 1.0, 1.0, "theta", Sad(window=SearchWindow(half_rotation_deg=0))
        )
