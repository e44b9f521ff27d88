"""The run that results come from: a command with its settings, in the folder of its results."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePath
from typing import Any

from locplan._support.reading import (
    MAX_JSON_BYTES,
    check_file_stamp,
    dump_yaml,
    make_file_stamp,
    parse_yaml,
    read_content,
)
from locplan.errors import LocplanError

RUN_FILE = "run.yaml"
"""The file in a folder of results that records the command, its settings and the version."""
FILE_RUN_SUFFIX = f".{RUN_FILE}"
"""Ending of the run beside a file."""
KIND, VERSION = "run", 1
REMEDY = "name the run.yaml of a folder of results"
Setting = str | bool | list[str]
"""What was typed for an option: its text, True for a switch, or texts of a repeated one."""
POSITIONAL = "map", "file"
"""Names of arguments that are typed without them."""
_CURRENT: list[RunRecord] = []


@dataclass
class RunRecord:
    """A command with its settings as typed, and its input files."""

    command: str
    """Name of the command."""
    settings: dict[str, Setting]
    """What was typed for each option, by its name; "map" has the maps."""
    files: frozenset[str] = frozenset()
    """Names of the settings that name files."""
    maps: dict[str, str] = field(default_factory=dict)
    """Digest of each map that was read, by its name."""
    robot: dict[str, str] = field(default_factory=dict)
    """Title and digest of the robot; nothing where there is none."""
    written: list[str] = field(default_factory=list)
    """A line for people on each of the most useful files that were written."""

    def to_yaml_content(self, home: Path) -> dict[str, Any]:
        """Return the entries of run.yaml, with files relative to its folder."""
        settings = dict(self.settings)
        for name in self.files & settings.keys():
            settings[name] = _convert_setting(
                settings[name], lambda text: _make_relative(text, home)
            )
        content: dict[str, Any] = {"command": self.command, "settings": settings}
        content |= {name: digests for name in ("maps", "robot") if (digests := getattr(self, name))}
        content["files"] = sorted(self.files & settings.keys())
        return content

    @classmethod
    def read(cls, path: Path) -> RunRecord:
        """Read the run of a file or folder, with files relative to the current folder.

        Raises
        ------
        LocplanError
            If it cannot be read, is damaged, or of a newer locplan.
        """
        file = path / RUN_FILE if path.is_dir() else path
        content = parse_yaml(file, read_content(file, MAX_JSON_BYTES, REMEDY), REMEDY)
        check_file_stamp(file, content, KIND, VERSION)
        if "command" not in content:
            raise LocplanError(f"{file}: was written in Python, not by a command; {REMEDY}")
        try:
            files = frozenset(map(str, content["files"]))
            settings = {str(name): value for name, value in content["settings"].items()}
            for name, value in settings.items():
                if name in files:
                    settings[name] = _convert_setting(value, partial(_resolve_path, file.parent))
                elif value is not True:
                    settings[name] = _convert_setting(value, str)
            maps, robot = (
                {str(name): str(digest) for name, digest in content.get(section, {}).items()}
                for section in ("maps", "robot")
            )
            return cls(str(content["command"]), settings, files, maps, robot)
        except (KeyError, TypeError, ValueError, AttributeError):
            raise LocplanError(f"{file}: is damaged; {REMEDY}") from None

    def list_command_words(self) -> list[str]:
        """Return the words of the command line, without the options for output."""
        words = [self.command]
        for name, value in self.settings.items():
            option = f"--{name.replace('_', '-')}"
            for argument in value if isinstance(value, list) else [value]:
                words.append(
                    format_argument(str(argument))
                    if name in POSITIONAL
                    else option
                    if argument is True
                    else f"{option}={argument}"
                )  # fmt: skip
        return words


@contextmanager
def record_run(run: RunRecord) -> Iterator[RunRecord]:
    """Write the run's file into the folders of results of this block."""
    _CURRENT.append(run)
    try:
        yield run
    finally:
        _CURRENT.pop()


def get_command_line() -> list[str]:
    """Return the words of the running command without output options; empty in Python."""
    return (
        ["locplan", *_CURRENT[-1].list_command_words()] if _CURRENT and _CURRENT[-1].command else []
    )


def record_map(name: str, digest: Callable[[], str]) -> None:
    """Record the map in the current run, if any."""
    if _CURRENT and _CURRENT[-1].command:
        _CURRENT[-1].maps[name] = digest()


def record_robot(title: str, digest: str) -> None:
    """Record the robot in the current run, if any."""
    if _CURRENT:
        _CURRENT[-1].robot = {"title": title, "digest": digest}


def record_written_files(target: Path, files: Sequence[tuple[Path, str]], n_more: int) -> None:
    """Record the written files in the current run, if any.

    Parameters
    ----------
    target : Path
        The file or folder of the results.
    files : sequence of (Path, str)
        The most useful files with their purposes.
    n_more : int
        Number of further files.
    """
    if _CURRENT:
        lines = [f"wrote {file}: {purpose}" for file, purpose in files]
        if n_more:
            number = f"{n_more} more files" if n_more > 1 else "1 more file"
            lines.append(f"wrote {target}: {number}" if files else f"wrote {target}")
        _CURRENT[-1].written += lines


def pop_written_lines() -> list[str]:
    """Return the lines on the files that the run has written since the last call."""
    if not _CURRENT:
        return []
    lines, _CURRENT[-1].written = _CURRENT[-1].written, []
    return lines


def format_run(home: Path, kind: str, outputs: Mapping[str, str]) -> str:
    """Return the text of run.yaml: the running command, if any, and its output files.

    Parameters
    ----------
    home : Path
        The folder of run.yaml.
    kind : str
        The kind of the results.
    outputs : mapping of str to str
        SHA-256 of each file by its name.
    """
    content = make_file_stamp(KIND, VERSION)
    if _CURRENT and _CURRENT[-1].command:
        content |= _CURRENT[-1].to_yaml_content(home)
    return dump_yaml({**content, "results": kind, "outputs": dict(sorted(outputs.items()))})


def read_outputs(file: Path) -> tuple[str | None, dict[str, str]]:
    """Return the kind of a run's results, and SHA-256 of each file by its name.

    The kind is None if there is no such run.
    """
    try:
        content = parse_yaml(file, read_content(file, MAX_JSON_BYTES, REMEDY), REMEDY)
        check_file_stamp(file, content, KIND, VERSION)
        outputs = {str(name): str(digest) for name, digest in content["outputs"].items()}
        return str(content["results"]), outputs
    except (LocplanError, KeyError, TypeError, AttributeError):
        return None, {}


def _convert_setting(value: Any, change: Any) -> Setting:
    if isinstance(value, list):
        return [change(str(setting_text)) for setting_text in value]
    return str(change(str(value)))


def _make_relative(text: str, home: Path) -> str:
    """Return a file relative to a folder; names of built-in maps stay as they are.

    A file on another drive becomes absolute.
    """
    if not os.path.lexists(text):
        return text
    try:
        return PurePath(os.path.relpath(text, home)).as_posix()
    except ValueError:
        return os.path.abspath(text)


def _resolve_path(home: Path, text: str) -> str:
    """Return a file relative to the current folder instead of another folder."""
    file = os.path.normpath(home / text)
    return file if os.path.lexists(file) else text


def format_argument(text: str) -> str:
    """Return a file's name as an argument; a leading dash would make it an option."""
    return f"./{text}" if text.startswith("-") else text
