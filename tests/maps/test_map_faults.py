"""Faults that `faults` finds in a map without a recorded drive, and maps with hollow walls."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from support import oracles
from support.maps import ascii_map, blocks, random_rooms

from locplan._support.kernels import particles
from locplan._support.kernels.walls import count_deep_faces
from locplan.maps import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    OccupancyGrid,
    faults,
    find_maps,
    hollow_walls,
    measure_solidity,
    read_map,
)
from locplan.maps.map_faults import MapFault, WallSolidity

SOLID = {
    "f1tenth_gym_berlin",
    "f1tenth_gym_skirk",
    "f1tenth_gym_stata_basement",
    "navfn_willow_costmap",
    "tuw_warehouse008",
    "tuw_warehouse032",
    "tuw_warehouse200",
}


def list_fault_kinds(grid: OccupancyGrid) -> list[str]:
    return [each.kind for each in faults(grid)]


@pytest.mark.parametrize("seed", range(3))
def test_deep_face_counts_equal_plain_loops(seed):
    cells = random_rooms((31, 24), seed)
    for deep in (1, 3):
        assert count_deep_faces(cells, FREE, OCCUPIED, deep) == oracles.walls.surface_depths(
            cells, FREE, OCCUPIED, deep
        )


@pytest.mark.parametrize("seed", range(3))
def test_hollow_walls_keeps_single_cell_rim(seed):
    cells = random_rooms((31, 24), seed)
    cells[:3, 4:9] = OCCUPIED  # black up to the edge of the map
    grid = OccupancyGrid(cells, 0.05, (1.0, 2.0, 0.1), "rooms")
    hollow = hollow_walls(grid)
    assert np.array_equal(hollow.cells, oracles.walls.hollowed(grid.cells))
    assert (hollow.resolution, hollow.origin, hollow.name) == (0.05, (1.0, 2.0, 0.1), "rooms")
    assert hollow_walls(hollow) == hollow


def test_faults_distinguish_solid_from_hollow_blocks():
    found = faults(blocks())
    assert found.is_solid
    assert np.array_equal(found.cells, hollow_walls(blocks()).cells != blocks().cells)
    assert hollow_walls(blocks()) == blocks(thick=False)
    assert list_fault_kinds(blocks(thick=False)) == []


def test_faults_report_shallow_walls_as_thick(monkeypatch):
    monkeypatch.setattr("locplan.maps.map_faults.MISLEADING_DEPTH", 3.5)
    found = faults(replace(blocks(), origin=(1.0, 0.0, 0.0)))  # another map, which is checked again
    assert [(each.kind, each.is_certain) for each in found] == [("thick walls", False)]
    assert not found.is_solid


@pytest.mark.parametrize(
    ("wins", "hollow", "depth", "kind"),
    [
        (0.2, 0.1, 0.15, "solid walls"),
        (0.2, 0.1, 0.14, "thick walls"),
        (0.19, 0.0, 0.5, None),
        (0.6, 0.31, 0.5, None),
    ],
)
def test_solid_walls_follow_solidity_thresholds(wins, hollow, depth, kind, monkeypatch):
    """Walls mislead at least a fifth of scans, hollow walls at most half as many."""
    monkeypatch.setattr(
        "locplan.maps.map_faults.measure_solidity", lambda _: WallSolidity(wins, hollow, depth)
    )
    found = faults(blocks())
    assert [each.kind for each in found] == [kind] * (kind is not None)
    assert found.repaired_map == (hollow_walls(blocks()) if kind == "solid walls" else blocks())
    deep = replace(found, faults=(*found, MapFault("deep walls", "")))
    assert deep.repaired_map == blocks()  # the truth lies inside


@pytest.mark.parametrize(("cells", "depth"), [(5, 0.0), (6, 1.0)])
def test_deep_walls_exceed_half_metre(cells, depth):
    room = np.pad(np.full((30, 40), FREE, np.uint8), cells, constant_values=OCCUPIED)
    assert measure_solidity(OccupancyGrid(room, 0.1)).deep_surface_share == depth


def test_solidity_is_measured_once_per_map():
    first = measure_solidity(blocks())
    assert measure_solidity(blocks()) is first
    assert 0.2 <= first.wrong_pose_share <= 1
    assert first.hollowed_wrong_pose_share <= first.wrong_pose_share / 2


def test_solidity_scores_poses_in_c_order(monkeypatch):
    """Numba compiles `add_scores` again for each array order, which takes a second."""
    is_c_order = set()
    add_scores = particles.add_scores

    def record_order(scores, ends, poses, count, sums):
        is_c_order.add(poses.flags.c_contiguous)
        add_scores(scores, ends, poses, count, sums)

    monkeypatch.setattr(particles, "add_scores", record_order)
    measure_solidity(replace(blocks(), origin=(2.0, 0.0, 0.0)))  # a map that is not cached
    assert is_c_order == {True}


@pytest.mark.parametrize(("speck", "many"), [(1, True), (3, True), (4, False)])
def test_specks_have_up_to_three_cells(speck, many):
    cells = np.full((60, 60), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for row in range(5, 55, 10):
        for col in range(5, 55, 10):
            cells[row, col : col + speck] = OCCUPIED
    assert list_fault_kinds(OccupancyGrid(cells, 0.05)) == ["specks"] * many
    assert list_fault_kinds(OccupancyGrid(cells, 0.2)) == []  # fewer than one a square metre
    cells[cells == FREE] = UNKNOWN
    cells[30, 30] = FREE
    assert "specks" not in list_fault_kinds(OccupancyGrid(cells, 0.05))


def test_specks_do_not_depend_on_bands(monkeypatch):
    random = np.random.default_rng(0)
    cells = np.where(random.random((90, 40)) < 0.1, OCCUPIED, FREE).astype(np.uint8)
    grid = OccupancyGrid(cells, 0.05)
    whole = faults(grid).cells
    monkeypatch.setattr("locplan.maps.map_faults.ROWS", 7)
    assert whole.any()
    assert np.array_equal(faults(grid).cells, whole)


def test_faults_name_painted_unknown_space():
    cells = np.full((60, 60), OCCUPIED, np.uint8)
    cells[20:40, 10:50] = FREE
    painted = OccupancyGrid(cells, 0.05)
    assert "painted unknown" in list_fault_kinds(painted)
    assert "painted unknown" not in list_fault_kinds(hollow_walls(painted))
    some = np.where(np.arange(60) == 0, UNKNOWN, cells).astype(np.uint8)
    assert "painted unknown" not in list_fault_kinds(OccupancyGrid(some, 0.05))
    cells = cells.copy()
    cells[2:58, 2:58] = FREE  # walls of two cells are no painted space
    assert "painted unknown" not in list_fault_kinds(OccupancyGrid(cells, 0.05))
    assert "painted unknown" not in list_fault_kinds(blocks())  # nor are a few racks


def save_and_read_map(folder, name, pixels, free_thresh=0.196):
    Image.fromarray(pixels).save(folder / "lab.png")
    (folder / f"{name}.yaml").write_text(
        "image: lab.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        f"occupied_thresh: 0.65\nfree_thresh: {free_thresh}\n"
    )
    return read_map(folder / f"{name}.yaml")


def test_mask_is_not_checked_for_walls(tmp_path):
    for name, expected in (
        ("keepout", "mask"),
        ("lab_virtual_walls", "mask"),
        ("virtual_lab", "solid walls"),
        ("costmap", "solid walls"),
    ):
        found = faults(*save_and_read_map(tmp_path, name, blocks().cells))
        assert [each.kind for each in found] == [expected]


def test_faults_use_intended_thresholds(tmp_path):
    pixels = np.full((60, 60), 254, np.uint8)
    pixels[:, 30:] = 205  # map_saver's grey, here read as free
    pixels[5:55:2, 35:55:2] = 0  # within it
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    grid, source = save_and_read_map(tmp_path, "lab", pixels, free_thresh=0.25)
    found = faults(grid, source)
    assert [each.kind for each in found] == ["thresholds"]
    assert [each.kind for each in faults(grid)] == ["specks"]
    assert np.array_equal(found.repaired_map.cells[::-1] == FREE, pixels == 254)
    assert found.summary()["map"]["digest"] == grid.digest


def test_faults_are_saved_and_reported(tmp_path):
    found = faults(blocks())
    found.save(tmp_path)
    assert {"faults.json", "faults.csv", "faults.png"} <= {each.name for each in tmp_path.iterdir()}
    assert "solid walls: walls are black inside" in found.report()
    assert found.summary()["faults"][0]["sure"] is True
    assert "no fault" in faults(ascii_map(" ###", " #.#", " ###", resolution=0.5)).report()
    assert "coarse cells: cells of 1 m" in faults(ascii_map(" ###", " #.#", " ###")).report()


@pytest.mark.long
def test_real_maps_have_expected_solid_walls(real_maps):
    every = {file.parent.name: faults(*read_map(file)) for file in find_maps(real_maps)}
    found = {name for name, each in every.items() if each.is_solid}
    assert found == SOLID
    painted = {n for n, each in every.items() if "painted unknown" in {f.kind for f in each}}
    assert painted == SOLID - {"navfn_willow_costmap"}


@pytest.mark.parametrize(("values", "is_costmap"), [((50, 253, 254), True), ((0, 252, 254), False)])
def test_faults_recognize_costmap(tmp_path, values, is_costmap):
    pixels = np.random.default_rng(0).choice(np.array(values, np.uint8), (60, 80))
    found = faults(*save_and_read_map(tmp_path, "lab", pixels))
    assert ("costmap" in [each.kind for each in found]) == is_costmap
    assert ("this is a costmap, not a map" in found.report()) == is_costmap
