"""Folders of results, written whole or not at all beside the user's own files."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from locplan._util.checks import is_file_name
from locplan._util.files import check_folder, check_no_input, errors_in_one_line
from locplan._util.reading import opened, parsed_json, read_text
from locplan._util.runs import write_run
from locplan._util.supervision import remove_abandoned, temporary_folder
from locplan.errors import LocplanError

MANIFEST = ".locplan.json"
"""The file in a folder of results that lists what was written there, with SHA-256 digests."""

Written = dict[str, dict[str, str]]
"""The digests of files by kind of result and by name, relative to the folder."""


@dataclass(frozen=True)
class ResultFolder:
    """A folder that results of one kind are written into, which need not exist.

    Only a file that an earlier run wrote, and that nobody has changed since, is replaced or
    removed; the manifest in the folder tells which these are.
    """

    folder: Path
    """The folder, in which there may be other results and files of the user's."""
    kind: str
    """The kind of the results, such as plan: files of other kinds are never removed."""
    force: bool = False
    """Whether files of the same names are replaced, whoever wrote them."""

    def check(self, *names: str) -> None:
        """Raise a LocplanError unless files of these names can be written; before long work."""
        check_folder(self.folder)
        known = self._known()
        for name in names:
            self._check_way(name, known)

    @contextmanager
    def writing(self, *, others_stay: bool = False) -> Iterator[Path]:
        """Yield a new folder, whose files are moved into the folder when the block succeeds.

        What an earlier run wrote of this kind and this block did not is removed, unless
        `others_stay`. On an exception the folder stays as it was; one that is raised while files
        move is put off until they have moved.

        Raises
        ------
        LocplanError
            If a file cannot be written, or would replace one that locplan did not write.
        """
        check_folder(self.folder)
        remove_abandoned(self.folder.parent)  # where one was that made the folder
        with (
            errors_in_one_line(self.folder),
            temporary_folder(_nearest(self.folder)) as temporary,
        ):
            new = temporary / "new"
            new.mkdir()
            try:
                yield new
            except LocplanError as error:  # it names the file's last place
                raise type(error)(str(error).replace(str(new), str(self.folder))) from None
            write_run(new, self.folder)
            known, written = self._known(), _digests(new)
            for name, digest in written.items():
                self._check_way(name, known, digest)
            before: dict[str, set[str]] = {}
            for kind in (self.kind, self._unfinished):
                for name, digest in known.pop(kind, {}).items():
                    before.setdefault(name, set()).add(digest)
            untouched = {
                name: found
                for name in before.keys() - written.keys()
                if (found := digest_of(self.folder / name)) in before[name]
            }
            others = {
                kind: {name: digest for name, digest in files.items() if name not in written}
                for kind, files in known.items()
            }
            kept = untouched if others_stay else {}
            stale = [name for name in untouched.keys() - kept if ".." not in PurePath(name).parts]
            listed = {**others, self.kind: {**kept, **written}}
            # Whatever kills the process while files move: the next one knows all of them as ours.
            meanwhile = {**self._known(), self._unfinished: written}
            with interrupts_put_off():
                self._move(new, temporary / "old", [*written], stale, (meanwhile, listed))

    def _move(
        self, new: Path, old: Path, written: list[str], stale: list[str], manifests: Sequence[Any]
    ) -> None:
        """Move all files into the folder, and the stale ones out of it, or none.

        The manifest is the first one while they move, and the last one at the end.
        """
        meanwhile, listed = manifests
        manifest = new / MANIFEST
        if not self.folder.exists():
            _write(manifest, listed)
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            new.rename(self.folder)
            return

        def moves() -> Iterator[tuple[Path | None, Path]]:
            _write(manifest, meanwhile)
            yield manifest, self.folder / MANIFEST
            yield from ((new / name, self.folder / name) for name in written)
            yield from ((None, self.folder / name) for name in stale)
            _write(manifest, listed)
            os.replace(manifest, self.folder / MANIFEST)

        move_together(moves(), old)

    @property
    def _unfinished(self) -> str:
        """The kind of the files that are moved into the folder just now."""
        return f"{self.kind}, unfinished"

    def _known(self) -> Written:
        """What the manifest lists; nothing if there is none.

        One that is damaged, or not locplan's, is in the way unless the user forces it.
        """
        file = self.folder / MANIFEST
        if not os.path.lexists(file):
            return {}
        try:
            return _parsed(read_text(file))
        except (LocplanError, ValueError, TypeError, AttributeError):
            if self.force and not file.is_dir():
                return {}
            raise LocplanError(
                f"{file}: is in the way, and no list of locplan's results; move it, or replace a"
                " file with --force (in Python force=True)"
            ) from None

    def _check_way(self, name: str, known: Written, digest: str | None = None) -> None:
        file = self.folder / name
        check_no_input(file)
        if file.is_dir():
            raise LocplanError(f"{file}: is a folder, and in the way of a file; move it")
        if file.parent != self.folder and file.parent.exists() and not file.parent.is_dir():
            raise LocplanError(f"{file.parent}: is in the way of a folder; move it")
        if self.force or not os.path.lexists(file):
            return
        ours = {files.get(name) for files in known.values()} | {digest}
        if digest_of(file) not in ours - {None}:
            raise LocplanError(
                f"{file}: is in the way, and not as locplan wrote it; move it, name another folder,"
                " or replace it with --force (in Python force=True)"
            )


@dataclass(frozen=True)
class Results:
    """A kind of results, which are written together."""

    kind: str
    """The name of the kind, such as plan."""
    names: tuple[str, ...]
    """The files that are known before the work."""

    def into(self, folder: Path, *names: str, force: bool = False) -> ResultFolder:
        """The folder that takes these results, and files of more names, checked before the work.

        Raises
        ------
        LocplanError
            If a file cannot be written, or would replace one that locplan did not write.
        """
        results = ResultFolder(folder, self.kind, force)
        results.check(*self.names, *names)
        return results


@contextmanager
def interrupts_put_off() -> Iterator[None]:
    """Put off what Ctrl-C and SIGTERM do until the block has ended; it must be short."""
    if threading.current_thread() is not threading.main_thread():
        yield  # they reach the main thread only
        return
    caught: list[int] = []
    before: dict[int, Any] = {}
    for each in (signal.SIGINT, signal.SIGTERM):
        before[each] = signal.signal(each, lambda number, _: caught.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if caught:
            signal.raise_signal(caught[0])


def move_together(moves: Iterable[tuple[Path | None, Path]], old: Path) -> None:
    """Move files to their places, or remove what is there, all or none.

    What was there is kept in the folder `old` meanwhile, which need not exist.
    """
    with ExitStack() as undo:
        for number, (source, target) in enumerate(moves):
            _replace(source, target, old / str(number), undo)
        undo.pop_all()


def _parsed(manifest: str) -> Written:
    """The content of a manifest; one of several errors if it is none."""
    known = {kind: dict(files) for kind, files in parsed_json(manifest).items()}
    for files in known.values():
        for name, digest in files.items():
            if not is_file_name(name) or not isinstance(digest, str):
                raise ValueError
    return known


def _replace(source: Path | None, target: Path, backup: Path, undo: ExitStack) -> None:
    """Move a file to its place, or remove what is there; there is always one or the other."""
    target.parent.mkdir(parents=True, exist_ok=True)
    backup.parent.mkdir(parents=True, exist_ok=True)
    if os.path.lexists(target):
        try:
            os.link(target, backup, follow_symlinks=False)
        except (OSError, NotImplementedError):  # a file system without hard links
            shutil.copy2(target, backup, follow_symlinks=False)
        undo.callback(os.replace, backup, target)
    else:
        undo.callback(target.unlink, missing_ok=True)
    if source:
        os.replace(source, target)
    else:
        target.unlink()


def _write(file: Path, manifest: Written) -> None:
    file.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")


def _nearest(folder: Path) -> Path:
    """The folder itself, or the nearest one above it that exists."""
    return next(each for each in (folder, *folder.absolute().parents) if each.exists())


def _digests(folder: Path) -> dict[str, str]:
    files = sorted(each for each in folder.rglob("*") if each.is_file())
    return {file.relative_to(folder).as_posix(): digest_of(file) or "" for file in files}


def digest_of(file: Path) -> str | None:
    """SHA-256 of a file, or None if there is none that can be read."""
    try:
        with opened(file) as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except (OSError, ValueError):  # the latter for names that no file can have
        return None
