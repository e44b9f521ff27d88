"""Objects that are saved to files and loaded again, and equality by value.

A file holds a tree: texts, numbers, lists and entries by name, as JSON has them, and arrays. As
.json they are lists; as .npz they are separate arrays, and the tree is the array "about".
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
from locplan._support.checks import check_file_path, short_repr
from locplan._support.files import check_writable_file, write_text
from locplan._support.output import replace_file
from locplan._support.reading import (
    STAMP,
    check_file_stamp,
    make_file_stamp,
    parse_json,
    read_bytes,
)
from locplan.errors import LocplanError

MAX_SAVED_BYTES = 2**32
"""Maximum size of a file that is read back, unpacked."""
TREE_NAME = "about"
"""Array of a .npz file that holds the tree, in which a text in this entry names each array."""
ARRAY = "array of the file"
INFINITIES = {math.inf: "Infinity", -math.inf: "-Infinity"}


class EqualByValue:
    """A dataclass that equals another one whose fields have the same values, NaN included."""

    derived: ClassVar[tuple[str, ...]] = ()
    """Properties that files have beside the fields, for their readers."""
    former: ClassVar[tuple[str, ...]] = ()
    """Fields and properties of older versions, which are not read."""

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return self is other or all(
            _are_equal(getattr(self, compared_field.name), getattr(other, compared_field.name))
            for compared_field in _get_compared_fields(self)
        )

    def __hash__(self) -> int:
        return hash(
            tuple(
                _hash_value(getattr(self, compared_field.name))
                for compared_field in _get_compared_fields(self)
            )
        )


class StoredResult(EqualByValue):
    """A result that can be loaded from its folder."""

    kind: ClassVar[str]
    """Name of the kind in files and in errors, such as plan."""
    version: ClassVar[int] = 1
    """Version of the file's content, which rises when an older locplan could not read it."""
    suffix: ClassVar[str] = ".npz"
    """Suffix of the file: .npz, or .json for what people read."""

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Load a saved object; it equals the original.

        Parameters
        ----------
        path : path
            The file, or a folder of results with one.

        Raises
        ------
        LocplanError
            If it cannot be read, is damaged, is of another kind, or is of a newer locplan.
        """
        file = check_file_path(f"a file of a {cls.kind}", path)
        file = file / f"{cls.kind}{cls.suffix}" if file.is_dir() else file
        content = _read(file)
        check_file_stamp(file, content, cls.kind, cls.version)
        try:
            return cast("Self", decode_tree(cls, _strip_stamp(content)))
        except (LocplanError, ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise LocplanError(
                f"{file}: is damaged ({short_repr(str(error))}). Save it again"
            ) from None

    def write(self, file: Path) -> None:
        """Write all of it, as a whole or not at all.

        Parameters
        ----------
        file : path
            The file, with the kind's suffix.

        Raises
        ------
        LocplanError
            If it cannot be written, or could not be loaded again.
        """
        tree = encode_tree(self)
        try:
            if decode_tree(type(self), tree) != self:
                raise ValueError("an estimator or another part is not registered by its name")
        except (LocplanError, TypeError, ValueError) as error:
            raise LocplanError(f"{file}: could not be read back: {error}") from None
        content = {**make_file_stamp(self.kind, self.version), **tree}
        with replace_file(file) as temporary:
            if self.suffix == ".json":
                text = json.dumps(arrays_to_lists(content), indent=1, allow_nan=False)
                write_text(temporary, text + "\n")
            else:
                _write_arrays(temporary, content)


class StoredObject(StoredResult):
    """An object that `save` writes into a file and `load` reads again."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all of it into a file, for `load`.

        Parameters
        ----------
        path : path
            The file; an existing file is replaced.

        Raises
        ------
        LocplanError
            If the file cannot be written, or its name does not end in the kind's suffix.
        """
        target = check_file_path(f"a file of a {self.kind}", path)
        check_writable_file(target, self.suffix)
        self.write(target)


def encode_tree(value: Any) -> Any:
    """Return the tree of a value: a dataclass by its compared and derived fields."""
    if value is None or isinstance(value, (bool, str, np.ndarray)):
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        number = float(value)
        return None if math.isnan(number) else INFINITIES.get(number, number)
    if isinstance(value, Mapping):
        return {str(name): encode_tree(member) for name, member in value.items()}
    if isinstance(value, (list, tuple)):
        return [encode_tree(member) for member in value]
    if isinstance(value, range):
        return [value.start, value.stop]
    if hasattr(value, "to_json"):
        return encode_tree(value.to_json())
    if hasattr(value, "from_summary"):
        return encode_tree(value.summary())
    names = [
        *(member.name for member in _get_compared_fields(value)),
        *getattr(value, "derived", ()),
    ]
    return {name: encode_tree(getattr(value, name)) for name in names}


def to_plain_data(record: Any) -> dict[str, Any]:
    """Return a dataclass as plain data, fit for JSON: its compared and derived fields by name."""
    return dict(arrays_to_lists(encode_tree(record)))


def arrays_to_lists(tree: Any) -> Any:
    """Return the tree with lists instead of arrays, for JSON."""
    if isinstance(tree, np.ndarray):
        return arrays_to_lists(encode_tree(tree.tolist()))
    if isinstance(tree, dict):
        return {name: arrays_to_lists(subtree) for name, subtree in tree.items()}
    return [arrays_to_lists(subtree) for subtree in tree] if isinstance(tree, list) else tree


def decode_tree(kind: Any, tree: Any) -> Any:
    """Return the value of a type from its tree, the inverse of `encode_tree`.

    Raises
    ------
    TypeError, ValueError, KeyError, LocplanError
        If the tree is of another kind.
    """
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return tree
    if origin in (typing.Union, types.UnionType):
        return _decode_union(args, tree)
    if origin is typing.Literal:
        return _require_valid(tree, tree in args)
    if hasattr(origin, "__value__"):  # an alias, as NDArray is from Python 3.12 on
        return decode_tree(origin.__value__[args], tree)
    if origin is np.ndarray:
        return _decode_array(tree, args[1])
    if origin is not None:
        return _decode_collection(origin, args, tree)
    if kind is float:
        return _decode_number(tree)
    if kind in (int, str, bool, type(None)):
        return _require_valid(tree, type(tree) is kind)
    if maker := getattr(kind, "from_json", None) or getattr(kind, "from_summary", None):
        return maker(_require_mapping(tree))
    if kind is range or issubclass(kind, tuple):
        return kind(*_decode_numbers(_require_list(tree)))
    hints, derived = typing.get_type_hints(kind), getattr(kind, "derived", ())
    left_out = (*derived, *getattr(kind, "former", ()))
    fields = {
        name: subtree for name, subtree in _require_mapping(tree).items() if name not in left_out
    }
    return kind(**{name: decode_tree(hints[name], subtree) for name, subtree in fields.items()})


def _decode_collection(origin: Any, args: tuple[Any, ...], tree: Any) -> Any:
    """Return a tuple, list or dictionary of values from its tree."""
    if issubclass(origin, Mapping):
        return {
            name: decode_tree(args[1], subtree) for name, subtree in _require_mapping(tree).items()
        }
    if not issubclass(origin, tuple):
        return [decode_tree(args[0], subtree) for subtree in _require_list(tree)]
    member_kinds = args[:1] * len(tree) if args[-1] is ... else args
    return tuple(
        decode_tree(member_kind, subtree)
        for member_kind, subtree in zip(member_kinds, _require_list(tree), strict=True)
    )


def _decode_union(kinds: Sequence[Any], tree: Any) -> Any:
    """Return the value of the first type that fits the tree."""
    if tree is None and type(None) in kinds:
        return None
    for kind in kinds:
        try:
            return decode_tree(kind, tree)
        except (TypeError, ValueError, KeyError):
            continue
    raise ValueError(f"{short_repr(tree)} is none of its kinds")


def _decode_array(tree: Any, kind: Any) -> NDArray[Any]:
    """Return a read-only array of the type of a dtype[...]."""
    (scalar_type,) = typing.get_args(kind)
    dtype = np.dtype(
        scalar_type if isinstance(scalar_type, type) and scalar_type is not Any else None
    )
    if isinstance(tree, np.ndarray):
        _require_valid(tree, np.can_cast(tree.dtype, dtype, "same_kind"))
        values = tree.astype(dtype, copy=False)
    else:
        values = np.array(_decode_numbers(_require_list(tree)), dtype)
    values.setflags(write=False)
    return values


def _decode_numbers(tree: Any) -> Any:
    if isinstance(tree, list):
        return [_decode_numbers(subtree) for subtree in tree]
    return tree if type(tree) in (int, bool) else _decode_number(tree)


def _decode_number(tree: Any) -> float:
    if tree is None:
        return math.nan
    if tree in INFINITIES.values():
        return float(tree)
    return float(_require_valid(tree, type(tree) in (int, float)))


def _require_valid(tree: Any, is_valid: bool) -> Any:
    if not is_valid:
        raise ValueError(f"{short_repr(tree)} is of another kind")
    return tree


def _require_list(tree: Any) -> list[Any]:
    return cast("list[Any]", _require_valid(tree, isinstance(tree, list)))


def _require_mapping(tree: Any) -> dict[str, Any]:
    return cast("dict[str, Any]", _require_valid(tree, isinstance(tree, dict)))


def _strip_stamp(content: dict[str, Any]) -> dict[str, Any]:
    return {name: setting for name, setting in content.items() if name not in STAMP}


def _get_compared_fields(value: Any) -> list[dataclasses.Field[Any]]:
    return [
        dataclass_field for dataclass_field in dataclasses.fields(value) if dataclass_field.compare
    ]


def _are_equal(first: Any, second: Any) -> bool:
    if first is second:
        return True
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second, equal_nan=first.dtype.kind == second.dtype.kind == "f")
    if isinstance(first, (tuple, list)) and type(first) is type(second):
        return len(first) == len(second) and all(map(_are_equal, first, second))
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(
            _are_equal(first[name], second[name]) for name in first
        )
    return bool(first == second or (first != first and second != second))


def _hash_value(value: Any) -> int:
    if isinstance(value, np.ndarray):
        return hash((value.shape, (value + value.dtype.type(0)).tobytes()))  # 0 is -0, too
    if isinstance(value, Mapping):
        return hash(frozenset(value))
    if isinstance(value, (tuple, list)):
        return hash(tuple(map(_hash_value, value)))
    return 0 if value != value else hash(value)


def _read(file: Path) -> Any:
    """Read the tree of a file; None if it is damaged."""
    try:
        if file.suffix == ".json":
            return parse_json(read_bytes(file, MAX_SAVED_BYTES).decode("utf-8"))
        return _decode_arrays(read_arrays(file, MAX_SAVED_BYTES))
    except OSError as error:
        raise LocplanError(f"{file}: cannot be read ({error.strerror or error})") from None
    except (LookupError, TypeError, ValueError):
        return None


def _write_arrays(file: Path, content: Any) -> None:
    arrays: dict[str, NDArray[Any]] = {}

    def add_array(array: NDArray[Any]) -> dict[str, int]:
        number = len(arrays)
        arrays[str(number)] = array
        return {ARRAY: number}

    tree_text = np.array(json.dumps(content, default=add_array, allow_nan=False))
    write_arrays(file, {TREE_NAME: tree_text, **arrays})


def _decode_arrays(arrays: Mapping[str, NDArray[Any]]) -> Any:
    def resolve_array(tree: dict[str, Any]) -> Any:
        return arrays[str(int(tree[ARRAY]))] if tree.keys() == {ARRAY} else tree

    return parse_json(str(arrays[TREE_NAME]), resolve_array)
