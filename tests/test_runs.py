"""Folders of results record the command that wrote them."""

import json
import shlex
from types import SimpleNamespace

import pytest
import yaml
from conftest import drawn

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


def test_run_file_records_command_and_settings(run, place):
    command = ("plan", "hall.yaml", *ENDS, "--via", "4,2", "--weight", "6")
    assert run(*command, "--json", "-o", "made/first", "--force")[0] == 0
    about = yaml.safe_load((place / "made/first/run.yaml").read_text())
    assert about["command"] == "plan"
    assert about["settings"]["map"] == "../../hall.yaml"
    assert about["settings"]["weight"] == "6"
    assert not {"json", "output", "force"} & about["settings"].keys()
    assert about["maps"].keys() == {"hall"}
    assert about["locplan"] == locplan.__version__


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


def test_run_file_stands_beside_a_written_field(run, place):
    assert run("field", "hall.yaml", "--stride", "0.5", "-o", "made/field.zarr")[0] == 0
    about = yaml.safe_load((place / "made/field.zarr.run.yaml").read_text())
    assert about["settings"]["map"] == "../hall.yaml"


def test_an_export_without_an_output_has_its_run_beside_it(run, place, monkeypatch):
    monkeypatch.chdir(place)
    assert run("export", "hall.yaml", "--to", "path", *ENDS, "--disc", "3")[0] == 0
    assert (place / "hall-path.csv.run.yaml").exists()
