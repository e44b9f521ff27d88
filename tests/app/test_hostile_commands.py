"""Every command refuses what it cannot read or write in one line, with exit code 2."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from support.command_line import check_refusal
from support.maps import ascii_map

from locplan import Lidar, save_map
from locplan.app.cli.application import COMMANDS, make_application
from locplan.recordings import Recording

ENDS = "--start", "0.6,0.6", "--goal", "2.0,0.8"
NEEDED = {
    "compare": ("-o", "out"),
    "plan": ENDS,
    "export": ("--to", "ros-map"),
}
"""What a command refuses to run without, but for its map."""
FIRST = {"recording": "drive.npz"}
"""First argument of commands that do not begin with a map."""
WRITING = {
    "info": ("-o", "disk/out.png"),
    "plan": (*ENDS, "-o", "disk/out"),
    "simulate": (*ENDS, "--drives", "2", "--stride", "1", "-o", "disk/out"),
    "export": ("--to", "ros-map", "-o", "disk/out"),
    "field": ("--stride", "1", "-o", "disk/out.npz"),
}
"""A quick line of commands that write a picture, a folder of results or of an export, a field."""


def inputs(command: str) -> list[Any]:
    """The options of a command, without those for where results go."""
    app = make_application(command)[command]
    if not app.default_command:
        return []
    return [
        each
        for each in app.assemble_argument_collection()
        if each.names != ("*",) and not {"-o", "--json"} & {*each.names}
    ]


def takes(argument: Any, kind: type) -> bool:
    """Whether values of an option are of a type, or of several of them."""

    def of(hint: Any) -> bool:
        inner = get_args(hint)
        return hint is kind or any(map(of, inner))

    return of(argument.hint)


@pytest.fixture
def room(tmp_path, monkeypatch) -> str:
    """A map in the folder here, where there is no file `absent`, and a folder `empty`."""
    monkeypatch.chdir(tmp_path)
    save_map(
        ascii_map("#" * 12, *["#" + "." * 10 + "#"] * 8, "#" * 12, resolution=0.25), "room.yaml"
    )
    Path("empty").mkdir()
    Recording(np.ones((3, 4)), Lidar(range=10.0, beams=4), np.zeros((3, 3))).save("drive.npz")
    return "room.yaml"


@pytest.mark.parametrize("command", COMMANDS)
def test_command_refuses_missing_files_and_nan(run, room, command):
    arguments = inputs(command)
    given, first = NEEDED.get(command, ()), FIRST.get(command, room)
    for argument in arguments:
        name = argument.name
        if argument.index is not None:
            words = [(bad, *given) for bad in ("absent", "empty")] if takes(argument, Path) else []
        else:
            bad = ["absent", "empty"] * takes(argument, Path) + ["nan"] * takes(argument, float)
            words = [(first, *given, name, each) for each in bad]
        for line in words:
            check_refusal(run(command, *line))


@pytest.mark.skipif(
    sys.platform != "linux" or os.geteuid() != 0, reason="only root makes a small disk on Linux"
)
@pytest.mark.parametrize("command", WRITING)
def test_command_refuses_full_disk(run, room, command):
    disk = Path("disk")
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", disk], check=True)
    try:
        (disk / "filler").write_bytes(b"x" * 4096)
        code, _, err = run(command, room, *WRITING[command])
    finally:
        subprocess.run(["umount", "-l", disk], check=True)
    assert code == 2
    assert err.count("locplan: error: ") == 1
    assert "No space left" in err or "cannot be written" in err
