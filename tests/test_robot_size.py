"""The size of a robot in its parameters of Nav2."""

import json
import math

import numpy as np
import pytest

from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, save_map
from locplan.robots import read_robot_size

OUTLINE = '"[[0.5, 0.3], [0.5, -.3], [-0.5, -0.3], [-0.5, 0.3]]"'
AMCL = "amcl: {ros__parameters: {alpha1: 0.1}}\n"


def costmap(name: str, **values: object) -> str:
    own = ", ".join(f"{key}: {value}" for key, value in values.items())
    return f"{name}_costmap: {{{name}_costmap: {{ros__parameters: {{{own}}}}}}}\n"


def read(folder, text):
    (folder / "nav2.yaml").write_text(text)
    return read_robot_size(folder / "nav2.yaml")


def test_the_footprint_counts_before_the_radius_as_in_nav2(tmp_path):
    size = read(tmp_path, costmap("global", robot_radius=0.2, footprint=OUTLINE))
    assert size.radius == pytest.approx(0.3)
    assert size.footprint.circumscribed_radius == pytest.approx(math.hypot(0.5, 0.3))
    for none in ('"[]"', '""', "[]"):
        size = read(tmp_path, costmap("global", robot_radius=0.2, footprint=none))
        assert (size.radius, size.footprint) == (0.2, None)
        assert size.source == f"robot_radius 0.2 m of global_costmap in {tmp_path}/nav2.yaml"


def test_the_global_costmap_counts_before_the_local_one(tmp_path):
    local = costmap("local", footprint=OUTLINE)
    assert read(tmp_path, local + costmap("global", robot_radius=0.4)).radius == 0.4
    assert read(tmp_path, local + costmap("global", resolution=0.05)).radius == pytest.approx(0.3)
    assert read(tmp_path, AMCL + costmap("local", footprint_padding=0.1)) is None


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
def test_what_is_no_size_is_refused(tmp_path, own, fault):
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
SAID = "read robot_radius 0.5 m of global_costmap in"


@pytest.mark.parametrize(
    ("command", "options", "stopped_by"),
    [
        ("plan", ENDS, "locplan.planners.check_ends"),
        ("choose", ENDS, "locplan.simulation.choice._choose.check_way"),
        ("simulate", ENDS, "locplan.planners.check_ends"),
        ("simulate", ("--random", "2"), "locplan.planners.random_queries"),
        ("tune", (), "locplan.simulation.tuning._tune.tune"),
        ("evaluate", (), "locplan.simulation._evaluation.evaluate"),
        ("calibrate", (), "locplan.simulation._places.places_of"),
        ("landmarks", ENDS, "locplan.landmarks.place_landmarks"),
        ("features", ENDS, "locplan.landmarks.key_features"),
        ("explore", ("--no-browser",), "locplan.explorer._explore.opened"),
        ("export", ("--to", "nav2-keepout"), "locplan.export._nav2.keepout_mask"),
        ("export", ("--to", "nav2-speed"), "locplan.export._nav2.speed_mask"),
        ("export", ("--to", "nav2-routes", *ENDS), "locplan.export._recommended.check_ways"),
    ],
)
def test_every_command_takes_the_radius_of_the_parameters(
    run, hall, monkeypatch, command, options, stopped_by
):
    radii = []

    def stop(*arguments, **named):
        radii.append(named.get("robot_radius"))
        for each in (*arguments, *named.values()):
            radii.append(getattr(each, "robot_radius", None))
        raise ConfigError("stopped")

    monkeypatch.setattr(stopped_by, stop)
    given = ("--params", hall / "nav2.yaml", *options)
    monkeypatch.chdir(hall)
    for own, radius in (((), 0.5), (("--robot-radius", "0.3"), 0.3)):
        radii.clear()
        lidar = () if command in ("export",) else ("--lidar", "tim571")
        code, _, err = run(command, hall / "m.yaml", *given, *lidar, *own)
        assert "stopped" in err, err
        assert code == 2
        assert {each for each in radii if each is not None} == {radius}
        assert (SAID in err) == (radius == 0.5)


def test_plan_keeps_the_outline_of_the_parameters(run, hall):
    (hall / "nav2.yaml").write_text(costmap("global", footprint=OUTLINE))
    asked = "plan", hall / "m.yaml", *ENDS, "--params", hall / "nav2.yaml", "--json"
    code, out, err = run(*asked)
    assert code == 0, err
    assert err.startswith("read footprint [[0.5, 0.3], [0.5, -.3],")
    assert "(inscribed radius 0.3 m) of global_costmap in" in err
    about = json.loads(out)
    assert len(about["shortest"]["footprint"]) == 4


def test_parameters_that_are_not_read_are_refused(run, hall):
    (hall / "nav2.yaml").write_text(AMCL)
    code, _, err = run("plan", hall / "m.yaml", *ENDS, "--params", hall / "nav2.yaml")
    assert code == 2
    assert "--params is not read unless the lidar is named" in err
