"""The journal: runs are written down as they come, so that a comparison can be taken up again."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any

from locplan._util.files import make_folder
from locplan.comparison._runs import Run, Task
from locplan.errors import LocplanError

FORMAT = "locplan comparison 1"
Key = tuple[Task, str]
"""A task, and the digest of all that decides its result."""


class Journal:
    """A JSON-lines file with one line a run; a context manager.

    Each run has the digest of what decided it beside it. Where maps, settings or planners have
    changed since, or others were added, only what is the same is taken from the journal.

    Parameters
    ----------
    file : path
        Made if it is not there.
    resume : bool
        Whether there may be runs in it.

    Raises
    ------
    LocplanError
        If the file cannot be written, is no journal, holds runs and is not to be resumed, or is
        in use.
    """

    def __init__(self, file: str | os.PathLike[str], *, resume: bool = False) -> None:
        self.path = Path(file)
        self._made_folder = not self.path.parent.exists()
        make_folder(self.path.parent)
        try:
            self._file = self.path.open("a+", encoding="ascii")
        except OSError as error:
            raise LocplanError(f"{self.path}: cannot be written ({error.strerror})") from None
        try:
            self._lock()
            self.runs = self._read()
            if self.runs and not resume:
                raise LocplanError(
                    f"{self.path}: holds {len(self.runs)} runs; resume it, or name another file"
                )
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
        if error is not None and not self.runs:  # nothing was run: leave nothing behind
            self.path.unlink(missing_ok=True)
            if self._made_folder:
                with suppress(OSError):  # somebody else has written into it
                    self.path.parent.rmdir()

    def add(self, run: Run, digest: str) -> None:
        """Write a run down."""
        self._append({"digest": digest, **to_json(run)})
        self.runs[run.task, digest] = run

    def _read(self) -> dict[Key, Run]:
        """The runs that are there; what a killed process wrote last is cut off."""
        self._file.seek(0)
        try:
            *lines, torn = self._file.read().split("\n")
        except UnicodeDecodeError:
            raise LocplanError(f"{self.path}: is no journal of a comparison") from None
        if torn and lines:
            self._file.truncate(sum(len(line) + 1 for line in lines))
        if not lines and (not torn or json.dumps({"format": FORMAT}).startswith(torn)):
            self._file.truncate(0)
            self._append({"format": FORMAT})
            return {}
        if not lines or lines[0] != json.dumps({"format": FORMAT}):
            raise LocplanError(f"{self.path}: is no journal of a comparison; name another file")
        return dict(self._parsed(n, line) for n, line in enumerate(lines[1:], 2))

    def _parsed(self, number: int, line: str) -> tuple[Key, Run]:
        try:
            about = json.loads(line)
            run = from_json(about)
            return (run.task, about["digest"]), run
        except (ValueError, KeyError, TypeError):
            raise LocplanError(
                f"{self.path}: line {number} is damaged; delete the line to make its run anew"
            ) from None

    def _append(self, about: Mapping[str, Any]) -> None:
        try:
            self._file.write(json.dumps(about, allow_nan=False) + "\n")
            self._file.flush()
        except OSError as error:
            raise LocplanError(f"{self.path}: cannot be written ({error.strerror})") from None

    def _lock(self) -> None:
        try:
            import fcntl
        except ModuleNotFoundError:
            return  # a system without locks (Windows)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LocplanError(
                f"{self.path}: another comparison writes to it; wait, or name another file"
            ) from None
        except OSError:
            return  # a file system without locks


def to_json(run: Run) -> dict[str, Any]:
    """A run as JSON has it; null where a number is not finite."""
    about = asdict(run)
    about["measures"] = {name: _finite(value) for name, value in run.measures.items()}
    return about | {name: _finite(about[name]) for name in ("seconds", "wall_seconds")}


def from_json(about: Mapping[str, Any]) -> Run:
    """The inverse; NaN where there is null."""
    return Run(
        Task(**about["task"]),
        about["status"],
        _number(about["seconds"]),
        _number(about["wall_seconds"]),
        {name: _number(value) for name, value in about["measures"].items()},
        tuple((at, cost) for at, cost in about["history"]),
        tuple((x, y) for x, y in about["xy"]),
        about["note"],
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
