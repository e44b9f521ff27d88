"""The one way to write results: into a temporary folder next to their place, then moved there.

When everything is written, a journal in this folder lists the moves to come; then the files move.
A process that is killed leaves its folder behind. The next process that writes to the same place
finishes the moves of a journal, or removes an unlocked folder without a journal.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import Any

from locplan._support import runs
from locplan._support.checks import check_file_path
from locplan._support.files import (
    check_replaces_no_input,
    check_writable_file,
    check_writable_folder,
    translate_write_errors,
    write_text,
)
from locplan._support.reading import open_plain_file, parse_json, read_text
from locplan._support.supervision import announce_folder
from locplan.errors import LocplanError

PREFIX, NEW, JOURNAL = ".locplan-tmp-", "new", "moves.json"
_NAME = re.compile(re.escape(PREFIX) + r"[a-z0-9_]{8}")
UNLOCKED = f"{PREFIX}unlocked-"
"""Prefix of a folder without a lock, which no other process can take for abandoned."""
MAX_DESCRIBED = 5
"""Maximum number of files whose purpose is noted; the others are counted."""
_STAGED = re.compile(rf"[\\/]{re.escape(PREFIX)}(unlocked-)?[a-z0-9_]{{8}}[\\/]{NEW}\b")


@dataclass(frozen=True)
class ResultOutput:
    """A file or a folder of results, which need not exist.

    Results replace unchanged earlier results of their kind. A folder with further files or results
    is refused.
    """

    target: Path
    """The file or the folder."""
    kind: str
    """The kind of the results, such as choice."""
    force: bool = False
    """True overwrites files of the same names and removes the earlier results; others stay."""
    is_file: bool = False
    """True for a file, whose run stands next to it."""
    unfinished: tuple[str, ...] = ()
    """Files that the work itself keeps in the folder."""
    purposes: Mapping[str, str] = field(default_factory=dict)
    """Purpose of a file by its name or pattern, the most useful first; others are counted."""

    @property
    def _folder(self) -> Path:
        """The folder of the files, as it was named."""
        return self.target.parent if self.is_file else self.target

    @property
    def _absolute_folder(self) -> Path:
        return self._folder.absolute()

    @property
    def _run_name(self) -> str:
        return self.target.name + runs.FILE_RUN_SUFFIX if self.is_file else runs.RUN_FILE

    def check(self, *names: str) -> None:
        """Raise a LocplanError unless files of these names can be written; before long work."""
        for folder in (self._absolute_folder, *self._absolute_folder.parents):
            clear_abandoned_folders(folder)  # the folder may exist only since a run was killed
        if self.is_file:
            check_writable_file(self.target)
        else:
            check_writable_folder(self.target)
        for name in names:
            self._check_name(name)
        kind, recorded_digests = runs.read_outputs(self._absolute_folder / self._run_name)
        if self.force:
            return
        if kind not in (None, self.kind):
            fault = f"holds the results of another command ({kind})"
            raise LocplanError(f"{self.target}: {fault}; {self._remedy}")
        expected_names = {*self.unfinished, self._run_name if kind else ""}
        for name in self._list_present_names():
            if name not in expected_names and recorded_digests.get(name, "") != compute_file_digest(
                self._absolute_folder / name
            ):
                fault = "was changed after locplan wrote it"
                if name not in recorded_digests:
                    fault = "was not written by this command"
                raise LocplanError(f"{self._folder / name}: {fault}; {self._remedy}")

    @contextmanager
    def writing(self, *, adds: bool = False) -> Iterator[Path]:
        """Yield a file, or a folder, whose content moves to its place when the block succeeds.

        Earlier results that the block does not write are removed, unless it `adds` to them or
        writes nothing.
        """
        self.check()
        base = next(
            existing_parent
            for existing_parent in (self._absolute_folder, *self._absolute_folder.parents)
            if existing_parent.is_dir()
        )
        with translate_write_errors(self.target), temporary_folder(base) as staging:
            within = self._absolute_folder.relative_to(base)
            new = staging / NEW / within
            new.mkdir(parents=True)
            try:
                yield new / self.target.name if self.is_file else new
            except LocplanError as error:
                text = strip_staging_folder(str(error)).replace(
                    str(self._absolute_folder), str(self._folder)
                )
                raise type(error)(text) from None
            self.check(*(written := _compute_digests(new)))
            if not written:
                return
            kind, recorded_digests = runs.read_outputs(self._absolute_folder / self._run_name)
            present = {
                name: compute_file_digest(self._absolute_folder / name)
                for name in {**recorded_digests, **written}
            }
            unchanged = {
                name for name in recorded_digests if present[name] == recorded_digests[name]
            }
            is_more = adds and kind == self.kind
            stale = set() if is_more else unchanged - written.keys()
            outputs = {name: recorded_digests[name] for name in unchanged - stale} | written
            text = runs.format_run(
                Path(strip_staging_folder(self._absolute_folder)), self.kind, outputs
            )
            write_text(new / self._run_name, text)
            present[self._run_name] = compute_file_digest(self._absolute_folder / self._run_name)
            moves, removals = (
                {(within / name).as_posix(): present[name] for name in names}
                for names in ((*written, self._run_name), stale)
            )
            write_move_journal(staging, moves, removals)
        if not _STAGED.search(
            str(self._absolute_folder)
        ):  # results within others are noted with these
            described = describe_files(self.purposes, written)
            files = [(self._folder / name, purpose) for name, purpose in described]
            runs.record_written_files(self.target, files, len(written) - len(files))

    @property
    def _remedy(self) -> str:
        names = "file, or overwrite it" if self.is_file else "folder, or overwrite equal names"
        return f"name another {names} with --force (in Python force=True)"

    def _list_present_names(self) -> Iterable[str]:
        """Names of the files that are there, hidden ones aside."""
        if self.is_file:
            names = [self.target.name, self._run_name]
            return [name for name in names if os.path.lexists(self._absolute_folder / name)]
        return list_files(self._absolute_folder)

    def _check_name(self, name: str) -> None:
        file = self._absolute_folder / name
        check_replaces_no_input(file)
        if file.is_dir() and not file.is_symlink():
            raise LocplanError(f"{file}: is a folder, but a file goes there; move it")
        if (
            file.parent != self._absolute_folder
            and os.path.lexists(file.parent)
            and not file.parent.is_dir()
        ):
            raise LocplanError(f"{file.parent}: is a file, but a folder goes there; move it")


@dataclass(frozen=True)
class ResultFiles:
    """Names and purposes of the files of one kind of results."""

    kind: str
    """The name of the kind, such as choice."""
    names: tuple[str, ...]
    """The files that are known before the work."""
    unfinished: tuple[str, ...] = ()
    """Files that the work itself keeps in the folder."""
    purposes: Mapping[str, str] = field(default_factory=dict)
    """Purpose of a file by its name or pattern, the most useful first."""

    def make_output(self, folder: Path, *names: str, force: bool = False) -> ResultOutput:
        """Return the output into a folder, checked for these files and more before the work."""
        output = ResultOutput(
            folder, self.kind, force, unfinished=self.unfinished, purposes=self.purposes
        )
        output.check(*self.names, *names)
        return output


def describe_files(purposes: Mapping[str, str], names: Iterable[str]) -> list[tuple[str, str]]:
    """Return the most useful files of results with their purposes.

    >>> purposes = {"chosen.csv": "the recommended path", "*.csv": "a candidate path"}
    >>> describe_files(purposes, ["1-short.csv", "choice.json", "chosen.csv"])
    [('chosen.csv', 'the recommended path'), ('1-short.csv', 'a candidate path')]
    """
    names = sorted(names)
    described: dict[str, str] = {}
    for pattern, purpose in purposes.items():
        for name in names:
            if fnmatch(name, pattern):
                described.setdefault(name, purpose)
    return [*described.items()][:MAX_DESCRIBED]


@contextmanager
def replace_file(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary file that replaces `target` when the block succeeds.

    It has the target's name, since writers choose the format by its suffix.
    """
    path = check_file_path("a file to write", target)
    check_replaces_no_input(path)
    with translate_write_errors(path), temporary_folder(path.parent) as folder:
        new = folder / path.name
        new.touch()
        yield new
        os.replace(new, path)


@contextmanager
def temporary_folder(parent: Path | None = None) -> Iterator[Path]:
    """Yield a new folder in `parent`, or in the system's folder for temporary files.

    It is removed at the end.
    """
    home = os.path.abspath(parent or gettempdir())
    clear_abandoned_folders(home)
    folder, lock = _make_locked_folder(home)
    announce_folder(str(folder))
    try:
        yield folder
    finally:
        try:
            finish_moves(folder)
        except KeyboardInterrupt:  # the files move together, or not at all
            finish_moves(folder)
            raise
        finally:
            announce_folder(str(folder), is_gone=True)
            if lock is not None:
                os.close(lock)


def write_move_journal(
    staging: Path, moves: Mapping[str, str | None], removals: Mapping[str, str | None] | None = None
) -> None:
    """List the moves out of a temporary folder, and the removals, that its end brings.

    Each name has the digest of the file in its place, None if there is none: a file that somebody
    changes after a kill stays.
    """
    for name in moves:
        if (staging.parent / name).is_dir():
            raise IsADirectoryError(21, "a folder is in its place", str(staging.parent / name))
    draft = staging / "draft"
    write_text(draft, json.dumps([dict(moves), dict(removals or {})]))
    os.replace(draft, staging / JOURNAL)


def finish_moves(staging: Path) -> None:
    """Finish the moves of a temporary folder, and remove it."""
    journal, home = staging / JOURNAL, staging.parent
    if journal.exists():
        moves, removals = parse_json(read_text(journal))
        for name, before in {**moves, **removals}.items():
            new, target = staging / NEW / name, home / name
            if compute_file_digest(target) != before or not is_below(target, home):
                continue
            if name in removals:
                target.unlink(missing_ok=True)
                with suppress(OSError):  # other files are in it
                    target.parent.rmdir()
            elif new.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                os.replace(new, target)
        journal.unlink()
    shutil.rmtree(staging, ignore_errors=True)


def is_below(file: Path, folder: Path) -> bool:
    """True if a file lies in a folder, or in one below it, links followed."""
    return file.parent.resolve().is_relative_to(folder.resolve()) and file.name != ".."


def clear_abandoned_folders(folder: str | os.PathLike[str]) -> None:
    """Clear the temporary folders in a folder that killed processes have left."""
    with suppress(OSError):  # it cannot be listed, or is gone
        for name in filter(_NAME.fullmatch, os.listdir(folder)):
            staging = Path(folder, name)
            with suppress(OSError, ValueError, LocplanError):  # held, or damaged
                is_mine = not hasattr(os, "getuid") or staging.lstat().st_uid == os.getuid()
                if is_mine and (lock := _lock(staging, wait=False)) is not None:
                    finish_moves(staging)
                    os.close(lock)


def strip_staging_folder(text: str | os.PathLike[str]) -> str:
    """Return a path, or a text with paths, as it is when the files have moved to their place."""
    return _STAGED.sub("", str(text))


def list_files(folder: Path) -> Iterator[str]:
    """Names of the files in a folder and in those below, but for hidden ones."""
    for place, folders, files in os.walk(folder):
        links = [
            folder_name
            for folder_name in folders
            if os.path.islink(os.path.join(place, folder_name))
        ]
        folders[:] = sorted(
            folder_name
            for folder_name in folders
            if folder_name[0] != "." and folder_name not in links
        )
        for name in sorted([*files, *links]):
            if name[0] != ".":
                yield Path(place, name).relative_to(folder).as_posix()


def compute_file_digest(file: Path) -> str | None:
    """SHA-256 of a file, or None if there is none that can be read."""
    try:
        with open_plain_file(file) as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except (OSError, ValueError):  # the latter for names that no file can have
        return None


def _compute_digests(folder: Path) -> dict[str, str]:
    return {name: compute_file_digest(folder / name) or "" for name in list_files(folder)}


def _make_locked_folder(home: str) -> tuple[Path, int | None]:
    """Return a new folder, and the descriptor of its lock, None where there are no locks."""
    if _import_lock_module() is None:
        return Path(mkdtemp(prefix=UNLOCKED, dir=home)), None
    while True:
        folder = Path(mkdtemp(prefix=PREFIX, dir=home))
        try:
            return folder, _lock(folder, wait=True)
        except FileNotFoundError:
            continue  # another process took it for abandoned before it was locked
        except OSError:
            return folder, None


def _import_lock_module() -> Any:
    """Return the module of locks; None on Windows."""
    try:
        import fcntl
    except ModuleNotFoundError:
        return None
    return fcntl


def _lock(folder: Path, *, wait: bool) -> int | None:
    """Return the descriptor that holds the lock of a folder until it is closed; None on Windows.

    It is an OSError if another process holds it, or has removed the folder.
    """
    fcntl = _import_lock_module()
    if fcntl is None:
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.stat(folder)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
