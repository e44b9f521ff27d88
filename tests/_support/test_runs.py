"""Folders of results record the command that wrote them."""

import pytest
import yaml
from support.maps import ascii_map

import locplan
from locplan import save_map
from locplan._support.runs import RunRecord
from locplan.errors import LocplanError

ENDS = "--start=1,2.5", "--goal=8,1"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a map, which is the current one."""
    grid = ascii_map(*["#" * 20, *["#" + "." * 18 + "#"] * 6, "#" * 20], resolution=0.5)
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
    files = {each.name for each in (place / "made/first").iterdir()}
    assert about["outputs"].keys() == files - {"run.yaml"}


def test_python_run_file_has_no_command(place):
    from locplan import Costmap, load_map, plan

    plan(Costmap.blank(load_map("hall.yaml")), (1, 2.5), (8, 1)).save("planned")
    about = yaml.safe_load((place / "planned/run.yaml").read_text())
    assert about["outputs"].keys() == {"plan.json", "plan.png", "path.csv"}
    assert "command" not in about
    with pytest.raises(LocplanError, match=r"run\.yaml: was written in Python"):
        RunRecord.read(place / "planned")


def test_run_file_lies_next_to_field(run, place):
    assert run("field", "hall.yaml", "--stride", "0.5", "-o", "made/field.npz")[0] == 0
    about = yaml.safe_load((place / "made/field.npz.run.yaml").read_text())
    assert about["settings"]["map"] == "../hall.yaml"


def test_export_without_output_writes_run_file(run, place, monkeypatch):
    monkeypatch.chdir(place)
    assert run("export", "hall.yaml", "--to", "path", *ENDS, "--stride", "0.5")[0] == 0
    assert (place / "hall-path.csv.run.yaml").exists()
