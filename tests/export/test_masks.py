"""Exports, read as the stacks read them: their loaders, layers, filters and planners' costs."""

import dataclasses
import itertools
import json
import math
import re
import sys
import warnings
from contextlib import nullcontext
from importlib import import_module

import numpy as np
import pytest
import yaml
from support import ros_readers
from support.cases import sample_cases
from support.command_line import check_refusal
from support.maps import ascii_map, random_rooms
from support.smac import (
    STACKS,
    apply_mask,
    compare_with_smac,
    find_far_ends,
    make_roomy,
    plan_by_smac,
)

from locplan import load_map, save_map
from locplan._support.public import read_field_docs
from locplan.errors import LocplanError
from locplan.export import (
    formats as export_formats,
    nav2_keepout,
    nav2_speed,
    plain_files,
    ros_map,
)
from locplan.export.masks import compute_keepout_mask, compute_mask_density
from locplan.export.parameters import DistroWarning, ParametersChanged, RobotWarning
from locplan.export.registry import list_formats
from locplan.export.values import YawWarning, drop_costmap_yaw
from locplan.field import CovarianceField, FieldConfig, Sad, covariance_field, load_or_compute
from locplan.maps import FREE, OccupancyGrid, Zone, Zones, environments
from locplan.planning import Costmap, Path, path_metrics, plan

pytestmark = pytest.mark.usefixtures("undrawn")

PLANNERS = ("smac2d", "smac-hybrid", "thetastar")


@pytest.fixture(scope="module")
def costs():
    """Without symmetry, and with an origin."""
    grid = OccupancyGrid(random_rooms((70, 110), seed=6), 0.1, (2.0, -1.0, 0.0), name="rooms")
    field = covariance_field(grid, FieldConfig(Sad(range=1.0)))
    return Costmap.from_field(field, weight=4.0, robot=0.15)


@pytest.mark.parametrize("stack", ["main", "humble", "ros1"])
def test_ros_map_values_survive_loading(tmp_path, stack):
    values = np.minimum(np.arange(-1, 101), 98).astype(np.int8).reshape(6, 17)
    grid = OccupancyGrid(np.full(values.shape, FREE), 0.05, (1.5, -2.5, 0.0))
    u = np.where(values < 0, np.nan, values / 100)
    ros_map(tmp_path / "map", dataclasses.replace(Costmap.blank(grid), u=u))
    read = ros_readers.load(tmp_path / "map" / "raw.yaml", stack)
    np.testing.assert_array_equal(read.data, values)
    assert read.origin == (1.5, -2.5, 0.0)
    assert read.resolution == float(np.float32(0.05))


def test_ros_map_contains_u_in_percent(tmp_path, costs):
    ros_map(tmp_path / "u", costs)
    per_cent = np.minimum(np.floor(100 * np.nan_to_num(costs.u) + 0.5), 98)
    expected = np.where(np.isnan(costs.u), -1, per_cent)
    for stack in ("main", "humble", "ros1"):
        read = ros_readers.load(tmp_path / "u" / "raw.yaml", stack)
        np.testing.assert_array_equal(read.data, expected)


def test_static_layer_accepts_ros_map(tmp_path, costs):
    """With the README's parameters, the layer reads no value of u as an obstacle."""
    certain = dataclasses.replace(costs, u=np.where(costs.grid.free, 1.0, np.nan))
    ros_map(tmp_path / "u", certain)
    values = ros_readers.load(tmp_path / "u" / "raw.yaml", "main").data
    readme = (tmp_path / "u" / "README.md").read_text()
    layer = {}
    for text in re.findall("`([a-z_]+: [^`]+)`", readme):
        layer |= yaml.safe_load(text)
    assert layer["localizability_layer"]["plugin"] == "nav2_costmap_2d::StaticLayer"
    assert layer["use_maximum"] is True
    for stack in ("main", "humble"):
        soft = ros_readers.static_layer(
            values,
            stack,
            trinary_costmap=layer["trinary_costmap"],
            lethal_cost_threshold=layer["lethal_cost_threshold"],
            track_unknown_space=True,
        )
        assert (soft[costs.grid.free] == 248).all()
        assert (soft[~costs.grid.free] == ros_readers.NO_INFORMATION).all()  # the walls below count


@pytest.mark.parametrize("stack", STACKS)
@pytest.mark.parametrize("name", PLANNERS)
def test_planner_cost_matches_costmap_density(tmp_path, costs, name, stack):
    conversion = nav2_keepout(tmp_path / "mask", costs, planner=name)
    master = apply_mask(tmp_path / "mask", costs, stack)
    passable = np.isfinite(costs.density)
    assert (master[~passable] >= ros_readers.INSCRIBED).all()
    assert (master[passable] <= 251).all()
    parameters = yaml.safe_load((tmp_path / "mask" / "nav2.yaml").read_text())
    own = parameters["planner_server"]["ros__parameters"]["GridBased"]
    charged = {
        "smac2d": lambda: ros_readers.smac2d_multiplier(master, own["cost_travel_multiplier"]),
        "smac-hybrid": lambda: (
            ros_readers.smac_hybrid_multiplier(master, own["cost_penalty"])
            / ros_readers.smac_hybrid_multiplier(np.zeros(1, np.uint8), 0.0)
        ),
        "thetastar": lambda: (
            (own["w_euc_cost"] + ros_readers.theta_star_traversal(master, own["w_traversal_cost"]))
            / (
                own["w_euc_cost"]
                + ros_readers.theta_star_traversal(np.zeros(1, np.uint8), own["w_traversal_cost"])
            )
        ),
    }[name]()
    error = np.abs(charged - compute_mask_density(costs))[passable & (master < 251)]
    assert conversion.saturated_share == 0
    assert error.max() <= conversion.quantisation + 1e-5
    assert conversion.quantisation < 0.06
    assert error.mean() == pytest.approx(conversion.mean_quantisation, rel=0.2)


def test_mask_export_reports_saturation(tmp_path, costs):
    heavy = costs.with_weight(10.0)
    excess = 10.0 * heavy.u[heavy.grid.free]
    k = float(np.median(excess))
    conversion = nav2_keepout(tmp_path / "mask", heavy, planner="smac2d", planner_param=k)
    assert conversion.max_excess == pytest.approx(k * 251 / 252)
    above = excess[heavy.grid.clearance[heavy.grid.free] >= 0.45] > conversion.max_excess
    assert conversion.saturated_share == pytest.approx(above.mean())
    assert 0 < conversion.saturated_share < 1
    row, col = heavy.grid.cell(conversion.most_saturated_place)
    assert 10.0 * heavy.u[row, col] > k
    x, y = conversion.most_saturated_place
    assert f"room for a follower, most of them around ({x:.2f}, {y:.2f})" in read_readme(
        tmp_path / "mask"
    )
    values = ros_readers.load(tmp_path / "mask" / "mask.yaml", "main").data
    assert (values[10.0 * np.nan_to_num(heavy.u) > k] == 99).all()
    about = json.loads((tmp_path / "mask" / "export.json").read_text())
    assert about["conversion"]["saturates_at_weight_u"] == conversion.max_excess
    with pytest.warns(RobotWarning, match=r"navfn does not follow a mask: it ignores most"):
        assert nav2_keepout(tmp_path / "n", heavy, planner="navfn").max_excess == 4.0


@pytest.mark.parametrize("write", [nav2_keepout, nav2_speed])
def test_mask_covers_exactly_free_cells(tmp_path, costs, write):
    wide = costs.with_robot(0.3)
    assert np.isinf(wide.density[wide.grid.free]).any()
    write(tmp_path / "out", wide)
    values = ros_readers.load(tmp_path / "out" / "mask.yaml", "main").data
    np.testing.assert_array_equal(values >= 0, wide.grid.free)


@pytest.fixture(scope="module")
def corridors(tmp_path_factory):
    """A folder with the mask of two_corridors, its costmap, and its walls as Nav2 has them."""
    grid = environments.make("two_corridors", resolution=0.05)
    costs = Costmap.from_field(load_or_compute(grid, FieldConfig(stride=0.5)))
    folder = tmp_path_factory.mktemp("corridors") / "mask"
    nav2_keepout(folder, costs)
    walls = np.select([grid.free, grid.cells == 0], [0, 100], -1).astype(np.int8)
    return folder, costs, ros_readers.static_layer(walls, "main", track_unknown_space=True)


@pytest.mark.parametrize(
    ("radius", "scaling"),
    [(None, None), *itertools.product((0.15, 0.22, 0.3), (3.0, 10.0, 30.0, 100.0))],
)
def test_masked_smac2d_path_avoids_blind_corridor(corridors, radius, scaling):
    folder, costs, master = corridors
    grid = costs.grid
    if radius:  # else nothing is inflated
        master = ros_readers.inflation(master, grid.resolution, radius, radius, scaling)
    mask = ros_readers.load(folder / "mask.yaml", "main")
    master = ros_readers.keepout(master, mask, mask.resolution, grid.origin[:2])
    nav2 = yaml.safe_load((folder / "nav2.yaml").read_text())
    own = nav2["planner_server"]["ros__parameters"]["GridBased"]
    at = environments.place_positions("two_corridors")
    ends = (grid.cell(at[end]) for end in ("start", "goal"))
    cells = ros_readers.smac2d_path(master, *ends, own["cost_travel_multiplier"])
    assert max(grid.position(*cell)[1] for cell in cells) > 9  # the irregular corridor


def test_blocked_cells_are_lethal_in_mask(costs):
    mine = np.zeros(costs.grid.shape, bool)
    mine[30:40, 50:70] = True
    values, _ = compute_keepout_mask(costs.with_blocked(mine))
    plain, _ = compute_keepout_mask(costs)
    clear = mine & np.isfinite(costs.density)
    assert clear.any()
    assert (values[clear] == 100).all()
    np.testing.assert_array_equal(values[~clear], plain[~clear])
    density = np.where(mine, np.inf, 1.5)
    values, _ = compute_keepout_mask(Costmap.from_density(costs.grid, density))
    np.testing.assert_array_equal(values == 100, mine & costs.grid.free)


def test_speed_limit_falls_linearly_with_degeneracy(tmp_path, costs):
    """Nav2 reads a limit of 0 as no limit, so the mask never reaches 100."""
    nav2_speed(tmp_path / "speed", costs, slowest=0.25, lead=0.0)
    read = ros_readers.load(tmp_path / "speed" / "mask.yaml", "main")
    servers = yaml.safe_load((tmp_path / "speed" / "servers.yaml").read_text())
    info = servers["localizability_speed_info_server"]["ros__parameters"]
    assert info["type"] == 1
    limit = ros_readers.speed_limit(read.data, info["type"], info["base"], info["multiplier"])
    known = ~np.isnan(costs.u)
    percent = np.where(limit == 0, 100, limit)[known]  # 0 is no limit
    np.testing.assert_allclose(percent, 100 - 75 * costs.u[known], atol=0.5 + 1e-9)
    assert np.isnan(limit[~known]).all()
    nav2_speed(tmp_path / "slow", costs, slowest=0.01)
    slow = ros_readers.load(tmp_path / "slow" / "mask.yaml", "main").data
    assert slow.max() <= 99


def test_speed_limit_begins_before_degenerate_cell(tmp_path):
    grid = OccupancyGrid(np.full((21, 40), FREE), 0.1)
    u = np.zeros(grid.shape)
    u[10, 20] = 1.0
    costs = Costmap.from_layers(grid, u=u)
    nav2_speed(tmp_path / "speed", costs, lead=0.4)
    values = ros_readers.load(tmp_path / "speed" / "mask.yaml", "main").data
    away = np.hypot(*(np.indices(grid.shape) - np.array([10, 20])[:, None, None]))
    np.testing.assert_array_equal(values, np.where(away <= 4, 70, 0))


YAW = 0.6


def test_mask_drops_map_yaw(tmp_path, costs):
    """Nav2 ignores the yaw of a map."""
    grid = OccupancyGrid(costs.grid.cells, 0.1, (2.0, -1.0, YAW), name="turned")
    turned = dataclasses.replace(costs, grid=grid)
    with pytest.warns(YawWarning, match=r"yaw of 0\.6 rad"):
        nav2_keepout(tmp_path / "mask", turned)
    mask = ros_readers.load(tmp_path / "mask" / "mask.yaml", "main")
    assert mask.origin == (2.0, -1.0, 0.0)
    assert (mask.data[np.isfinite(costs.density)] >= 0).all()


def test_thetastar_minimises_j_on_generated_map(tmp_path):
    grid = environments.make("two_corridors", resolution=0.1)
    costs = Costmap.from_field(load_or_compute(grid, FieldConfig()), robot=0.25)
    at = environments.place_positions("two_corridors")
    nav2_keepout(tmp_path / "out", costs, planner="thetastar")
    master = apply_mask(tmp_path / "out", costs)
    nav2 = yaml.safe_load((tmp_path / "out" / "nav2.yaml").read_text())
    own = nav2["planner_server"]["ros__parameters"]["GridBased"]
    fixed = ros_readers.theta_star_traversal(master, own["w_traversal_cost"])
    step, blocked = own["w_euc_cost"], ros_readers.theta_star_blocked(master, own["allow_unknown"])
    ends = [costs.find_cell(at[end]) for end in ("start", "goal")]
    cells, _ = ros_readers.grid_path(step, blocked, *ends, fixed)
    path = Path(np.array([grid.position(*cell) for cell in cells]))
    centres = [grid.position(*cell) for cell in ends]
    costs = make_roomy(costs)
    ours = plan(costs, *centres, planner="grid", allow_corner_cutting=True)
    assert path_metrics(costs, path).cost <= 1.01 * ours.metrics.cost


@pytest.mark.parametrize("name", ["two_corridors", pytest.param("office", marks=pytest.mark.long)])
@pytest.mark.parametrize("weight", [1.0, 12.0])
def test_smac2d_minimises_j_on_generated_maps(tmp_path, name, weight):
    grid = environments.make(name, resolution=0.1)
    field = load_or_compute(grid, FieldConfig())
    costs = Costmap.from_field(field, weight=weight, robot=0.25)
    at = environments.place_positions(name)
    theirs, ours, _ = compare_with_smac(tmp_path / "mask", costs, at["start"], at["goal"])
    assert ours.cost <= theirs.cost * (1 + 1e-9)
    assert theirs.cost <= 1.01 * ours.cost


@pytest.mark.parametrize(
    "name", sample_cases(["aws_small_house", "willow_full_stage", "tuw_warehouse032"])
)
def test_smac2d_minimises_j_on_real_maps(tmp_path, real_maps, name):
    (file,) = (real_maps / name).glob("*.yaml")
    grid = load_map(file)
    field = load_or_compute(grid, FieldConfig(stride=0.4))
    costs = Costmap.from_field(field, weight=4.0, robot=0.2)
    theirs, ours, _ = compare_with_smac(tmp_path / "mask", costs, *find_far_ends(costs, seed=3))
    assert ours.cost <= theirs.cost * (1 + 1e-9)
    assert theirs.cost <= 1.01 * ours.cost


PLACES = (
    *("aws_small_house", "willow_full_stage", "tuw_warehouse032"),
    *("fetch_3_1_16_png", "tb4_depot"),
)


@pytest.mark.long
def test_smac2d_median_j_equals_minimum(tmp_path, real_maps):
    ratios = []
    for name in PLACES:
        (file,) = (real_maps / name).glob("*.yaml")
        grid = load_map(file)
        field = load_or_compute(grid, FieldConfig(stride=0.4))
        costs = Costmap.from_field(field, robot=0.2)
        for seed in range(4):
            theirs, ours, _ = compare_with_smac(tmp_path / name, costs, *find_far_ends(costs, seed))
            ratios.append(theirs.cost / ours.cost)
    assert abs(np.median(ratios) - 1) < 0.003


def test_smac2d_takes_blind_corridor_without_mask(tmp_path):
    grid = environments.make("two_corridors", resolution=0.1)
    costs = Costmap.from_field(load_or_compute(grid, FieldConfig()), robot=0.25)
    at = environments.place_positions("two_corridors")
    nav2_keepout(tmp_path / "mask", costs)
    with_ours = plan_by_smac(tmp_path / "mask", costs, at["start"], at["goal"])
    nav2_keepout(tmp_path / "mask", costs.with_weight(0.0))
    without = plan_by_smac(tmp_path / "mask", costs, at["start"], at["goal"])
    assert without.xy[:, 1].max() < 6
    assert with_ours.xy[:, 1].max() > 9
    assert with_ours.length > without.length + 5


def test_keepout_export_accepts_custom_density(tmp_path, costs):
    density = np.where(np.isfinite(costs.density), 1 + 2 * np.nan_to_num(costs.u), np.inf)
    own = Costmap.from_density(costs.grid, density)
    conversion = nav2_keepout(tmp_path / "mask", own)
    assert conversion.saturated_share == 0
    with pytest.raises(LocplanError, match="needs a covariance field"):
        nav2_speed(tmp_path / "speed", own)
    with pytest.raises(LocplanError, match="needs a covariance field"):
        ros_map(tmp_path / "u", own)


def test_mask_values_minimise_rounding_error(costs):
    density = 1 + np.linspace(0, 8.125, 400)[None]  # 6.5 fits
    blank = Costmap.blank(OccupancyGrid(np.full((1, 400), FREE), 0.1))
    steep = dataclasses.replace(blank, weight=4.0, u=(density - 1) / 4)
    values, conversion = compute_keepout_mask(steep, planner="thetastar")
    charged = conversion.planner.compute_excess(
        np.floor(np.arange(100) * 2.54 + 0.5), conversion.parameter_value
    )
    nearest = np.abs(charged[None] - (density[0] - 1)[:, None]).argmin(axis=1)
    np.testing.assert_array_equal(charged[values[0]], charged[nearest])
    assert conversion.saturated_share == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"planner": "teb"}, "must be one of smac2d"),
        ({"planner": "navfn", "planner_param": 2.0}, "no parameter"),
        ({"planner_param": 0.0}, "must be a positive number"),
        ({"planner_param": math.nan}, "must be a positive number"),
        ({"planner_param": math.inf}, "must be a positive number"),
        ({"distro": "foxy"}, "distro must be one of"),
    ],
)
def test_keepout_export_rejects_wrong_settings(tmp_path, costs, settings, message):
    """A refused export writes no files."""
    with pytest.raises(LocplanError, match=message):
        nav2_keepout(tmp_path / "mask", costs, **settings)
    assert not list(tmp_path.iterdir())


def test_keepout_export_rejects_oversized_robot(tmp_path, costs):
    with pytest.raises(LocplanError, match="no cell of the costmap is passable"):
        nav2_keepout(tmp_path / "mask", costs.with_robot(50.0))


def test_mask_export_rejects_occupied_map(tmp_path):
    walls = ascii_map("###", "###", resolution=0.1)
    costs = Costmap.from_field(load_or_compute(walls, FieldConfig()))
    for write in (nav2_keepout, nav2_speed):
        with pytest.raises(LocplanError, match="the mask would be empty"):
            write(tmp_path / "mask", costs)
    assert not (tmp_path / "mask").exists()


def test_thetastar_mask_rejects_large_weight(tmp_path, costs):
    with pytest.raises(LocplanError, match="only 94 times"):
        nav2_keepout(tmp_path / "mask", costs.with_weight(100.0), planner="thetastar")


def read_readme(folder):
    return (folder / "README.md").read_text()


@pytest.mark.parametrize(
    ("planner", "words"),
    [
        ("smac2d", ("`cost_travel_multiplier: 6.526` (Nav2's default is 1)", "iterations: -1")),
        ("smac-hybrid", ("`cost_penalty: 6.429`", "may take up to 25 s (`max_planning_time`")),
        ("thetastar", ("`w_traversal_cost: ",)),
    ],
)
def test_readme_lists_planner_settings(tmp_path, costs, planner, words):
    nav2_keepout(tmp_path / "mask", costs, planner=planner)
    text = read_readme(tmp_path / "mask")
    assert all(word in text for word in words)
    assert ("max_iterations" in text) == planner.startswith("smac")
    nav2 = yaml.safe_load((tmp_path / "mask" / "nav2.yaml").read_text())
    own = nav2["planner_server"]["ros__parameters"]["GridBased"]
    assert ("max_iterations" in own) == ("max_planning_time" in own) == planner.startswith("smac")


def read_folder(path):
    return {file.name: file.read_bytes() for file in path.iterdir()}


def test_failed_export_keeps_previous_folder(tmp_path, costs, monkeypatch):
    nav2_keepout(tmp_path / "mask", costs)
    before = read_folder(tmp_path / "mask")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("locplan.export.nav2.write_servers", fail)
    with pytest.raises(LocplanError, match="No space left"):
        nav2_keepout(tmp_path / "mask", costs.with_weight(1.0))
    assert read_folder(tmp_path / "mask") == before
    assert [path.name for path in tmp_path.iterdir()] == ["mask"]


def test_export_protects_foreign_folders(tmp_path, costs):
    (tmp_path / "empty").mkdir()
    ros_map(tmp_path / "empty", costs)
    with pytest.raises(LocplanError, match=r"results of another command \(ros-map\)"):
        nav2_speed(tmp_path / "empty", costs)
    nav2_speed(tmp_path / "empty", costs, force=True)
    assert "nav2.yaml" in read_folder(tmp_path / "empty")
    assert "raw.yaml" not in read_folder(tmp_path / "empty")
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "thesis.tex").write_text("years of work")
    with pytest.raises(LocplanError, match=r"thesis\.tex: was not written by"):
        ros_map(tmp_path / "theirs", costs)
    assert (tmp_path / "theirs" / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("change", sample_cases(["edited", "added"]))
def test_export_protects_edited_folders(tmp_path, costs, change):
    folder = tmp_path / "mask"
    nav2_keepout(folder, costs)
    if change == "added":
        (folder / "mine.yaml").write_text("a: 1")
    else:
        (folder / "nav2.yaml").write_text((folder / "nav2.yaml").read_text() + "# mine")
    before = read_folder(folder)
    with pytest.raises(LocplanError, match=r"was not written by|was changed after"):
        nav2_keepout(folder, costs)
    assert read_folder(folder) == before
    nav2_keepout(folder, costs, force=True)
    assert (folder / "mine.yaml").exists() == (change == "added")


@pytest.mark.parametrize("write", [nav2_keepout, nav2_speed, ros_map])
def test_short_readme_lists_all_files(tmp_path, costs, write):
    write(tmp_path / "out", costs)
    files = read_folder(tmp_path / "out")
    lines = [line for line in files["README.md"].decode().splitlines() if line]
    assert len(lines) <= 15
    for name in set(files) - {"README.md", "run.yaml"}:
        assert name in "".join(lines) or name.endswith(".png"), name
    about = json.loads(files["export.json"])
    assert about["map"]["digest"] == costs.grid.digest
    assert about["config"]["estimator"]["range"] == 1.0
    assert (about["weight"], about["criterion"]) == (4.0, "e")


def test_launch_file_starts_configured_nodes(tmp_path, costs):
    from xml.etree import ElementTree

    nav2_keepout(tmp_path / "out", costs)
    nodes = ElementTree.parse(tmp_path / "out" / "localizability.launch.xml").findall("node")
    servers = yaml.safe_load((tmp_path / "out" / "servers.yaml").read_text())
    assert [node.get("name") for node in nodes] == list(servers)
    manager = servers["lifecycle_manager_localizability_keepout"]["ros__parameters"]
    assert manager["node_names"] == list(servers)[:-1]
    mask, info = (servers[name]["ros__parameters"] for name in manager["node_names"])
    assert "yaml_filename" not in mask  # it would hide the absolute one below a SetParameter
    file = nodes[0].find("param[@name='yaml_filename']")
    assert file.get("value") == "$(dirname)/mask.yaml"
    assert mask["topic_name"] == info["mask_topic"]
    nav2 = yaml.safe_load((tmp_path / "out" / "nav2.yaml").read_text())
    costmap = nav2["global_costmap"]["global_costmap"]["ros__parameters"]
    (name,) = costmap["filters"]
    assert costmap[name]["filter_info_topic"] == info["filter_info_topic"]
    assert (info["type"], info["base"], info["multiplier"]) == (0, 0.0, 1.0)
    assert all(type(info[key]) is float for key in ("base", "multiplier"))


THETA = "nav2_theta_star_planner::ThetaStarPlanner"
PARAMS = """
global_costmap:
  global_costmap:
    ros__parameters:
      robot_radius: 0.22
      plugins: ["static_layer", "obstacle_layer", "inflation_layer"]
      filters: ["keepout_filter"]
      keepout_filter: {plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true}
planner_server:
  ros__parameters:
    planner_plugins: ["Fast", "Good"]
    Fast: {plugin: "nav2_navfn_planner::NavfnPlanner", tolerance: 0.5}
    Good: {plugin: "nav2_smac_planner::SmacPlanner2D", tolerance: 0.25, allow_unknown: true}
"""


def test_export_merges_into_robot_parameters(tmp_path, costs):
    (tmp_path / "own.yaml").write_text(PARAMS)
    change = "nav2.yaml changes values of own.yaml: planner_server.Good.allow_unknown: false"
    with pytest.warns(ParametersChanged, match=re.escape(change)):
        nav2_keepout(tmp_path / "mask", costs, planner="smac2d", params=tmp_path / "own.yaml")
    assert "- planner_server.Good.allow_unknown: false (was true)" in read_readme(tmp_path / "mask")
    merged = yaml.safe_load((tmp_path / "mask" / "nav2.yaml").read_text())
    costmap = merged["global_costmap"]["global_costmap"]["ros__parameters"]
    assert costmap["filters"] == ["keepout_filter", "localizability_keepout_filter"]
    assert costmap["robot_radius"] == 0.22
    server = merged["planner_server"]["ros__parameters"]
    assert server["planner_plugins"] == ["Fast", "Good"]
    assert server["Good"]["tolerance"] == 0.25
    assert server["Good"]["allow_unknown"] is False
    assert server["Good"]["cost_travel_multiplier"] == pytest.approx(6.5 * 252 / 251, abs=1e-3)
    assert "cost_travel_multiplier" not in server["Fast"]
    assert server["Good"]["max_iterations"] == -1
    assert server["Good"]["max_planning_time"] == 10.0
    again = tmp_path / "mask" / "nav2.yaml"
    nav2_keepout(tmp_path / "again", costs, planner="smac2d", params=again)
    assert yaml.safe_load((tmp_path / "again" / "nav2.yaml").read_text()) == merged


def test_export_keeps_other_nested_nodes(tmp_path, costs):
    """Older files have nodes of Nav2's own beside a costmap, such as global_costmap_client."""
    (tmp_path / "own.yaml").write_text(
        "global_costmap: {global_costmap: {ros__parameters: {a: 1}},"
        " global_costmap_client: {ros__parameters: {use_sim_time: true}}}\n"
        "planner_server: {ros__parameters: {b: 2}, planner_server_rclcpp_node: {c: 3}}\n"
    )
    for n, write in enumerate([nav2_keepout, nav2_speed]):
        write(tmp_path / f"{n}", costs, params=tmp_path / "own.yaml")
        merged = yaml.safe_load((tmp_path / f"{n}" / "nav2.yaml").read_text())
        beside = merged["global_costmap"]["global_costmap_client"]
        assert beside == {"ros__parameters": {"use_sim_time": True}}
        assert merged["global_costmap"]["global_costmap"]["ros__parameters"]["a"] == 1
        assert merged["planner_server"]["planner_server_rclcpp_node"] == {"c": 3}
        assert merged["planner_server"]["ros__parameters"]["b"] == 2


@pytest.fixture(scope="module")
def zones():
    """Zones of all kinds in the rooms of `costs`."""
    return Zones(
        [
            Zone("no-go", [[3.0, 0.0], [5.0, 0.5], [4.0, 2.0]]),
            Zone("slow", [[7.0, 0.0], [9.0, 0.0], [9.0, 3.0], [7.0, 3.0]], 30),
            Zone("prefer", [[2.0, -1.0], [7.0, -1.0], [7.0, 6.0], [2.0, 6.0]]),
        ]
    )


def add_zones(costs, zones):
    """The costmap with zones."""
    return Costmap.from_layers(
        costs.grid, u=costs.u, e=costs.e, weight=costs.weight, robot=0.15, zones=zones
    )


@pytest.mark.parametrize("name", PLANNERS)
def test_keepout_mask_has_cost_of_zones(costs, zones, name):
    """Outside preferred zones the planner's charge is that of J, and no-go cells are lethal."""
    zoned = add_zones(costs, zones)
    values, conversion = compute_keepout_mask(zoned, planner=name)
    closed = zones.cells(costs.grid, "no-go")
    np.testing.assert_array_equal(values == 100, closed)
    density, open_cells = compute_mask_density(zoned), costs.grid.free & ~closed
    more = density[open_cells] - compute_mask_density(costs)[open_cells]
    np.testing.assert_allclose(more, zones.cost_per_metre(costs.grid)[open_cells], atol=1e-12)
    has_room = open_cells & (costs.grid.clearance > 0.45)
    costs_of_values = np.floor(np.maximum(values, 0) * 2.54 + 0.5)
    charged = conversion.planner.compute_excess(costs_of_values, conversion.parameter_value)
    np.testing.assert_allclose(
        charged[has_room], density[has_room] - 1, atol=conversion.quantisation + 1e-9
    )
    assert conversion.quantisation < 0.1
    _, plain = compute_keepout_mask(costs, planner=name)
    assert conversion.max_excess == pytest.approx(plain.max_excess + 1, abs=0.02)


def test_speed_mask_takes_lower_limit(tmp_path, costs, zones):
    zoned = add_zones(costs, zones)
    for slowest in (1.0, 0.3):
        nav2_speed(tmp_path / "mask", zoned, slowest=slowest, lead=0.0)
        mask = ros_readers.load(tmp_path / "mask" / "mask.yaml", "main")
        limit = ros_readers.speed_limit(mask.data, 1, 100.0, -1.0)
        slow, known = zones.cells(costs.grid, "slow"), np.isfinite(limit)
        by_u = np.floor(100 * (1 - slowest) * np.nan_to_num(costs.u) + 0.5)
        expected = 100 - np.where(slow, np.maximum(by_u, 70), by_u)
        expected[expected == 100] = 0  # no limit
        np.testing.assert_array_equal(limit[known], expected[known])
        assert known[costs.grid.free].all()
        assert (tmp_path / "mask" / "zones.geojson").read_text() == zones.text


def test_speed_limit_begins_before_slow_zone(tmp_path, costs, zones):
    nav2_speed(tmp_path / "mask", add_zones(costs, zones), slowest=1.0, lead=0.5)
    mask = ros_readers.load(tmp_path / "mask" / "mask.yaml", "main")
    row, col = costs.grid.cell((6.55, 1.0))
    near, far = mask.data[row, col - 3 : col + 2], mask.data[row, : col - 5]
    assert set(near.tolist()) <= {0, 70, -1}
    assert 70 in near
    assert 70 not in far


def test_export_with_zones_has_both_masks(tmp_path, costs, zones):
    zoned = add_zones(costs, zones)
    nav2_keepout(tmp_path / "out", zoned, distro="jazzy")
    folder = read_folder(tmp_path / "out")
    assert folder["zones.geojson"].decode() == zones.text
    assert "vector_objects.yaml" not in folder
    readme = folder["README.md"].decode()
    for name in ("zones.geojson", "speed_mask.yaml", "speed_mask.pgm"):
        assert name in folder
        assert name in readme
    speeds = ros_readers.load(tmp_path / "out" / "speed_mask.yaml", "main").data
    assert set(np.unique(speeds)) == {-1, 0, 70}
    costmap = yaml.safe_load(folder["nav2.yaml"])["global_costmap"]["global_costmap"]
    filters = costmap["ros__parameters"]["filters"]
    assert filters == ["localizability_keepout_filter", "localizability_speed_filter"]
    servers = yaml.safe_load(folder["servers.yaml"])
    (manager,) = (name for name in servers if name.startswith("lifecycle"))
    assert servers[manager]["ros__parameters"]["node_names"] == [*servers][:-1]
    assert len(servers) == 5
    for each in filters:
        info = costmap["ros__parameters"][each]["filter_info_topic"]
        published = [s["ros__parameters"].get("filter_info_topic") for s in servers.values()]
        assert info in published
    assert b'value="$(dirname)/speed_mask.yaml"' in folder["localizability.launch.xml"]
    nav2_keepout(tmp_path / "out", costs)
    folder = read_folder(tmp_path / "out")
    assert not {"zones.geojson", "speed_mask.yaml"} & set(folder)


def test_dropping_yaw_keeps_zone_cells(costs, zones):
    turned = dataclasses.replace(costs.grid, origin=(2.0, -1.0, 0.3))
    polygons = [
        dataclasses.replace(
            zone,
            polygon=np.column_stack(
                turned.grid_to_world(*costs.grid.world_to_grid(*zone.polygon.T))
            ),
        )
        for zone in zones
    ]
    with pytest.warns(YawWarning):
        unturned = drop_costmap_yaw(dataclasses.replace(costs, grid=turned, zones=Zones(polygons)))
    for kind in ("no-go", "slow", "prefer"):
        cells = zones.cells(costs.grid, kind)
        assert cells.any()
        np.testing.assert_array_equal(unturned.zones.cells(unturned.grid, kind), cells)


@pytest.mark.parametrize("distro", ["kilted", "lyrical", "rolling"])
def test_vector_objects_equal_no_go_zones(tmp_path, costs, zones, distro):
    """From lyrical on, nav2_map_server has a vector object server."""
    turned = dataclasses.replace(
        add_zones(costs, zones), grid=dataclasses.replace(costs.grid, origin=(2.0, -1.0, 0.3))
    )
    with pytest.warns((DistroWarning, YawWarning)):
        nav2_keepout(tmp_path / "out", turned, distro=distro)
    folder = read_folder(tmp_path / "out")
    if distro == "kilted":
        assert "vector_objects.yaml" not in folder
        return
    server, info = (
        each["ros__parameters"] for each in yaml.safe_load(folder["vector_objects.yaml"]).values()
    )
    assert (info["mask_topic"], info["type"]) == (server["map_topic"], 0)
    assert server["shapes"] == ["no_go_1"]
    shape = server["no_go_1"]
    assert (shape["type"], shape["closed"], shape["value"]) == ("polygon", True, 100)
    assert all(isinstance(value, float) for value in shape["points"])
    # The polygon is where it is on the map without its yaw, as Nav2 has it.
    unturned = dataclasses.replace(turned.grid, origin=(2.0, -1.0, 0.0))
    polygon = Zones([Zone("no-go", np.reshape(shape["points"], (-1, 2)))])
    np.testing.assert_array_equal(
        polygon.cells(unturned, "no-go"), zones.cells(turned.grid, "no-go")
    )
    assert info["filter_info_topic"] in folder["README.md"].decode()


def test_speed_export_keeps_keepout_filter(tmp_path, costs):
    nav2_keepout(tmp_path / "one", costs)
    nav2_speed(tmp_path / "two", costs, params=tmp_path / "one" / "nav2.yaml")
    merged = yaml.safe_load((tmp_path / "two" / "nav2.yaml").read_text())
    costmap = merged["global_costmap"]["global_costmap"]["ros__parameters"]
    assert costmap["filters"] == ["localizability_keepout_filter", "localizability_speed_filter"]
    assert all("plugin" in costmap[name] for name in costmap["filters"])
    nodes = [
        set(yaml.safe_load((tmp_path / name / "servers.yaml").read_text()))
        for name in ("one", "two")
    ]
    assert not (nodes[0] & nodes[1])


def test_export_keeps_other_planners(tmp_path, costs):
    (tmp_path / "own.yaml").write_text(PARAMS)
    ours = (
        r"own\.yaml: its planners are Fast \(nav2_navfn_planner::.*; the export adds Localizability"
    )
    with pytest.warns(RobotWarning, match=ours):
        nav2_keepout(tmp_path / "m", costs, planner="thetastar", params=tmp_path / "own.yaml")
    server = yaml.safe_load((tmp_path / "m" / "nav2.yaml").read_text())["planner_server"]
    own = server["ros__parameters"]
    assert own["planner_plugins"] == ["Fast", "Good", "Localizability"]
    assert own["Fast"] == {"plugin": "nav2_navfn_planner::NavfnPlanner", "tolerance": 0.5}
    assert own["Localizability"]["plugin"] == "nav2_theta_star_planner::ThetaStarPlanner"
    humble = PARAMS.replace("::", "/").replace("costmap_2d/", "costmap_2d::")
    (tmp_path / "own.yaml").write_text(humble)
    settings = {"params": tmp_path / "own.yaml", "distro": "humble"}
    with pytest.warns(RobotWarning, match="does not follow a mask"):
        nav2_keepout(tmp_path / "n", costs, planner="navfn", **settings)
    server = yaml.safe_load((tmp_path / "n" / "nav2.yaml").read_text())["planner_server"]
    fast = server["ros__parameters"]["Fast"]  # as the robot's distribution spells it
    assert (fast["plugin"], fast["allow_unknown"]) == ("nav2_navfn_planner/NavfnPlanner", False)
    assert json.loads((tmp_path / "n" / "export.json").read_text())["planner_id"] == "Fast"


@pytest.mark.parametrize(
    ("change", "planner", "called"),
    [
        (('["Fast", "Good"]', "[Fast]"), "smac2d", "Localizability"),
        (("nav2_navfn_planner::NavfnPlanner", "mine::Own"), "smac2d", "Good"),
        (("nav2_navfn_planner::NavfnPlanner", THETA), "thetastar", "Fast"),
    ],
)
def test_mask_uses_planner_of_robot(tmp_path, costs, change, planner, called):
    (tmp_path / "own.yaml").write_text(PARAMS.replace(*change))
    with warnings.catch_warnings(record=True, action="always"):
        found = nav2_keepout(tmp_path / "m", costs, params=tmp_path / "own.yaml")
    assert found.planner.name == planner
    assert json.loads((tmp_path / "m" / "export.json").read_text())["planner_id"] == called


@pytest.mark.parametrize(
    ("distro", "plugin", "words"),
    [
        ("jazzy", "nav2_smac_planner/SmacPlanner2D", "as in humble; give --distro humble"),
        (
            "humble",
            "nav2_smac_planner::SmacPlanner2D",
            "as from jazzy on, but humble needs / instead of ::",
        ),
    ],
)
def test_export_warns_about_wrong_distribution(tmp_path, costs, distro, plugin, words):
    (tmp_path / "own.yaml").write_text(
        f'planner_server: {{ros__parameters: {{planner_plugins: [A], A: {{plugin: "{plugin}"}}}}}}'
    )
    with pytest.warns(RobotWarning, match=re.escape(words)):
        nav2_keepout(tmp_path / "m", costs, params=tmp_path / "own.yaml", distro=distro)


def test_merged_parameters_keep_yaml_types(tmp_path, costs):
    own = 'amcl: {ros__parameters: {a: "1e3", b: 1e3, c: "y", d: y, e: N, f: "no", g: x}}\n'
    (tmp_path / "own.yaml").write_text(own)
    nav2_keepout(tmp_path / "m", costs, params=tmp_path / "own.yaml")
    assert own in (tmp_path / "m" / "nav2.yaml").read_text()
    shared = "planner_server: &p {ros__parameters: {b: 1}}\nmine: *p\n"  # not to be changed alone
    (tmp_path / "own.yaml").write_text(own + shared)
    nav2_keepout(tmp_path / "n", costs, params=tmp_path / "own.yaml")
    assert "(without its comments)" in read_readme(tmp_path / "n")
    text = (tmp_path / "n" / "nav2.yaml").read_text()
    for line in ('a: "1e3"', "b: 1000.0", 'c: "y"', "d: true", "e: false", "f: 'no'", "g: x"):
        assert f"    {line}\n" in text


def test_speed_export_warns_about_second_filter(tmp_path, costs):
    own = PARAMS.replace("KeepoutFilter", "SpeedFilter")
    (tmp_path / "own.yaml").write_text(own)
    with pytest.warns(RobotWarning, match="global_costmap has a speed filter, keepout_filter"):
        nav2_speed(tmp_path / "m", costs, params=tmp_path / "own.yaml")


def test_readme_lists_added_parameters(tmp_path, costs):
    (tmp_path / "own.yaml").write_text(
        PARAMS.replace("allow_unknown: true", "allow_unknown: false")
    )
    nav2_keepout(tmp_path / "m", costs, planner="smac2d", params=tmp_path / "own.yaml")
    text = read_readme(tmp_path / "m")
    assert "- global_costmap.filters: localizability_keepout_filter" in text
    assert "- planner_server.Good.max_iterations: -1" in text
    assert "(was " not in text  # no value of the robot changes


def test_readme_reports_ignored_map_yaw(tmp_path, costs):
    grid = OccupancyGrid(costs.grid.cells, 0.1, (2.0, -1.0, YAW), name="turned")
    with pytest.warns(YawWarning):
        nav2_keepout(tmp_path / "m", dataclasses.replace(costs, grid=grid))
    assert "The map has a yaw of 0.6 rad, which Nav2 ignores" in read_readme(tmp_path / "m")


def test_export_overrides_incompatible_planner_parameters(tmp_path, costs):
    (tmp_path / "own.yaml").write_text(
        "planner_server: {ros__parameters: {planner_plugins: [A], A: {plugin: "
        '"nav2_smac_planner::SmacPlannerHybrid", use_quadratic_cost_penalty: true, '
        "retrospective_penalty: 0.1, angle_quantization_bins: 72}}}"
    )
    settings = {"planner": "smac-hybrid", "params": tmp_path / "own.yaml"}
    with pytest.warns(ParametersChanged) as caught:
        nav2_keepout(tmp_path / "m", costs, **settings)
    assert str(caught[0].message).endswith(
        "planner_server.A.use_quadratic_cost_penalty: false (was true);"
        " planner_server.A.retrospective_penalty: 0.015 (was 0.1)"
    )
    server = yaml.safe_load((tmp_path / "m" / "nav2.yaml").read_text())["planner_server"]
    own = server["ros__parameters"]["A"]
    assert own["use_quadratic_cost_penalty"] is False
    assert own["retrospective_penalty"] == 0.015
    assert own["angle_quantization_bins"] == 72


@pytest.mark.parametrize(
    "text",
    [
        *("", "a: 1", "- 1", "{", "planner_server: 3", "planner_server:", "\x00"),
        "planner_server: {ros__parameters: 3}",
        "planner_server: {ros__parameters: {planner_plugins: GridBased}}",
        "global_costmap: {global_costmap: {ros__parameters: {filters: none}}}",
        "global_costmap: {global_costmap: {ros__parameters: {plugins: [3]}}}",
        "robot1: {map_server: {ros__parameters: {a: 1}}}",
    ],
)
def test_export_rejects_invalid_parameter_files(tmp_path, costs, text):
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(LocplanError, match=r"own\.yaml") as fault:
        nav2_keepout(tmp_path / "mask", costs, params=tmp_path / "own.yaml")
    assert "\n" not in str(fault.value)
    assert not (tmp_path / "mask").exists()


@pytest.mark.parametrize(("theirs", "then"), [(2.0, 10.0), (30.0, 30.0)])
def test_export_keeps_longer_planning_time(tmp_path, costs, theirs, then):
    (tmp_path / "own.yaml").write_text(
        "planner_server: {ros__parameters: {planner_plugins: [A], A: {plugin: "
        f'"nav2_smac_planner::SmacPlanner2D", max_planning_time: {theirs}}}}}}}'
    )
    with warnings.catch_warnings(record=True, action="always") as caught:
        nav2_keepout(tmp_path / "m", costs, params=tmp_path / "own.yaml")
    assert len(caught) == (theirs != then)
    server = yaml.safe_load((tmp_path / "m" / "nav2.yaml").read_text())["planner_server"]
    assert server["ros__parameters"]["A"]["max_planning_time"] == then


@pytest.mark.parametrize("distro", sample_cases(["humble", "jazzy", "kilted", "lyrical"], 2))
def test_parameters_match_ros_distribution(tmp_path, costs, distro):
    """Humble spells plugins with a slash, and has no quadratic cost penalty to switch off."""
    unsure = distro in ("kilted", "lyrical")
    with pytest.warns(DistroWarning) if unsure else nullcontext():
        nav2_keepout(tmp_path / "s", costs, planner="smac-hybrid", distro=distro)
    nav2 = yaml.safe_load((tmp_path / "s" / "nav2.yaml").read_text())
    own = nav2["planner_server"]["ros__parameters"]["GridBased"]
    old = distro == "humble"
    assert own["plugin"] == f"nav2_smac_planner{'/' if old else '::'}SmacPlannerHybrid"
    assert ("use_quadratic_cost_penalty" in own) is not old
    assert json.loads((tmp_path / "s" / "export.json").read_text())["distro"] == distro


ZONES_FILE = """
local_costmap:
  local_costmap:
    ros__parameters:
      filters: [zones]
      zones: {plugin: "nav2_costmap_2d::KeepoutFilter", enabled: KEEPOUT_ZONE_ENABLED,
              filter_info_topic: keep_out}
global_costmap:
  global_costmap:
    ros__parameters:
      filters: [zones, slow_zones, other]
      zones: {plugin: "nav2_costmap_2d::KeepoutFilter", enabled: KEEPOUT_ZONE_ENABLED,
              filter_info_topic: /keep_out}
      slow_zones: {plugin: "nav2_costmap_2d::SpeedFilter", enabled: SPEED_ZONE_ENABLED,
                   filter_info_topic: slow_down}
      other: {plugin: "nav2_costmap_2d::KeepoutFilter", filter_info_topic: elsewhere}
keepout_filter_mask_server:
  ros__parameters: {topic_name: mask}
keepout_costmap_filter_info_server:
  ros__parameters: {type: 0, filter_info_topic: keep_out, mask_topic: mask}
speed_costmap_filter_info_server:
  ros__parameters: {type: 1, filter_info_topic: slow_down, mask_topic: speeds}
bt_navigator:
  ros__parameters: {odom_topic: wheels}
"""
BRINGUP = "ros2 launch nav2_bringup bringup_launch.py map:=MAP.yaml params_file:=$PWD/nav2.yaml"


def is_filter_enabled(nav2, name, costmap="global_costmap"):
    filters = nav2[costmap][costmap]["ros__parameters"]
    return filters[name].get("enabled", True)


@pytest.fixture
def export_mask(tmp_path, costs):
    """A function that exports a mask for a distribution and returns its folder and nav2.yaml."""

    def export(write, distro, text=ZONES_FILE, **settings):
        (tmp_path / "own.yaml").write_text(text)
        folder = tmp_path / f"{write.__name__}-{distro}"
        with warnings.catch_warnings(record=True, action="always"):
            write(folder, costs, params=tmp_path / "own.yaml", distro=distro, **settings)
        return folder, yaml.safe_load((folder / "nav2.yaml").read_text())

    return export


@pytest.mark.parametrize(
    ("write", "kind", "arguments"),
    [
        (nav2_keepout, "keepout", "keepout_mask:=$PWD/mask.yaml use_speed_zones:=False"),
        (nav2_speed, "speed", "speed_mask:=$PWD/mask.yaml use_keepout_zones:=False"),
    ],
)
def test_bringup_publishes_masks_since_kilted(export_mask, write, kind, arguments):
    """bringup_launch.py starts both servers and gives the mask's file to the first one."""
    folder, nav2 = export_mask(write, "kilted")
    steps = [line for line in read_readme(folder).splitlines() if re.match(r"\d\. ", line)]
    assert steps == [f"1. `{BRINGUP} {arguments}` (in this folder), with your usual arguments"]
    mask = nav2[f"{kind}_filter_mask_server"]["ros__parameters"]
    info = nav2[f"{kind}_costmap_filter_info_server"]["ros__parameters"]
    costmap = nav2["global_costmap"]["global_costmap"]["ros__parameters"]
    name = f"localizability_{kind}_filter"
    assert name in costmap["filters"]
    assert costmap[name]["filter_info_topic"] == info["filter_info_topic"]
    assert info["mask_topic"] == mask["topic_name"] == f"/localizability_{kind}_mask"
    servers = yaml.safe_load((folder / "servers.yaml").read_text())
    # The launch file, for robots without bringup_launch.py, publishes the same.
    assert info == servers[f"localizability_{kind}_info_server"]["ros__parameters"]


def test_mask_replaces_filters_of_bringup(export_mask, tmp_path):
    _, nav2 = export_mask(nav2_keepout, "kilted")
    assert is_filter_enabled(nav2, "zones") is False
    assert is_filter_enabled(nav2, "zones", "local_costmap") is False
    assert is_filter_enabled(nav2, "other") is True  # another server feeds it
    assert is_filter_enabled(nav2, "slow_zones") == "SPEED_ZONE_ENABLED"
    folder, nav2 = export_mask(nav2_speed, "kilted")
    assert is_filter_enabled(nav2, "slow_zones") is False
    assert is_filter_enabled(nav2, "zones") == "KEEPOUT_ZONE_ENABLED"
    assert "switches off slow_zones (global_costmap)." in read_readme(folder)


def test_masks_stay_separate_before_kilted(export_mask):
    folder, nav2 = export_mask(nav2_keepout, "jazzy")
    assert "1. `ros2 launch ./localizability.launch.xml`" in read_readme(folder)
    assert f"2. `{BRINGUP}`, with your usual arguments" in read_readme(folder)
    added = nav2.pop("planner_server"), nav2.pop("global_costmap")
    before = yaml.safe_load(ZONES_FILE)
    assert is_filter_enabled({"global_costmap": added[1]}, "zones") == "KEEPOUT_ZONE_ENABLED"
    del before["global_costmap"]
    assert nav2 == before


def test_second_mask_keeps_first_in_bringup(export_mask, tmp_path, costs):
    first, _ = export_mask(nav2_keepout, "kilted")
    folder, nav2 = export_mask(nav2_speed, "kilted", (first / "nav2.yaml").read_text())
    assert "speed_mask:=$PWD/mask.yaml keepout_mask:=FILE.yaml`" in read_readme(folder)
    info = nav2["keepout_costmap_filter_info_server"]["ros__parameters"]
    assert info["filter_info_topic"] == "/localizability_keepout_info"
    assert is_filter_enabled(nav2, "localizability_keepout_filter") is True


def test_export_adds_servers_to_costmap_file(tmp_path, costs):
    (tmp_path / "amcl.yaml").write_text("amcl: {ros__parameters: {alpha1: 0.1}} # mine\n")
    (tmp_path / "own.yaml").write_text("# mine\n" + PARAMS)
    files = [tmp_path / "amcl.yaml", tmp_path / "own.yaml"]
    with pytest.warns((DistroWarning, ParametersChanged)):
        nav2_keepout(tmp_path / "mask", costs, planner="smac2d", params=files, distro="kilted")
    text = (tmp_path / "mask" / "nav2.yaml").read_text()
    assert text.startswith("# mine\n")
    assert "amcl" not in text
    assert "keepout_filter_mask_server" in text


@pytest.mark.parametrize("lead", [0.0, 0.8])
def test_speed_filter_looks_ahead_since_lyrical(export_mask, costs, lead):
    """speed_filter.cpp looks ahead by at least `min_lookahead`; its odometry needs "/"."""
    folders = {}
    for distro in ("kilted", "lyrical"):
        folders[distro], nav2 = export_mask(nav2_speed, distro, lead=lead)
        own = nav2["global_costmap"]["global_costmap"]["ros__parameters"]
        own = own["localizability_speed_filter"]
        ahead = ("enable_path_lookahead", "min_lookahead", "odom_topic")
        expected = (lead > 0, lead, "/wheels") if distro == "lyrical" else (None, None, None)
        assert tuple(map(own.get, ahead)) == expected
    text = f"looks {lead:g} m ahead along the plan"
    assert {distro: text in read_readme(folder) for distro, folder in folders.items()} == {
        "kilted": False,
        "lyrical": lead > 0,
    }
    masks = {
        name: ros_readers.load(folder / "mask.yaml", "main") for name, folder in folders.items()
    }
    widened = masks["kilted"].data > masks["lyrical"].data
    assert widened.any() == (lead > 0)
    known = ~np.isnan(costs.u)
    np.testing.assert_array_equal(masks["lyrical"].data[known], np.floor(70 * costs.u[known] + 0.5))


def test_slow_zones_use_lookahead_of_nav2(tmp_path, costs, zones):
    with pytest.warns(DistroWarning):
        nav2_keepout(tmp_path / "out", add_zones(costs, zones), distro="lyrical")
    mask = ros_readers.load(tmp_path / "out" / "speed_mask.yaml", "main").data
    np.testing.assert_array_equal(mask == 70, zones.cells(costs.grid, "slow") & costs.grid.free)
    nav2 = yaml.safe_load((tmp_path / "out" / "nav2.yaml").read_text())
    own = nav2["global_costmap"]["global_costmap"]["ros__parameters"]["localizability_speed_filter"]
    assert (own["enable_path_lookahead"], own["min_lookahead"]) == (True, 0.5)
    assert own["odom_topic"] == "/odom"
    assert "(`min_lookahead`)" in read_readme(tmp_path / "out")


@pytest.mark.parametrize(
    ("distro", "factor", "expected"),
    [("kilted", None, None), ("lyrical", None, 16), ("lyrical", 4, 16), ("lyrical", 40, 40)],
)
def test_navfn_gets_cycles_for_longer_paths(export_mask, distro, factor, expected):
    """NavFn's plan fails if its path has more steps than this times the map's longer side."""
    text = PARAMS.replace(
        "tolerance: 0.5", f"max_cycles_factor: {factor}" if factor else "tolerance: 0.5"
    )
    _, nav2 = export_mask(nav2_keepout, distro, text)
    server = nav2["planner_server"]["ros__parameters"]
    assert server["Fast"].get("max_cycles_factor") == expected
    assert "max_cycles_factor" not in server["Good"]


ROUTE = Path(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]]))


def test_loaded_path_equals_written_path(tmp_path):
    plain_files.write_path_file(tmp_path / "p.csv", ROUTE)
    again = Path.load(tmp_path / "p.csv")
    np.testing.assert_allclose(again.xy, ROUTE.xy)
    np.testing.assert_allclose(again.heading, ROUTE.facing, atol=1e-6)
    assert ROUTE.facing.tolist() == pytest.approx([math.atan2(4, 3), math.pi / 2, math.pi / 2])
    (tmp_path / "excel.csv").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "p.csv").read_bytes())
    np.testing.assert_array_equal(Path.load(tmp_path / "excel.csv").xy, again.xy)
    plain_files.write_path_file(tmp_path / "fine.CSV", ROUTE, step=0.3)
    fine = Path.load(tmp_path / "fine.CSV").xy
    assert len(fine) == 22
    assert fine[17].tolist() == [3.0, 4.0]  # a corner that no multiple of the step meets
    assert np.hypot(*np.diff(fine, axis=0).T).max() <= 0.3 + 1e-6
    plain_files.write_path_file(tmp_path / "p.json", ROUTE, frame="odom")
    about = json.loads((tmp_path / "p.json").read_text())
    assert (about["frame"], about["length"]) == ("odom", 6.0)
    assert about["poses"][1]["distance"] == 5.0
    plain_files.write_path_file(tmp_path / "p.geojson", ROUTE, frame="odom")
    assert json.loads((tmp_path / "p.geojson").read_text()) == ROUTE.to_geojson(frame="odom")


def test_path_yaml_is_valid_ros_message(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    plain_files.write_path_file(tmp_path / "p.yaml", ROUTE)
    message = yaml.safe_load((tmp_path / "p.yaml").read_text())
    types = get_typestore(Stores.ROS2_HUMBLE)
    fields = {name for name, _ in types.fielddefs["nav_msgs/msg/Path"][1]}
    assert set(message) == fields
    assert message == ROUTE.to_nav_msgs()
    poses = [pose["pose"] for pose in message["poses"]]
    assert [(p["position"]["x"], p["position"]["y"]) for p in poses] == [
        tuple(xy) for xy in ROUTE.xy
    ]
    turn = poses[0]["orientation"]
    assert 2 * math.atan2(turn["z"], turn["w"]) == pytest.approx(math.atan2(4, 3))
    assert {pose["header"]["frame_id"] for pose in message["poses"]} == {"map"}


@pytest.mark.parametrize(
    "text", ["", "x_m,y_m\n1,2", "x,y", "x,y\n1", "x,y\n1,nan", "x,y\na,b", "\x00"]
)
def test_path_rejects_invalid_files(tmp_path, text):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(LocplanError):
        Path.load(tmp_path / "p.csv")
    with pytest.raises(LocplanError, match="there is no such file"):
        Path.load(tmp_path / "none.csv")
    with pytest.raises(LocplanError, match=r"\.csv, \.json, \.geojson, \.yaml"):
        plain_files.write_path_file(tmp_path / "p.txt", ROUTE)


def test_field_writes_numpy_arrays(tmp_path, costs):
    field = covariance_field(costs.grid, FieldConfig(Sad(range=1.0)))
    plain_files.write_field_file(tmp_path / "f.npz", field)
    with np.load(tmp_path / "f.npz") as arrays:
        assert {*arrays} == {"about", "covariance", "u_map", "cells"}
        np.testing.assert_array_equal(arrays["covariance"], field.covariance)
        u = Costmap.from_field(field).u
        np.testing.assert_array_equal(arrays["u_map"], u)
        np.testing.assert_array_equal(arrays["cells"], costs.grid.cells)
        about = json.loads(str(arrays["about"]))
        assert about["origin"] == [2.0, -1.0, 0.0]
        assert about["config"]["estimator"]["range"] == 1.0
    assert CovarianceField.load(tmp_path / "f.npz").config == field.config
    with pytest.raises(LocplanError, match=r"must end in \.npz"):
        plain_files.write_field_file(tmp_path / "f.txt", field)


TOY = '''
"""The dearest cell as a text."""
from __future__ import annotations
from dataclasses import dataclass
from pathlib import Path
from locplan.errors import ConfigError
from locplan.export.registry import ExportSummary, ExportFormat


@dataclass(frozen=True)
class ToyOptions:
    slowest: float = 0.001
    """The step of the number."""

    def __post_init__(self):
        if not self.slowest > 0:
            raise ConfigError(f"slowest must be above 0, not {self.slowest}")


def write(target, job, options):
    most = float(job.field.e[job.field.is_evaluated].max())
    target.write_text(f"{round(most / options.slowest)}")
    return ExportSummary({"most": most}, (("greatest e", str(most)),))


FORMATS = (ExportFormat("toy", "the greatest e", write, ToyOptions, suffixes=(".txt",)),)
'''


def test_command_supports_registered_format(run, tmp_path, monkeypatch):
    """A new format needs a file and a line in FORMATS."""
    (tmp_path / "toy_format.py").write_text(TOY)
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("locplan.app.cli.export", "toy_format"):
        monkeypatch.setitem(sys.modules, name, None)  # so that it is forgotten at last
        monkeypatch.delitem(sys.modules, name)
    toy = import_module("toy_format")
    monkeypatch.setattr(export_formats, "FORMATS", (*export_formats.FORMATS, *toy.FORMATS))
    save_map(ascii_map("....", "....", "....", resolution=0.5), tmp_path / "bay.yaml")
    _, out, _ = run("export", "--help")
    names = ", ".join(each.name for each in export_formats.FORMATS)  # with toy
    assert f"{names}]" in " ".join(out.replace("│", " ").split())
    ask = "export", tmp_path / "bay.yaml", "--to", "toy"
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*ask, "--slowest", 0.5)
    assert (code, err) == (0, "")
    assert out.endswith("wrote bay-toy.txt: the export\n")
    most = float(re.search(r"greatest e +(\S+)", out)[1])
    assert int((tmp_path / "bay-toy.txt").read_text()) == round(most / 0.5)
    assert "slowest must be above 0" in check_refusal(run(*ask, "--slowest", 0))
    for extra in (("--frame", "odom"), ("--start", "1,1", "--goal", "1,2")):
        message = check_refusal(run(*ask, *extra))
        assert re.search(f"{extra[0]} has no effect with --to toy; .*path", message)
    assert "must end in .txt" in check_refusal(run(*ask, "-o", "toy.csv"))


def test_formats_describe_every_option():
    for each in list_formats().values():
        for name, doc in read_field_docs(each.options).items():
            assert doc.endswith("."), f"{each.name}: {name}"


def test_command_overwrites_files_only_with_force(run, tmp_path):
    save_map(ascii_map("....", "....", "....", resolution=0.5), tmp_path / "bay.yaml")
    (tmp_path / "mine.csv").write_text("years of work")
    ask = "export", tmp_path / "bay.yaml", "--to", "path", "--start", "0.8,0.8"
    ask = *ask, "--goal", "1.2,0.8", "-o", tmp_path / "mine.csv"
    assert "mine.csv: was not written by this command; name another file" in check_refusal(
        run(*ask)
    )
    assert (tmp_path / "mine.csv").read_text() == "years of work"
    code, out, _ = run(*ask, "--force")
    assert code == 0
    assert "6 m assumed" in " ".join(out.split())
    assert (tmp_path / "mine.csv").read_text().startswith("x,")
