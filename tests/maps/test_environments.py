"""Properties of the generated maps, and of the noise put on them."""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage
from support.cases import sample_cases

from locplan.errors import ConfigError, MapError
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, environments, load_map, save_map

NAMES = environments.list_environments()
MAPS = Path(__file__).resolve().parents[2] / "maps"
RESOLUTIONS = sample_cases([0.05, 0.1, 0.02], 2)
ROBOT_RADIUS = 0.25
make = functools.cache(environments.make)


def box(grid: OccupancyGrid, x0: float, y0: float, x1: float, y1: float) -> NDArray[np.uint8]:
    """Cells whose centres lie in a box in world metres."""
    (r0, c0), (r1, c1) = grid.cell((x0 + 1e-6, y0 + 1e-6)), grid.cell((x1, y1))
    return grid.cells[r0:r1, c0:c1]


def mismatch(grid: OccupancyGrid, at: tuple[float, float], d: tuple[float, float]) -> float:
    """Mismatch area [m^2] of the disc of 6 m around a position and the one d metres away."""
    row, col = grid.cell(at)
    reach = round(6 / grid.resolution)
    shift = [round(v / grid.resolution) for v in d]
    pad = reach + max(map(abs, shift))
    cells = np.pad(grid.cells.astype(int), pad, constant_values=UNKNOWN)

    def window(dx: int, dy: int) -> NDArray[np.int_]:
        r, c = row + pad + dy - reach, col + pad + dx - reach
        return cells[r : r + 2 * reach + 1, c : c + 2 * reach + 1]

    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    difference = np.abs(window(0, 0) - window(*shift))[u * u + v * v <= reach * reach]
    return float(difference.sum()) / 254 * grid.resolution**2


def range_to_wall(grid: OccupancyGrid, at: tuple[float, float], heading: float) -> float:
    """Distance [m] from a position to the first cell along a ray that is not free."""
    distance = 0.0
    while True:
        x, y = at[0] + distance * math.cos(heading), at[1] + distance * math.sin(heading)
        if not grid.free[grid.cell((x, y))]:
            return distance
        distance += grid.resolution / 5


def boundary(grid: OccupancyGrid) -> NDArray[np.bool_]:
    free, occupied = grid.cells == FREE, grid.cells == OCCUPIED
    cross = ndimage.generate_binary_structure(2, 1)
    return (occupied & ndimage.binary_dilation(free, cross)) | (
        free & ndimage.binary_dilation(occupied, cross)
    )


def route(grid: OccupancyGrid, *, blocked: tuple[float, float, float, float] | None) -> float:
    """Length [m] of the shortest way from start to goal over the cells' eight neighbours."""
    from skimage.graph import MCP_Geometric

    cost = np.where(grid.free & (grid.clearance >= ROBOT_RADIUS), 1.0, -1.0)
    if blocked:
        (r0, c0), (r1, c1) = grid.cell(blocked[:2]), grid.cell(blocked[2:])
        cost[r0:r1, c0:c1] = -1
    places = environments.place_positions(grid.name)
    lengths, _ = MCP_Geometric(cost).find_costs([grid.cell(places["start"])])
    return float(lengths[grid.cell(places["goal"])]) * grid.resolution


@pytest.mark.parametrize("name", NAMES)
class TestEveryEnvironment:
    def test_environment_is_reproducible(self, name: str) -> None:
        assert environments.make(name).digest == environments.make(name).digest
        assert environments.make(name, seed=1).digest == make(name).digest

    def test_environment_has_name_and_origin(self, name: str) -> None:
        grid = make(name)
        assert grid.name == name
        assert grid.origin[2] == 0
        assert all(-1 <= v <= -0.5 for v in grid.origin[:2])
        assert all(v % 2 == 0 for v in grid.shape)

    def test_environment_has_all_three_levels(self, name: str) -> None:
        assert set(np.unique(make(name).cells)) == {FREE, UNKNOWN, OCCUPIED}

    def test_margin_of_unknown_space_is_tight(self, name: str) -> None:
        grid = make(name)
        rows, cols = np.nonzero(grid.free)
        for low, high, size in (
            (rows.min(), rows.max(), grid.shape[0]),
            (cols.min(), cols.max(), grid.shape[1]),
        ):
            assert 0.5 <= low * grid.resolution <= 1.0
            assert 0.5 <= (size - 1 - high) * grid.resolution <= 1.0
        edge = np.concatenate([grid.cells[0], grid.cells[-1], grid.cells[:, 0], grid.cells[:, -1]])
        assert (edge == UNKNOWN).all()

    @pytest.mark.parametrize("resolution", RESOLUTIONS)
    def test_walls_part_free_from_unknown_space(self, name: str, resolution: float) -> None:
        grid = make(name, resolution=resolution)
        beside_free = ndimage.binary_dilation(grid.free, np.ones((3, 3)))
        assert not (beside_free & (grid.cells == UNKNOWN)).any()
        reach = ndimage.distance_transform_edt(~grid.free)[grid.cells == OCCUPIED].max()
        assert reach * resolution <= max(0.1, 1.5 * resolution) + 1e-6

    @pytest.mark.parametrize("resolution", RESOLUTIONS)
    def test_free_space_is_one_component(self, name: str, resolution: float) -> None:
        assert ndimage.label(make(name, resolution=resolution).free)[1] == 1

    @pytest.mark.parametrize("resolution", RESOLUTIONS)
    def test_robot_reaches_every_place(self, name: str, resolution: float) -> None:
        grid = make(name, resolution=resolution)
        rooms, _ = ndimage.label(grid.free & (grid.clearance >= ROBOT_RADIUS))
        found = {rooms[grid.cell(at)] for at in environments.place_positions(name).values()}
        assert len(found) == 1
        assert found != {0}

    @pytest.mark.parametrize("resolution", RESOLUTIONS)
    def test_resolution_changes_neither_size_nor_area(self, name: str, resolution: float) -> None:
        grid, usual = make(name, resolution=resolution), make(name)
        size, expected = (np.array(g.shape) * g.resolution for g in (grid, usual))
        assert size == pytest.approx(expected, abs=resolution)
        assert grid.origin == usual.origin
        area, expected = (g.free.sum() * g.resolution**2 for g in (grid, usual))
        assert area == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("name", ["two_corridors", "office", "warehouse", "hall", "places"])
def test_checked_in_maps_equal_generated_maps(name: str) -> None:
    assert load_map(MAPS / f"{name}.yaml") == make(name)


@pytest.mark.parametrize("name", ["two_corridors", "office", "warehouse"])
def test_large_maps_span_40_m(name: str) -> None:
    grid = make(name)
    assert grid.shape[1] * grid.resolution >= 40
    places = environments.place_positions(name)
    assert math.dist(places["start"], places["goal"]) >= 35


class TestPlaces:
    grid = make("places")
    at = environments.place_positions("places")

    def test_corridor_b_has_no_visible_end(self) -> None:
        x, y = self.at["B"]
        assert (box(self.grid, x - 12, y - 0.95, x + 12, y + 0.95) == FREE).all()
        around = box(self.grid, x - 8, y - 8, x + 8, y + 6)
        assert (around == around[:, :1]).all()
        assert mismatch(self.grid, (x, y), (2.0, 0.0)) == 0

    def test_room_c_is_round_except_door(self) -> None:
        headings = np.arange(0, 2 * math.pi, 0.05)
        ranges = np.array([range_to_wall(self.grid, self.at["C"], h) for h in headings])
        radius = np.median(ranges)
        door = np.abs(headings - math.pi) < 0.12
        assert np.abs(ranges[~door] - radius).max() < 1.5 * self.grid.resolution
        assert 3.5 <= radius <= 5
        assert ranges[door].max() > radius + 1

    def test_corridor_d_repeats_periodically(self) -> None:
        """The period is 1.6 m."""
        x, y = self.at["D"]
        cells = box(self.grid, x - 10.8, y - 3, x + 10.8, y + 1.8)
        period = round(1.6 / self.grid.resolution)
        assert (cells[:, period:] == cells[:, :-period]).all()
        assert (cells[:, period // 2 :] != cells[:, : -period // 2]).any()
        assert mismatch(self.grid, (x, y), (1.6, 0.0)) == 0
        assert mismatch(self.grid, (x, y), (0.8, 0.0)) > 1.5

    def test_complex_room_differs_at_every_offset(self) -> None:
        steps = np.arange(-2, 2.1, 0.4)
        offsets = [(dx, dy) for dx in steps for dy in steps if math.hypot(dx, dy) > 0.1]
        assert min(mismatch(self.grid, self.at["A"], d) for d in offsets) > 5


class TestHall:
    grid = make("hall")
    at = environments.place_positions("hall")

    def test_middle_is_far_from_every_wall(self) -> None:
        assert self.grid.clearance[self.grid.cell(self.at["E"])] > 12

    def test_hall_floor_is_40_by_30(self) -> None:
        x, y = self.at["E"]
        assert (box(self.grid, x - 20, y - 15, x + 20, y + 15) == FREE).all()

    def test_hall_rooms_offer_longer_route(self) -> None:
        direct = route(self.grid, blocked=None)
        around = route(self.grid, blocked=(18, 0, 25, 32.7))
        assert direct == pytest.approx(36, abs=0.5)
        assert direct * 1.1 < around < direct * 1.6

    def test_hall_rooms_have_features(self) -> None:
        steps = np.arange(-2, 2.1, 0.4)
        offsets = [(dx, dy) for dx in steps for dy in steps if math.hypot(dx, dy) > 0.1]
        assert min(mismatch(self.grid, self.at["F"], d) for d in offsets) > 1.5


class TestTwoCorridors:
    grid = make("two_corridors")
    at = environments.place_positions("two_corridors")

    def test_start_and_goal_have_fixed_positions(self) -> None:
        """They lie in the rooms at the ends."""
        assert self.at["start"] == (2, 3)
        assert self.at["goal"] == (38, 3)

    def test_short_corridor_is_straight_and_featureless(self) -> None:
        x, y = self.at["short"]
        assert (box(self.grid, x - 11, y - 0.95, x + 11, y + 0.95) == FREE).all()
        for dx in np.arange(-2, 2.1, 0.4):
            assert mismatch(self.grid, (x, y), (dx, 0.0)) < 1e-9

    def test_irregular_corridor_is_moderately_longer(self) -> None:
        """The route is a quarter to a third longer."""
        short = route(self.grid, blocked=None)
        long = route(self.grid, blocked=(18, 1.5, 22, 4.5))
        assert 1.25 <= long / short <= 1.35

    @pytest.mark.parametrize(
        "area",
        [(7.5, 9.8, 32.5, 14.4), (0.5, 0.5, 6.5, 13.5), (33.5, 0.5, 39.5, 13.5)],
        ids=["irregular corridor", "western room", "eastern room"],
    )
    def test_areas_outside_short_corridor_have_features(
        self, area: tuple[float, float, float, float]
    ) -> None:
        near = [(0.4 * math.cos(a), 0.4 * math.sin(a)) for a in np.arange(8) * math.pi / 4]
        far = [(5 * dx, 5 * dy) for dx, dy in near]
        checked = 0
        for x in np.arange(area[0], area[2], 1.5):
            for y in np.arange(area[1], area[3], 1.1):
                cell = self.grid.cell((x, y))
                if self.grid.free[cell] and self.grid.clearance[cell] >= ROBOT_RADIUS:
                    checked += 1
                    assert min(mismatch(self.grid, (x, y), d) for d in near + far) > 1.5
        assert checked >= 15


def test_warehouse_aisles_are_identical() -> None:
    grid = make("warehouse")
    cells = box(grid, 1, 1.8, 30, 25.2)
    period = round(3.6 / grid.resolution)
    assert (cells[period:] == cells[:-period]).all()


def test_office_has_at_least_24_rooms() -> None:
    grid = make("office")
    # What a disc as wide as a door cannot pass falls apart into rooms.
    parts, _ = ndimage.label(grid.free & (grid.clearance > 0.55))
    areas = np.bincount(parts.ravel())[1:] * grid.resolution**2
    assert (areas > 1.0).sum() >= 24


class TestBoundaryNoise:
    grid = make("two_corridors")

    def test_zero_noise_changes_no_cell(self) -> None:
        assert environments.with_boundary_noise(self.grid, 0.0, seed=3).digest == self.grid.digest

    def test_full_noise_flips_every_boundary_cell(self) -> None:
        noisy = environments.with_boundary_noise(self.grid, 1.0)
        assert ((noisy.cells != self.grid.cells) == boundary(self.grid)).all()

    @pytest.mark.parametrize("fraction", [0.05, 0.1, 0.5])
    def test_noise_flips_share_of_boundary_cells(self, fraction: float) -> None:
        noisy = environments.with_boundary_noise(self.grid, fraction, seed=2)
        changed, at_boundary = noisy.cells != self.grid.cells, boundary(self.grid)
        assert not (changed & ~at_boundary).any()
        assert changed.sum() / at_boundary.sum() == pytest.approx(fraction, rel=0.1)
        assert ((noisy.cells == UNKNOWN) == (self.grid.cells == UNKNOWN)).all()
        assert (noisy.cells[changed].astype(int) == 254 - self.grid.cells[changed]).all()

    def test_noise_follows_seed(self) -> None:
        first, again, other = (
            environments.make("places", boundary_noise=0.1, seed=seed).digest for seed in (1, 1, 2)
        )
        assert first == again != other
        assert first != make("places").digest

    def test_noise_keeps_name_and_origin(self) -> None:
        """The original map does not change either."""
        before = self.grid.digest
        noisy = environments.with_boundary_noise(self.grid, 0.3)
        assert (noisy.name, noisy.origin, noisy.shape) == (
            self.grid.name,
            self.grid.origin,
            self.grid.shape,
        )
        assert self.grid.digest == before

    def test_noise_keeps_map_without_boundaries(self) -> None:
        grid = OccupancyGrid(np.full((5, 7), FREE), resolution=0.05)
        assert environments.with_boundary_noise(grid, 1.0).digest == grid.digest


class TestErrors:
    @pytest.mark.parametrize("call", [environments.make, environments.place_positions])
    def test_unknown_name_error_lists_choices(self, call: object) -> None:
        assert callable(call)
        with pytest.raises(ConfigError, match=", ".join(NAMES)) as caught:
            call("garden")
        assert "garden" in str(caught.value)
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("resolution", [0.0, -0.05, 1e-4, 0.5, math.nan, math.inf, "fine"])
    def test_make_rejects_resolution_out_of_range(self, resolution: float) -> None:
        with pytest.raises(ConfigError, match=r"resolution must be .*0\.01 to 0\.1"):
            environments.make("hall", resolution=resolution)

    @pytest.mark.parametrize("fraction", [-0.1, 1.1, math.nan, None])
    def test_make_rejects_noise_out_of_range(self, fraction: float) -> None:
        with pytest.raises(ConfigError, match="boundary_noise must be"):
            environments.make("places", resolution=0.1, boundary_noise=fraction)

    @pytest.mark.parametrize("seed", [-1, 0.5, None])
    def test_make_rejects_invalid_seed(self, seed: int) -> None:
        with pytest.raises(ConfigError, match="seed must be a whole number of at least 0"):
            environments.make("places", resolution=0.1, seed=seed)


def test_place_positions_returns_copy() -> None:
    environments.place_positions("hall").clear()
    assert environments.place_positions("hall")


def test_load_map_draws_built_in_map(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in NAMES:
        grid = load_map(name)
        assert grid.name == name
        assert grid.digest == make(name).digest


def test_load_map_prefers_existing_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    drawn = OccupancyGrid(np.full((3, 4), FREE, np.uint8), 0.1, (0.0, 0.0, 0.0), "room")
    (tmp_path / "hall").mkdir()
    save_map(drawn, tmp_path / "hall" / "room.yaml")
    assert load_map("hall").shape == (3, 4)
    (tmp_path / "office").write_text("no map")
    with pytest.raises(MapError, match="office: "):
        load_map("office")


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("hal", "did you mean hall"), ("moon", "give a map's YAML"), ("hall.yaml", "no such file")],
)
def test_load_map_names_built_in_maps(tmp_path, monkeypatch, name, remedy):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MapError, match=remedy):
        load_map(name)
