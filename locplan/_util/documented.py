"""What the docstrings below the fields of a dataclass say."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap


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
