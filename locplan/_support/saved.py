"""What users come back to: objects that equal by value, and files that give them back.

A file holds a tree: texts, numbers, lists and entries by name, as JSON has them, and arrays. As
.json they are lists; as .npz they are arrays of their own, and the tree is the array "about".
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import NDArray

from locplan._support.arrays import read_arrays, write_arrays
from locplan._support.checks import file_path, shown
from locplan._support.files import check_target
from locplan._support.output import replacing
from locplan._support.reading import STAMP, check_stamp, parsed_json, read_bytes, stamp
from locplan.errors import LocplanError

MAX_SAVED_BYTES = 2**32
"""Maximum size of a file that is read back, unpacked."""
ABOUT = "about"
"""Array of a .npz file that holds the tree, in which a text in this entry names each array."""
ARRAY = "array of the file"
INFINITIES = {math.inf: "Infinity", -math.inf: "-Infinity"}


class Valued:
    """A dataclass that equals another one whose fields have the same values, NaN included."""

    derived: ClassVar[tuple[str, ...]] = ()
    """Properties that files have beside the fields, for their readers."""
    former: ClassVar[tuple[str, ...]] = ()
    """Fields and properties of older versions, which are not read."""

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return self is other or all(
            _alike(getattr(self, compared_field.name), getattr(other, compared_field.name)) for compared_field in _compared(self)
        )

    def __hash__(self) -> int:
        return hash(tuple(_hashed(getattr(self, compared_field.name)) for compared_field in _compared(self)))


class Stored(Valued):
    """A result that is read back from its folder as it was."""

    kind: ClassVar[str]
    """Name of the kind in files and in errors, such as plan."""
    version: ClassVar[int] = 1
    """Version of the file's content, which rises when an older locplan could not read it."""
    suffix: ClassVar[str] = ".npz"
    """Suffix of the file: .npz, or .json for what people read."""

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read what `save` has written; it equals what was saved.

        Parameters
        ----------
        path : path
            The file, or a folder of results with one.

        Raises
        ------
        LocplanError
            If it cannot be read, is damaged, holds something else, or is of a newer locplan.
        """
        file = file_path(f"a file of a {cls.kind}", path)
        file = file / f"{cls.kind}{cls.suffix}" if file.is_dir() else file
        content = _read(file)
        check_stamp(file, content, cls.kind, cls.version)
        try:
            return cast("Self", made(cls, _unstamped(content)))
        except (LocplanError, ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise LocplanError(f"{file}: is damaged ({shown(str(error))}); save it anew") from None

    def write(self, file: Path) -> None:
        """Write all of it, as a whole or not at all.

        Parameters
        ----------
        file : path
            The file, with the kind's suffix.

        Raises
        ------
        LocplanError
            If it cannot be written, or what is written could not be read back.
        """
        tree = tree_of(self)
        try:
            if made(type(self), tree) != self:
                raise ValueError("an estimator or another part is not registered by its name")
        except (LocplanError, TypeError, ValueError) as error:
            raise LocplanError(f"{file}: could not be read back: {error}") from None
        content = {**stamp(self.kind, self.version), **tree}
        with replacing(file) as temporary:
            if self.suffix == ".json":
                text = json.dumps(listed(content), indent=1, allow_nan=False)
                temporary.write_text(text + "\n", encoding="utf-8")
            else:
                _write_arrays(temporary, content)


class Saved(Stored):
    """What `save` writes into a file, and `load` reads back as it was."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all of it into a file, for `load`.

        Parameters
        ----------
        path : path
            The file; one that is there is replaced.

        Raises
        ------
        LocplanError
            If the file cannot be written, or its name does not end in the kind's suffix.
        """
        target = file_path(f"a file of a {self.kind}", path)
        check_target(target, self.suffix)
        self.write(target)


def tree_of(value: Any) -> Any:
    """The tree of a value: a dataclass by its compared and derived fields, or its `to_json`."""
    if value is None or isinstance(value, (bool, str, np.ndarray)):
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        number = float(value)
        return None if math.isnan(number) else INFINITIES.get(number, number)
    if isinstance(value, Mapping):
        return {str(name): tree_of(member) for name, member in value.items()}
    if isinstance(value, (list, tuple)):
        return [tree_of(member) for member in value]
    if isinstance(value, range):
        return [value.start, value.stop]
    if hasattr(value, "to_json"):
        return tree_of(value.to_json())
    if hasattr(value, "from_summary"):
        return tree_of(value.summary())
    names = [*(member.name for member in _compared(value)), *getattr(value, "derived", ())]
    return {name: tree_of(getattr(value, name)) for name in names}


def plain(record: Any) -> dict[str, Any]:
    """Return a dataclass as plain data, fit for JSON: its compared and derived fields by name."""
    return dict(listed(tree_of(record)))


def listed(tree: Any) -> Any:
    """The tree with lists in place of arrays, fit for JSON."""
    if isinstance(tree, np.ndarray):
        return listed(tree_of(tree.tolist()))
    if isinstance(tree, dict):
        return {name: listed(subtree) for name, subtree in tree.items()}
    return [listed(subtree) for subtree in tree] if isinstance(tree, list) else tree


def made(kind: Any, tree: Any) -> Any:
    """The value of a kind, which is a type with its arguments, that `tree_of` has made a tree of.

    Raises
    ------
    TypeError, ValueError, KeyError, LocplanError
        If the tree is of another kind.
    """
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return tree
    if origin in (typing.Union, types.UnionType):
        return _one_of(args, tree)
    if origin is typing.Literal:
        return _checked(tree, tree in args)
    if hasattr(origin, "__value__"):  # an alias, as NDArray is from Python 3.12 on
        return made(origin.__value__[args], tree)
    if origin is np.ndarray:
        return _array(tree, args[1])
    if origin is not None:
        return _several(origin, args, tree)
    if kind is float:
        return _number(tree)
    if kind in (int, str, bool, type(None)):
        return _checked(tree, type(tree) is kind)
    if maker := getattr(kind, "from_json", None) or getattr(kind, "from_summary", None):
        return maker(_entries(tree))
    if kind is range or issubclass(kind, tuple):
        return kind(*_unlisted(_list(tree)))
    hints, derived = typing.get_type_hints(kind), getattr(kind, "derived", ())
    left_out = (*derived, *getattr(kind, "former", ()))
    fields = {name: subtree for name, subtree in _entries(tree).items() if name not in left_out}
    return kind(**{name: made(hints[name], subtree) for name, subtree in fields.items()})


def _several(origin: Any, args: tuple[Any, ...], tree: Any) -> Any:
    """A tuple, a list or a dictionary of values."""
    if issubclass(origin, Mapping):
        return {name: made(args[1], subtree) for name, subtree in _entries(tree).items()}
    if not issubclass(origin, tuple):
        return [made(args[0], subtree) for subtree in _list(tree)]
    member_kinds = args[:1] * len(tree) if args[-1] is ... else args
    return tuple(made(member_kind, subtree) for member_kind, subtree in zip(member_kinds, _list(tree), strict=True))


def _one_of(kinds: Sequence[Any], tree: Any) -> Any:
    """The value of the first of several kinds that the tree is of."""
    if tree is None and type(None) in kinds:
        return None
    for kind in kinds:
        try:
            return made(kind, tree)
        except (TypeError, ValueError, KeyError):
            continue
    raise ValueError(f"{shown(tree)} is none of its kinds")


def _array(tree: Any, kind: Any) -> NDArray[Any]:
    """An array that nobody changes, of the type of a dtype[...]."""
    (scalar_type,) = typing.get_args(kind)
    dtype = np.dtype(scalar_type if isinstance(scalar_type, type) and scalar_type is not Any else None)
    if isinstance(tree, np.ndarray):
        _checked(tree, np.can_cast(tree.dtype, dtype, "same_kind"))
        values = tree.astype(dtype, copy=False)
    else:
        values = np.array(_unlisted(_list(tree)), dtype)
    values.setflags(write=False)
    return values


def _unlisted(tree: Any) -> Any:
    if isinstance(tree, list):
        return [_unlisted(subtree) for subtree in tree]
    return tree if type(tree) in (int, bool) else _number(tree)


def _number(tree: Any) -> float:
    if tree is None:
        return math.nan
    if tree in INFINITIES.values():
        return float(tree)
    return float(_checked(tree, type(tree) in (int, float)))


def _checked(tree: Any, right: bool) -> Any:
    if not right:
        raise ValueError(f"{shown(tree)} is of another kind")
    return tree


def _list(tree: Any) -> list[Any]:
    return cast("list[Any]", _checked(tree, isinstance(tree, list)))


def _entries(tree: Any) -> dict[str, Any]:
    return cast("dict[str, Any]", _checked(tree, isinstance(tree, dict)))


def _unstamped(content: dict[str, Any]) -> dict[str, Any]:
    return {name: setting for name, setting in content.items() if name not in STAMP}


def _compared(value: Any) -> list[dataclasses.Field[Any]]:
    return [dataclass_field for dataclass_field in dataclasses.fields(value) if dataclass_field.compare]


def _alike(one: Any, other: Any) -> bool:
    if one is other:
        return True
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")
    if isinstance(one, (tuple, list)) and type(one) is type(other):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_alike(one[name], other[name]) for name in one)
    return bool(one == other or (one != one and other != other))


def _hashed(value: Any) -> int:
    if isinstance(value, np.ndarray):
        return hash((value.shape, (value + value.dtype.type(0)).tobytes()))  # 0 is -0, too
    if isinstance(value, Mapping):
        return hash(frozenset(value))
    if isinstance(value, (tuple, list)):
        return hash(tuple(map(_hashed, value)))
    return 0 if value != value else hash(value)


def _read(file: Path) -> Any:
    """The tree of a file; None if it is damaged."""
    try:
        if file.suffix == ".json":
            return parsed_json(read_bytes(file, MAX_SAVED_BYTES).decode("utf-8"))
        return _tree_of_arrays(read_arrays(file, MAX_SAVED_BYTES))
    except OSError as error:
        raise LocplanError(f"{file}: cannot be read ({error.strerror or error})") from None
    except (LookupError, TypeError, ValueError):
        return None


def _write_arrays(file: Path, content: Any) -> None:
    arrays: dict[str, NDArray[Any]] = {}

    def named(array: NDArray[Any]) -> dict[str, int]:
        number = len(arrays)
        arrays[str(number)] = array
        return {ARRAY: number}

    tree_text = np.array(json.dumps(content, default=named, allow_nan=False))
    write_arrays(file, {ABOUT: tree_text, **arrays})


def _tree_of_arrays(arrays: Mapping[str, NDArray[Any]]) -> Any:
    def entries(tree: dict[str, Any]) -> Any:
        return arrays[str(int(tree[ARRAY]))] if tree.keys() == {ARRAY} else tree

    return parsed_json(str(arrays[ABOUT]), entries)
