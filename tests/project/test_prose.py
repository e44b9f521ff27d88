"""Limits on vague names, repeated names, hidden arguments and twisted English."""

from __future__ import annotations

import ast
import re
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]


def split_words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


VAGUE_WORDS = split_words(
    """
    about again alike alone another apart aside asked away begun beside besides better beyond
    both checked chosen done drawn driven each enough every few found given here how instead it
    its joined judged kept known least like likeliest likely listed made many meant mine more
    most moved much named needed none one opened others ours own planned raised said searched
    seen shown so some such sure taken that theirs there these this those together told tried
    tuned turned usual wanted what when where which who whole why worse wrapped
    """
)
"""Words that name nothing: a variable is vague if it is or begins with one."""
GENERIC_NAMES = split_words(
    """
    elem element elements entries entry info item items obj res ret stuff thing things tmp val
    vals
    """
)
PREPOSITIONS = split_words(
    """
    about against along around beside between by for from near of on to under with within
    without
    """
)
"""Words that a function's name must not end in."""
PARTICIPLE = re.compile(r"[a-z]+(ed|en)|made|kept|told|found|said|held|left|lost|seen|shown|drawn")
NOT_PARTICIPLES = split_words(
    """
    elapsed embed exceed feed flatten golden hidden lengthen listen need open proceed read
    screen seed shorten speed straighten succeed tighten token widen
    """
)
MARKERS = {
    "code that speaks": r"\b(says?|said|tells?|told)\b",
    "where or else for if": r"((^|[.;:] |\()Where\b|[,;] where (it|they|that|no|the|a)\b"
    r"|\b[Ee]lse\b(?! if))",
    "relative clause as a noun": r"\b(what|who|whose|how|where|which)"
    r" (is|are|was|were|it|they|the|a|an|its|that|can|has|have|does)\b",
    "rare word": r"\b(lest|anew|besides?|seldom|hardly|foresee[ns]?|forth|whoever|wherever|alike"
    r"|likeliest|dearer|thereby|in force|all over)\b",
    "trailing too": r", too\b",
    "pronoun for a noun": r"\b(one that|those that|that of|those of)\b",
    "own and other": r"\b(own|others?|one's)\b",
}
"""Patterns of sentences that a native engineer would not say, by their fault."""


class Module(NamedTuple):
    """A Python file of the package."""

    place: str
    tree: ast.Module


@cache
def read_modules() -> tuple[Module, ...]:
    """Return every module of the package, parsed."""
    paths = sorted((ROOT / "locplan").rglob("*.py"))
    return tuple(Module(str(p.relative_to(ROOT)), ast.parse(p.read_text("utf-8"))) for p in paths)


def is_vague(name: str) -> bool:
    """True if a variable's name is a function word, or begins with one."""
    first, *others = name.strip("_").lower().split("_")
    return first in VAGUE_WORDS and not (others and first in ("most", "least", "how"))


def is_vague_function(name: str) -> bool:
    """True if a function is named by a function word, a participle, or up to a preposition."""
    plain = name.strip("_").lower()
    if name.startswith("__") or plain in NOT_PARTICIPLES:
        return False
    is_participle = "_" not in plain and PARTICIPLE.fullmatch(plain)
    return plain in VAGUE_WORDS or plain.split("_")[-1] in PREPOSITIONS or bool(is_participle)


@cache
def bindings() -> tuple[tuple[str, str], ...]:
    """Return place and name of every variable, argument and attribute that is assigned."""
    names = []
    for place, tree in read_modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                names.append((f"{place}:{node.lineno}", node.id))
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                names.append((f"{place}:{node.lineno}", node.attr))
            elif isinstance(node, ast.arg) and node.arg not in ("self", "cls"):
                names.append((f"{place}:{node.lineno}", node.arg))
    return tuple((place, name) for place, name in names if name != "_")


@cache
def nodes_of(*kinds: type[ast.AST]) -> tuple[tuple[str, ast.AST], ...]:
    """Return place and node of every node of some kinds."""
    return tuple(
        (f"{place}:{node.lineno}", node)
        for place, tree in read_modules()
        for node in ast.walk(tree)
        if isinstance(node, kinds)
    )


def check_share(offenders: list[str], total: int, limit: float) -> None:
    """Fail with all offenders if they are more than `limit` of 1,000."""
    share = 1000 * len(offenders) / total
    assert share <= limit, f"{share:.1f} per 1,000, limit {limit}:\n" + "\n".join(offenders)


def check_count(offenders: list[str], limit: int) -> None:
    """Fail with all offenders if there are more than `limit`."""
    assert len(offenders) <= limit, f"{len(offenders)}, limit {limit}:\n" + "\n".join(offenders)


def repeated(places_by_name: dict[str, list[str]]) -> list[str]:
    """Return the names that have several places, with these."""
    return [f"{name}: {', '.join(p)}" for name, p in places_by_name.items() if len(p) > 1]


def find_markers(place: str, text: str) -> list[str]:
    """Return an excerpt for each marker of twisted English in a text."""
    return [
        f"{place} [{marker}] {text[max(0, match.start() - 40) : match.end() + 40]}"
        for marker, pattern in MARKERS.items()
        for match in re.finditer(pattern, text)
    ]


def check_markers(texts: list[tuple[str, str]], limit: float) -> None:
    """Fail with all markers of some texts if they are more than `limit` of 1,000 words."""
    plain = [(place, re.sub(r"`[^`]*`", "x", text)) for place, text in texts]
    markers = [marker for place, text in plain for marker in find_markers(place, text)]
    check_share(markers, sum(len(text.split()) for _, text in plain), limit)


def strip_markdown(text: str) -> str:
    """Return the prose of a page: no code, table, HTML or address of a link."""
    text = re.sub(r"^(```|~~~).*?^(```|~~~)\s*$", "", text, flags=re.M | re.S)
    text = re.sub(r"^\s*\|.*$|^\s*<.*$", "", text, flags=re.M)
    return re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)


def read_pages() -> list[tuple[str, str]]:
    """Return place and prose of every page, except the JOSS paper, which has its limit."""
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    pages += sorted(page for page in (ROOT / "examples").rglob("*.md") if "joss" not in page.parts)
    return [(str(p.relative_to(ROOT)), strip_markdown(p.read_text("utf-8"))) for p in pages]


def test_variables_name_things():
    vague = [f"{place} {name}" for place, name in bindings() if is_vague(name)]
    check_share(vague, len(bindings()), 5)


def test_variables_are_rarely_generic():
    generic = [f"{p} {name}" for p, name in bindings() if name.strip("_") in GENERIC_NAMES]
    check_share(generic, len(bindings()), 10)


def test_functions_are_verbs():
    functions = nodes_of(ast.FunctionDef, ast.AsyncFunctionDef)
    vague = [f"{place} {node.name}" for place, node in functions if is_vague_function(node.name)]
    check_share(vague, len(functions), 15)


def test_class_names_are_unique():
    places = defaultdict(list)
    for place, node in nodes_of(ast.ClassDef):
        places[node.name].append(place)
    assert repeated(places) == []


def test_public_names_are_rarely_repeated():
    places = defaultdict(list)
    for place, tree in read_modules():
        for node in tree.body:
            is_definition = isinstance(node, ast.FunctionDef | ast.ClassDef)
            if is_definition and "/cli/" not in place and not node.name.startswith("_"):
                places[node.name].append(f"{place}:{node.lineno}")
    check_count(repeated(places), 20)


def test_calls_rarely_hide_arguments():
    calls = nodes_of(ast.Call)
    hidden = [place for place, call in calls if any(word.arg is None for word in call.keywords)]
    listing = [
        f"{count:3} {path}" for path, count in Counter(p.split(":")[0] for p in hidden).items()
    ]
    assert len(hidden) <= 60, "\n".join(listing)


def test_docstrings_are_plain():
    docstrings = [
        (place, re.sub(r">>>.*", "", text))
        for place, node in nodes_of(ast.ClassDef, ast.FunctionDef)
        if (text := ast.get_docstring(node))
    ]
    docstrings += [
        (place, re.sub(r">>>.*", "", text))
        for place, tree in read_modules()
        if (text := ast.get_docstring(tree))
    ]
    check_markers(docstrings, 5)


def test_pages_are_short():
    counts = {place: len(text.split()) for place, text in read_pages()}
    assert sum(counts.values()) <= 19_000, counts


def test_pages_are_plain():
    paper = strip_markdown((ROOT / "examples" / "joss" / "paper.md").read_text("utf-8"))
    check_markers([*read_pages(), ("examples/joss/paper.md", paper)], 8)


@pytest.mark.parametrize(
    ("name", "vague"),
    [("each", True), ("own_seed", True), ("most_cells", False), ("route", False), ("_found", True)],
)
def test_vague_variable_is_recognized(name, vague):
    assert is_vague(name) is vague


@pytest.mark.parametrize(
    ("name", "vague"),
    [("judged", True), ("values_of", True), ("read", False), ("plan_path", False), ("_lost", True)],
)
def test_vague_function_is_recognized(name, vague):
    assert is_vague_function(name) is vague


def test_twisted_sentence_is_recognized():
    assert len(find_markers("page", "It says which of what is found holds, too.")) == 3
    assert find_markers("page", "The report shows the error of each fix.") == []
