"""The help of every public name is enough to use it: each parameter and field is described."""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import pydoc
import re
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import locplan
from locplan._support.public import read_field_docs

SEE = re.compile(r"\b[Ss]ee ((?:`[\w.]+`(?:, | and | or )?)+)")
BOUND = (classmethod, staticmethod)
MEMBERS = (types.FunctionType, *BOUND, property, functools.cached_property)
KINDS = (type, types.FunctionType)


class Place(NamedTuple):
    """A public name, and where it is defined."""

    name: str
    thing: Any
    owner: type | None = None
    """The class of a method or property."""

    @property
    def module(self) -> Any:
        return sys.modules[(self.owner or self.thing).__module__]

    @property
    def package(self) -> str:
        return self.module.__name__.split(".")[1]

    @property
    def doc(self) -> str:
        """What help() shows."""
        return (
            pydoc.getdoc(self.thing)
            if inspect.isclass(self.thing)
            else inspect.getdoc(self.thing) or ""
        )


def faces(package: Any = locplan) -> Iterator[Any]:
    """The package, and the packages and modules that it names."""
    yield package
    for name in getattr(package, "__all__", ()):
        if inspect.ismodule(getattr(package, name)):
            yield from faces(getattr(package, name))


def named_by(face: Any) -> Iterator[Any]:
    """The classes and functions that a package names, or that a module defines."""
    named = getattr(face, "__all__", None)
    for name in dir(face) if named is None else named:
        thing = getattr(face, name)
        home = getattr(thing, "__module__", "") if isinstance(thing, KINDS) else ""
        known = home == face.__name__ if named is None else home.startswith("locplan.")
        if known and not name.startswith("_"):
            yield thing


def bases(kind: type) -> list[type]:
    """A class and its bases of ours."""
    return [base for base in kind.__mro__ if base.__module__.startswith("locplan.")]


def places() -> Iterator[Place]:
    """All public classes and functions, with the methods and properties that help() shows."""
    things = dict.fromkeys(thing for face in faces() for thing in named_by(face))
    for thing in things:
        yield Place(thing.__qualname__, thing)
    classes = [thing for thing in things if inspect.isclass(thing)]
    for owner in dict.fromkeys(base for kind in classes for base in bases(kind)):
        for name, value in vars(owner).items():
            public = not name.startswith("_") and name not in fields_of(owner)
            made = getattr(value, "__module__", "") == "matplotlib.artist"  # such as Artist.set
            if public and not made and isinstance(value, MEMBERS):
                called = getattr(owner, name) if isinstance(value, BOUND) else value
                yield Place(f"{owner.__qualname__}.{name}", called, owner)


def fields_of(kind: type) -> list[str]:
    """What a class is made of: its fields, or the parameters of its own `__init__`."""
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind) if field.init]
    if "__init__" in vars(kind) and not getattr(kind, "_is_protocol", False):
        return list(inspect.signature(kind).parameters)
    return list(getattr(kind, "_fields", ()))


PLACES = list(places())
CLASSES = [place for place in PLACES if inspect.isclass(place.thing)]


@functools.cache
def classes_of(module: str) -> dict[str, ast.ClassDef]:
    """The classes of a module, as they are written."""
    tree = ast.parse(Path(sys.modules[module].__file__).read_text("utf-8"))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def described(doc: str) -> dict[str, str]:
    """The descriptions in the section Parameters by name."""
    found = re.search(r"^Parameters\n-{10}\n(.*?)(?=\n\n[A-Z]\w+\n-{3,}|\Z)", doc, re.DOTALL | re.M)
    texts: dict[str, str] = {}
    names: list[str] = []
    for line in filter(None, found[1].splitlines() if found else ()):
        if line[0] != " ":
            names = [name.strip(" *") for name in line.partition(" : ")[0].split(",")]
            texts |= dict.fromkeys(names, "")
        else:
            texts |= {name: f"{texts[name]} {line.strip()}" for name in names}
    return texts


def resolved(name: str, place: Place) -> Any:
    """What a name in a docstring stands for; None if nothing."""
    package = getattr(locplan, place.package, None)
    kind = place.thing if inspect.isclass(place.thing) else None
    for start in (place.owner, kind, place.module, package, locplan):
        first, *rest = name.removeprefix("locplan.").split(".")
        at = start
        for part in (first, *rest):
            fields = getattr(at, "__dataclass_fields__", {})
            at = fields[part] if part in fields else getattr(at, part, None)
            if at is None:
                break
        if at is not None:
            return at
    return None


def undescribed(place: Place, wanted: list[str]) -> list[str]:
    """Those of a function's parameters that neither it describes, nor what it refers to."""
    known = described(place.doc)
    own_text = place.doc.partition("Parameters\n---")[0]
    missing = []
    for name in wanted:
        text = known.get(name, own_text if name not in known else "")
        targets = [resolved(one, place) for one in references(text)]
        calls = [one for one in targets if isinstance(one, (*KINDS, types.MethodType))]
        plain = name not in known or re.match(r" See `", text)  # all that is said stands there
        if not text.strip() or (
            plain and not any(name in described(inspect.getdoc(one) or "") for one in calls)
        ):
            missing.append(name)
    return missing


def references(text: str) -> list[str]:
    """The names that a text refers its reader to."""
    return [name for group in SEE.findall(text) for name in re.findall(r"`([\w.]+)`", group)]


def test_every_parameter_is_described():
    lacking, unknown = {}, {}
    for place in PLACES:
        if inspect.isfunction(place.thing) or inspect.ismethod(place.thing):
            names = [name for name in inspect.signature(place.thing).parameters if name != "self"]
            lacking[place.name] = undescribed(place, names)
            unknown[place.name] = [name for name in described(place.doc) if name not in names]
    assert {name: names for name, names in lacking.items() if names} == {}
    assert {name: names for name, names in unknown.items() if names} == {}


def test_docstrings_state_actual_defaults():
    wrong = []
    for place in PLACES:
        if not (inspect.isfunction(place.thing) or inspect.ismethod(place.thing)):
            continue
        parameters = inspect.signature(place.thing).parameters
        for names, text in re.findall(r"^([\w*, ]+) : .*?, default (.*)$", place.doc, re.MULTILINE):
            for name in names.split(", "):
                default = parameters[name.strip("*")].default
                told = text.replace('"', "'").strip("`").replace("_", "")
                constants = [name for name, value in vars(place.module).items() if value is default]
                known = [repr(default), getattr(default, "__name__", ""), *constants]
                if told not in [each.replace("_", "") for each in known]:
                    wrong.append((place.name, name, text, default))
    assert wrong == []


def test_every_default_is_told():
    silent = []
    for place in PLACES:
        if inspect.isfunction(place.thing) or inspect.ismethod(place.thing):
            for name, parameter in inspect.signature(place.thing).parameters.items():
                given = re.search(rf"^(?:[\w*]+, )*{name}(?:, [\w*]+)* : (.*)$", place.doc, re.M)
                if parameter.default is not inspect.Parameter.empty and given:
                    word = "optional" if parameter.default is None else "default"
                    silent += [] if word in given[1] else [(place.name, name)]
    assert silent == []


def test_every_field_is_described():
    lacking = {}
    for place in CLASSES:
        known = read_field_docs(place.thing) | described(place.doc)
        names = [name for name in fields_of(place.thing) if not name.startswith("_")]
        lacking[place.name] = [name for name in names if not known.get(name, "").strip()]
    assert {name: names for name, names in lacking.items() if names} == {}


def test_every_name_has_docstring():
    written = [place.name for place in PLACES if not place.doc]
    for place in CLASSES:  # dataclass writes one where there is none
        node = classes_of(place.module.__name__)[place.thing.__name__]
        written += [] if ast.get_docstring(node) else [place.name]
    assert written == []


def test_every_reference_leads_somewhere():
    dead = []
    for place in PLACES:
        for name in references(place.doc):
            if resolved(name, place) is None:
                dead.append((place.name, name))
    assert dead == []
