"""The digest of code of the user's own, so that edited code never finds an older result.

What is digested is what Python would run: bytecode, not source files, which may have been edited
since they were loaded, and which notebooks lack. Names are followed to functions, classes and
values; code of installed libraries is named only.
"""

from __future__ import annotations

import copyreg
import dis
import functools
import hashlib
import importlib.util
import sys
from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from pathlib import Path
from types import CodeType, FunctionType, MappingProxyType, ModuleType
from typing import Any, NamedTuple

from locplan.errors import LocplanError

_PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...), type(NotImplemented))
_CODE = (
    *("co_argcount", "co_posonlyargcount", "co_kwonlyargcount", "co_flags", "co_code"),
    *("co_names", "co_varnames", "co_freevars", "co_cellvars", "co_exceptiontable", "co_consts"),
)
"""What decides what a code object does; its file, its lines and its name do not."""
_UNDECISIVE = {
    *("__module__", "__doc__", "__dict__", "__weakref__", "__abstractmethods__", "_abc_impl"),
    *("__annotations__", "__annotate__", "__annotate_func__", "__annotations_cache__"),
    *("__dataclass_fields__", "__firstlineno__", "__static_attributes__"),
    *("__orig_bases__", "__parameters__"),
}
"""Members of a class that decide no value; a dataclass's defaults stand in its `__init__`, too."""


def code_digest(value: object, computing: Iterable[object]) -> str:
    """Digest of an object, with all code of the user's own that it computes with.

    It is the same in each process of one version of Python, whatever the hash seed or the memory
    addresses. Files that the code reads are no part of it.

    Parameters
    ----------
    value : object
        The object; what it has found out lazily (`functools.cached_property`) does not count.
    computing : iterable of classes and functions
        What is followed, together with its own packages, even where it is installed.

    Raises
    ------
    LocplanError
        If it holds something whose content cannot be known, such as a lock or an open file.
    """
    lines = [line for root in computing for line in getattr(root, "__mro__", (root,))]
    own = {_package(getattr(each, "__module__", None)) for each in lines}
    walk = _Walk(frozenset(package for package in own if not _is_shipped(package)))
    try:
        return walk.digest(value)
    except LocplanError:
        raise
    except Exception as error:  # what an object gives of itself is its own code, and so its errors
        what = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise LocplanError(f"its code cannot be digested ({what})") from None


class _Taken(NamedTuple):
    """What code takes from a module: all in it that the code has a name of."""

    module: ModuleType
    names: frozenset[str]


class _Walk:
    """A walk through objects and code, which digests each thing that it meets once."""

    def __init__(self, own: frozenset[str]) -> None:
        self._own = own
        self._content = hashlib.blake2b(digest_size=16)
        self._things: list[object] = []
        self._numbers: dict[object, int] = {}
        self._put("python", sys.version_info[:2])

    def digest(self, value: object) -> str:
        """Digest of a value and of all things that it leads to, in the order of their meeting."""
        self._add(value)
        for thing in self._things:  # which grows on the way
            self._add_parts(thing)
        return self._content.hexdigest()

    def _put(self, *content: object) -> None:
        text = repr(content).encode()
        self._content.update(b"%d %b" % (len(text), text))

    def _add(self, value: Any) -> None:
        """Add a value of any kind: a constant itself, and the number of anything else."""
        kind = type(value)
        if kind in _PLAIN:
            self._put(kind.__name__, value)
        elif kind in (tuple, CodeType, frozenset):  # constants, which Python may share or not
            self._add_parts(value)
        elif home := self._library_of(value):
            self._put("named", home)
        else:
            key = value if kind is _Taken else id(value)
            if key not in self._numbers:
                self._numbers[key] = len(self._things)
                self._things.append(value)  # and so kept, that no other gets its id
            self._put("thing", self._numbers[key])

    def _add_parts(self, value: object) -> None:
        parts = [*self._parts(value)]
        self._put("kind", type(value).__name__, len(parts))
        for part in parts:
            self._add(part)

    def _parts(self, value: Any) -> Iterable[Any]:
        """What decides a thing."""
        kind = type(value)
        if kind in (tuple, list):
            return list(value)
        if kind in (set, frozenset):
            # Each by itself, whatever the order and the numbers of those met before.
            return sorted(_Walk(self._own).digest(each) for each in value)
        if kind in (dict, MappingProxyType):
            return chain.from_iterable(value.items())
        if kind is CodeType:
            return [getattr(value, name) for name in _CODE]
        if kind is _Taken:
            own = set() if self._is_library(value.module.__name__) else set(dir(value.module))
            taken = {name: getattr(value.module, name) for name in sorted(value.names & own)}
            return [value.module.__name__, _with_taken(taken, value.names)]
        if isinstance(value, type):
            decisive = sorted(set(value.__dict__) - _UNDECISIVE)
            members = {name: value.__dict__[name] for name in decisive}
            return [value.__qualname__, kind, *value.__bases__, members]
        return self._parts_of_code(value, kind)

    def _parts_of_code(self, value: Any, kind: type) -> list[Any]:
        """What decides a function, or what wraps one; anything else is an object."""
        if kind is FunctionType:
            return self._parts_of_function(value)
        if kind in (staticmethod, classmethod):
            return [value.__func__]
        if kind is functools.cached_property:
            return [value.func]
        if kind is property:
            return [value.fget, value.fset, value.fdel]
        if _package(kind.__module__) == "numba" and (compiled := _compiled(value)):
            return [compiled, getattr(value, "targetoptions", None)]
        return self._parts_of_object(value, kind)

    def _parts_of_function(self, function: FunctionType) -> list[Any]:
        """A function's code, its defaults and attributes, and what it closes over and names."""
        code, scope = function.__code__, function.__globals__
        if self._is_library(scope.get("__name__")):  # what a decorator of a library has made
            body: list[Any] = [scope["__name__"], code.co_qualname]
        else:
            attributes = frozenset(name for each in _codes(code) for name in each.co_names)
            body = [code, _with_taken(_named_by(code, scope, self._is_library), attributes)]
        closed = [_content_of(cell) for cell in function.__closure__ or ()]
        return [*body, function.__defaults__, function.__kwdefaults__, function.__dict__, *closed]

    def _parts_of_object(self, value: Any, kind: type) -> list[Any]:
        """What an object would be pickled as, but for what it keeps of its own values."""
        try:
            reduce = copyreg.dispatch_table.get(kind)
            made = reduce(value) if reduce else value.__reduce_ex__(4)
        except TypeError:
            made = ""
        if not isinstance(made, str):
            make, given, state, elements, items = (*made, None, None, None)[:5]
            if isinstance(state, Mapping):
                lazy = functools.cached_property
                state = {k: v for k, v in state.items() if type(getattr(kind, k, None)) is not lazy}
            return [make, given, state, list(elements or ()), list(items or ())]
        if made and self._is_of_library(value, made):  # what has but a name is code of the machine
            return [kind.__qualname__, made]
        if hasattr(value, "__wrapped__"):
            return [value.__wrapped__]
        what = f"{kind.__module__}.{kind.__qualname__}".removeprefix("builtins.")
        raise LocplanError(f"what it holds of type {what} cannot be digested")

    def _library_of(self, value: object) -> str:
        """Name by which a library gives an object, or an empty text."""
        module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
        if type(module) is not str or type(name) is not str or not self._is_library(module):
            return ""
        found: object = sys.modules.get(module)
        for part in name.split("."):
            found = getattr(found, part, None)
        return f"{module}:{name}" if found is value else ""

    def _is_of_library(self, value: object, name: str) -> bool:
        """Return whether a library has an object by a name: numpy's functions know no module."""
        modules = [(home, getattr(one, "__dict__", {})) for home, one in [*sys.modules.items()]]
        return any(own.get(name) is value and self._is_library(home) for home, own in modules)

    def _is_library(self, module: object) -> bool:
        package = _package(module)
        return package not in ("__main__", *self._own) and (
            _is_shipped(package) or _is_installed(package)
        )


def _package(module: object) -> str:
    return module.partition(".")[0] if isinstance(module, str) else ""


def _is_shipped(package: str) -> bool:
    """Return whether a package is locplan, or comes with Python."""
    return package == "locplan" or package in sys.stdlib_module_names


@functools.cache
def _is_installed(package: str) -> bool:
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):  # the latter for no name, or a module made by hand
        return False
    if spec is None:
        return False
    places = [spec.origin or "", *(spec.submodule_search_locations or ())]
    return any({"site-packages", "dist-packages"} & set(Path(place).parts) for place in places)


def _compiled(value: Any) -> object:
    """The function that numba has compiled or will compile, or None."""
    return getattr(value, "py_func", None) or getattr(value, "__wrapped__", None)


def _codes(code: CodeType) -> list[CodeType]:
    """A code object and all that are defined in it."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    return [code, *(one for each in inner for one in _codes(each))]


def _content_of(cell: Any) -> Any:
    """What a function closes over; nothing is there before its definition has ended."""
    try:
        return cell.cell_contents
    except ValueError:
        return NotImplemented


def _with_taken(named: Mapping[str, Any], names: frozenset[str]) -> dict[str, Any]:
    """What names stand for; of a module, what code with these names takes from it."""
    return {
        name: _Taken(value, names) if isinstance(value, ModuleType) else value
        for name, value in named.items()
    }


def _named_by(
    code: CodeType, scope: Mapping[str, Any], is_library: Callable[[object], bool]
) -> dict[str, Any]:
    """The globals that a function's code names, and the modules that it imports, by name."""
    named = {}
    for each in _codes(code):
        steps = [step for step in dis.get_instructions(each) if step.opname != "EXTENDED_ARG"]
        for at, step in enumerate(steps):
            if step.opname in ("LOAD_GLOBAL", "LOAD_NAME") and step.argval in scope:
                named[step.argval] = scope[step.argval]
            elif step.opname == "IMPORT_NAME":
                level, what = (before.argval for before in steps[at - 2 : at])
                if level or not is_library(step.argval):
                    module = __import__(step.argval, dict(scope), None, what, level)
                    named[f"import {level} {step.argval} {what}"] = module
    return dict(sorted(named.items()))
