"""The repaired map for the filter: its cells, its verdict, and its files for Nav2."""

import numpy as np
import pytest
import yaml
from PIL import Image
from support.command_line import check_refusal
from support.maps import ascii_map, blocks

import locplan
from locplan import load_map, repair, save_map
from locplan.advice.figures import repair_figure
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, faults, hollow_walls
from locplan.maps.files import format_corrected_yaml, read_map, with_corrected_thresholds

pytestmark = pytest.mark.usefixtures("undrawn")

ROOM = ascii_map("########", *["#......#"] * 4, "########", resolution=0.5)


@pytest.fixture(scope="module")
def blocks_repair():
    return repair(blocks(), paths=2, drives=8)


def test_hollow_map_loses_fewer_drives(blocks_repair):
    assert blocks_repair.grid == blocks()
    assert blocks_repair.filter_map == hollow_walls(blocks())
    (verdict,) = blocks_repair.verdicts
    assert verdict.lost_repaired.value < verdict.lost_as_is.value
    assert verdict.rmse_ratio.value < 1
    assert verdict.verdict == blocks_repair.summary()["verdicts"][0]["verdict"] == "better"
    assert "better" in blocks_repair.report()


def test_repair_figure_names_lost_drives(blocks_repair):
    (verdict,) = blocks_repair.verdicts
    figure = repair_figure(blocks_repair)
    assert figure.get_suptitle().endswith(f"repaired map: {verdict.verdict} for {verdict.filter}")
    titles = [axes.get_title() for axes in figure.axes]
    shares = verdict.lost_as_is.value, verdict.lost_repaired.value
    for title, share in zip(titles, shares, strict=True):
        assert f"\n{share:.0%} of the drives lost, {verdict.filter}" in title


def test_repair_drives_default_and_robot_filter(blocks_repair):
    robot = locplan.Robot().with_settings({"alpha1": 0.05})
    both = repair(blocks(), robot, paths=2, drives=8)
    assert both.verdicts[0] == blocks_repair.verdicts[0]
    assert [each.filter for each in both.verdicts] == ["Nav2's defaults", "the robot's"]
    assert both.verdicts[1] != both.verdicts[0]


def test_repair_skips_drives_without_faults(tmp_path):
    result = repair(ROOM)
    assert (result.n_changed, result.verdicts) == (0, ())
    assert "Nothing to repair" in result.report()
    result.save(tmp_path / "room")
    assert not (tmp_path / "room" / "map_amcl.yaml").exists()


def test_specks_are_erased_and_walls_stay():
    cells = np.full((60, 60), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    walls = cells.copy()
    cells[5:55:8, 5:55:8] = OCCUPIED
    result = repair(OccupancyGrid(cells, 0.05), locplan.Robot(footprint=0.02, margin=0.0), drives=2)
    assert np.array_equal(result.filter_map.cells, walls)


def test_repair_writes_second_map_server(blocks_repair, tmp_path):
    """It has its own lifecycle manager."""
    blocks_repair.save(tmp_path)
    written = load_map(tmp_path / "map_amcl.yaml")
    assert np.array_equal(written.cells, blocks_repair.filter_map.cells)
    assert (written.resolution, written.origin) == (blocks().resolution, blocks().origin)
    assert yaml.safe_load((tmp_path / "map_amcl.yaml").read_text())["mode"] == "trinary"
    servers = yaml.safe_load((tmp_path / "servers.yaml").read_text())
    topic = servers["map_amcl_server"]["ros__parameters"]["topic_name"]
    amcl = yaml.safe_load((tmp_path / "amcl.yaml").read_text())
    assert amcl["amcl"]["ros__parameters"] == {"map_topic": topic}
    manager = servers["lifecycle_manager_map_amcl"]["ros__parameters"]
    assert manager == {"autostart": True, "node_names": ["map_amcl_server"]}
    launch = (tmp_path / "localizability.launch.xml").read_text()
    assert '<param name="yaml_filename" value="$(dirname)/map_amcl.yaml"/>' in launch


def test_simulate_suggests_repair_of_solid_walls(tmp_path, run):
    save_map(blocks(), tmp_path / "blocks.yaml")
    save_map(hollow_walls(blocks()), tmp_path / "hollow.yaml")
    words = "--start", "0.8,0.8", "--goal", "3,0.8", "--drives", "2", "--lidar", "turtlebot3"
    simulate = "simulate", tmp_path / "blocks.yaml", *words
    code, _, err = run(*simulate)
    assert (code, err.count("Run `locplan repair`")) == (0, 1)
    code, _, err = run(*simulate, "--filter-map", tmp_path / "hollow.yaml")
    assert (code, err.count("repair")) == (0, 0)


def test_report_names_affected_filters(blocks_repair, tmp_path, run):
    """A beam model needs no repaired map."""
    (line,) = (each for each in blocks_repair.report().splitlines() if "helps" in each)
    assert "AMCL, als_ros" in line
    assert "als_ros" not in repair(ROOM).report()
    save_map(blocks(), tmp_path / "blocks.yaml")
    beam = tmp_path / "beam.yaml"
    beam.write_text(yaml.safe_dump({"amcl": {"ros__parameters": {"laser_model_type": "beam"}}}))
    words = "repair", tmp_path / "blocks.yaml", "--robot", beam, "--lidar", "turtlebot3"
    assert "needs no repaired map" in check_refusal(run(*words))


def test_repair_rejects_wrong_numbers(tmp_path, run):
    save_map(ROOM, tmp_path / "room.yaml")
    assert "drives" in check_refusal(run("repair", tmp_path / "room.yaml", "--drives", "1"))
    assert "paths" in check_refusal(run("repair", tmp_path / "room.yaml", "--paths", "0"))


def test_repair_rejects_costmap_filter_mask(tmp_path, run):
    save_map(ROOM, tmp_path / "speed_mask.yaml")
    mask = "repair", tmp_path / "speed_mask.yaml", "-o", tmp_path / "repaired"
    assert "plan on the map that it belongs to" in check_refusal(run(*mask))
    assert not (tmp_path / "repaired").exists()


def test_repair_recognizes_costmap_file(tmp_path, run):
    pixels = np.full((60, 80), 254, np.uint8)
    pixels[20:30, 20:40] = 253
    pixels[[0, -1]] = pixels[:, [0, -1]] = 50
    lab = write_map(tmp_path, pixels, "occupied_thresh: 0.65\nfree_thresh: 0.196")
    code, out, _ = run("repair", lab)
    assert (code, "costmap: this is a costmap, not a map" in out) == (0, True)


def write_map(folder, pixels, thresholds):
    Image.fromarray(pixels).save(folder / "lab.png")
    (folder / "lab.yaml").write_text(
        f"image: lab.png\nresolution: 0.1\norigin: [0, 0, 0]\n{thresholds}\n"
    )
    return folder / "lab.yaml"


def test_repair_corrects_thresholds_in_both_maps(tmp_path, run):
    """One map is for the filter, one for planning."""
    pixels = np.full((60, 80), 254, np.uint8)
    pixels[[0, -1]] = pixels[:, [0, -1]] = pixels[20:24, 20:60] = 110
    lab = write_map(tmp_path, pixels, "occupied_thresh: 0.65\nfree_thresh: 0.196")
    words = "repair", lab, "--paths", "2", "--drives", "2", "-o", tmp_path / "repaired"
    code, out, _ = run(*words)
    assert (code, "Plan on map.yaml (free_thresh 0.196" in out) == (0, True)
    read = load_map(tmp_path / "repaired" / "map.yaml")
    assert np.array_equal(read.cells == OCCUPIED, pixels[::-1] == 110)
    assert np.array_equal(load_map(tmp_path / "repaired" / "map_amcl.yaml").cells, read.cells)
    grid, source = read_map(lab)
    assert with_corrected_thresholds(grid, None) == grid
    result = repair(grid, source=source, paths=2, drives=2)
    assert result.faults.faults == faults(grid, source).faults
    assert result.verdicts[0].rmse_ratio.value < 1


@pytest.mark.parametrize(
    "entries",
    [
        "{image: lab.png, resolution: 0.1, origin: [1, 2, 0], occupied_thresh: 0.65,\n"
        " free_thresh: 0.25, negate: true}",
        '"image": lab.png\nresolution: 0.1 # m\norigin:\n- 1\n- 2\n- 0\nnegate: 1\n'
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n...",
        "resolution: 0.1\norigin: [1, 2, 0]\nnegate: 1\nimage: lab.png\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.65",
    ],
)
def test_threshold_repair_accepts_all_yaml_styles(tmp_path, entries):
    folder = tmp_path / 'of "Anna"'
    folder.mkdir()
    pixels = np.full((60, 80), 1, np.uint8)
    pixels[20:24, 20:60], pixels[40:50, 40:60] = 140, 50
    Image.fromarray(pixels).save(folder / "lab.png")
    (folder / "lab.yaml").write_text(entries)
    grid, source = read_map(folder / "lab.yaml")
    more = {"resolution": 0.2, "origin": [2, 4, 0]}
    (tmp_path / "map.yaml").write_text(format_corrected_yaml(source, more))
    read = load_map(tmp_path / "map.yaml")
    assert (read.resolution, read.origin) == (0.2, (2, 4, 0))
    assert np.array_equal(read.cells, with_corrected_thresholds(grid, source).cells)
    assert set(read.cells[::-1][40:50, 40:60].flat) == {UNKNOWN}


def test_repair_restores_unknown_cells(tmp_path, run):
    """The robot fits nowhere, so that nothing is simulated."""
    pixels = np.full((20, 20), 205, np.uint8)
    pixels[5:11, 5:11] = 0
    pixels[6:10, 6:10] = 254
    lab = write_map(tmp_path, pixels, "occupied_thresh: 0.65\nfree_thresh: 0.25")
    code, out, _ = run("repair", lab)
    assert (code, "The walls are unchanged" in out) == (0, True)
    assert "No simulated drives: lab: has no cell where the robot fits" in out
    result = repair(*read_map(lab)[:1], source=read_map(lab)[1])
    assert np.array_equal(result.filter_map.cells == FREE, pixels[::-1] == 254)
