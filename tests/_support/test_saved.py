"""What users come back to: a file gives back what was saved, and says what is wrong with it."""

import json
import math
import zipfile
from functools import cache
from io import BytesIO

import numpy as np
import pytest
import yaml
from support.maps import ascii_map

import locplan
from locplan import (
    Costmap,
    CovarianceField,
    FieldConfig,
    Lidar,
    OccupancyGrid,
    Path,
    Plan,
    Robot,
    Sad,
)
from locplan.errors import LocplanError
from locplan.field import SearchWindow
from locplan.planning import ParetoFront
from locplan.recordings import Recording, read_recording
from locplan.recordings.files import save_recording

DRAWN = ascii_map(
    "##########", "#...#....#", "#........#", "#....#...#", "##########", resolution=0.5
)
ROOM = OccupancyGrid(DRAWN.cells, 0.5, (1e-3, -2 / 3, 0.0), name="a room")
ENDS = (0.75, 0.1), (4.25, 1.1)
SEEDS = range(6)


@cache
def small_field(estimator=None, **more):
    window = SearchWindow(half_rotation_deg=20)
    return locplan.covariance_field(
        ROOM, FieldConfig(estimator or Sad(range=1.0, window=window), stride=0.5, **more)
    )


def seen_field():
    lidar = Lidar(range=3.0, field_of_view_deg=180.0, beams=31)
    return small_field(locplan.Fisher(lidar), headings=4)


def save_and_load(value, folder):
    """Save a value to a file or a folder, and return the loaded value."""
    suffix = {"Path": ".csv", "Robot": ".yaml", "CovarianceField": ".npz", "Costmap": ".npz"}
    target = folder / f"it{suffix.get(type(value).__name__, '')}"
    value.save(target)
    return type(value).load(target)


@pytest.mark.parametrize("seed", SEEDS)
def test_loaded_path_equals_saved_path(tmp_path, seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 9))
    xy = rng.uniform(-1, 1, (count, 2)) * 10.0 ** rng.integers(-9, 9, (count, 2))
    path = Path(xy, rng.uniform(-1e6, 1e6, count) if seed % 2 else None)
    found = save_and_load(path, tmp_path)
    assert found == path
    assert hash(found) == hash(path)


def test_path_file_must_be_existing_csv(tmp_path):
    with pytest.raises(LocplanError, match=r"must end in \.csv"):
        Path([(0.0, 0.0), (1.0, 0.0)]).save(tmp_path / "path.json")
    with pytest.raises(LocplanError, match="there is no such file"):
        Path.load(tmp_path / "none.csv")


@pytest.mark.parametrize("seed", SEEDS)
def test_loaded_robot_equals_saved_robot(tmp_path, seed):
    rng = np.random.default_rng(seed)
    outline = locplan.Footprint(rng.uniform(0.01, 1, (4, 2)) * [(1, 1), (-1, 1), (-1, -1), (1, -1)])
    lidar = [None, Lidar(range=4.0), Lidar.preset("turtlebot4")][seed % 3]
    robot = Robot(lidar, footprint=outline if seed % 2 else rng.uniform(0, 3))
    robot = robot.with_settings(
        {"alpha1": rng.uniform(0, 1), "boundary_noise": rng.uniform(0, 0.5)}
    )
    assert save_and_load(robot, tmp_path) == robot


@pytest.mark.parametrize("make_field", [small_field, seen_field])
@pytest.mark.parametrize("law", ["logarithmic", "linear", "cube-root"])
def test_loaded_costmap_equals_saved_costmap(tmp_path, make_field, law):
    field = make_field()
    rng = np.random.default_rng(len(law))
    options = {"weight": rng.uniform(0, 1e9), "robot": rng.uniform(0, 0.6), "law": law}
    costs = Costmap.from_field(field, **options)
    found = save_and_load(costs, tmp_path)
    assert found == costs
    assert hash(found) == hash(costs)
    assert found.grid.name == ROOM.name
    assert not found.u.flags.writeable
    if make_field is seen_field:
        np.testing.assert_array_equal(found.density_of_heading, costs.density_of_heading)
    assert found != costs.with_weight(costs.weight + 1)


@pytest.mark.parametrize("seed", SEEDS)
def test_loaded_custom_costmap_equals_saved_costmap(tmp_path, seed):
    rng = np.random.default_rng(seed)
    density = rng.uniform(1, 10.0 ** rng.integers(1, 9), ROOM.shape)
    density[1, 1] = math.inf
    costs = Costmap.from_density(ROOM, density, robot=rng.uniform(0, 0.6))
    assert save_and_load(costs, tmp_path) == costs


@pytest.mark.parametrize("more", [{}, {"via": [(2.75, 0.6)]}, {"max_e": 1e-9}, {"budget": 9.0}])
def test_loaded_plan_equals_saved_plan(tmp_path, more):
    for costs in (Costmap.from_field(small_field(), robot=0.1), Costmap.blank(ROOM)):
        if costs.settings is None and more:
            continue
        plan = locplan.plan(costs, *ENDS, planner="grid" if "budget" in more else None, **more)
        found = save_and_load(plan, tmp_path)
        assert found == plan
        assert found.costs is None
        assert found.path == plan.path
        if plan.path:
            assert (tmp_path / "it/path.csv").exists()
            assert found.with_costs(costs).metrics == plan.metrics


@pytest.mark.parametrize("objective", ["u", "e"])
def test_loaded_front_equals_saved_front(tmp_path, objective):
    costs = Costmap.from_field(small_field(), robot=0.1)
    front = locplan.pareto_front(costs, *ENDS, objective=objective)
    found = save_and_load(front, tmp_path)
    assert found == front
    assert found.plan(0) == front.plan(0)
    assert found.knee == front.knee
    assert found.figure()


def test_loaded_empty_front_equals_saved_front(tmp_path):
    walls = ascii_map("###########", "#...###...#", "###########", resolution=0.5)
    field = locplan.covariance_field(walls, small_field().config)
    front = locplan.pareto_front(Costmap.from_field(field, robot=0.0), (0.75, 0.75), (4.25, 0.75))
    assert front.status == "unreachable"
    assert save_and_load(front, tmp_path) == front


@pytest.mark.parametrize("make_field", [small_field, seen_field])
def test_loaded_field_equals_saved_field(tmp_path, make_field):
    field = make_field()
    found = save_and_load(field, tmp_path)
    assert found == field
    assert found != CovarianceField(2 * field.covariance, field.grid, field.config, field.layers)


def saved(folder):
    """A file of each kind, and the function that reads it."""
    costs = Costmap.from_field(small_field(), robot=0.1)
    Robot("turtlebot4").save(folder / "robot.yaml")
    costs.save(folder / "costs.npz")
    locplan.plan(costs, *ENDS).save(folder / "plan")
    locplan.pareto_front(costs, *ENDS).save(folder / "front")
    return {
        "robot.yaml": Robot.load,
        "costs.npz": Costmap.load,
        "plan/plan.json": Plan.load,
        "front/front.npz": ParetoFront.load,
    }


def saved_inputs(folder):
    """A file of each kind that has its own reader, and this reader."""
    small_field().save(folder / "field.npz")
    locplan.save_config(small_field().config, folder / "settings.json")
    ranges, poses = np.ones((2, 360), np.float32), np.zeros((2, 3))
    save_recording(Recording(ranges, Lidar(), poses), folder / "drive.npz")
    return {
        "field.npz": CovarianceField.load,
        "settings.json": locplan.load_config,
        "drive.npz": read_recording,
    }


def changed(file, **entries):
    """Change entries of what a file says about itself."""
    if file.suffix == ".npz":
        with zipfile.ZipFile(file) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        with zipfile.ZipFile(file, "w") as archive:
            for name, data in members.items():
                if name == "about.npy":
                    about = json.loads(str(np.load(BytesIO(data))))
                    with BytesIO() as new:
                        np.save(new, np.array(json.dumps(about | entries)))
                        data = new.getvalue()
                archive.writestr(name, data)
    elif file.suffix == ".yaml":
        file.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | entries))
    else:
        file.write_text(json.dumps(json.loads(file.read_text()) | entries))


def test_load_refuses_newer_or_foreign_file(tmp_path):
    for name, load in (saved(tmp_path) | saved_inputs(tmp_path)).items():
        file = tmp_path / name
        assert load(file)
        changed(file, version=99)
        with pytest.raises(LocplanError, match=r"newer locplan \(version 99 of .* update locplan"):
            load(file)
        changed(file, version=1, kind="teapot")
        with pytest.raises(LocplanError, match="holds a teapot, not a"):
            load(file)
        changed(file, kind=["\n"])
        with pytest.raises(LocplanError, match="is damaged, or no"):
            load(file)


def test_load_refuses_damaged_file(tmp_path):
    for name, load in saved(tmp_path).items():
        file, whole = tmp_path / name, (tmp_path / name).read_bytes()
        if file.suffix != ".yaml":
            for part in (whole[: len(whole) // 2], b"", b"PK\x03\x04", b"[1]", b"\xff"):
                file.write_bytes(part)
                with pytest.raises(LocplanError, match="is damaged, or no") as error:
                    load(file)
                assert "\n" not in str(error.value)
            file.write_bytes(whole)
            changed(file, start=["north"], weight="heavy")
            with pytest.raises(LocplanError, match=r"is damaged .*\. Save it again"):
                load(file)
        file.unlink()
        with pytest.raises(LocplanError, match=r"cannot be read|[Nn]o such"):
            load(file)


def test_path_error_names_renamed_columns(tmp_path):
    """locplan 0.1 wrote x_m, y_m and heading_rad."""
    (tmp_path / "old.csv").write_text("x_m,y_m,heading_rad\n1,2,0\n")
    with pytest.raises(LocplanError, match="name them x, y, and heading_rad heading"):
        Path.load(tmp_path / "old.csv")


def test_save_refuses_costmap_of_unregistered_estimator(tmp_path):
    class Mine(Sad):
        name = "nobody's"

    estimator = Mine(range=1.0, window=small_field().config.estimator.window)
    field = locplan.covariance_field(ROOM, FieldConfig(estimator, stride=0.5))
    with pytest.raises(LocplanError, match="could not be read back"):
        Costmap.from_field(field).save(tmp_path / "mine.npz")
    assert not (tmp_path / "mine.npz").exists()


def test_paths_are_compared_by_value():
    one, other = Path([[0.0, 1.0]]), Path([[-0.0, 1.0]])
    assert one == other
    assert hash(one) == hash(other)
    assert one != Path([[0.0, 1.0]], [0.0])
    assert one != "a path"
