"""What the docstrings below the fields of a dataclass say."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import textwrap
from typing import Any

INDENTS: dict[str, Any] = {"initial_indent": "    ", "subsequent_indent": "    "}
PARAMETERS = re.compile(r"^Parameters\n---", re.MULTILINE)


def field_docs(kind: type) -> dict[str, str]:
    """The docstring of each field in one line, those of base classes included.

    A dataclass that was not written in a file has none.
    """
    docs = dict.fromkeys((each.name for each in dataclasses.fields(kind)), "")
    for base in reversed(kind.__mro__[:-1]):
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        except (OSError, TypeError):
            continue
        assert isinstance(tree, ast.ClassDef)
        for one, after in zip(tree.body, tree.body[1:], strict=False):
            match one, after:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(text))),
                ):
                    docs[name] = " ".join(text.split())
    return docs


class WithFields:
    """The docstring of a dataclass, with what stands below its fields, which Python does not show.

    The source is read where the docstring is looked at.
    """

    def __init__(self, text: str) -> None:
        self.text = text

    def __get__(self, _: object, kind: type) -> str:
        if PARAMETERS.search(self.text):
            return self.text
        docs, lines = field_docs(kind), []
        for each in dataclasses.fields(kind):
            if each.init and (text := docs[each.name]):
                lines += [f"{each.name} : {each.type}", *textwrap.wrap(text, 96, **INDENTS)]
        if not lines:
            return self.text
        about, *sections = re.split(r"\n\n(?=[A-Z]\w+\n---)", self.text, maxsplit=1)
        return "\n\n".join([about, "\n".join(["Parameters", "-" * 10, *lines]), *sections])


def tell_fields(thing: object) -> None:
    """Let the help of a dataclass tell its fields; nothing happens to other objects."""
    if isinstance(thing, type) and dataclasses.is_dataclass(thing):
        text = vars(thing)["__doc__"]
        if isinstance(text, str):
            thing.__doc__ = WithFields(inspect.cleandoc(text))  # type: ignore[assignment]
