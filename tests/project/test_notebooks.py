"""The notebooks run, and are stored with their outputs: small, and the same on every machine."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]
FOLDER = PROJECT / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
MAX_BYTES = 400_000
METADATA = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
LOCAL_FOLDER = re.compile(r"/home/|/root|/tmp|/work|/Users|[A-Z]:\\\\|site-packages|\.venv")


PARTS = (("stdout", "a"), ("stdout", "b"), ("stderr", "c"))


def read(file: Path) -> dict:
    return json.loads(file.read_text("utf-8"))


def code_cells(file: Path) -> list[dict]:
    return [cell for cell in read(file)["cells"] if cell["cell_type"] == "code"]


def read_texts(file: Path) -> str:
    """Return all texts of a notebook, without its pictures."""
    cells = read(file)["cells"]
    for cell in cells:
        for output in cell.get("outputs", []):
            output.get("data", {}).pop("image/png", None)
    return json.dumps(cells)


def test_there_are_two_notebooks():
    assert [file.name[0] for file in NOTEBOOKS] == ["1", "2"]


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_is_stored_executed_and_small(file):
    assert file.stat().st_size < MAX_BYTES
    assert read(file)["metadata"] == METADATA
    cells = code_cells(file)
    assert 8 <= len(read(file)["cells"]) <= 16
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert all(cell["metadata"] == {} for cell in cells)  # no times
    for output in (output for cell in cells for output in cell["outputs"]):
        printed = output["output_type"] == "stream" and output["name"] == "stdout"
        assert printed or output["output_type"] == "execute_result", output  # no warning, no error
    assert any("image/png" in o.get("data", {}) for cell in cells for o in cell["outputs"])


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_names_no_local_folder(file):
    assert not LOCAL_FOLDER.search(read_texts(file))


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_links_and_index_entries_exist(file):
    for link in re.findall(r"\]\(([^)\s]+)\)", read_texts(file)):
        assert (FOLDER / link).is_file(), link
    for index in (PROJECT / "examples" / "README.md", FOLDER.parent / "guides" / "README.md"):
        assert f"notebooks/{file.name})" in index.read_text("utf-8")


@pytest.fixture
def execute(monkeypatch):
    """The program that executes notebooks; their kernels import this project."""
    pytest.importorskip("nbclient", reason="nbclient is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    monkeypatch.setenv("PYTHONPATH", str(PROJECT), prepend=os.pathsep)
    spec = importlib.util.spec_from_file_location("execute", FOLDER / "execute.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "execute", module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_run_repeats_output_kinds(file, execute):
    cells = [cell for cell in execute.executed(file).cells if cell.cell_type == "code"]
    for stored, new in zip(code_cells(file), cells, strict=True):
        kinds = [output.output_type for output in new.outputs]
        assert kinds == [output["output_type"] for output in stored["outputs"]]


@pytest.mark.long
def test_notebook_runs_in_project_folder(execute, tmp_path):
    from nbformat.v4 import new_code_cell

    notebook = execute.nbformat.read(NOTEBOOKS[0], as_version=4)
    notebook.cells.append(new_code_cell("import os; os.getcwd()"))
    execute.nbformat.write(notebook, tmp_path / "copy.ipynb")
    last = execute.executed(tmp_path / "copy.ipynb", PROJECT).cells[-1]
    assert last.outputs[0].data["text/plain"] == repr(str(PROJECT))


@pytest.mark.long
def test_error_in_notebook_cell_is_raised(execute, tmp_path):
    from nbclient.exceptions import CellExecutionError
    from nbformat.v4 import new_code_cell, new_notebook

    file = tmp_path / "wrong.ipynb"
    execute.nbformat.write(new_notebook(cells=[new_code_cell("1 / 0")]), file)
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        execute.executed(file)


def test_notebook_output_joins_printed_parts(execute):
    from nbformat.v4 import new_output

    parts = [new_output("stream", name=name, text=text) for name, text in PARTS]
    whole = execute.whole(parts)
    assert [(each.name, each.text) for each in whole] == [("stdout", "ab"), ("stderr", "c")]
