"""Execute the notebooks of this folder anew, and store them with their outputs.

Run: python examples/notebooks/execute.py [NAME.ipynb ...]
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).resolve().parent
SECONDS = 900
"""Time after which a cell is ended [s]."""


def executed(file: Path, folder: Path = HERE) -> nbformat.NotebookNode:
    """The notebook with new outputs, executed in a folder; an error of a cell is raised.

    It has no times, no version of Python, and nothing else that differs from run to run.
    """
    notebook = nbformat.read(file, as_version=4)
    where = {"metadata": {"path": str(folder)}}
    client = NotebookClient(
        notebook, timeout=SECONDS, kernel_name="python3", record_timing=False, resources=where
    )
    client.execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = whole(cell.outputs)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata = nbformat.from_dict({"kernelspec": kernel})
    return notebook


def whole(outputs: list[nbformat.NotebookNode]) -> list[nbformat.NotebookNode]:
    """The outputs with what was printed in one piece, however it arrived."""
    found: list[nbformat.NotebookNode] = []
    for output in outputs:
        before = found[-1] if found else {}
        if output.output_type == "stream" and before.get("name") == output.name:
            found[-1].text += output.text
        else:
            found.append(output)
    return found


def main(*names: str) -> None:
    for file in [HERE / name for name in names] or sorted(HERE.glob("*.ipynb")):
        nbformat.write(executed(file), file)
        print(f"executed {file.name}, {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(*sys.argv[1:])
