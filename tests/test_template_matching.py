import naive
import numpy as np
import pytest
from conftest import random_rooms

from locplan.config import FieldConfig
from locplan.grid import FREE, OCCUPIED, UNKNOWN
from locplan.search_window import SearchWindow
from locplan.template_matching import (
    BEHIND,
    beam_count,
    disc,
    local_map,
    rotated_template,
    sad_distribution,
    visible_part,
)


def test_sad_distribution_equals_the_plain_loops():
    cells = random_rooms((31, 38), seed=3)
    config = FieldConfig(window=0.3, step=0.1, rotation_window_deg=60, rotation_step_deg=30)
    window = SearchWindow.from_config(config, 0.05)
    for row, col in ((15, 19), (0, 0), (30, 5)):
        expected = naive.mismatch_counts(cells, row, col, 7, 2, 3, window.angles)
        result = sad_distribution(cells, row, col, 7, window)
        np.testing.assert_array_equal(result, 127 * expected.transpose(0, 2, 1))


def test_template_turns_counter_clockwise():
    cells = np.full((21, 21), FREE, np.uint8)
    cells[10, 16] = OCCUPIED  # six cells along +x
    template = rotated_template(cells, 10, 10, 8, np.pi / 2)
    assert np.argwhere(template == OCCUPIED).tolist() == [[14, 8]]  # six cells along +y


def test_unturned_template_is_the_local_map():
    cells = random_rooms((40, 40), seed=1)
    np.testing.assert_array_equal(
        rotated_template(cells, 3, 38, 9, 0.0), local_map(cells, 3, 38, 9)
    )


def test_outside_the_map_is_unknown():
    around = local_map(np.full((2, 2), FREE, np.uint8), 0, 0, 1)
    assert around.tolist() == [[UNKNOWN] * 3, [UNKNOWN, FREE, FREE], [UNKNOWN, FREE, FREE]]


@pytest.mark.parametrize("radius", [0, 1, 5, 40])
def test_disc_is_symmetric_and_touches_its_radius(radius):
    mask = disc(radius)
    assert (mask == mask.T).all()
    assert (mask == mask[::-1]).all()
    assert mask[radius].all()
    assert mask[0].sum() == 1


def test_mismatch_is_zero_at_zero_lag():
    cells = random_rooms((60, 60), seed=2)
    window = SearchWindow.from_config(FieldConfig(window=0.4), 0.1)
    assert sad_distribution(cells, 30, 30, 12, window)[2, 2, 6] == 0


def test_a_ray_sees_the_wall_but_not_the_room_behind():
    cells = np.full((41, 41), FREE, np.uint8)
    cells[:, 28] = OCCUPIED  # a wall eight cells to the right
    seen = visible_part(cells, 20, 20, 15, 0.0)
    assert seen[15, :26].all()  # up to the wall and two cells behind
    assert not seen[15, 26:].any()
    assert seen[:, 15].all()  # along the wall nothing hides anything
    turned = visible_part(cells, 20, 20, 15, np.pi / 2)
    np.testing.assert_array_equal(turned, np.rot90(seen, -1))


def test_in_the_open_everything_is_seen():
    seen = visible_part(np.full((41, 41), FREE, np.uint8), 20, 20, 12, 0.3)
    np.testing.assert_array_equal(seen, disc(12))


def test_the_visible_part_equals_the_plain_loops():
    cells = random_rooms((50, 60), seed=13, blocks=20)
    for row, col, theta in ((25, 30, 0.0), (0, 0, 0.5), (40, 10, -1.0)):
        expected = naive.visible_part(cells, row, col, 18, theta, beam_count(18), BEHIND)
        np.testing.assert_array_equal(visible_part(cells, row, col, 18, theta), expected)
