"""What `describe_map` tells of a map: size, rooms, places, and what misleads."""

import json
import math
import shlex
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from support.cases import sample_cases
from support.command_line import check_refusal
from support.maps import ascii_map, random_rooms

from locplan import Fused, Lidar, covariance_field
from locplan._support.drawing import save_figure
from locplan.maps import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    OccupancyGrid,
    faults,
    figures as _cells,
    find_maps,
    read_map,
)
from locplan.maps.figures import map_figure
from locplan.planning import Costmap, describe_map, plan
from locplan.planning.figures import map_info_figure
from locplan.planning.metrics import compare_lidars

TWO_ROOMS = (
    "##############",
    "#....#.......#",
    "#....#.......#",
    "#....#.......#",
    "##############",
)
U_TURN = (
    "###########",
    "#.........#",
    "#.#######.#",
    "#.#     #.#",
    "#.#     #.#",
    "###     ###",
)
YAML = "image: {image}\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\n{more}\n"
USUAL = "occupied_thresh: 0.65\nfree_thresh: 0.196"


def misleading(grid, source=None):
    """The sentences of a map's faults."""
    return tuple(each.sentence for each in faults(grid, source))


def image_map(folder, pixels, more=USUAL, name="lab"):
    """A map file of grey pixels, top row first."""
    Image.fromarray(np.array(pixels, np.uint8)).save(folder / f"{name}.png")
    (folder / f"{name}.yaml").write_text(YAML.format(image=f"{name}.png", more=more))
    return folder / f"{name}.yaml"


def walled(inside, wall=0, size=12):
    """Pixels of a square room with a wall one pixel thick."""
    pixels = np.full((size, size), wall, np.uint8)
    pixels[1:-1, 1:-1] = inside
    return pixels


def room_of(info, place):
    return info.room_of_cell[info.grid.cell((place.x, place.y))]


def test_rooms_are_numbered_by_area():
    info = describe_map(ascii_map(*TWO_ROOMS), robot=0.0)
    assert [(room.number, room.area) for room in info.rooms] == [(1, 21.0), (2, 12.0)]
    assert info.room_of_cell[2].tolist() == [0, 2, 2, 2, 2, 0, 1, 1, 1, 1, 1, 1, 1, 0]
    assert {place.room for place in info.places} == {1, 2}
    for pair in info.pairs:
        assert room_of(info, pair.start) == room_of(info, pair.goal) == pair.start.room
    assert info.pairs[0].start.room == 1
    assert [place.name for place in info.places] == list("ABCDEFGH")[: len(info.places)]


def test_levels_have_areas_and_shares():
    info = describe_map(ascii_map("##.. ", "##...", resolution=0.5), robot=0.0)
    assert (info.free.area, info.occupied.area, info.unknown.area) == (1.25, 1.0, 0.25)
    assert (info.free.share, info.occupied.share, info.unknown.share) == (0.5, 0.4, 0.1)


def test_robot_radius_separates_rooms():
    doors = ascii_map(*["#" * 13], *["#.....#.....#"] * 2, "#...........#", *["#.....#.....#"] * 2)
    assert len(describe_map(doors, robot=0.4).rooms) == 1
    assert len(describe_map(doors, robot=0.6).rooms) == 2


@pytest.mark.parametrize(("cells", "rooms"), [(6, 1), (7, 2)])
def test_room_needs_tenth_of_largest_area(cells, rooms):
    lines = ["#" * 18, "#........#" + ("." * cells).ljust(8, "#"), *["#........#########"] * 7]
    info = describe_map(ascii_map(*lines, "#" * 18, resolution=0.3), robot=0.0)
    assert (len(info.rooms), info.specks) == (rooms, 2 - rooms)


def test_specks_are_summed_up():
    lines = ["#" * 14, *["#........#.#.#"] * 8, "#" * 14]
    lines[3] = lines[6] = "#........#####"
    info = describe_map(ascii_map(*lines, resolution=0.3), robot=0.0)
    assert len(info.rooms) == 1
    assert info.specks == 6
    assert info.specks_area == pytest.approx(12 * 0.09)
    assert "6 specks" in info.report()


def test_places_are_chosen_by_path_length():
    info = describe_map(ascii_map(*U_TURN), robot=0.0)
    first = info.pairs[0]
    assert (first.start.x, first.goal.x) == (1.5, 9.5)
    assert max(first.start.y, first.goal.y) < 2
    assert first.distance == 14
    assert info.pairs[1].distance < first.distance


def test_places_are_connected_and_clear():
    cells = np.pad(random_rooms((200, 300), seed=4), 1)
    grid = OccupancyGrid(cells, 0.05, (-3.0, 2.0, 0.4))
    info = describe_map(grid, robot=0.2)
    costs = Costmap.blank(grid, robot=0.2)
    assert len(info.pairs) >= 3
    for pair in info.pairs:
        ends = (pair.start.x, pair.start.y), (pair.goal.x, pair.goal.y)
        length = plan(costs, *ends, planner="grid").metrics.length
        assert length == pytest.approx(pair.distance, abs=0.3)
    for place in info.places:
        assert grid.clearance[grid.cell((place.x, place.y))] > 0.35


def test_places_are_independent_of_origin():
    grid = ascii_map(*U_TURN, resolution=0.5)
    turned = OccupancyGrid(grid.cells, 0.5, (10.0, -4.0, math.radians(130)))
    infos = [describe_map(each, robot=0.0) for each in (grid, turned)]
    cells = [{info.grid.cell((place.x, place.y)) for place in info.places} for info in infos]
    assert cells[0] == cells[1]
    assert infos[1].extent[0] == pytest.approx(
        10 - 5.5 * math.cos(math.radians(50)) - 3 * 0.766, abs=0.01
    )


def test_large_room_uses_coarser_grid(monkeypatch):
    grid = OccupancyGrid(np.pad(random_rooms((200, 300), seed=4), 1), 0.05, (1.0, 2.0, 0.4))
    exact = describe_map(grid, robot=0.2).pairs[0].distance
    monkeypatch.setattr("locplan.planning.cost_to_go.MAX_ROOM_CELLS", 4000)
    coarse = describe_map(grid, robot=0.2)
    assert coarse.pairs[0].distance == pytest.approx(exact, rel=0.05)
    for place in coarse.places:
        assert room_of(coarse, place) == place.room


@pytest.mark.parametrize("radius", [0.2, 0.8])
def test_banded_description_equals_whole_description(monkeypatch, radius):
    cells = np.pad(random_rooms((200, 300), seed=6, blocks=90), 1)
    grid = OccupancyGrid(cells, 0.05, (1.0, 2.0, 0.4))
    whole = describe_map(grid, robot=radius)
    assert len(whole.rooms) > 1
    monkeypatch.setattr("locplan.planning.grid.BAND_CELLS", 7 * 302)
    banded = describe_map(grid, robot=radius)
    np.testing.assert_array_equal(banded.room_of_cell, whole.room_of_cell)
    assert banded.report() == whole.report()
    assert banded.summary() == whole.summary()


def test_describe_map_uses_little_memory(monkeypatch):
    """2^28 cells, the most that are read, are described in under 2 GB."""
    monkeypatch.setattr("locplan.planning.grid.BAND_CELLS", 2**14)
    cells = np.tile(np.pad(np.full((48, 60), FREE, np.uint8), 2), (20, 16))
    grid = OccupancyGrid(cells, 0.05)
    describe_map(grid)  # so that what is imported does not count
    tracemalloc.start()
    describe_map(grid)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 6 * cells.size


def test_describe_map_skips_surroundings_of_rooms():
    lines = ["............", ".##########.", *[".#........#."] * 3, ".##########.", "............"]
    info = describe_map(ascii_map(*lines), robot=0.0)
    assert info.rooms[0].area > info.rooms[1].area
    assert {pair.start.room for pair in info.pairs} == {2}
    assert (info.main_part == (info.room_of_cell == 2)).all()


def test_places_lie_in_open_building():
    """Places lie in the building that contains a closet, not on the ground around it."""
    cells = np.full((80, 120), FREE, np.uint8)
    for box in np.s_[20:61:40, 20:101], np.s_[20:61, 20:101:80]:
        cells[box] = OCCUPIED
    cells[40:44, 20] = FREE  # the door to the outside
    cells[48:57, [60, 68]] = cells[[48, 56], 60:69] = OCCUPIED
    info = describe_map(OccupancyGrid(cells, 0.25), robot=0.2)
    assert len(info.rooms) == 2
    assert all(5 < place.x < 25.25 and 5 < place.y < 15.25 for place in info.places)
    assert info.pairs[0].distance > 15
    assert not info.main_part[:20].any()
    assert info.main_part[25:35, 25:55].all()


def test_describe_map_uses_ground_around_obstacles():
    """Two obstacles and a closet on free ground are no building."""
    cells = np.full((80, 80), FREE, np.uint8)
    cells[60:, 30], cells[60:, 40], cells[60, 30:41] = OCCUPIED, OCCUPIED, OCCUPIED
    info = describe_map(OccupancyGrid(cells, 0.25), robot=0.2)
    assert {pair.start.room for pair in info.pairs} == {1}
    assert info.pairs[0].distance > 15


@pytest.mark.parametrize("level", [FREE, UNKNOWN, OCCUPIED])
def test_describe_map_accepts_single_cell(level, tmp_path):
    info = describe_map(OccupancyGrid([[level]], 1.0), robot=0.25)
    assert info.places == info.pairs == ()
    assert len(info.rooms) == (level == FREE)
    assert info.warnings
    json.dumps(info.summary(), allow_nan=False)
    assert "1 x 1 cells" in info.report()
    save_figure(map_info_figure(info), tmp_path / "one.png")


def test_describe_map_warns_without_free_cells(tmp_path):
    info = describe_map(ascii_map("####", "#  #", "####"))
    assert info.rooms == info.pairs == ()
    assert any("no cell is free" in warning for warning in info.warnings)
    assert "no room for a robot of radius 0.2" in info.report()
    save_figure(map_info_figure(info), tmp_path / "none.png")


def test_describe_map_warns_of_unsuitable_radius():
    grid = ascii_map("#####", "#...#", "#####", resolution=0.2)
    assert any("fits nowhere: the widest" in text for text in describe_map(grid).warnings)
    (text,) = describe_map(grid, robot=0.05).warnings
    assert "a cell of 0.2 m is larger than the robot's radius of 0.05 m" in text


def test_usual_map_has_no_faults(tmp_path):
    pixels = np.pad(walled(254), 3, constant_values=205)
    assert misleading(*read_map(image_map(tmp_path, pixels))) == ()


GREY_ROOM = np.pad(walled(254), 3, constant_values=205)
NEARLY_GREY = np.pad(walled(254), 3, constant_values=206)
GREY_WALLS = np.pad(walled(254, wall=120), 3, constant_values=205)
RAW = "mode: raw\n" + USUAL


@pytest.mark.parametrize(
    ("pixels", "more", "warning"),
    [
        (GREY_ROOM, "occupied_thresh: 0.65\nfree_thresh: 0.25", "lower free_thresh to 0.196"),
        (NEARLY_GREY, USUAL, "mostly 206, are read as free"),
        (NEARLY_GREY, USUAL, "lower free_thresh to 0.15"),
        (GREY_WALLS, USUAL, "44 dark grey pixels are read as unknown, beside 0 occupied"),
        (walled(254), "occupied_thresh: 0.5\nfree_thresh: 0.5", "are both 0.5"),
        (walled(254), RAW, "100 pixels (69%) are above 100"),
        (walled(254), "mode: scale\noccupied_thresh: 1.0\nfree_thresh: 0.0", "a mask for a"),
        (np.full((9, 9), 254), USUAL, "no cell is occupied"),
        (np.full((9, 9), 254), USUAL, "runs out of the image along 16 m (100% of its edge)"),
        (np.full((9, 9), 0), USUAL, "no cell is free"),
        (np.pad(GREY_WALLS, ((0, 9), (0, 0))), USUAL, "is open to the unknown instead of walled"),
    ],
)
def test_faults_name_misleading_settings(tmp_path, pixels, more, warning):
    file = image_map(tmp_path, pixels, more)
    assert any(warning in text for text in misleading(*read_map(file))), misleading(*read_map(file))


def test_faults_ignore_grey_and_transparent_pixels(tmp_path):
    """Only dark grey pixels may be walls."""
    assert misleading(*read_map(image_map(tmp_path, GREY_ROOM.clip(None, 254)))) == ()
    drawn_map = np.where(GREY_ROOM == 205, 128, GREY_ROOM)
    assert misleading(*read_map(image_map(tmp_path, drawn_map))) == ()
    file = image_map(tmp_path, GREY_WALLS)
    grey = Image.open(tmp_path / "lab.png")
    Image.merge("LA", (grey, grey.point(lambda v: 0 if v == 120 else 255))).save(
        tmp_path / "lab.png"
    )
    assert read_map(file)[1].dark_unknown == 0


@pytest.mark.parametrize("courtyard", [slice(0), slice(14, 26)], ids=["outside", "courtyard"])
def test_dark_grey_surroundings_are_no_wall(tmp_path, courtyard):
    """Rays of free cells cut thin pieces off the outside, as on maps that a robot made."""
    pixels = np.pad(walled(254, size=40), 12, constant_values=150)
    pixels[courtyard, 14:26] = 150
    pixels[30, 40:] = pixels[33, 40:] = 254
    assert not any(
        "dark grey" in text for text in misleading(*read_map(image_map(tmp_path, pixels)))
    )


def test_dark_grey_edge_walls_are_reported(tmp_path):
    pixels = walled(254, wall=107, size=40)
    pixels[0, 5:10] = 0
    assert "151 dark grey" in " ".join(misleading(*read_map(image_map(tmp_path, pixels))))


def test_lidars_are_compared_by_fused(monkeypatch):
    def load(grid, config, **_):
        assert config.estimator == Fused(lidar)
        return covariance_field(grid, config)

    monkeypatch.setattr("locplan.planning.metrics.load_or_compute", load)
    lidar = Lidar(range=1.0, beams=12)
    (found,) = compare_lidars(OccupancyGrid(walled(254, size=16), 0.25), [lidar])
    assert found.lidar == lidar


def test_names_tell_masks_by_whole_words(tmp_path):
    mask = image_map(tmp_path, GREY_ROOM, name="lab_keepout")
    assert "its name has the word keepout" in misleading(*read_map(mask))[0]
    assert misleading(*read_map(image_map(tmp_path, GREY_ROOM, name="speedway"))) == ()


def test_faults_name_yaw_and_suspect_degrees():
    grid = ascii_map("###", "#.#", "###", resolution=0.5)
    turned = replace(grid, origin=(0.0, 0.0, 0.5))
    assert "yaw of 28.65 deg counts" in misleading(turned)[0]
    assert "looks like degrees" in misleading(replace(grid, origin=(0.0, 0.0, 90.0)))[0]
    assert misleading(grid) == ()


@pytest.mark.parametrize("resolution", [0.05, 0.0504, 0.3])
def test_cells_near_walls_match_clearance(resolution):
    for seed, distance in enumerate((0.0, 0.025, 0.025 + 1e-9, 0.075, 0.25, 0.31, 1.7)):
        cells = random_rooms((40, 50), seed)
        far = OccupancyGrid(cells, resolution).cells_near_walls(distance)
        np.testing.assert_array_equal(far, OccupancyGrid(cells, resolution).clearance < distance)


def test_info_figure_shows_rooms_and_places():
    grid = ascii_map(*TWO_ROOMS)
    info = describe_map(OccupancyGrid(grid.cells, 1.0, (5.0, -2.0, 0.3), "lab"), robot=0.0)
    figure = map_info_figure(info)
    (axes,) = figure.axes
    assert axes.get_title().startswith("lab: 14 x 5 m, 1 m a cell, yaw 17.19 deg\n2 rooms")
    figure.canvas.draw()
    lines = [tick.gridline.get_visible() for tick in axes.xaxis.get_major_ticks()]
    assert all(lines)
    low, high = axes.get_xlim()
    assert 8 <= sum(low <= x <= high for x in axes.get_xticks()) <= 26
    texts = {text.get_text(): text.get_position() for text in axes.texts}
    assert texts == {place.name: (place.x, place.y) for place in info.places}
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert named[:2] == ["room 1, 21.0 m²", "room 2, 12.0 m²"]
    assert f"{info.places[0].position_argument} m" in named


def test_map_figure_keeps_walls_if_downsampled(monkeypatch):
    monkeypatch.setattr(_cells, "MAX_DRAWN_CELLS", 20)
    cells = np.full((50, 31), FREE, np.uint8)
    cells[:, 17] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1)
    image = map_figure(grid).axes[0].images[0]
    shades = image.get_array()
    assert shades.shape == (17, 11)
    assert (shades[:, 5] == 0).all()
    assert (shades == 0).sum() == 17
    assert image.get_extent() == pytest.approx((0, 3.3, 0, 5.1))


@pytest.mark.parametrize("resolution", [0.2, 2.0, 5.0])
def test_info_figure_limits_grid_lines(resolution):
    """The longer side has more than 9 and at most 24 spacings."""
    grid = OccupancyGrid(ascii_map(*TWO_ROOMS).cells, resolution, (0.0, 0.0, 0.0))
    (axes,) = map_info_figure(describe_map(grid, robot=0.0)).axes
    spacing = np.diff(axes.get_xticks())[0]
    assert 9 < max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())) / spacing <= 24


def test_info_command_prints_table_or_json(run, tmp_path):
    """It also writes the picture, and the command that it prints runs."""
    file = image_map(tmp_path, walled(254, size=16))
    code, out, err = run("info", file, "-o", tmp_path / "info.png", "--set", "footprint=0.25")
    assert code == 0
    assert (tmp_path / "info.png").stat().st_size > 1000
    assert (out.splitlines()[-1], err) == (f"wrote {tmp_path / 'info.png'}: the picture", "")
    assert "16 x 16 cells, 8.00 x 8.00 m" in out
    assert "free_thresh 0.196, occupied_thresh 0.65" in out
    (command, *_) = [line.strip() for line in out.splitlines() if "locplan plan" in line]
    assert command.endswith("--lidar turtlebot4 --set footprint=0.3 --set margin=0")
    code, out, _ = run("info", file, "--json")
    about = json.loads(out)
    assert about["pairs"][0]["distance"] > 7
    assert "--set" not in about["pairs"][0]["command"]
    few = "--set", "min_particles=100", "--set", "max_particles=100", "--drives", 2
    code, out, _ = run(*shlex.split(command)[1:], "--set", "range=1", *few, "--json")
    assert code == 0
    assert json.loads(out)["robot"]["lidar"]["range"] == 1


def test_info_command_prints_fault_once(run, tmp_path):
    file = image_map(tmp_path, GREY_ROOM, "occupied_thresh: 0.65\nfree_thresh: 0.25")
    code, out, err = run("info", file)
    assert (code, err) == (0, "")
    assert out.count("warning: 180 pixels") == 1


def test_wrong_pictures_and_radii_are_refused(run, tmp_path):
    file = image_map(tmp_path, walled(254))
    assert "must end in .png" in check_refusal(run("info", file, "-o", tmp_path / "info.txt"))
    first = run("info", tmp_path / "no.yaml", "-o", tmp_path / "info.txt")  # before the map is read
    assert "must end in .png" in check_refusal(first)
    assert "replaces lab.png" in check_refusal(run("info", file, "-o", tmp_path / "lab.png"))
    assert "margin must be at least 0" in check_refusal(run("info", file, "--set", "margin=-1"))


def test_report_shortens_list_of_rooms(monkeypatch):
    monkeypatch.setattr("locplan.planning.map_info.MAX_LISTED_ROOMS", 1)
    text = describe_map(ascii_map(*TWO_ROOMS), robot=0.0).report()
    assert "1 more" in text
    assert "12.0 m²" in text


MASKS = ("nav2_depot_keepout", "nav2_speed_mask", "fetch_3_1_16_limit_raw")
SOME = ("nav2_depot", "willow_garage_0.10", "aws_small_house", "tb4_depot", *MASKS)


@pytest.mark.parametrize("names", sample_cases([SOME, ("",)]), ids=["some", "all"])
def test_real_maps_are_described(real_maps, names):
    said = {}
    for file in (file for name in names for file in find_maps(real_maps / name)):
        info = describe_map(file)
        costs = Costmap.blank(info.grid)
        for place in info.places:
            assert costs.find_cell((place.x, place.y))
        assert info.report()
        said[file.parent.name] = " ".join(info.warnings)
    assert "lower free_thresh to 0.196" in said["nav2_depot"]
    assert "dark grey pixels are read as unknown" in said["willow_garage_0.10"]
    for name in MASKS:
        assert "a mask for a costmap filter" in said[name]
    assert said["aws_small_house"] == said["tb4_depot"] == ""
