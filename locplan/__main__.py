"""The program ``locplan``, also as ``python -m locplan``."""

from __future__ import annotations

import gc
import os
import sys


def main() -> None:
    """Run the command line; where there is fork, in a process that Ctrl-C ends within a second."""
    _open_closed_streams()
    _search_python_path_last()
    try:
        from locplan._support.supervision import run_supervised

        code = run_supervised(run_command_line, finish_and_remove_temporary_folder)
    except KeyboardInterrupt:  # before there was a second process
        print("locplan: interrupted", file=sys.stderr)
        code = 130
    sys.exit(code)


def _open_closed_streams() -> None:
    """Let each standard stream that is closed lead nowhere: else the next file takes its number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)  # the same number, if all is well
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, "w" if number else "r"))


def _search_python_path_last() -> None:
    """Prefer the installed packages to those in the folders of PYTHONPATH.

    A sourced ROS sets PYTHONPATH. If a folder there has dependencies of locplan for another Python,
    such as numpy, they would replace locplan's. The folder with locplan keeps its place, because it
    may have the dependencies.
    """
    locplan_folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    folders = {os.path.abspath(path) for path in paths if path} - {locplan_folder}
    sys.path.sort(key=lambda path: path in folders)  # keeps the order otherwise


def finish_and_remove_temporary_folder(folder: str) -> None:
    """Finish what a killed process has begun in a temporary folder, and remove it."""
    from contextlib import suppress
    from pathlib import Path

    from locplan._support import output

    with suppress(Exception):  # the next process that writes there tries again
        output.finish_moves(Path(folder))


def run_command_line() -> None:
    """Run the command line in this process, and let it end without a last search for garbage."""
    # Imports alone make so many objects that the default, 700, costs half of the start.
    gc.set_threshold(200_000, 20, 50)
    from locplan.app.cli import main

    try:
        main()
    finally:
        # The search takes a third of a second; OMPL's bindings report leaks unless there is one.
        if "ompl" not in sys.modules:
            gc.disable()
            gc.freeze()


if __name__ == "__main__":
    main()
