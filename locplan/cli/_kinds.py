"""Options of several kinds of a thing, such as formats; each kind has a dataclass of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from typing import Annotated, Any, get_type_hints

from cyclopts import Group, Parameter

from locplan._util.public import field_docs
from locplan.errors import ConfigError


def joint_options(kinds: Mapping[str, type], group: Group, but: Collection[str] = ()) -> type:
    """A dataclass with the options of all kinds but some; one that was not given is None."""
    docs: dict[str, dict[str, list[str]]] = {}
    types: dict[str, Any] = {}
    for kind, options in kinds.items():
        types |= get_type_hints(options)
        for name, doc in ((n, d) for n, d in field_docs(options).items() if n not in but):
            docs.setdefault(name, {}).setdefault(doc.removesuffix("."), []).append(kind)
    fields = []
    for name, sentences in docs.items():
        help = " ".join(f"{doc} ({', '.join(having)})." for doc, having in sentences.items())
        fields.append((name, Annotated[types[name] | None, Parameter(help=help)], None))
    own = {"__module__": __name__}
    joint = dataclasses.make_dataclass("JointOptions", fields, frozen=True, namespace=own)
    return Parameter(name="*", group=group)(joint)


def options_of(
    kinds: Mapping[str, type], kind: str, switch: str, joint: Any, **others: object
) -> Any:
    """The options of one kind from those given; `switch` is the option that chooses the kind.

    An option that is given and not for this kind is a ConfigError; others are then left out.
    """
    given = given_of(joint)
    for name in given:
        having = [each for each in kinds if name in field_names(kinds[each])]
        check_has(f"--{name.replace('_', '-')}", switch, kind, having)
    known = field_names(kinds[kind])
    return kinds[kind](**given, **{name: others[name] for name in others if name in known})


def field_names(kind: Any) -> list[str]:
    """The names of a dataclass's fields."""
    return [each.name for each in dataclasses.fields(kind)]


def check_has(option: str, switch: str, kind: str, having: list[str]) -> None:
    """Raise a ConfigError unless the kind is one of those that have the option."""
    if kind not in having:
        raise ConfigError(f"{option} is for {switch} {', '.join(having)}, not for {kind}")


def given_of(options: Any) -> dict[str, Any]:
    """The options that were given, by name."""
    return {name: value for name, value in vars(options).items() if value is not None}
