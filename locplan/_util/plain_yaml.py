"""YAML of users, read without obeying a tag or expanding an alias."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locplan._util.reading import read_bytes
from locplan.errors import MapError

if TYPE_CHECKING:
    import yaml

SCALAR_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "int", "float", "bool")}
ROS_BOOLEANS = {"y": True, "Y": True, "n": False, "N": False}
"""Plain words that are booleans to ROS, but texts to PyYAML."""
ROS_NUMBER = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+")
"""Plain words that are numbers to ROS, but texts to PyYAML."""
MAX_DEPTH = 100
"""Greatest depth of brackets; PyYAML's time grows with its square."""


def compose(file: Path, content: bytes, remedy: str) -> yaml.Node | None:
    """Nodes of a file's YAML, of which no tag is obeyed and no alias expanded."""
    import yaml

    if _depth(content) > MAX_DEPTH:
        raise fault_of(file, f"has brackets over {MAX_DEPTH} deep", remedy)
    try:
        return yaml.compose(content.decode("utf-8-sig"), Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError, ValueError, OverflowError) as error:
        mark = getattr(error, "problem_mark", None)
        fault = "is not YAML in UTF-8" + (f", see line {mark.line + 1}" if mark else "")
        raise fault_of(file, fault, remedy) from error


def document(file: Path, content: bytes, remedy: str) -> Any:
    """Values of a file's YAML of locplan's own; None if it holds none, or others."""
    import yaml

    node = compose(file, content, remedy)
    try:
        # Aliases are not expanded: a node that comes again is one object.
        return yaml.SafeLoader("").construct_document(node) if node else None
    except Exception:  # a value that is none of its tag fails in as many ways as there are tags
        return None


def dumped(content: Mapping[str, Any], **style: Any) -> str:
    """Text of values in their order, as YAML."""
    import yaml

    text: str = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=100, **style)
    return text


def _depth(content: bytes) -> int:
    """Depth of the brackets of a text, those in comments and quotes included."""
    steps = (1 if bracket in b"[{" else -1 for bracket in re.findall(rb"[\[\]{}]", content))
    depths = itertools.accumulate(steps, lambda depth, step: max(0, depth + step), initial=0)
    return max(depths)


def read_content(file: Path, limit: int, remedy: str) -> bytes:
    """Read a plain file of up to `limit` bytes; what is none is a MapError with the remedy."""
    try:
        content = read_bytes(file, limit)
    except FileNotFoundError:
        raise fault_of(file, "there is no such file", "check its name and folder") from None
    except (OSError, ValueError) as error:
        raise fault_of(file, f"cannot be read ({reason_of(error)})", remedy) from error
    if not content:
        raise fault_of(file, "is empty", "copy or export it again")
    if content.startswith(b"version https://git-lfs.github.com/spec/"):
        raise fault_of(file, "is a Git LFS pointer, not the content", "run git lfs pull")
    return content


def fault_of(file: Path, fault: str, remedy: str) -> MapError:
    """Make the error of a file: the end of its name, what is wrong, and the remedy."""
    return MapError(f"{str(file)[-200:]}: {fault}; {remedy}")


def reason_of(error: Exception) -> str:
    """Return the short reason in the message of another library's error."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return text.split(" <")[0].split(", could")[0][:80]  # without a stream's repr or Pillow's alarm


def scalar_text(value: float | str | bool) -> str:
    """Text of a value that YAML and ROS read as the same value of the same type."""
    if isinstance(value, bool):
        return "true" if value else "false"
    text = str(value) if isinstance(value, str) else repr(value)
    if isinstance(value, float) and "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text
