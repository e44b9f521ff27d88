"""Writing files and folders whole or not at all, and checks of where to write them."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from locplan.errors import LocplanError

PICTURES = (".png", ".pdf", ".svg")
"""Suffixes of the picture formats that can be written."""

_INPUTS: ContextVar[set[Path] | None] = ContextVar("_INPUTS", default=None)


@contextmanager
def protect_inputs() -> Iterator[None]:
    """Refuse to overwrite the files of `protect_input` in this block."""
    before = _INPUTS.set(set())
    try:
        yield
    finally:
        _INPUTS.reset(before)


def protect_input(path: Path) -> None:
    """Mark a file as an input; without effect outside `protect_inputs`."""
    inputs = _INPUTS.get()
    if inputs is not None:
        inputs.add(_resolve_links(path))


def check_writable_file(path: Path, *suffixes: str) -> None:
    """Raise a LocplanError unless a file with one of these suffixes can be written there.

    It is called before long work, so that no work is lost.
    """
    if path.is_dir() and path.suffix.lower() in suffixes:
        raise LocplanError(f"{path}: is a folder; name a file in it")
    _check_writable_place(path, *suffixes)


def check_writable_folder(folder: Path) -> None:
    """Raise a LocplanError unless results can be written into a folder, which need not exist.

    It is called before long work; the folder is made when there is something to write.
    """
    with translate_write_errors(folder):
        existing_parent = next(
            parent for parent in (folder, *folder.absolute().parents) if os.path.lexists(parent)
        )
        if not existing_parent.is_dir():
            obstacle = "a file, not a folder" if existing_parent.exists() else "a link to nothing"
            raise LocplanError(f"{existing_parent}: is {obstacle}; name another folder")
        try:  # root may, by its rights, also where no file system takes a folder
            os.rmdir(tempfile.mkdtemp(dir=existing_parent))
        except OSError:
            raise LocplanError(
                f"{existing_parent}: cannot be written; choose another folder"
            ) from None


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, unless they exist."""
    check_writable_folder(folder)
    with translate_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)


def write_text(file: Path, text: str, errors: str = "strict") -> None:
    """Write text as UTF-8 and keep its line endings, also on Windows."""
    file.write_text(text, encoding="utf-8", errors=errors, newline="\n")


def check_replaces_no_input(path: Path) -> None:
    """Raise a LocplanError if writing there replaces an input, or a folder with one in it."""
    target = _resolve_links(path)
    for input_file in _INPUTS.get() or ():
        if any(_is_same_file(target, place) for place in (input_file, *input_file.parents)):
            raise LocplanError(
                f"{path}: replaces {input_file.name}, a map or another input; choose another name"
            )


def _is_same_file(one: Path, other: Path) -> bool:
    """True if two paths lead to one file, such as Map.yaml and map.yaml on macOS and Windows."""
    with suppress(OSError):  # one of them does not exist
        return one == other or os.path.samefile(one, other)
    return False


def _resolve_links(path: Path) -> Path:
    return Path(os.path.realpath(path))


def _check_writable_place(path: Path, *suffixes: str) -> None:
    if suffixes and path.suffix.lower() not in suffixes:
        raise LocplanError(f"{path}: must end in {', '.join(suffixes)}")
    check_replaces_no_input(path)
    if not path.parent.exists():
        raise LocplanError(f"{path}: the folder {path.parent} does not exist; make it first")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise LocplanError(f"{path}: {path.parent} is no folder that can be written")


@contextmanager
def translate_write_errors(path: Path) -> Iterator[None]:
    """Translate an OSError of writing to a LocplanError of one line."""
    try:
        yield
    except OSError as error:
        raise LocplanError(f"{path}: cannot be written ({error.strerror or error})") from None
