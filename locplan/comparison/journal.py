"""Journal of a comparison: a file with the settings and each completed run."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from locplan._support.checks import check_file_path
from locplan._support.files import make_folder, translate_write_errors
from locplan._support.reading import open_plain_file, parse_json
from locplan._support.saved import decode_tree
from locplan._support.tables import nan_to_none
from locplan.comparison.statistics import STATUSES, PlannerRun, RunTask
from locplan.errors import LocplanError

FORMAT = "locplan comparison"
VERSION = 2


class RunJournal:
    """A JSON-lines file with settings and versions in the first line, then a run per line.

    If a task has several lines, the last one counts. The journal is a context manager, which
    removes a new file without runs if its block fails.

    Parameters
    ----------
    file : path
        The file, which need not exist.
    settings : mapping
        All settings that affect the runs, and the versions, as plain data for JSON.
    force : bool, default False
        True discards the runs in the file.

    Raises
    ------
    LocplanError
        If the file cannot be written, is not a journal, or its runs have different settings.
    """

    def __init__(
        self, file: str | os.PathLike[str], settings: Mapping[str, Any], *, force: bool = False
    ) -> None:
        self.path = check_file_path("a journal", file)
        self.runs: dict[RunTask, PlannerRun] = {}
        self._head = {"format": FORMAT, "version": VERSION, **nan_to_none(settings)}
        self._has_made_folder = not self.path.parent.exists()
        make_folder(self.path.parent)
        with translate_write_errors(self.path):
            if self.path.exists():
                open_plain_file(self.path, 2**28).close()
            self._file = self.path.open("a+", encoding="ascii", newline="\n")
        try:
            self._lock()
            self._read_runs(force)
        except BaseException:
            with suppress(OSError):
                self._file.close()
            raise

    def __enter__(self) -> RunJournal:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        # Closing writes what could not be written before.
        with translate_write_errors(self.path) if error is None else suppress(OSError):
            self._file.close()
        if error is not None and not self.runs:
            self.path.unlink(missing_ok=True)
            if self._has_made_folder:
                with suppress(OSError):  # another process has written into it
                    self.path.parent.rmdir()

    def add(self, run: PlannerRun) -> None:
        """Append a run; non-finite numbers become null.

        Parameters
        ----------
        run : Run
            The run.
        """
        self._append_line(nan_to_none(asdict(run)))
        self.runs[run.task] = run

    def _read_runs(self, force: bool) -> None:
        """Read the runs of the file, except an incomplete last line."""
        self._file.seek(0)
        try:
            *lines, torn = self._file.read().split("\n")
        except UnicodeDecodeError:
            raise self._format_error from None
        start = _dump_line({"format": FORMAT})[:-2]
        if not lines and torn and not (start.startswith(torn) or torn.startswith(start)):
            raise self._format_error
        head = self._parse_head(lines[0]) if lines else None
        if head is None or force:
            self._file.truncate(0)
            self._append_line(self._head)
            return
        self._check_settings(head)
        if torn:
            self._file.truncate(sum(len(line) + 1 for line in lines))
        for number, line in enumerate(lines[1:], 2):
            run = self._parse_run(number, line)
            self.runs[run.task] = run

    @property
    def _format_error(self) -> LocplanError:
        return LocplanError(f"{self.path}: is not a journal of a comparison; name another file")

    def _parse_head(self, line: str) -> dict[str, Any]:
        try:
            head = parse_json(line)
            if str(head["format"]).startswith(FORMAT):  # version 1 had it in the same text
                return dict(head)
        except (LookupError, TypeError, ValueError):
            pass
        raise self._format_error

    def _check_settings(self, head: Mapping[str, Any]) -> None:
        """Raise a LocplanError if the runs in the file have different settings."""
        current_settings = parse_json(_dump_line(self._head))
        names = [
            name
            for name in {**current_settings, **head}
            if current_settings.get(name) != head.get(name)
        ]
        if names:
            raise LocplanError(
                f"{self.path}: has runs with other settings ({', '.join(names)}); name another"
                " file, or replace them with force=True"
            )

    def _parse_run(self, number: int, line: str) -> PlannerRun:
        try:
            run: PlannerRun = decode_tree(PlannerRun, parse_json(line))
            if run.status not in STATUSES or math.isnan(run.task.weight):
                raise ValueError("is not a run")
            return run
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            raise LocplanError(
                f"{self.path}: line {number} is damaged; delete it to repeat its run"
            ) from None

    def _append_line(self, content: Mapping[str, Any]) -> None:
        with translate_write_errors(self.path):
            self._file.write(_dump_line(content) + "\n")
            self._file.flush()

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


def _dump_line(content: Mapping[str, Any]) -> str:
    return json.dumps(content, allow_nan=False)
