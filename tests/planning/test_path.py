import dataclasses
import json
from functools import partial

import numpy as np
import pytest
from support.cases import sample_cases
from support.maps import ascii_map

from locplan.comparison.journal import RunJournal
from locplan.errors import LocplanError
from locplan.field import CovarianceField, load_config
from locplan.maps import FREE, OccupancyGrid, load_map
from locplan.planning import Costmap, Path, path_cost, path_metrics, plan, random_queries
from locplan.planning.metrics import compute_profile, find_cells_of_path
from locplan.planning.queries import read_queries

ANGLED = Path([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])


@pytest.mark.parametrize("spacing", [0.3, 0.5, 2.0])
def test_resampling_keeps_line_and_corners(spacing):
    fine = ANGLED.resample(spacing)
    assert np.diff(fine.distance).max() <= spacing + 1e-9
    assert fine.length == pytest.approx(3.0, abs=1e-12)
    assert {*ANGLED} <= {*fine}


def test_positions_at_equal_distances_cut_corners():
    xy = ANGLED.resample(0.3, even=True).xy.round(9)
    assert xy[2:6].tolist() == [[0.6, 0.0], [0.9, 0.0], [1.0, 0.2], [1.0, 0.5]]


def test_resampling_keeps_turns_in_place():
    path = Path([[0, 0], [1, 0], [1, 0], [1, 1]], [3.0, 3.0, -3.0, -2.0])
    fine = path.resample(0.4)
    assert fine.heading[:5] == pytest.approx([3.0, 3.0, 3.0, 3.0, 2 * np.pi - 3.0])
    grid = OccupancyGrid(np.full((2, 2), FREE), 0.7)
    (heading, _, _, lengths), other = (find_cells_of_path(grid, each, 64) for each in (path, fine))
    assert np.array_equal(np.unique(heading), np.unique(other[0]))
    np.testing.assert_allclose(np.bincount(heading, lengths), np.bincount(other[0], other[3]))


@pytest.mark.parametrize("name", sample_cases(["tb4_depot", "willow_full_stage", "tuw_cave"]))
def test_resampling_keeps_path_cost(real_maps, name):
    costs = Costmap.blank(load_map(real_maps / name), robot=0.25)
    for query in random_queries(costs, 15, 1, min_distance=5.0):
        path = plan(costs, query.start, query.goal).path
        for spacing in (0.1, 0.2, 0.3, 0.5):
            fine = path.resample(spacing)
            assert path_cost(costs, fine) == pytest.approx(path_cost(costs, path), rel=1e-12)


def test_single_position_has_zero_length():
    path = Path(np.array([[1.0, 2.0]]))
    assert path.length == 0.0
    assert path.resample(1.0).xy.tolist() == [[1.0, 2.0]]


def test_geojson_has_line_and_headings():
    path = Path([[0.0, 1.0], [2.0, 1.0]], [0.0, 0.5])
    (line,) = json.loads(json.dumps(path.to_geojson(frame="odom")))["features"]
    assert line["geometry"] == {"type": "LineString", "coordinates": path.xy.tolist()}
    assert line["properties"] == {"frame": "odom", "length": 2.0, "heading": [0.0, 0.5]}
    (point,) = Path([[3.0, 4.0]]).to_geojson()["features"]
    assert point["geometry"]["coordinates"] == [[3.0, 4.0]] * 2  # a line needs two positions


def test_nav_msgs_poses_face_travel_direction():
    fields = ANGLED.to_nav_msgs(frame="odom")
    assert fields["header"]["frame_id"] == "odom"
    positions = [pose["pose"]["position"] for pose in fields["poses"]]
    assert [(at["x"], at["y"]) for at in positions] == [*ANGLED]
    turns = [pose["pose"]["orientation"] for pose in fields["poses"]]
    yaw = [2 * np.arctan2(turn["z"], turn["w"]) for turn in turns]
    assert yaw == pytest.approx([0.0, np.pi / 2, 0.0, 0.0])


def test_spacing_must_be_positive():
    with pytest.raises(LocplanError, match="spacing"):
        Path(np.zeros((2, 2))).resample(0.0)


@pytest.mark.parametrize(
    ("xy", "message"),
    [
        (np.zeros((0, 2)), r"array of finite metres, not \(0, 2\)"),
        (np.zeros(3), r"array of finite metres, not \(3,\)"),
        (np.full((2, 2), np.nan), "array of finite metres"),
        ([[0, 0], [1e12, 0]], r"must lie within ±1e\+08 m"),
        ([[10**400, 0]], r"needs an \(n, 2\) array of metres"),
        ([["a", 0]], r"needs an \(n, 2\) array of metres"),
        ([[0, 0], [0]], r"needs an \(n, 2\) array of metres"),
    ],
)
def test_path_rejects_invalid_positions(xy, message):
    with pytest.raises(LocplanError, match=message):
        Path(xy)


@pytest.mark.parametrize("heading", [[1e300, 0.0], ["east", 0.0], [10**400, 0], [0.0]])
def test_path_rejects_invalid_headings(heading):
    with pytest.raises(LocplanError, match="headings must be 2 angles"):
        Path(np.zeros((2, 2)), heading)


def test_no_path_takes_endless_steps():
    far = Path([[0.0, 0.0], [1e8, 0.0]])
    with pytest.raises(LocplanError, match="greater spacing"):
        far.resample(0.001)
    costs = Costmap.from_density(ascii_map("...."), np.ones((1, 4)))
    with pytest.raises(LocplanError, match="crosses over 10000000 cells"):
        path_metrics(costs, far)
    assert path_metrics(costs, Path([[0.5, 0.5], [1e4, 0.5]])).cost == np.inf


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no path; its first line must name x,y"),
        ("x,y\n", "is no path; its first line must name x,y"),
        ("x,y\n1\n", "is no path; its first line must name x,y"),
        ("x,y\n1e12,0\n", r"a path must lie within ±1e\+08 m"),
        ("x,y\n1,2\n" + "9" * 400 + ",0", "line 3 has x, y that are not all finite"),
    ],
)
def test_load_rejects_files_without_path(tmp_path, text, message):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(LocplanError, match=f"p.csv: {message}"):
        Path.load(tmp_path / "p.csv")


@pytest.mark.parametrize("name", ["", " ", "a\0b", "\ud800", None, 3])
def test_readers_reject_invalid_file_names(name):
    for read in (
        Path.load,
        load_map,
        load_config,
        read_queries,
        CovarianceField.load,
        partial(RunJournal, settings={}),
    ):
        with pytest.raises(LocplanError, match="must be a path, not"):
            read(name)


def test_load_rejects_large_files(tmp_path):
    with (tmp_path / "p.csv").open("wb") as file:
        file.truncate(2**24 + 1)
    with pytest.raises(LocplanError, match=r"over 16\.8 MB"):
        Path.load(tmp_path / "p.csv")


def test_path_cost_takes_arrays_and_plans():
    costs = Costmap.blank(OccupancyGrid(np.full((20, 40), 254), resolution=0.1))
    result = plan(costs, (0.5, 1.0), (3.5, 1.0))
    cost = path_cost(costs, result.path)
    assert cost == pytest.approx(3.0)
    assert path_cost(costs, result) == cost == path_cost(costs, result.path.xy)
    poses = np.column_stack([result.path.xy, np.zeros(len(result.path))])
    assert path_metrics(costs, poses).cost == cost
    assert compute_profile(costs, poses.tolist(), costs.u)[0][-1] == pytest.approx(3.0)
    nowhere = dataclasses.replace(result, path=None)
    for path_like, fault in (
        (nowhere, "the plan has no path"),
        ([1.0, 2.0], "a path must be a Path"),
    ):
        with pytest.raises(LocplanError, match=fault):
            path_cost(costs, path_like)
