"""Folders of results say how they were made, and `locplan run` makes them again."""

import json
import shlex
from types import SimpleNamespace

import pytest
import yaml
from conftest import drawn, refused

import locplan
from locplan import FieldConfig, Robot, Sad, save_map
from locplan._util.runs import Recipe
from locplan.field import config_spelled
from locplan.robots import robot_spelled

ENDS = "--start=1,2.5", "--goal=8,1"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a map, which is the current one."""
    grid = drawn(*["#" * 20, *["#" + "." * 18 + "#"] * 6, "#" * 20], resolution=0.5)
    save_map(grid, tmp_path / "hall.yaml")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "made").mkdir()
    return tmp_path


def content(folder):
    """The files of a folder whose numbers count, without those that name times or the folder."""
    skipped = {".locplan.json", "run.yaml", "front.npz"}
    files = {file.name: file.read_bytes() for file in folder.iterdir() if file.name not in skipped}
    return {name: data for name, data in files.items() if not name.endswith((".png", ".json"))}


@pytest.mark.parametrize(
    "command",
    [
        ("plan", "hall.yaml", *ENDS, "--via", "4,2", "--weight", "6"),
        ("plan", "hall.yaml", *ENDS, "--front"),
        ("twins", "hall.yaml", "--lidar", "rplidar-a1", "--set", "range=3", "--spacing", "1.5"),
        ("landmarks", "hall.yaml", *ENDS, "--set", "range=3", "--count", "1", "--drives", "0"),
        ("export", "hall.yaml", "--to", "nav2-keepout"),
    ],
)
def test_a_run_is_repeated_to_the_same_files_from_anywhere(run, place, monkeypatch, command):
    assert run(*command, "--json", "-o", "made/first", "--force")[0] == 0
    about = yaml.safe_load((place / "made/first/run.yaml").read_text())
    assert about["command"] == command[0]
    assert about["settings"]["map"] == "../../hall.yaml"
    assert not {"json", "output", "force"} & about["settings"].keys()
    assert about["maps"].keys() == {"hall"}
    monkeypatch.chdir(place / "made")
    code, _, err = run("run", "first", "-o", "../second")
    assert code == 0
    assert "changed" not in err
    first, second = content(place / "made/first"), content(place / "second")
    assert first
    assert first == second
    again = yaml.safe_load((place / "second/run.yaml").read_text())
    assert again["settings"].pop("map") == "../hall.yaml"
    assert about["settings"].pop("map")
    assert again == about


def test_without_another_folder_the_runs_own_results_are_replaced(run, place):
    run("plan", "hall.yaml", *ENDS, "--front", "-o", "front")
    before = (place / "front/front.csv").read_bytes()
    assert run("run", "front/run.yaml")[0] == 0
    assert (place / "front/front.csv").read_bytes() == before
    code, out, _ = run("run", "front", "--json")
    assert code == 0
    assert json.loads(out)["status"] == "solved"


def test_a_map_or_a_robot_that_has_changed_is_said_in_one_line(run, place):
    Robot(footprint=0.2).save("robot.yaml")
    run("plan", "hall.yaml", *ENDS, "--front", "--robot", "robot.yaml", "-o", "front")
    assert "changed" not in run("run", "front")[2]
    Robot(footprint=0.3).save("robot.yaml")
    (line,) = [line for line in run("run", "front", "-o", "b")[2].splitlines() if "changed" in line]
    assert "warning: the robot has changed since the run: it was no lidar named; radius 0.2" in line
    Robot(footprint=0.2).save("robot.yaml")
    grid = drawn(*["#" * 20, *["#" + "." * 18 + "#"] * 5, "#" * 20], resolution=0.5)
    save_map(grid, "hall.yaml")
    (line,) = [line for line in run("run", "front", "-o", "c")[2].splitlines() if "changed" in line]
    assert line == "locplan: warning: the map hall has changed since the run"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "is empty"),
        ("{", "is not YAML"),
        ("- 1", "is damaged, or no run"),
        ("kind: robot\nversion: 1", "holds a robot, not a run"),
        ("kind: run\nversion: 2", "is of a newer locplan"),
        ("kind: run\nversion: 1\ncommand: plan", "is damaged"),
        ("kind: run\nversion: 1\ncommand: plan\nsettings: 3\nfiles: []", "is damaged"),
        ("kind: run\nversion: 1\ncommand: fly\nsettings: {}\nfiles: []", "fly"),
        (
            "kind: run\nversion: 1\ncommand: run\nsettings: {}\nfiles: []",
            "not one that is repeated",
        ),
        ("a: &a [*a]", "is"),
        ("!!python/object/apply:os.system [echo]", "is damaged"),
    ],
)
def test_a_file_that_is_no_run_is_refused(run, place, text, fault):
    (place / "run.yaml").write_text(text)
    assert fault in refused(run("run", "run.yaml"))
    assert "no such file" in refused(run("run", "elsewhere"))


def test_what_is_written_in_python_is_of_no_run(place):
    from locplan import Costmap, load_map, plan

    plan(Costmap.blank(load_map("hall.yaml")), (1, 2.5), (8, 1)).save("planned")
    assert not (place / "planned/run.yaml").exists()


def test_a_recipe_gives_the_same_path_in_a_shell_and_in_python(run, place):
    robot = Robot(footprint=0.3).changed({"margin": 0.1})
    config = FieldConfig(Sad(range=3.0), stride=0.5)
    recipe = Recipe(
        "plan",
        "pareto_front",
        "hall.yaml",
        {
            "start": (1.0, 2.5),
            "goal": (8.1, 1 / 3 + 0.7),
            "robot": robot_spelled(robot),
            "config": config_spelled(config, None),
            "front": True,
            "time_limit": 20,
        },
        ("the first note",),
    )
    note, line = recipe.shell.splitlines()
    assert note == recipe.python.splitlines()[0] == "# the first note"
    code, out, _ = run(*shlex.split(line)[1:], "--json")
    assert code == 0
    assert json.loads(out)["goal"] == [8.1, 1 / 3 + 0.7]
    assert json.loads(out)["robot_radius"] == pytest.approx(0.4)
    seen = {}

    def pareto_front(grid, start, goal, robot, **more):
        seen.update(more, ends=(start, goal), robot=robot, shape=grid.shape)

    made = SimpleNamespace(**{name: getattr(locplan, name) for name in locplan.__all__})
    made.pareto_front = pareto_front
    exec(recipe.python.replace("import locplan\n", ""), {"locplan": made})
    ends = (1.0, 2.5), (8.1, 1 / 3 + 0.7)
    assert seen == {
        "ends": ends,
        "robot": robot,
        "config": config,
        "front": True,
        "time_limit": 20,
        "shape": (8, 20),
    }


def test_a_recipe_says_lists_switches_and_hard_names():
    settings = {"via": [(1.0, 2.0), (3, 4.5)], "no_verdict": True, "weight": None, "to": "it's"}
    recipe = Recipe("plan", "plan", "-dash $x.yaml", settings)
    expected = "plan './-dash $x.yaml' --via 1,2 --via 3,4.5 --no-verdict --to 'it'\"'\"'s'"
    assert recipe.shell == f"locplan {expected}"
    assert "via=[(1, 2), (3, 4.5)], no_verdict=True, weight=None" in recipe.python


@pytest.mark.parametrize(
    ("command", "file"),
    [
        (("export", "hall.yaml", "--to", "path", *ENDS), "values.csv"),
        (("field", "hall.yaml", "--stride", "0.5"), "field.zarr"),
    ],
)
def test_a_run_beside_a_file_is_repeated_in_its_place_or_another(run, place, command, file):
    assert run(*command, "--disc", "3", "-o", f"made/{file}")[0] == 0
    beside = place / f"made/{file}.run.yaml"
    about = yaml.safe_load(beside.read_text())
    assert about["settings"]["map"] == "../hall.yaml"
    assert run("run", beside, "-o", f"again-{file}")[0] == 0
    assert yaml.safe_load((place / f"again-{file}.run.yaml").read_text())["command"] == command[0]
    assert f"wrote {place / 'made' / file}" in run("run", beside, "--force")[2]
    assert yaml.safe_load(beside.read_text()) == about


def test_an_export_without_an_output_has_its_run_beside_it(run, place, monkeypatch):
    monkeypatch.chdir(place)
    assert run("export", "hall.yaml", "--to", "path", *ENDS, "--disc", "3")[0] == 0
    assert (place / "hall-path.csv.run.yaml").exists()
