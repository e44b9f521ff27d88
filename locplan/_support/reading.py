"""All reading of files: size-limited plain files, YAML, JSON, and version stamps."""

from __future__ import annotations

import gzip
import itertools
import json
import os
import re
import stat
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import Any

from locplan import __version__
from locplan._support.checks import short_repr
from locplan.errors import LocplanError, MapError

MAX_BYTES, MAX_JSON_BYTES, MAX_LOG_BYTES = 2**24, 2**20, 2**32
"""Maximum size of a text that is read at once, whose numbers may take fifty times as much; of a
file of settings, or of a description in JSON; and, unpacked, of a log that is read line by line."""
MAX_LINE, MAX_LINES = 2**22, 2**22
"""Maximum length of a log's line [characters], and greatest number of lines."""

NO_FILE = "there is no such file", "check its name and folder"
"""Fault and remedy of a missing file."""


def open_plain_file(file: str | os.PathLike[str], limit: float = float("inf")) -> BufferedReader:
    """Open a plain file of up to `limit` bytes; an OSError if it is none: a pipe would block."""

    def open_nonblocking(path: str, flags: int) -> int:
        return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))

    content = open(file, "rb", opener=open_nonblocking)  # noqa: SIM115
    status = os.fstat(content.fileno())
    if stat.S_ISREG(status.st_mode) and status.st_size <= limit:
        return content
    content.close()
    if stat.S_ISREG(status.st_mode):
        raise OSError(f"it is over {limit / 1e6:.3g} MB, too much for such a file")
    raise OSError("it is no plain file, but a pipe or a device")


def read_bytes(file: str | os.PathLike[str], limit: int) -> bytes:
    """Read a plain file of up to `limit` bytes; raise an OSError or a ValueError otherwise."""
    with open_plain_file(file, limit) as content:
        return content.read(os.fstat(content.fileno()).st_size)  # room is made for all of it


@contextmanager
def _translate_errors(prefix: str = "") -> Iterator[None]:
    """Translate errors of reading a text to one line that starts with `prefix`."""
    try:
        yield
    except UnicodeDecodeError:
        raise LocplanError(f"{prefix}is no text; save it as UTF-8") from None
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise LocplanError(f"{prefix}is cut off or damaged (gzip); copy it again") from None
    except FileNotFoundError:
        raise LocplanError(prefix + "; ".join(NO_FILE)) from None
    except (OSError, ValueError) as error:  # the latter for names that no file can have
        reason = getattr(error, "strerror", None) or error
        raise LocplanError(f"{prefix}cannot be read ({reason})") from None


def read_text(file: Path, limit: int = MAX_BYTES) -> str:
    """Read a text in UTF-8, without a byte order mark.

    Raises
    ------
    LocplanError
        If it cannot be read, or is no text of up to `limit` bytes.
    """
    with _translate_errors(f"{file}: "):
        return read_bytes(file, limit).decode("utf-8-sig")


def read_numbered_lines(file: Path, errors: str = "strict") -> Iterator[tuple[int, str]]:
    """Yield the lines of a log with their numbers; .gz files are unpacked on the way.

    Raises
    ------
    LocplanError
        If it cannot be read, is damaged, is no text in UTF-8 (unless `errors` are replaced), or is
        too long.
    """
    number = size = 0
    with _translate_errors(), open_plain_file(file, MAX_LOG_BYTES) as content:
        unpacked = gzip.GzipFile(fileobj=content) if file.suffix == ".gz" else content
        text = TextIOWrapper(unpacked, "utf-8-sig", errors)
        while line := text.readline(MAX_LINE):
            number, size = number + 1, size + len(line)
            if len(line) == MAX_LINE:
                raise LocplanError(f"line {number} is too long for a log of scans")
            if number > MAX_LINES or size > MAX_LOG_BYTES:
                log_limits = f"{MAX_LINES:,} lines, or {MAX_LOG_BYTES / 1e6:.0f} MB"
                raise LocplanError(f"goes on beyond {log_limits}; split it")
            yield number, line


def parse_json(text: str, object_hook: Callable[[dict[str, Any]], Any] | None = None) -> Any:
    """Parse a text in JSON; raise a ValueError if it is invalid or too deep.

    What `object_hook` makes of each dictionary stands in its place.
    """
    try:
        return json.loads(text, object_hook=object_hook)
    except RecursionError:
        raise ValueError("its brackets are too deep") from None


SCALAR_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "int", "float", "bool")}
ROS_BOOLEANS = {"y": True, "Y": True, "n": False, "N": False}
"""Plain words that are booleans to ROS, but texts to PyYAML."""
ROS_NUMBER = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+")
"""Plain words that are numbers to ROS, but texts to PyYAML."""
MAX_DEPTH = 100
"""Maximum depth of brackets; PyYAML's time grows with its square."""


def compose_yaml(file: Path, content: bytes, remedy: str) -> Any:
    """Return the nodes of a file's YAML or None, without resolving tags or aliases."""
    import yaml

    if _compute_bracket_depth(content) > MAX_DEPTH:
        raise make_map_error(file, f"has brackets over {MAX_DEPTH} deep", remedy)
    try:
        return yaml.compose(content.decode("utf-8-sig"), Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError, ValueError, OverflowError) as error:
        mark = getattr(error, "problem_mark", None)
        fault = "is not YAML in UTF-8" + (f", see line {mark.line + 1}" if mark else "")
        raise make_map_error(file, fault, remedy) from error


def parse_yaml(file: Path, content: bytes, remedy: str) -> Any:
    """Return the values of a YAML file written by locplan; None for invalid values."""
    import yaml

    node = compose_yaml(file, content, remedy)
    try:
        # Aliases are not expanded: a node that comes again is one object.
        return yaml.SafeLoader("").construct_document(node) if node else None
    except Exception:  # a value that is none of its tag fails in as many ways as there are tags
        return None


def dump_yaml(content: Mapping[str, Any], **style: Any) -> str:
    """Return values as YAML, in their order."""
    import yaml

    style = {"sort_keys": False, "allow_unicode": True, "width": 100, **style}
    text: str = yaml.safe_dump(content, **style)
    return text


def parse_scalar(node: Any) -> Any:
    """Return the value of a scalar node of YAML; its text if it does not fit its tag."""
    import yaml

    try:
        return yaml.SafeLoader("").construct_object(node) if node.tag in SCALAR_TAGS else node.value
    except (ValueError, ArithmeticError, LookupError, AttributeError):  # such as !!int x
        return node.value


def _compute_bracket_depth(content: bytes) -> int:
    """Return the depth of the brackets of a text, including comments and quotes."""
    steps = (1 if bracket in b"[{" else -1 for bracket in re.findall(rb"[\[\]{}]", content))
    depths = itertools.accumulate(steps, lambda depth, step: max(0, depth + step), initial=0)
    return max(depths)


def read_content(file: Path, limit: int, remedy: str) -> bytes:
    """Read a plain file of up to `limit` bytes; raise a MapError with the remedy otherwise."""
    try:
        content = read_bytes(file, limit)
    except FileNotFoundError:
        raise make_map_error(file, *NO_FILE) from None
    except (OSError, ValueError) as error:
        raise make_map_error(file, f"cannot be read ({extract_reason(error)})", remedy) from error
    if not content:
        raise make_map_error(file, "is empty", "copy or export it again")
    if content.startswith(b"version https://git-lfs.github.com/spec/"):
        raise make_map_error(file, "is a Git LFS pointer, not the content", "run git lfs pull")
    return content


def make_map_error(file: Path, fault: str, remedy: str) -> MapError:
    """Return the error of a file: the end of its name, the fault, and the remedy."""
    return MapError(f"{str(file)[-200:]}: {fault}; {remedy}")


def extract_reason(error: Exception) -> str:
    """Return the short reason in the message of another library's error."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return text.split(" <")[0].split(", could")[0][:80]  # without a stream's repr or Pillow's alarm


def format_yaml_scalar(value: float | str | bool) -> str:
    """Return the text of a value that YAML and ROS read as the same value and type."""
    if isinstance(value, bool):
        return "true" if value else "false"
    text = str(value) if isinstance(value, str) else repr(value)
    if isinstance(value, float) and "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text


def format_yaml_flow(value: Any) -> str:
    """Return a value, list or mapping as one line that YAML and ROS read equally.

    Names of plugins are quoted: libyaml below 0.2.2 fails on an unquoted :: between braces.
    """
    if isinstance(value, str) and "::" in value:
        return f'"{value}"'
    if isinstance(value, dict):
        members = (f"{key}: {format_yaml_flow(member)}" for key, member in value.items())
        return f"{{{', '.join(members)}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(format_yaml_flow, value))}]"
    return format_yaml_scalar(value)


STAMP = ("locplan", "kind", "version")
"""Names of the entries."""


def make_file_stamp(kind: str, version: int) -> dict[str, Any]:
    """Return the first entries of a file: program, kind, and version."""
    return dict(zip(STAMP, (__version__, kind, version), strict=True))


def check_file_stamp(file: object, content: object, kind: str, version: int) -> None:
    """Raise a LocplanError unless a file holds this kind of thing, in a version that is known."""
    fields = content if isinstance(content, dict) else {}
    file_kind, file_version = fields.get("kind"), fields.get("version")
    if (
        not isinstance(file_kind, str)
        or not isinstance(file_version, int)
        or not 1 <= file_version < 10**6
    ):
        raise LocplanError(f"{file}: is damaged, or not a {kind} saved by locplan. Save it again")
    if file_kind != kind:
        raise LocplanError(
            f"{file}: holds a {short_repr(file_kind)[1:-1]}, not a {kind}. Name another file"
        )
    if file_version > version:
        raise LocplanError(
            f"{file}: is of a newer locplan (version {file_version} of a {kind}, this one reads"
            f" {version}); update locplan"
        )
