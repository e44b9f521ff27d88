"""The robot on the command line, and its size in parameters of Nav2."""

import json
import math

import numpy as np
import pytest

from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, load_map, save_map
from locplan.planning import Path
from locplan.recordings import Recording, record_drive
from locplan.robots import Footprint, Lidar, Robot

OUTLINE = '"[[0.5, 0.3], [0.5, -.3], [-0.5, -0.3], [-0.5, 0.3]]"'
AMCL = "amcl: {ros__parameters: {alpha1: 0.1}}\n"


def costmap(name: str, **values: object) -> str:
    own = ", ".join(f"{key}: {value}" for key, value in values.items())
    return f"{name}_costmap: {{{name}_costmap: {{ros__parameters: {{{own}}}}}}}\n"


def read(folder, text):
    (folder / "nav2.yaml").write_text(text)
    return Robot.load(folder / "nav2.yaml")


def test_footprint_overrides_radius_as_in_nav2(tmp_path):
    robot = read(tmp_path, costmap("global", robot_radius=0.2, footprint=OUTLINE))
    assert robot.radius == pytest.approx(0.31)  # Nav2 pads it by 1 cm
    assert robot.outline.circumscribed_radius == pytest.approx(math.hypot(0.5, 0.3))
    for none in ('"[]"', '""', "[]"):
        robot = read(tmp_path, costmap("global", robot_radius=0.2, footprint=none))
        assert (robot.radius, robot.outline) == (pytest.approx(0.21), None)


def test_global_costmap_overrides_local_costmap(tmp_path):
    local = costmap("local", footprint=OUTLINE, footprint_padding=0.0)
    both = local + costmap("global", robot_radius=0.4, footprint_padding=0.1)
    assert read(tmp_path, both).radius == pytest.approx(0.5)
    assert read(tmp_path, local + costmap("global", resolution=0.05)).radius == pytest.approx(0.3)
    assert read(tmp_path, AMCL + costmap("local", footprint_padding=0.1)).radius == 0.25


@pytest.mark.parametrize(
    ("own", "fault"),
    [
        ({"robot_radius": -1}, "robot_radius must be a positive"),
        ({"robot_radius": "wide"}, "robot_radius must be a positive"),
        ({"footprint": '"[[0.3, 0.2], [0.3]]"'}, "footprint must be corners"),
        ({"footprint": '"[0.3, 0.2]"'}, "footprint must be corners"),
        ({"footprint": '"[[1 2, 3], [1, -1], [-1, 0]]"'}, "footprint must be corners"),
        ({"footprint": '"[[1, 1], [2, 1], [2, 2]]"'}, "must be a polygon around"),
        ({"footprint": '"[[1, 1], [1, nan], [-1, 0]]"'}, "finite"),
    ],
)
def test_wrong_robot_size_is_refused(tmp_path, own, fault):
    with pytest.raises(ConfigError, match=f"nav2.yaml: global_costmap: .*{fault}"):
        read(tmp_path, costmap("global", **own))


@pytest.fixture
def hall(tmp_path):
    """A map, and the parameters of a robot of 0.5 m."""
    cells = np.full((40, 90), FREE, np.uint8)
    cells[20, 20:70] = OCCUPIED
    save_map(OccupancyGrid(cells, 0.1), tmp_path / "m.yaml")
    (tmp_path / "nav2.yaml").write_text(AMCL + costmap("global", robot_radius=0.5))
    return tmp_path


ENDS = "--start", "0.75,0.75", "--goal", "7.5,0.75"
SAID = "locplan: robot: tim571, 25 m, 270°; radius 0.5 m, margin 0.01 m; AMCL's alpha1 0.1\n"


@pytest.mark.parametrize(
    ("command", "options", "stopped_by"),
    [
        ("plan", (*ENDS, "--front"), "locplan.planning.plans.check_ends"),
        ("plan", ENDS, "locplan.simulation.problem.check_ends"),
        ("simulate", ENDS, "locplan.planning.plans.check_ends"),
        ("simulate", ("--random", "2"), "locplan.planning.queries.random_queries"),
        ("tune", (), "locplan.advice.tuning.tune"),
        ("landmarks", ENDS, "locplan.place_landmarks"),
        ("info", (), "locplan.planning.map_info.describe_map"),
        ("compare", ("-o", "compared"), "locplan.compare"),
        ("explore", ("--no-browser",), "locplan.app.explorer.explorer.open_explorer"),
        ("export", ("--to", "nav2-keepout"), "locplan.export.nav2.compute_keepout_mask"),
        ("export", ("--to", "nav2-speed"), "locplan.export.nav2.compute_speed_mask"),
        (
            "export",
            ("--to", "nav2-routes", *ENDS),
            "locplan.export.recommended_routes.check_routable_paths",
        ),
    ],
)
def test_commands_use_robot_size(run, hall, monkeypatch, command, options, stopped_by):
    radii = []

    def stop(*arguments, **named):
        for each in (*arguments, *named.values()):
            robot = getattr(each, "robot", each)
            radii.append(getattr(robot, "radius", getattr(each, "robot_radius", None)))
        radii.append(named.get("robot_radius"))
        raise ConfigError("stopped")

    monkeypatch.setattr(stopped_by, stop)
    monkeypatch.chdir(hall)
    lidar = ("--set", "range=1") if command == "export" else ("--lidar", "tim571")
    for own, radius in (((), 0.51), (("--set", "footprint=0.3", "--set", "margin=0"), 0.3)):
        radii.clear()
        code, _, err = run(command, "m.yaml", "--robot", "nav2.yaml", *lidar, *options, *own)
        assert "stopped" in err, err
        assert code == 2
        assert {round(each, 9) for each in radii if each is not None} == {radius}
        assert (SAID in err) == (command != "export" and not own)


def test_plan_keeps_footprint_off_walls(run, hall):
    (hall / "nav2.yaml").write_text(costmap("global", footprint=OUTLINE))
    asked = "plan", hall / "m.yaml", *ENDS, "--robot", hall / "nav2.yaml", "--json"
    code, out, err = run(*asked)
    assert code == 0, err
    assert err == "locplan: robot: no lidar named; 4 corners, margin 0.01 m; Nav2's defaults\n"
    about = json.loads(out)
    assert len(about["robot"]["footprint"]) == 4
    outline = Footprint(about["robot"]["footprint"])
    paths = [Path(each["path"]["xy"]) for each in about["candidates"]]
    grid = load_map(hall / "m.yaml")
    assert paths
    assert not any(outline.find_first_collision(grid, path) for path in paths)
    code, out, err = run(*asked, "--budget", "20")  # which keeps no outline
    assert code == 0, err
    assert json.loads(out)["settings"]["budget"] == 20
    assert "for a circular robot of radius" in err


def test_later_files_and_options_win(run, hall):
    def read(*options):
        err = run("field", hall / "m.yaml", "--stride", "1", *options)[2]
        return err.partition("\n")[0]

    own = hall / "own.yaml"
    Robot("turtlebot3", footprint=0.1, margin=0.0).save(own)
    nav2 = hall / "nav2.yaml"
    first = "locplan: robot: turtlebot3, 8 m, 360°; radius 0.5 m, margin 0.01 m; AMCL's alpha1 0.1"
    assert read("--robot", own, "--robot", nav2) == first
    last = "locplan: robot: turtlebot3, 8 m, 360°; radius 0.1 m; Nav2's defaults"
    assert read("--robot", nav2, "--robot", own) == last
    options = "--lidar", "turtlebot4", "--set", "range=2", "--set", "outliers=0.5"
    changed = "locplan: robot: turtlebot4, 2 m, 360°; radius 0.1 m; Nav2's defaults, outliers 0.5"
    assert read("--robot", own, *options) == changed


def test_export_never_overwrites_robot_file(run, hall):
    before = (hall / "nav2.yaml").read_text()
    ends = "--path", hall / "p.csv", "--to", "path"
    (hall / "p.csv").write_text("x,y\n0.75,0.75\n7.5,0.75\n")
    given = "--robot", hall / "nav2.yaml", "-o", hall / "nav2.yaml", "--force", "--stride", "1"
    code, _, err = run("export", hall / "m.yaml", *ends, *given)
    assert code == 2
    assert "another input; choose another name" in err
    assert (hall / "nav2.yaml").read_text() == before


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--set", "range=8"), "--set range has no effect with --recording"),
        (("--set", "outliers=0.1"), "--set outliers has no effect with --recording"),
        (("--set", "turn_bias=0"), "--set turn_bias has no effect with --recording"),
        (("--lidar", "tim571"), "--lidar has no effect with --recording, which sets the lidar"),
    ],
)
def test_recording_refuses_lidar_and_noise_options(run, hall, given, said):
    poses = np.linspace((1.0, 1.0, 0.0), (2.0, 1.0, 0.0), 5)
    lidar = Lidar(range=10.0, beams=8)
    Recording(np.full((5, 8), 1.0), lidar, poses).save(hall / "d.npz")
    drive = "--recording", hall / "d.npz"
    for command in ("simulate", "tune"):
        code, _, err = run(command, hall / "m.yaml", *drive, *given)
        assert code == 2
        assert said in err


def test_replay_uses_lidar_of_recording(run, hall):
    robot = Robot(Lidar(range=10.0, beams=30, model="own"))
    path = Path([(1.0, 0.75), (7.0, 0.75)])
    record_drive(load_map(hall / "m.yaml"), path, robot).save(hall / "d.npz")
    Robot("tim571").save(hall / "robot.yaml")
    given = "--recording", hall / "d.npz", "--robot", hall / "robot.yaml", "--drives", "2"
    _, _, err = run("simulate", hall / "m.yaml", *given)
    assert err.count("robot: own, 10 m") == 1
