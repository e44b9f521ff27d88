import math

import numpy as np
import pytest
from support.maps import ascii_map, random_rooms

from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, Path, path_cost, plan
from locplan.robots import Footprint

LONG = [(1.2, 0.35), (1.2, -0.35), (-0.8, -0.35), (-0.8, 0.35)]


def test_radii():
    outline = Footprint(LONG)
    assert outline.circumscribed_radius == pytest.approx(math.hypot(1.2, 0.35))
    assert outline.inscribed_radius == pytest.approx(0.35)


def test_footprint_ignores_order_and_inner_corners():
    turned = Footprint([*LONG[::-1], (0.1, 0.1)])
    assert turned.inscribed_radius == pytest.approx(0.35)
    assert len(turned.vertices) == 4


def test_corners_may_come_in_any_order():
    corners = np.array([[math.cos(a), math.sin(a)] for a in np.arange(5) * 0.4 * np.pi])
    star = Footprint(corners[[0, 2, 4, 1, 3]])
    assert star.inscribed_radius == pytest.approx(math.cos(math.pi / 5))


@pytest.mark.parametrize(
    "vertices",
    [
        [(0, 0), (1, 1)],
        [(1, 1), (2, 1), (2, 2)],
        [(0, 1), (0, 2), (0, -3)],
        "abc",
        [[np.nan, 0]] * 3,
    ],
)
def test_invalid_footprint_is_refused(vertices):
    with pytest.raises(ConfigError, match="footprint"):
        Footprint(vertices)


def sampled_collision(outline: Footprint, grid: OccupancyGrid, path: Path) -> bool:
    """By points all over the outline, at close steps along lines and turns."""
    low, high = outline.vertices.min(axis=0), outline.vertices.max(axis=0)
    points = np.stack(np.meshgrid(*np.linspace(low, high, 25).T), axis=-1).reshape(-1, 2)
    edges = np.roll(outline.vertices, -1, axis=0) - outline.vertices
    to = points[:, None] - outline.vertices[None]
    inside = (edges[None, :, 0] * to[..., 1] - edges[None, :, 1] * to[..., 0] >= -1e-9).all(axis=1)
    points = points[inside]
    poses, previous = [], None
    for a, b in zip(path.xy[:-1], path.xy[1:], strict=True):
        heading = math.atan2(b[1] - a[1], b[0] - a[0])
        if previous is not None:
            turn = (heading - previous + math.pi) % (2 * math.pi) - math.pi
            poses += [(*a, previous + share * turn) for share in np.linspace(0, 1, 60)]
        poses += [(*(a + share * (b - a)), heading) for share in np.linspace(0, 1, 80)]
        previous = heading
    for x, y, theta in poses:
        turn = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
        world = points @ turn + (x, y)
        rows, cols = (np.floor(v).astype(int) for v in grid.world_to_grid(*world.T))
        here = (rows >= 0) & (cols >= 0) & (rows < grid.shape[0]) & (cols < grid.shape[1])
        if (grid.cells[rows[here], cols[here]] == OCCUPIED).any():
            return True
    return False


def test_collisions_agree_with_sampling():
    outcomes = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        cells = random_rooms((60, 60), seed, blocks=5)
        grid = OccupancyGrid(cells, 0.2, (-1.0, 0.5, 0.3))
        path = Path(np.column_stack(grid.grid_to_world(*rng.uniform(12, 48, (2, 3)))))
        outline = Footprint(LONG)
        exact = outline.find_first_collision(grid, path) is not None
        sampled = sampled_collision(outline, grid, path)
        assert exact >= sampled, seed  # a sample may miss what is hardly touched
        outcomes.append((exact, sampled))
    assert {(True, True), (False, False)} <= set(outcomes)
    assert sum(exact != sampled for exact, sampled in outcomes) <= 6


def door(width: int) -> OccupancyGrid:
    """Two rooms and a door of so many cells of 0.1 m."""
    cells = np.full((80, 120), 254, np.uint8)
    cells[:, 58:62] = OCCUPIED
    middle = 40 - width // 2
    cells[middle : middle + width, 58:62] = 254
    return OccupancyGrid(cells, 0.1)


@pytest.mark.parametrize("planner", ["grid", "any-angle"])
def test_long_robot_passes_narrow_door(planner):
    """The robot's outer circle does not fit through the door."""
    grid = door(10)
    costs = Costmap.blank(grid, robot=0.0)
    ends = (2.0, 4.05), (10.0, 4.05)
    round_one = plan(costs.with_robot(1.25), *ends, planner=planner)
    assert round_one.status == "unreachable"
    result = plan(costs, *ends, planner=planner, footprint=LONG)
    assert result.status == "solved"
    assert Footprint(LONG).find_first_collision(grid, result.path) is None


def test_plan_reports_door_narrower_than_robot():
    result = plan(Costmap.blank(door(6), robot=0.0), (2.0, 4.05), (10.0, 4.05), footprint=LONG)
    assert result.status == "infeasible"
    assert "footprint" in result.note


BOX = [(0.5, 0.3), (0.5, -0.3), (-0.5, -0.3), (-0.5, 0.3)]


def corridor_of(width: int) -> OccupancyGrid:
    """A corridor of so many cells of 0.1 m between walls."""
    return ascii_map("#" * 30, *["." * 30] * width, "#" * 30, resolution=0.1)


def test_lattice_finds_path_missed_by_circles():
    grid, start, goal = door(8), (5.3, 6.0), (6.8, 6.0)
    result = plan(Costmap.blank(grid, robot=0.0), start, goal, footprint=BOX)
    assert result.status == "solved"
    assert "lattice" in result.note
    assert Footprint(BOX).find_first_collision(grid, result.path) is None


def test_timeout_reports_lower_bound_of_lattice():
    cells = np.pad(door(8).cells, ((0, 600), (150, 150)), mode="edge")
    costs = Costmap.blank(OccupancyGrid(cells, 0.1), robot=0.0)
    limits = {"from_grid": True, "time_limit": 1e-3, "footprint": BOX}
    result = plan(costs, (20.3, 60.0), (21.8, 60.0), planner="RRTstar", **limits)
    assert result.status == "timeout"
    assert "every path of the lattice costs at least" in result.note


def test_failed_search_is_not_called_infeasible():
    grid, way = corridor_of(6), [(0.7, 0.4), (2.3, 0.4)]
    assert Footprint(BOX).find_first_collision(grid, Path(way)) is None
    result = plan(Costmap.blank(grid, robot=0.0), way[0], way[-1], footprint=BOX)
    assert result.status == "not found"
    assert "inner and outer circle (radii 0.3 and 0.583 m) were searched" in result.note
    assert "16 headings and cells of 0.1 m: there may be another path" in result.note


@pytest.mark.parametrize("radius", [0.0, 0.3])
def test_exact_fit_is_not_called_unreachable(radius):
    """The robot fits only between two rows of cell centres, so the grid proves nothing."""
    cells = np.full((26, 40), FREE)
    cells[:10, 12:28] = cells[16:, 12:28] = OCCUPIED
    grid, way = OccupancyGrid(cells, 0.1), [(0.6, 1.3), (3.4, 1.3)]
    assert Footprint(BOX).find_first_collision(grid, Path(way)) is None
    result = plan(Costmap.blank(grid, robot=radius), *way, footprint=BOX)
    assert result.status == "not found"


def test_footprint_never_opens_blocked_cells():
    """The costmap's radius counts even if it is wider than the footprint."""
    ends = (2.0, 4.05), (10.0, 4.05)
    wide = Costmap.blank(door(8), robot=0.5)
    closed = Costmap.blank(door(20), robot=0.0)
    closed = closed.with_blocked(np.arange(120) == 60)
    for costs in (wide, closed):
        assert plan(costs, *ends, footprint=BOX).status == "unreachable"


def test_corridor_narrower_than_footprint_is_infeasible():
    costs = Costmap.blank(corridor_of(4), robot=0.0)
    result = plan(costs, (0.7, 0.3), (2.3, 0.3), footprint=BOX)
    assert result.status == "infeasible"
    assert "not even the footprint's inner circle (radius 0.3 m) fits" in result.note
    walled = Costmap.blank(door(0), robot=0.0)
    assert plan(walled, (2.0, 4.05), (10.0, 4.05), footprint=BOX).status == "unreachable"


def test_drivable_path_is_never_called_infeasible():
    n_paths = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        grid = OccupancyGrid(random_rooms((60, 60), seed), 0.2, (-1.0, 0.5, 0.3))
        costs = Costmap.blank(grid, robot=0.0)
        path = Path(np.column_stack(grid.grid_to_world(*rng.uniform(12, 48, (2, 3)))))
        known = np.isfinite(path_cost(costs, path))
        if known and Footprint(LONG).find_first_collision(grid, path) is None:
            result = plan(costs, *path.xy[[0, -1]], footprint=LONG)
            assert result.status in ("solved", "not found"), seed
            n_paths += 1
    assert n_paths > 10


def test_wide_room_needs_inner_circle_only():
    """A note would name the outer circle or the lattice."""
    grid = ascii_map(*["." * 60] * 60, resolution=0.1)
    result = plan(Costmap.blank(grid, robot=0.0), (2.0, 2.0), (4.0, 3.0), footprint=LONG)
    assert (result.status, result.note) == ("solved", "")


def test_costmap_refuses_smaller_robot():
    with pytest.raises(ConfigError, match="cannot serve"):
        Costmap.blank(door(10), robot=0.5).with_robot(0.3)
