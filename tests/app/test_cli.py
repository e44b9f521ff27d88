import csv
import dataclasses
import json
import math
import re
import subprocess
import sys
import types
from typing import get_args, get_type_hints

import numpy as np
import pytest
import yaml
from support.cases import sample_cases
from support.command_line import check_refusal
from support.machine import SHARED_DATA
from support.maps import ascii_map

import locplan
from locplan import (
    Costmap,
    CovarianceField,
    FieldConfig,
    Lidar,
    LocplanError,
    OccupancyGrid,
    Path,
    Scan,
    Zone,
    Zones,
    load_config,
    load_map,
    load_or_compute,
    save_map,
)
from locplan._support import public
from locplan._support.output import replace_file
from locplan.app.cli.application import COMMANDS
from locplan.export import nav2_keepout
from locplan.field import save_config
from locplan.maps import FREE, OCCUPIED, environments
from locplan.planning import ParetoFront

ENDS = "--start", "1,1", "--goal", "2,2"


@pytest.fixture
def room(tmp_path):
    grid = ascii_map("##########", *["#........#"] * 6, "#...#    #", "##########", resolution=0.5)
    save_map(grid, tmp_path / "room.yaml")
    return tmp_path / "room.yaml"


def test_field_prints_table_and_writes_file(run, room, tmp_path):
    assert run("field", room, "-o", tmp_path / "f.png")[0] == 0
    code, out, err = run("field", room, "-o", tmp_path / "f.npz")
    assert code == 0
    assert "cells evaluated" in out
    assert "saturated" in out
    written = f"wrote {tmp_path / 'f.npz'}: the field, for --field"
    assert (out.splitlines()[-1], err) == (written, "")
    assert CovarianceField.load(tmp_path / "f.npz").grid.digest == load_map(room).digest
    assert (tmp_path / "f.png").stat().st_size > 1000


def test_json_is_json(run, room):
    code, out, _ = run("field", room, "--json", "--field", "sad-paper")
    assert code == 0
    about = json.loads(out)
    assert about["cells_evaluated"] == load_map(room).free.sum()
    assert about["config"]["estimator"]["weights"]["name"] == "inverse-square"


@pytest.mark.usefixtures("undrawn")
def test_plan_writes_paths_plan_and_picture(run, room, tmp_path):
    out_dir = tmp_path / "out"
    ends = "--start", "1,2", "--goal", "4,3.5"
    code, out, _ = run("plan", room, *ends, "-o", out_dir)
    assert code == 0
    assert "∫e ds" in out
    assert sorted(path.name for path in out_dir.iterdir()) == [
        "01-shortest.csv",
        "02-localizability-aware.csv",
        "candidates.csv",
        "choice.json",
        "choice.png",
        "chosen.csv",
        "errors.csv",
        "run.yaml",
    ]
    xy = np.loadtxt(out_dir / "01-shortest.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(xy[[0, -1]], [[1, 2], [4, 3.5]])
    about = json.loads((out_dir / "choice.json").read_text())
    assert about["candidates"][0]["metrics"]["length"] > 3
    assert about["about"]["config"]["estimator"]["range"] == 6.0
    assert about["about"]["map"]["digest"] == load_map(room).digest


def test_plan_compares_shortest_and_aware_path(run, tmp_path):
    """Both paths are measured on the same costs."""
    grid = environments.make("two_corridors", resolution=0.1)
    save_map(grid, tmp_path / "map.yaml")
    ends = "--start", "2,3", "--goal", "38,3"
    code, out, _ = run("plan", tmp_path / "map.yaml", *ends, "--stride", "0.5", "--json")
    assert code == 0
    first, second = json.loads(out)["candidates"]
    assert (first["name"], second["name"]) == ("shortest", "localizability-aware")
    shortest, aware = first["metrics"], second["metrics"]
    assert shortest["length"] == pytest.approx(36.0, abs=0.2)
    assert max(y for _, y in first["path"]["xy"]) < 5
    assert max(y for _, y in second["path"]["xy"]) > 10
    for metrics in (shortest, aware):
        expected = metrics["length"] + 4.0 * metrics["integrated_u"]
        assert metrics["cost"] == pytest.approx(expected, rel=1e-6)
    assert aware["cost"] < shortest["cost"]


def test_usage_errors_are_one_line(run, room):
    for arguments in (("plan", room), ("field",), ("field", room, "--stride", "6m"), ("fly",)):
        assert "--help" in check_refusal(run(*arguments))


def test_interrupt_ends_command_with_message(run, room, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("locplan.field.Sad.covariances", interrupt)
    code, _, err = run("field", room, "--stride", "0.77")
    assert code == 130
    assert err == "locplan: interrupted\n"


@pytest.mark.usefixtures("undrawn")
def test_plan_reports_unreachable_goal(run, tmp_path):
    """An unreachable goal is a result, not an error."""
    save_map(ascii_map("...#...", resolution=1.0), tmp_path / "parted.yaml")
    ends = "--start", "0.5,0.5", "--goal", "6.5,0.5"
    code, out, _ = run("plan", tmp_path / "parted.yaml", *ends, "-o", tmp_path / "out")
    assert code == 0
    assert "unreachable" in out
    assert (tmp_path / "out" / "choice.png").exists()


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("0.2,2", "lies in a wall; the nearest free position is"),
        ("9,9", "lies outside the map, which reaches from 0,0 to 5,4.5 m; the nearest free"),
        ("3.7,0.7", "lies in unknown space; the nearest free position is"),
        ("0.75,2", "closer than the robot's radius"),
        ("1;2", "must be X,Y in metres"),
        ("1,2,3", "have a heading"),
        ("1,2,3,4", "must be X,Y in metres"),
        ("nan,2", "must be X,Y in metres"),
    ],
)
def test_plan_refuses_impossible_start(run, room, tmp_path, start, message):
    arguments = "--start", start, "--goal", "4,3.5", "--set", "footprint=0.35", "-o", tmp_path / "o"
    assert message in check_refusal(run("plan", room, *arguments))
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--set", "range=-1"), "range must be a positive number of m"),
        (("--set", "rnge=8"), "a robot has no setting 'rnge'; it has footprint, margin"),
        (("--set", "range"), "--set must be NAME=VALUE"),
        (("--robot", "none.yaml"), "none.yaml: there is no such file"),
        (
            ("--field", "best"),
            "--field must be one of sad, fisher, scan, fused, sad-paper, or a file",
        ),
        (("--field", "fishr"), "did you mean 'fisher'?"),
        (("--field", "none.json"), "none.json: there is no such file"),
        (("--field", "none.npz"), "none.npz: there is no such file"),
        (("--stride", "nan"), "stride"),
        (("--threads", "0"), "threads"),
        (("-o", "field.txt"), "must end in .npz, .png"),
        (("-o", "nowhere/field.png"), "nowhere"),
        (("--picture", "e"), "name a file for the picture of e with --output"),
        (("--picture", "e", "-o", "field.npz"), "must end in .png"),
        (("--picture", "mood", "-o", "field.png"), "the picture must be one of e"),
        (("--picture", "ambiguity", "-o", "field.png"), "the picture must be one of e"),
    ],
)
def test_field_refuses_wrong_options(run, room, arguments, message):
    assert message in check_refusal(run("field", room, *arguments))


def test_bad_planner_and_weight_are_refused(run, room):
    ends = "--start", "1,2", "--goal", "4,3.5"
    assert "planner" in check_refusal(run("plan", room, *ends, "--planner", "magic"))
    assert "weight" in check_refusal(run("plan", room, *ends, "--weight", "-2"))


def test_info_writes_built_in_map(run, tmp_path):
    code, out, _ = run("info", "two_corridors", "-o", tmp_path / "maps")
    assert code == 0
    written = tmp_path / "maps" / "two_corridors.yaml"
    assert f"wrote {written}: the map, for ROS and all commands" in out
    assert f"wrote {tmp_path / 'maps'}: 1 more file" in out
    ascii_map = environments.make("two_corridors")
    assert load_map(tmp_path / "maps" / "two_corridors.yaml").digest == ascii_map.digest
    assert ".png" in check_refusal(run("info", tmp_path / "maps", "-o", tmp_path / "others"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "hall.yaml").write_text("mine")
    check_refusal(run("info", "hall", "-o", tmp_path / "mine"))
    assert (tmp_path / "mine" / "hall.yaml").read_text() == "mine"


@pytest.mark.usefixtures("undrawn")
def test_commands_accept_built_in_maps(run, tmp_path, monkeypatch, small_field):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run("info", "two_corridors")
    assert code == 0
    assert "locplan plan two_corridors --start" in out
    ends = "--start", "2,3", "--goal", "38,3", "--field", small_field
    assert run("plan", "two_corridors", *ends, "--stride", "1", "-o", "planned")[0] == 0
    assert "map: two_corridors\n" in (tmp_path / "planned" / "run.yaml").read_text()
    assert "did you mean two_corridors?" in check_refusal(run("plan", "two_coridors", *ends))
    built_in = ", ".join(environments.list_environments())
    assert f"a built-in map: {built_in}" in check_refusal(run("field", "moon"))


def test_field_draws_any_scalar(run, room, tmp_path):
    picture = tmp_path / "heading_std.png"  # the others are drawn elsewhere
    assert run("field", room, "-o", picture, "--picture", "heading_std")[0] == 0
    assert picture.stat().st_size > 1000
    code, out, _ = run("field", room, "-o", tmp_path / "default.pdf")
    assert code == 0
    assert f"wrote {tmp_path / 'default.pdf'}" in out


def test_field_writes_numpy_file(run, room, tmp_path):
    assert run("field", room, "-o", tmp_path / "lab.npz")[0] == 0
    with np.load(tmp_path / "lab.npz") as arrays:
        assert arrays["cells"].shape == load_map(room).shape
        assert arrays["u_map"].shape == load_map(room).shape
        assert json.loads(str(arrays["about"]))["config"]["estimator"]["range"] == 6.0


@pytest.mark.usefixtures("undrawn")
def test_field_draws_many_maps_into_folder(run, room, tmp_path):
    save_map(load_map(room), tmp_path / "other.yaml")
    assert run("field", tmp_path, "--picture", "e", "-o", tmp_path / "drawn")[0] == 0
    names = {file.name for file in (tmp_path / "drawn").iterdir()}
    assert names == {"room.png", "other.png", "run.yaml"}


def test_warnings_are_one_line(run, tmp_path):
    cells = ascii_map("....", "....")
    save_map(cells, tmp_path / "grey.yaml")
    image = tmp_path / "grey.pgm"
    image.write_bytes(image.read_bytes().replace(b"\xfe", b"\xcd"))
    text = (tmp_path / "grey.yaml").read_text().replace("0.196", "0.25")
    (tmp_path / "grey.yaml").write_text(text)
    code, _, err = run("field", tmp_path / "grey.yaml")
    assert code == 0
    assert err.startswith("locplan: warning: ")
    assert "free_thresh: 0.196" in err
    assert err.count("\n") == 1


def test_malformed_map_causes_no_traceback(run):
    folder = SHARED_DATA / "malformed"
    if not folder.is_dir():
        pytest.skip("the collection of malformed maps (../shared/data/malformed) is not here")
    rows = (folder / "README.md").read_text().splitlines()
    expected = dict(re.findall(r"\| (\w+) \| ([a-z-]+) \|", "\n".join(rows)))
    for case in sorted(folder.glob("bad_*")):
        result = run("field", case / "map.yaml")
        if result[0] or expected[case.name] == "clear-error":
            check_refusal(result)


def test_many_maps_share_one_table(run, room, tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("image: nowhere.pgm\n")
    (tmp_path / "params.yaml").write_text("amcl: {alpha1: 0.2}\n")
    code, out, _ = run("field", tmp_path, "-o", tmp_path / "fields")
    assert code == 2
    assert f"wrote {tmp_path / 'fields'}" in out
    assert re.search(r"room +51 ", out)
    assert re.search(r"bad +– .* failed\nfailed: .*nowhere.pgm|failed: .*bad.yaml", out)
    assert "params" not in out
    assert CovarianceField.load(tmp_path / "fields" / "room.npz").grid.name == "room"
    code, out, _ = run("field", room, room.parent / "." / "room.yaml", bad, "--json")
    assert code == 2
    assert [about["error"] is None for about in json.loads(out)] == [True, False]


def test_field_refuses_maps_of_equal_name(run, room, tmp_path):
    """Their files in the output folder would collide."""
    (tmp_path / "other").mkdir()
    save_map(load_map(room), tmp_path / "other" / "room.yaml")
    arguments = "field", room, tmp_path / "other"
    assert "have the same name" in check_refusal(run(*arguments, "-o", tmp_path / "fields"))
    assert run(*arguments)[0] == 0


def test_field_takes_folder_of_single_map(run, room, tmp_path):
    assert run("field", room.parent, "-o", tmp_path / "f.npz")[0] == 0
    assert CovarianceField.load(tmp_path / "f.npz").grid.name == "room"


def test_of_several_maps_outputs_are_folders(run, room, tmp_path):
    save_map(load_map(room), tmp_path / "other.yaml")
    assert "name a folder" in check_refusal(run("field", tmp_path, "-o", tmp_path / "f.npz"))


def test_field_refuses_folder_without_map(run, tmp_path):
    assert "is a folder without any map" in check_refusal(run("field", tmp_path))


def test_cache_command_lists_and_clears_results(run, room, tmp_path, monkeypatch, small_field):
    folder = tmp_path / "cache"
    monkeypatch.setenv("LOCPLAN_CACHE", str(folder))
    assert run("cache", "path")[1].strip() == str(folder)
    assert run("cache", "list")[1].startswith("0 results, 0 B of at most 5 GB")
    run("field", room, "--field", small_field)
    out = " ".join(run("cache", "list")[1].split())
    assert "field room sad, disc" in out
    assert "100%" in out
    (about,) = json.loads(run("cache", "list", "--json")[1])
    assert (about["kind"], about["map"], about["finished_share"]) == ("field", "room", 1.0)
    assert run("cache", "clear", "--older-than", "1")[1].startswith("removed 0")
    run("field", room, "--field", "fisher")
    out = " ".join(run("cache", "list")[1].split())
    assert "room fisher" in out
    (folder / ("0" * 32 + ".zarr")).mkdir()  # of an earlier version
    listed = json.loads(run("cache", "list", "--json")[1])
    assert sorted(each["kind"] for each in listed) == ["field", "field", "outdated"]
    assert run("cache", "clear")[1].startswith("removed 3")
    assert run("cache", "list")[1].startswith("0 results")


def test_plans_can_have_limits_and_waypoints(run, room):
    ends = "--start", "1,2", "--goal", "4,3.5"
    about = json.loads(run("plan", room, *ends, "--via", "1.25,3.25", "--json")[1])
    assert all([1.25, 3.25] in each["path"]["xy"] for each in about["candidates"])
    assert about["settings"]["via"] == [[1.25, 3.25]]
    code, out, _ = run("plan", room, *ends, "--budget", "1e-3")
    assert code == 0
    assert out.startswith("No path keeps the limits: ")
    assert "the least is" in out
    about = json.loads(run("plan", room, *ends, "--budget", "50", "--json")[1])
    assert about["candidates"][1]["planner"] == "grid"
    assert "no path within the budget is shorter than" in about["candidates"][1]["note"]
    assert "within 0; the least is" in run("plan", room, *ends, "--budget", "0")[1]
    _, out, _ = run("plan", room, *ends, "--max-e", "1e-9")
    assert "would do" in out


def test_plan_accepts_footprint_corners(run, room):
    ends = "--start", "1,2", "--goal", "4,3.5", "--set", "footprint=[[0.3,0.1],[0.3,-0.1],[-0.3,0]]"
    code, out, _ = run("plan", room, *ends, "--json")
    assert code == 0
    inscribed_radius, margin = 0.3 * 0.1 / math.hypot(0.6, 0.1), 0.05
    radius = json.loads(out)["about"]["robot_radius"]
    assert radius == pytest.approx(inscribed_radius + margin)
    for bad in ("0.3,0.1", "[[0,0],[1,1]]", "-1"):
        assert "footprint" in check_refusal(run("plan", room, *ends[:-1], f"footprint={bad}"))


@pytest.mark.usefixtures("undrawn")
def test_plan_front_prints_and_writes_front(run, room, tmp_path):
    ends = "--start", "1,2", "--goal", "4,3.5"
    code, out, _ = run("plan", room, *ends, "--front", "-o", tmp_path / "front")
    assert code == 0
    assert "exact" in out
    files = {path.name for path in (tmp_path / "front").iterdir()}
    assert files == {"run.yaml", *ParetoFront.files.names} - {"knee.csv"}  # it has no knee
    integral = np.loadtxt(tmp_path / "front" / "front.csv", delimiter=",", skiprows=1, ndmin=2)[
        :, 1
    ]
    about = json.loads((tmp_path / "front" / "front.json").read_text())
    assert integral.tolist() == about["integral"]  # with all digits: they are budgets
    lidar = "--lidar", "turtlebot4", "--set", "range=3", "--stride", "0.5"
    about = json.loads(run("plan", room, *ends, "--front", *lidar, "--json")[1])
    assert about["epsilon"] == 0
    assert len(about["length"]) == len(about["integral"]) > 0
    assert "drives" not in about


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--goal", "99,99"), "outside the map"),
        (("--goal", "4,3.5,90"), "--front ignores headings"),
        (("--drives", "4"), "--drives has no effect with --front"),
        (("--planner", "grid"), "--planner has no effect with --front"),
        (("--weight", "4"), "--weight has no effect with --front"),
        (("--longest", "2"), "--longest has no effect with --front"),
        (("--minimise", "lost"), "--minimise has no effect with --front"),
    ],
)
def test_plan_front_refuses_wrong_options(run, room, arguments, told):
    ends = ("--start", "1,2") + (() if "--goal" in arguments else ("--goal", "4,3.5"))
    assert told in check_refusal(run("plan", room, *ends, "--front", *arguments))


@pytest.mark.usefixtures("undrawn")
def test_ompls_planners_are_at_hand(run, room, tmp_path):
    folder = tmp_path / "out"
    ends = "--start", "1,1,90", "--goal", "4,3.5,0"
    planner = "RRTstar:space=Dubins,turning_radius=0.3,iterations=400,range=1.5"
    arguments = "--planner", planner, "--set", "footprint=0.05", "-o", folder
    code, out, _ = run("plan", room, *ends, *arguments)
    assert code == 0
    assert out.startswith("Untested: ")
    assert "paths with headings" in " ".join(out.split()).lower()
    assert (folder / "history.png").is_file()
    poses = np.loadtxt(folder / "02-localizability-aware.csv", delimiter=",", skiprows=1)
    assert poses[0] == pytest.approx([1, 1, math.pi / 2], abs=1e-5)
    assert poses[-1] == pytest.approx([4, 3.5, 0], abs=1e-5)
    about = json.loads((folder / "choice.json").read_text())["candidates"][1]
    assert about["planner"] == "RRTstar"
    assert len(about["path"]["heading"]) == len(about["path"]["xy"])
    assert about["history"][-1][1] == pytest.approx(about["metrics"]["cost"])


MY_PLANNER = """
from locplan import plan
from bends import bend

def mine(costs, start, goal, weight=1.0):
    return bend(plan(costs.with_weight(weight), start, goal, planner="grid").path)

def broken(costs, start, goal):
    return 3
"""


@pytest.fixture
def my_planner(tmp_path):
    """A file with two planners, which imports its neighbour."""
    (tmp_path / "bends.py").write_text(
        "import numpy as np\n\ndef bend(path):\n    return np.array(path)\n"
    )
    (tmp_path / "my.py").write_text(MY_PLANNER)
    return tmp_path / "my.py"


@pytest.mark.usefixtures("inline_workers", "undrawn")
def test_compare_runs_function_of_file(run, room, tmp_path, my_planner):
    words = "--planner", f"{my_planner}:mine:weight=2", "--planner", "rrt*:range=1,iterations=50"
    words = *words, "--random", 1, "--min-distance", 1, "-o", tmp_path / "out"
    code, _, err = run("compare", room, *words)
    assert code == 0, err
    with (tmp_path / "out" / "runs.csv").open() as file:
        status = {row["planner"]: row["status"] for row in csv.DictReader(file)}
    assert [*status] == ["my.py:mine:weight=2", "RRTstar:range=1,iterations=50"]
    assert status["my.py:mine:weight=2"] == "solved"


def test_plan_takes_function_of_file(run, room, my_planner):
    ends = "--start", "1,1", "--goal", "4,3.5"
    code, out, _ = run("plan", room, *ends, "--planner", f"{my_planner}:mine", "--json")
    assert code == 0
    assert json.loads(out)["candidates"][-1]["planner"] == "mine"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("my.py", "add the function f(costs, start, goal), such as"),
        ("my.py:theirs", "has no function 'theirs'; use one of mine, broken"),
        ("my.py:mine:wight=2", "no option 'wight'; it has: weight; did you mean 'weight'?"),
        ("my.py:broken", "the planner must return a locplan.Path, an array of positions"),
        ("none.py:mine", "there is no such file"),
        ("bad.py:mine", "cannot be run (ZeroDivisionError"),
    ],
)
def test_plan_refuses_wrong_planner_function(run, room, my_planner, name, message):
    (my_planner.parent / "bad.py").write_text("1 / 0")
    words = "--start", "1,1", "--goal", "4,3.5", "--planner", f"{my_planner.parent}/{name}"
    assert message in check_refusal(run("plan", room, *words))


def test_compare_names_missing_cloudpickle(run, room, tmp_path, my_planner, monkeypatch):
    monkeypatch.setattr(public, "find_spec", lambda name: None)
    words = "--planner", f"{my_planner}:mine", "-o", tmp_path / "out"
    message = "a custom planner, needs cloudpickle: pip install 'locplan[functions]'"
    assert message in check_refusal(run("compare", room, *words))
    assert not (tmp_path / "out").exists()


def test_plan_reports_planner_without_objective(run, room):
    ends = "--start", "1,1", "--goal", "4,3.5"
    code, out, _ = run("plan", room, *ends, "--planner", "RRT:improve=true")
    assert code == 0
    assert "any path, since its planner minimises nothing" in out


@pytest.mark.parametrize(
    ("planner", "message"),
    [
        ("RRTstar:range", "'range' must be NAME=VALUE"),
        ("RRTstar:rang=1", "did you mean 'range'?"),
        ("RRTstar:time_limit=-1", ": time_limit must be a positive number"),
        ("RRTstar:time_limt=1", "turning_radius, time_limit, iterations"),
        ("RRstar", "did you mean 'RRTstar'?"),
        ("FMT:space=Dubins,turning_radius=1", "cannot plan in"),
        ("RRTstar:space=SE2", "start must be x, y [m] and a heading"),
        ("grid:time_limit=1", "no option 'time_limit'"),
        ("any-angle:space=Dubins", "no option 'space'"),
    ],
)
def test_plan_refuses_wrong_planner_options(run, room, planner, message):
    ends = "--start", "1,1", "--goal", "4,3.5"
    assert message in check_refusal(run("plan", room, *ends, "--planner", planner))


def test_plan_gives_seed_to_random_planner(run, room):
    ends = "--start", "1,1", "--goal", "4,3.5", "--planner", "RRT:iterations=200"
    first, same, other = (
        json.loads(run("plan", room, *ends, "--seed", seed, "--json")[1])["candidates"][-1]
        for seed in (1, 1, 2)
    )
    assert first["path"] == same["path"]
    assert first["path"] != other["path"]


def test_lidar_options_override_field_settings(run, room, tmp_path):
    save_config(FieldConfig(Scan(Lidar(range=6.0, beams=90)), headings=4), tmp_path / "scan.json")
    sensor = "--field", tmp_path / "scan.json", "--set", "field_of_view_deg=180"
    sensor += "--set", "range=3", "--set", "footprint=0.05", "--lidar", "turtlebot4"
    code, out, _ = run("field", room, *sensor, "-o", tmp_path / "f.npz")
    assert code == 0
    assert "scan, turtlebot4, 3 m, 180°, 4 headings" in " ".join(out.split())
    field = CovarianceField.load(tmp_path / "f.npz")
    assert field.covariance.shape[2] == 4
    ends = "--start", "1,1", "--goal", "4,3.5", "--drives", "0"
    code, out, _ = run("plan", room, *ends, *sensor)
    assert code == 0
    picture = tmp_path / "ambiguity.png"
    assert run("field", room, *sensor, "-o", picture, "--picture", "ambiguity")[0] == 0
    assert picture.stat().st_size > 1000


@pytest.mark.long
def test_lidar_option_sets_estimator_and_simulator(run, room, tmp_path):
    _, out, _ = run("field", room, "--lidar", "utm-30lx")
    assert "fused, utm-30lx, 30 m, 270°, 8 headings" in " ".join(out.split())
    _, out, _ = run("field", room, "--lidar", "turtlebot3", "--field", "sad", "--set", "range=3")
    assert "sad, disc, exponential, turtlebot3, 3 m" in " ".join(out.split())
    _, out, _ = run("field", room)
    assert "no lidar named: the paper's disc, 6 m assumed" in " ".join(out.split())
    ends = "--start", "1,1", "--goal", "4,3", "--drives", "2", "--set", "footprint=0.05"
    for estimator in ("scan", "sad"):
        options = (*ends, "--lidar", "tim571", "--field", estimator, "--stride", "1")
        about = json.loads(run("simulate", room, *options, "--json")[1])
        seen = about["robot"]["lidar"]
        assert (seen["model"], seen["beams"]) == ("tim571", 811)


@pytest.mark.long
def test_commands_report_map_without_weak_spots(run, tmp_path, monkeypatch):
    lines = ["#" * 16, *["#" + "." * 14 + "#"] * 14, "#" * 16]
    save_map(ascii_map(*lines, resolution=0.1), tmp_path / "small.yaml")
    ends = "--start", "0.75,0.75", "--goal", "0.95,0.85", "--set", "footprint=0.05"
    said = "this lidar has no weak spot"
    for lidar, none in (("tim571", True), ("turtlebot4", False)):
        monkeypatch.setattr("locplan.field.beams.SHARP", 0.8 if none else 0.01)
        named = "--lidar", lidar
        assert (said in run("field", tmp_path / "small.yaml", *named)[1]) == none
        assert (said in run("plan", tmp_path / "small.yaml", *ends, *named)[1]) == none


def test_field_prints_centimetres_and_degrees(run, room):
    out = " ".join(run("field", room, "--lidar", "turtlebot4")[1].split())
    about = json.loads(run("field", room, "--lidar", "turtlebot4", "--json")[1])
    median = about["position_std"]["median"]
    assert f"/ {100 * median:.3g} /" in out
    assert f"/ {math.degrees(about['heading_std']['median']):.3g} /" in out
    assert out.index("cm") < out.index("deg") < out.index("m² rad")


def test_plan_prints_deviation_in_centimetres(run, room):
    ends = "--start", "1,2", "--goal", "4,3.5"
    asked = "plan", room, *ends, "--lidar", "turtlebot4", "--drives", "0"
    out, about = run(*asked)[1], json.loads(run(*asked, "--json")[1])
    lidar = locplan.Lidar.preset("turtlebot4")
    field = locplan.load_or_compute(load_map(room), locplan.Fused(lidar))
    shortest = about["candidates"][0]
    xy = locplan.Path(shortest["path"]["xy"]).resample(0.05).xy
    std = field.at(xy, "position_std")
    assert shortest["deviation"][0] == pytest.approx(std.mean(), rel=0.1)
    (line,) = [line for line in out.splitlines() if line.startswith("  shortest ")]
    assert f" {100 * shortest['deviation'][0]:.1f} " in line


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--lidar", "kinect"), "lidar must be one of rplidar-a1"),
        (
            ("--field", "fisher", "--set", "field_of_view_deg=0"),
            "field_of_view_deg must be a positive number",
        ),
    ],
)
def test_impossible_sensors_are_refused(run, room, options, message):
    assert message in check_refusal(run("field", room, *options))


@pytest.mark.parametrize(
    ("to", "name"),
    [
        *((to, "out") for to in ("nav2-keepout", "nav2-speed", "nav2-routes", "ros-map")),
        ("path", "out.yaml"),
    ],
)
def test_export_writes_every_format(run, room, tmp_path, to, name, small_field):
    field = "--field", small_field
    ends = ("--start", "1,1", "--goal", "4,1") if to in ("path", "nav2-routes") else ()
    written = "-o", tmp_path / name
    code, out, err = run("export", room, "--to", to, *written, *field, *ends, "--json")
    assert code == 0, err
    assert json.loads(out)["to"] == to
    assert (tmp_path / name).exists()
    assert name != "out" or (tmp_path / name / "preview.png").stat().st_size > 1000
    runs = [] if (tmp_path / name).is_dir() else [f"{name}.run.yaml"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        ["room.yaml", "room.pgm", name, *runs]
    )


def test_copied_path_needs_no_field(run, room, tmp_path, monkeypatch):
    def fail(*_):
        raise AssertionError("a field was computed")

    monkeypatch.setattr("locplan.app.cli.groups.FieldOptions.compute", fail)
    Path(np.array([(1.0, 1.0), (4.0, 1.0)])).save(tmp_path / "mine.csv")
    line = "export", room, "--to", "path", "--path", tmp_path / "mine.csv"
    code, out, err = run(*line, "-o", tmp_path / "copy.csv")
    assert code == 0, err
    assert "field" not in out
    assert Path.load(tmp_path / "copy.csv").xy.tolist() == [[1, 1], [4, 1]]


def test_yaml_path_lies_on_nav2_map(run, room, tmp_path):
    """Nav2 ignores the yaw of a map. The CSV file stays in locplan's frame."""
    grid = load_map(room)
    turned = dataclasses.replace(grid, origin=(2.0, -1.0, 0.6), name="turned")
    save_map(turned, tmp_path / "turned.yaml")
    cells = grid.world_to_grid(np.array([1.0, 4.0]), np.array([1.0, 1.5]))
    xy = np.column_stack(turned.grid_to_world(*cells))
    Path(xy).save(tmp_path / "mine.csv")
    line = "export", tmp_path / "turned.yaml", "--to", "path", "--path", tmp_path / "mine.csv"
    code, _, err = run(*line, "-o", tmp_path / "out.csv")
    assert code == 0
    assert "yaw" not in err
    np.testing.assert_allclose(Path.load(tmp_path / "out.csv").xy, xy, atol=1e-6)
    _, _, err = run(*line, "-o", tmp_path / "out.yaml")
    assert "turned has a yaw of 0.6 rad" in err
    poses = [each["pose"] for each in yaml.safe_load((tmp_path / "out.yaml").read_text())["poses"]]
    nav2_grid = dataclasses.replace(turned, origin=(2.0, -1.0, 0.0))
    positions = np.array([[each["position"]["x"], each["position"]["y"]] for each in poses])
    np.testing.assert_allclose(nav2_grid.world_to_grid(*positions.T), cells, atol=1e-5)
    turn = poses[0]["orientation"]
    assert 2 * np.arctan2(turn["z"], turn["w"]) == pytest.approx(np.arctan2(0.5, 3), abs=1e-5)


@pytest.mark.parametrize("goal", [(4.0, 9.0), (4.0, 0.1)])
def test_exported_path_must_be_free(run, room, tmp_path, goal):
    """Ends outside the map and in a wall."""
    Path(np.array([(1.0, 1.0), goal])).save(tmp_path / "mine.csv")
    line = "export", room, "--to", "path", "--path", tmp_path / "mine.csv"
    message = check_refusal(run(*line, "-o", tmp_path / "out.csv"))
    assert "path mine has no length, or leaves the map's free space" in message
    assert not (tmp_path / "out.csv").exists()


def square(x, y, size=0.6):
    """Corners of a square."""
    return [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]


ZONES = Zones(
    [
        Zone("no-go", square(2, 1)),
        Zone("slow", square(1.2, 2), 40),
        Zone("prefer", square(0.5, 0.5, 2)),
    ]
)


@pytest.mark.usefixtures("undrawn")
def test_exported_zones_equal_python_export(run, room, tmp_path, small_field):
    """The command and Python write equal files. An exported choice keeps its zones."""
    ZONES.save(tmp_path / "zones.geojson")
    zones, field = ("--zones", tmp_path / "zones.geojson"), ("--field", small_field)
    mask = "export", room, "--to", "nav2-keepout", "--distro", "lyrical"
    code, out, err = run(*mask, *zones, *field, "-o", tmp_path / "mask")
    assert code == 0, err
    assert re.search(r"zones +1 no-go, 1 slow, 1 prefer\n", out)
    grid = load_map(room)
    computed = load_or_compute(grid, load_config(small_field))
    costs = Costmap.from_field(computed, zones=Zones.load(tmp_path / "zones.geojson"))
    with pytest.warns(UserWarning, match="lyrical"):
        nav2_keepout(tmp_path / "python", costs, distro="lyrical")
    names = {"zones.geojson", "mask.pgm", "speed_mask.pgm", "nav2.yaml", "vector_objects.yaml"}
    written = [
        {file.name: file.read_bytes() for file in (tmp_path / folder).iterdir()}
        for folder in ("mask", "python")
    ]
    assert names <= written[0].keys() == written[1].keys()
    assert written[0]["zones.geojson"] == (tmp_path / "zones.geojson").read_bytes()
    for name in written[0].keys() - {"run.yaml", "preview.png"}:
        assert written[0][name] == written[1][name], name
    ends = "--start", "1,1.2", "--goal", "3.5,1.2"
    code, out, err = run("plan", room, *ends, *zones, *field, "-o", tmp_path / "planned")
    assert code == 0, err
    assert f"zones of {tmp_path / 'zones.geojson'}: 1 no-go, 1 slow, 1 prefer\n" in out
    closed = ZONES.cells(grid, "no-go")
    for file in (tmp_path / "planned").glob("[0-9c]*.csv"):
        if file.name != "candidates.csv":
            assert not closed[grid.cell(Path.load(file).resample(0.005).xy)].any()
    code, _, err = run(*mask, "--choice", tmp_path / "planned", "-o", tmp_path / "chosen")
    assert code == 0, err
    assert (tmp_path / "chosen" / "zones.geojson").read_text() == ZONES.text
    message = check_refusal(run(*mask, "--choice", tmp_path / "planned", *zones))
    assert "--zones has no effect with --choice" in message


@pytest.mark.usefixtures("undrawn")
def test_plan_takes_keepout_mask_as_zones(run, room, tmp_path, small_field):
    grid = load_map(room)
    cells = np.full(grid.shape, FREE)
    closed = Zones([Zone("no-go", square(2, 1))]).cells(grid, "no-go")
    cells[closed] = OCCUPIED
    save_map(OccupancyGrid(cells, grid.resolution, grid.origin), tmp_path / "keepout.yaml")
    ends = "--start", "1,1.2", "--goal", "3.5,1.2", "--zones", tmp_path / "keepout.yaml"
    code, out, err = run("plan", room, *ends, "--field", small_field, "--json")
    assert code == 0, err
    for each in json.loads(out)["candidates"]:
        path = Path(np.array(each["path"]["xy"]))
        assert not closed[grid.cell(path.resample(0.005).xy)].any()
    code, out, err = run(
        "plan", room, *ends, "--field", small_field, "--front", "-o", tmp_path / "f"
    )
    assert code == 0, err
    assert f"zones of {ends[-1]}: 1 no-go\n" in out
    front = ParetoFront.load(tmp_path / "f")
    for index in range(len(front)):
        assert not closed[grid.cell(front.plan(index).path.resample(0.005).xy)].any()


@pytest.mark.usefixtures("undrawn")
def test_export_takes_planner_of_nav2(run, room, tmp_path, small_field):
    field = "--field", small_field, "--nav2-planner", "smac-hybrid"
    code, out, _ = run("export", room, "--to", "nav2-keepout", *field, "-o", tmp_path / "mask")
    assert code == 0
    assert "nav2-keepout" in out
    assert re.search("planner +smac-hybrid", out)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "nav2"), "--to must be one of nav2-keepout"),
        (
            ("--to", "ros-map", "--nav2-planner", "smac2d"),
            "--nav2-planner has no effect with --to ros-map; it is for nav2-keepout",
        ),
        (
            ("--to", "ros-map", "--slowest", "0.5"),
            "--slowest has no effect with --to",
        ),
        (("--to", "nav2-speed", "--slowest", "5"), "slowest must be 0.01 to 1"),
        (("--to", "nav2-keepout", "--nav2-planner", "teb"), "planner must be one of"),
        (("--to", "nav2-keepout", "--distro", "foxy"), "distro must be one of"),
        (("--to", "nav2-keepout", "--robot", "none.yaml"), "none.yaml: there is no such file"),
        (("--to", "path"), "needs one path: pass --path, --start and --goal, or --choice"),
        (("--to", "path", "--start", "1,1"), "belong together"),
        (("--to", "path", "--start", "1,1,90", "--goal", "2,2"), "--start must be X,Y in metres"),
        (("--to", "path", "--path", "none.csv"), "none.csv: there is no such file"),
        (("--to", "path", "--path", "none.csv", "-o", "p.txt"), "none.csv: there is no such file"),
        (("--to", "nav2-routes"), "needs paths"),
        (("--to", "path", *ENDS, "-o", "no/such/x.csv"), "does not exist"),
        (("--to", "nav2-speed", "-o", "room.yaml"), "room.yaml"),
    ],
)
def test_export_refuses_before_computation(run, room, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("locplan.field.store.load_or_compute", None)  # would end in a traceback
    assert message in check_refusal(run("export", room, *arguments))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["room.pgm", "room.yaml"]


def test_info_refuses_folder_of_two_maps(run, room, tmp_path):
    assert run("info", tmp_path)[0] == 0
    save_map(load_map(room), tmp_path / "other.yaml")
    assert "holds 2 maps; name one" in check_refusal(run("info", tmp_path))


def test_help_of_all_commands_fits_terminal(run):
    """Texts have line ends and indents in the source that would be odd on a terminal."""
    _, out, _ = run("--help")
    for command in COMMANDS:
        assert re.search(rf"^│ {command} +[A-Z]", out, re.MULTILINE), command
        code, own, _ = run(command, "--help")
        assert code == 0
        for panel in own.split("╭")[1:]:
            lines = [line.strip("│").rstrip() for line in panel.splitlines() if line[:1] == "│"]
            indents = {len(line) - len(line.lstrip()) for line in lines}
            assert len({indent for indent in indents if indent > 8}) <= 1, (command, lines)
        examples = own.split("Examples\n")[-1]
        assert all(len(line) <= 100 for line in examples.splitlines()), command
        assert f"Examples\n  locplan {command}" in own
        assert "─ Output ─" in own
    _, out, _ = run("plan", "-h")
    titles = "Arguments", "Options", "Robot", "Computation", "Output"
    places = [out.index(f"─ {title} ─") for title in titles]
    assert places == sorted(places)


def test_errors_hint_at_common_mistakes(run, room):
    way = "--start", "1,1", "--goal"
    assert "unexpected argument: 2; write positions as X,Y with a comma" in check_refusal(
        run("info", room, "2")
    )
    assert "--goal must be X,Y in metres, such as 2.0,3.5" in check_refusal(
        run("plan", room, *way, "1", "2")
    )
    assert "unexpected argument: map (see --help" in check_refusal(run("info", room, "map"))
    lidar = "--lidar", "rplidar-a1", "--set", "range=1200"
    assert "the data sheet of rplidar-a1 says 12 m, not 1200" in check_refusal(
        run("plan", room, *way, "2,2", *lidar)
    )


def test_new_command_needs_module_and_line(run, monkeypatch):
    source = """
from locplan.app.cli.application import command
@command("hello you")
def hello(name: str) -> int:
    "Greet somebody."
    print("hello", name)
    return 3
"""
    module = types.ModuleType("locplan.app.cli.hello")
    exec(source, module.__dict__)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr("locplan.app.cli.application.COMMANDS", COMMANDS | {"hello": "Start"})
    assert run("hello", "world") == (3, "hello world\n", "")
    assert "Greet somebody." in run("--help")[1]


def test_helps_import_no_heavy_library():
    code = (
        "import sys\n"
        "from locplan.app.cli import main\n"
        "from locplan.app.cli.application import COMMANDS\n"
        "for words in ['--version'], ['--help'], *([name, '--help'] for name in COMMANDS):\n"
        "    sys.argv = ['locplan', *words]\n"
        "    try: main()\n"
        "    except SystemExit: pass\n"
        "heavy = {'numba', 'matplotlib', 'cv2', 'ompl', 'scipy'}\n"
        "print('heavy:', sorted(heavy & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.endswith("heavy: []\n"), result.stderr


def test_cli_imports_only_running_command():
    code = (
        "import sys; sys.argv = ['locplan', '-v', 'cache', 'path']\n"
        "from locplan.app.cli import main\n"
        "try: main()\n"
        "except SystemExit: print([n for n in ('plan', 'export', 'compare')"
        " if 'locplan.app.cli.' + n in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.endswith("[]\n"), result.stderr


def test_package_runs_as_module():
    command = [sys.executable, "-m", "locplan", "--version"]
    assert subprocess.run(command, capture_output=True, text=True).stdout == (
        f"locplan {locplan.__version__}\n"
    )


@pytest.mark.parametrize("shell", sample_cases(["bash", "zsh", "fish"]))
def test_install_completion_writes_script(run, tmp_path, monkeypatch, shell):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    code, out, _ = run("--install-completion", "-o", "plan", "--shell", shell)
    assert code == 0
    assert str(tmp_path / "plan") in out
    script = (tmp_path / "plan").read_text()
    for word in (*COMMANDS, "robot", "nav2-planner", "smac-hybrid"):
        assert word in script
    assert "csh" in check_refusal(run("--install-completion", "--shell", "csh"))


@pytest.mark.parametrize("start", [("--start", "-2,3"), ("--start=-2,3",)])
def test_option_values_may_be_negative(run, room, start):
    assert "lies outside the map" in check_refusal(run("plan", room, *start, "--goal", "4,3.5"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("field",), "MAP is missing"),
        (("plan", "MAP", "--strat", "1,1", "--goal", "2,2"), "Did you mean --start"),
        (("cache", "path", "now"), "unexpected argument: now"),
        (("fly",), 'Unknown command "fly"'),
        (
            ("plan", "MAP", *ENDS, "--minimise", "time"),
            "--minimise must be one of rmse, lost, goal-error",
        ),
    ],
)
def test_usage_errors_refer_to_help(run, words, message):
    err = check_refusal(run(*words))
    assert message in err
    assert err.endswith(" (see --help)\n")


def test_choices_of_options_match_library(run, room):
    from locplan.export.masks import compute_keepout_mask
    from locplan.export.registry import list_formats
    from locplan.field import ESTIMATORS
    from locplan.field.covariance import SCALARS

    options = get_type_hints(list_formats()["nav2-keepout"].options)
    names, _ = get_args(options["planner"])
    with pytest.raises(LocplanError, match=f"planner must be one of {', '.join(get_args(names))},"):
        compute_keepout_mask(locplan.Costmap.blank(load_map(room)), planner="other")
    help = run("field", "--help")[1]
    assert all(name in help for name in (*SCALARS, *(layer.name for layer in Scan.layers)))
    assert all(name in help for name in ESTIMATORS)


def test_plan_applies_weight_and_radius_options(run, room, tmp_path):
    ends = "--start", "1,2", "--goal", "4,3.5"
    run("plan", room, *ends, "--weight", "9", "-o", tmp_path / "out")
    about = json.loads((tmp_path / "out" / "choice.json").read_text())
    assert (about["about"]["weight"], about["about"]["robot_radius"]) == (9.0, 0.25)
    for plan in about["candidates"]:
        metrics = plan["metrics"]
        expected = metrics["length"] + 9 * metrics["integrated_u"]
        assert metrics["cost"] == pytest.approx(expected, rel=1e-6)
        assert plan["planner"] == "any-angle"
    wide = "--start", "0.77,2", "--goal", "4,3.5"
    assert run("plan", room, *wide)[0] == 0
    assert "robot's radius" in check_refusal(run("plan", room, *wide, "--set", "footprint=0.25"))


@pytest.mark.parametrize("command", ["compare", "plan", "simulate"])
def test_failed_command_leaves_no_folder(run, tmp_path, command):
    ends = () if command == "compare" else ("--start", "1,1", "--goal", "2,2")
    check_refusal(run(command, tmp_path / "none.yaml", *ends, "-o", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "command",
    [
        "field room.yaml -o room.png",
        "field . --picture e -o .",
        "field room.yaml -o link/room.png",
        "info room.yaml -o room.png",
        "export room.yaml --to path --path p.csv -o p.csv",
        "plan choice.yaml --start 1,2 --goal 4,3 --field c.json -o .",
        "recording c.npz room.yaml -o c.npz",
        "plan choice.yaml --start 1,2 --goal 4,3 -o .",
    ],
)
def test_commands_never_overwrite_inputs(run, room, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    room.with_suffix(".pgm").unlink()
    grid = ascii_map("##########", *["#........#"] * 6, "##########", resolution=0.5)
    for name in ("room", "choice"):
        save_map(grid, f"{name}.yaml", image_format="png")
    (tmp_path / "link").symlink_to(tmp_path)
    (tmp_path / "p.csv").write_text("x,y\n1,2\n4,3\n")
    save_config(FieldConfig(), tmp_path / "c.json")
    before = {file: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}
    code, out, err = run(*command.split())
    assert code == 2
    assert "another input; choose another name" in out + err
    assert {file: file.read_bytes() for file in before} == before


def test_python_may_overwrite_loaded_map(room, run):
    """Only a running command protects its inputs."""
    assert run("field", room)[0] == 0
    grid = load_map(room)
    with replace_file(room) as file:
        file.write_text("new")
    save_map(grid, room)
    assert load_map(room) == grid


@pytest.mark.parametrize("text", ["1.5", "x", "1e999", "nan"])
def test_count_options_require_whole_numbers(run, room, text):
    ends = "--start", "1,2", "--goal", "4,3.5", "--lidar", "turtlebot4"
    for command in ("plan", "simulate"):
        code, _, err = run(command, room, *ends, "--drives", text)
        assert (code, err.splitlines()[-1]) == (
            2,
            f"locplan: error: --drives must be a whole number, not '{text}'",
        )
    assert run("plan", room, "--start", "1,2", "--goal", "4,3.5", "--seed", "2.0")[0] == 0


def test_plan_warns_about_mask_as_map(run, room):
    mask = room.with_name("keepout_mask.yaml")
    save_map(load_map(room), mask)
    said = "this seems to be a mask for a costmap filter"
    for file, count in ((mask, 1), (room, 0)):
        code, _, err = run("plan", file, "--start", "1,2", "--goal", "4,3.5")
        assert (code, err.count(said)) == (0, count)


def test_simulate_reports_assumed_lidar(run, room):
    ends = "--start", "1,2", "--goal", "4,3.5", "--drives", "2"
    for more, count in (((), 1), (("--lidar", "turtlebot4"), 0)):
        code, _, err = run("simulate", room, *ends, *more)
        assert (code, err.count("robot: assumed lidar ")) == (0, count)


@pytest.mark.parametrize(
    ("command", "more", "message"),
    [
        ("simulate", ("--start", "2,nan", "--goal", "4,3.5"), "--start must be X,Y in metres"),
        (
            "simulate",
            ("--start", "1,2", "--goal", "1,2"),
            "--start and --goal are the same",
        ),
        ("simulate", ("--path", "p.csv", "--min-distance", "2"), "--min-distance has no effect"),
    ],
)
def test_errors_name_options_as_typed(run, room, command, more, message):
    assert message in check_refusal(run(command, room, *more))


def test_path_error_names_nonfinite_line(run, room, tmp_path):
    (tmp_path / "mine.csv").write_text("x,y\n1,2\n\n1,nan\n")
    found = check_refusal(run("simulate", room, "--path", tmp_path / "mine.csv"))
    assert "mine.csv: line 4 has x, y that are not all finite" in found


def test_simulate_distinguishes_paths_by_folder(run, room, tmp_path):
    files = [tmp_path / name / "01-shortest.csv" for name in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text("x,y\n1,2\n4,3\n")
    arguments = "--drives", "2", "--lidar", "turtlebot4", "--json"
    given = [text for file in files for text in ("--path", file)]
    code, out, _ = run("simulate", room, *given, *arguments)
    assert code == 0
    assert "a/01-shortest" in out
    assert "b/01-shortest" in out
    twice = check_refusal(run("simulate", room, *given, "--path", files[0], *arguments))
    assert "two --path files have the name a/01-shortest; rename one" in twice


def test_field_option_takes_computed_field(run, room, tmp_path, monkeypatch):
    """A field in a file is not computed again, and is refused on another map."""
    config = FieldConfig(locplan.Sad(range=1.0), stride=0.5)
    locplan.covariance_field(load_map(room), config).save(tmp_path / "lab.npz")
    monkeypatch.setattr("locplan.load_or_compute", None, raising=False)
    option = "--field", tmp_path / "lab.npz"
    about = json.loads(run("plan", room, "--start", "1,2", "--goal", "4,3.5", *option, "--json")[1])
    assert about["about"]["config"]["estimator"]["range"] == 1.0
    wide = ascii_map("#" * 12, *["#" + "." * 10 + "#"] * 8, "#" * 12, resolution=0.5)
    save_map(wide, tmp_path / "wide.yaml")
    mask = "--to", "ros-map", "-o", tmp_path / "mask"
    error = check_refusal(run("export", tmp_path / "wide.yaml", *mask, *option))
    assert "lab.npz was computed for another map (room); run `locplan field` on wide" in error
    error = check_refusal(run("field", room, *option, "--stride", "0.3"))
    assert "--stride has no effect with a computed field" in error


def test_field_option_rejects_other_lidar(run, room, tmp_path):
    config = FieldConfig(Scan(Lidar(range=3.0, beams=30, model="mine")), stride=1.0)
    locplan.covariance_field(load_map(room), config).save(tmp_path / "lab.npz")
    plan = "plan", room, "--start", "1,2", "--goal", "4,3.5", "--field", tmp_path / "lab.npz"
    assert "lab.npz was computed for another lidar (mine, 3 m" in check_refusal(
        run(*plan, "--lidar", "turtlebot4")
    )
    code, out, err = run(*plan, "--drives", "0", "--json")
    assert code == 0, err
    assert json.loads(out)["robot"]["lidar"]["model"] == "mine"


def test_field_option_takes_settings(run, room, small_field):
    about = json.loads(run("field", room, "--field", small_field, "--stride", "0.5", "--json")[1])
    assert about["config"]["estimator"]["range"] == 1.0
    assert about["config"]["stride"] == 0.5
    lidar = "--lidar", "turtlebot3", "--set", "range=2"
    about = json.loads(run("field", room, "--field", small_field, *lidar, "--json")[1])
    assert about["config"]["estimator"]["range"] == 2.0


def test_info_lists_settings_of_robot(run, tmp_path):
    code, out, _ = run("info", "--settings", "--lidar", "turtlebot4", "--json")
    values = {row["setting"]: row["value"] for row in json.loads(out)}
    assert code == 0
    assert (values["range"], values["alpha1"], values["max_particles"]) == ("12.0", "0.2", "2000")
    locplan.Robot("turtlebot4").with_settings({"alpha1": 0.05}).save(tmp_path / "robot.yaml")
    files = "--robot", tmp_path / "robot.yaml", "--set", "max_particles=900"
    rows = json.loads(run("info", "--settings", *files, "--json")[1])
    changed = {row["setting"]: row["value"] for row in rows}
    assert (changed["alpha1"], changed["max_particles"]) == ("0.05", "900")
    assert "no setting 'alpha9'" in check_refusal(run("info", "--settings", "--set", "alpha9=1"))


def test_info_settings_fit_on_narrow_terminal(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = run("info", "--settings", "--lidar", "turtlebot4", "--set", "footprint=0.3")
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert code == 0
    assert {"footprint [m] 0.3", "range [m] 12.0", "speed [m/s] 0.5"} <= {*lines}
    assert len(lines) < 70
    corners = "footprint=[[0.3,0.2],[0.3,-0.2],[-0.3,-0.2],[-0.3,0.2]]"
    assert '"value": "[[' in run("info", "--settings", "--set", corners, "--json")[1]


def test_info_lists_names_without_map(run):
    code, out, _ = run("info")
    assert code == 0
    for name in ("two_corridors", "turtlebot4", "any-angle", "BITstar", "locplan info --settings"):
        assert name in out
    assert "turtlebot4" in json.loads(run("info", "--json")[1])["lidars"]
    assert "name a map" in check_refusal(run("info", "--lidars"))


def test_info_settings_can_be_set(run):
    words = {"True": "true", "False": "false", "None": "null"}
    rows = json.loads(run("info", "--settings", "--lidar", "turtlebot4", "--json")[1])
    pairs = [(each["setting"], words.get(each["value"], each["value"])) for each in rows]
    options = [f"--set={name}={value}" for name, value in pairs if value != "-"]  # without a value
    code, out, err = run("info", "--settings", "--lidar", "turtlebot4", *options, "--json")
    assert code == 0, err
    assert json.loads(out) == rows


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_one_line_per_option(run, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "100")
    _, out, _ = run(command, "--help")
    lines = [line for line in out.splitlines() if line.startswith("│")]
    wrapped = [
        line for line in lines if not re.match(r"│ (?:[* ]  )?(--?\w|[A-Z]{3,}|[a-z]+ )", line)
    ]
    assert [line for line in wrapped if "[required]" not in line] == []  # that of export --to
    assert ";" not in out
    assert len(out.splitlines()) <= 60


@pytest.mark.parametrize(
    ("command", "words"), [("plan", "ueJ"), ("compare", "ueJ"), ("field", "ue")]
)
def test_help_explains_words(run, monkeypatch, command, words):
    monkeypatch.setenv("COLUMNS", "100")
    _, out, _ = run(command, "--help")
    lines = out.partition("Words\n")[2].splitlines()
    assert "".join(line.split()[0] for line in lines[: len(words)]) == words


def test_commands_and_options_are_few(run):
    from locplan.app.cli.application import OPTIONS, make_application

    counts = {}
    for command in set(COMMANDS) - {"cache"}:
        arguments = make_application(command)[command].assemble_argument_collection()
        counts[command] = sum(
            OPTIONS in each.parameter.group or not each.parameter.group
            for each in arguments
            if each.names[0].startswith("--") and "." not in each.names[0]
        )
    assert len(COMMANDS) == 14
    assert max(counts.values()) <= 14, counts
    assert sum(counts.values()) <= 110
