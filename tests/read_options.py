"""Options of commands, which are read from their signatures once in a test run.

For every command line cyclopts makes them six times anew, in 30 ms, and the tests run a thousand.
Here the first ones are kept, and each command line gets copies without its values.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest
from cyclopts.argument import ArgumentCollection


def keep_options(patch: pytest.MonkeyPatch) -> None:
    """Make collections of arguments only for functions and settings that had none so far."""
    made: dict[Callable[..., Any], list[tuple[Any, ArgumentCollection]]] = {}
    if not hasattr(ArgumentCollection, "_from_callable"):
        return  # a cyclopts that makes them otherwise: all works, but takes longer
    original = ArgumentCollection._from_callable.__func__

    def from_callable(cls, func, *defaults, reserved=None, **settings):
        reserved = tuple(reserved or ())
        of_function = made.setdefault(func, [])
        given = defaults, reserved, settings
        for known, arguments in of_function:
            if known == given:
                return without_values(arguments)
        arguments = original(cls, func, *defaults, reserved=reserved, **settings)
        if "<locals>" not in func.__qualname__:  # which is made anew for each command line
            of_function.append((given, without_values(arguments)))
        return arguments

    patch.setattr(ArgumentCollection, "_from_callable", classmethod(from_callable))


def without_values(arguments: ArgumentCollection) -> ArgumentCollection:
    """Copies that share all but what parsing writes."""
    copies = {id(each): copy.copy(each) for each in arguments}
    for each in copies.values():
        each.tokens = []
        each.children = ArgumentCollection(copies[id(child)] for child in each.children)
    return ArgumentCollection(copies.values())
