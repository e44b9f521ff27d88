"""Changes of the page: what they do to a map, a robot and zones."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from support.explorer_sessions import POINT, SAD

import locplan
from locplan.app.explorer.messages import Question
from locplan.app.explorer.sites import ExploredSite, read_changes
from locplan.errors import LocplanError
from locplan.field import FieldConfig
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, Zone, Zones

SQUARE = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]


def make_site(
    level: int = FREE, config: FieldConfig = SAD, robot=POINT, yaw: float = 0.0
) -> ExploredSite:
    cells = np.full((30, 40), level, np.uint8)
    return ExploredSite(OccupancyGrid(cells, 0.1, (0.5, 0.5, yaw)), config, robot)


def change(site: ExploredSite, *changes: dict) -> ExploredSite:
    return site.with_changes(read_changes(Question("change", 1, {"changes": list(changes)})))


def draw(kind: str, points, width: float) -> dict:
    return {"kind": kind, "points": points, "width": width}


def test_wall_fills_covered_cell_centres():
    site = make_site(yaw=0.7)
    points = [[0.0, 1.5], [0.6, 2.0], [0.2, 2.4]]
    grid = change(site, draw("wall", points, 0.3)).grid
    for row, col in itertools.product(range(30), range(40)):
        at = np.array(grid.position(row, col))
        distance = min(
            math.dist(at, np.array(a) + np.clip((at - a) @ d / (d @ d), 0, 1) * d)
            for a, b in itertools.pairwise(points)
            if (d := np.subtract(b, a)) is not None
        )
        assert (grid.cells[row, col] == OCCUPIED) == (distance <= 0.15), (row, col)


def test_thin_wall_has_no_gap():
    site = change(make_site(), draw("wall", [[0.5, 0.7], [4.5, 3.2]], 0.01))
    _, labels = locplan.planning.grid.label_connected_parts(
        locplan.Costmap.blank(site.grid, robot=0.0)
    )
    assert len(set(labels[site.grid.free])) == 2


def test_erase_frees_and_pole_fills_cells():
    site = change(make_site(UNKNOWN), draw("erase", [[1.0, 2.0], [4.0, 2.0]], 0.4))
    assert site.grid.free[site.grid.cell((2.5, 2.0))]
    site = change(make_site(), draw("pole", [[2.5, 2.0]], 1.0))
    area = (site.grid.cells == OCCUPIED).sum() * 0.1**2
    assert area == pytest.approx(math.pi / 4, rel=0.1)


def test_changes_are_applied_in_their_order():
    wall, erase = draw("wall", [[1.0, 2.0], [4.0, 2.0]], 0.4), draw("erase", [[2.0, 2.0]], 1.0)
    first, last = change(make_site(), wall, erase), change(make_site(), erase, wall)
    cell = first.grid.cell((2.0, 2.0))
    assert (first.grid.cells[cell], last.grid.cells[cell]) == (FREE, OCCUPIED)


def test_site_without_effective_changes_is_equal():
    site = make_site()
    other = change(site, draw("pole", [[500.0, 500.0]], 0.3), draw("erase", [[2.0, 2.0]], 1.0))
    assert other.grid is site.grid
    assert other.key == site.key == change(site).key


@pytest.mark.parametrize(
    ("lidar", "expected"),
    [
        ({"range": 1.0}, locplan.Sad(range=1.0)),
        ({"lidar": "lds-01"}, locplan.Sad().with_lidar(locplan.Lidar.preset("lds-01"))),
        ({}, SAD.estimator),
    ],
)
def test_lidar_changes_field_settings(lidar, expected):
    site = change(make_site(), {"kind": "lidar", **lidar})
    assert site.config == FieldConfig(expected, stride=SAD.stride)


def test_lidar_range_keeps_other_settings():
    lidar = locplan.Lidar(range=5.0, beams=90)
    config = FieldConfig(locplan.Fused(lidar), stride=0.4)
    site = change(
        make_site(config=config, robot=locplan.Robot(lidar)), {"kind": "lidar", "range": 3}
    )
    assert site.robot.lidar == site.config.estimator.lidar == locplan.Lidar(range=3.0, beams=90)
    assert site.key != make_site(config=config, robot=locplan.Robot(lidar)).key


def test_drawn_zones_equal_library_zones():
    slow = {"kind": "zone", "zone": "slow", "polygon": SQUARE, "percent": 30}
    site = change(make_site(), slow, {"kind": "zone", "zone": "no-go", "polygon": SQUARE[:3]})
    assert site.zones == Zones([Zone("slow", SQUARE, 30), Zone("no-go", SQUARE[:3])])
    assert site.grid == make_site().grid


@pytest.mark.parametrize(
    ("item", "fault"),
    [
        ({}, "a change must have a kind"),
        ({"kind": "box"}, "kind must be one of"),
        (draw("wall", [], 1), "at least one point"),
        (draw("wall", [[1, "a"]], 1), "points must be"),
        (draw("wall", [[1, 1]] * 5001, 1), "points must be"),
        (draw("pole", [[1, 1]], -1), "width must be"),
        (draw("pole", [[1, 1]], 1e9), "width must be"),
        (draw("pole", [[1, 1]], None), "width must be"),
        ({"kind": "lidar", "lidar": "x"}, "lidar must be one of"),
        ({"kind": "lidar", "range": 0}, "range must be"),
        ({"kind": "zone", "polygon": SQUARE}, "a zone must have a kind"),
        ({"kind": "zone", "zone": "x", "polygon": SQUARE}, "zone must be one of"),
        ({"kind": "zone", "zone": "no-go", "polygon": SQUARE[:2]}, "encloses no area"),
        ({"kind": "zone", "zone": "slow", "polygon": SQUARE, "percent": 0}, "percent must be"),
    ],
)
def test_site_refuses_wrong_change(item, fault):
    with pytest.raises(LocplanError, match=fault) as error:
        change(make_site(), draw("pole", [[2.0, 2.0]], 0.3), item)
    assert "\n" not in str(error.value)
