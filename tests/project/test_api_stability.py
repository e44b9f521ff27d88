"""Public names and signatures do not change since the last tag unless the changelog announces it.

griffe reads both versions without importing them. A name is public if its package exports it: in
`__all__`, or in the stub of `locplan`, which loads its names lazily.
"""

from __future__ import annotations

import ast
import io
import re
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path

import griffe
import pytest

import locplan

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path(locplan.__file__).parent
OLD = {
    "__init__.py": "__getattr__, __dir__, __all__ = attach(__name__, __file__)\n",
    "__init__.pyi": """
from . import maps as maps
from .drives import Robot as Robot, plan as plan
""",
    "drives.py": """
from dataclasses import dataclass

@dataclass
class Robot:
    lidar: str
    radius: float = 0.2

    def load(self, file): ...

def plan(start, goal, *, seed=1): ...
def helper(start): ...
""",
    "maps/__init__.py": "from sample.maps.files import load, save\n__all__ = ['load', 'save']\n",
    "maps/files.py": "def load(file): ...\ndef save(grid, file): ...\n",
}
NEW = OLD | {
    "__init__.pyi": OLD["__init__.pyi"] + "from .drives import helper as helper\n",
    "drives.py": OLD["drives.py"]
    .replace("radius: float = 0.2", "radius: float = 0.3")
    .replace("load(self, file)", "load(self, path)")
    .replace("plan(start, goal, *, seed=1)", "plan(start, target, *, seed=1, threads=None)")
    .replace("helper(start)", "helper(begin)"),
    "maps/__init__.py": "from sample.maps.files import load\n__all__ = ['load']\n",
}
BREAKS = ["Robot load file", "Robot load path", "Robot radius", "plan goal", "plan target", "save"]


def load_package(folder: Path, name: str) -> griffe.Object:
    """Return a package as griffe reads it, with only its exported names public."""
    # Without False, griffe prefers a package of that name in the current folder.
    package = griffe.load(
        name,
        try_relative_path=False,
        search_paths=[folder],
        allow_inspection=False,
        resolve_aliases=True,
    )
    stub = ast.parse((folder / name / "__init__.pyi").read_text("utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    package.exports = [alias.asname for node in imports for alias in node.names if alias.asname]
    for module in list_modules(package):
        module.public = module is package or module.name in (module.parent.exports or ())
        hidden = [name for name, member in module.members.items() if not member.is_public]
        for name in hidden if module.public else ():
            if module.members[name].is_alias:  # an import that is no longer exported
                module.del_member(name)
    return package


def list_modules(module: griffe.Object) -> Iterator[griffe.Object]:
    yield module
    for child in module.modules.values():
        if not child.is_alias:
            yield from list_modules(child)


def find_breaks(old: griffe.Object, new: griffe.Object) -> dict[str, str]:
    """Return an explanation of each breaking change by the words that announce it."""
    breaks = {}
    for breakage in griffe.find_breaking_changes(old, new):
        words = list_names(breakage.obj)
        for value in (breakage.old_value, breakage.new_value):
            if isinstance(value, griffe.Parameter) and value.name not in words:
                words.append(value.name)
        breaks[" ".join(words)] = breakage.explain(griffe.ExplanationStyle.MARKDOWN)
    return breaks


def list_names(member: griffe.Object) -> list[str]:
    """Return the names of a member and of its class; those of a constructor are its class's."""
    if member.parent.is_class:
        return list_names(member.parent) + [member.name] * (member.name != "__init__")
    return [member.name]


def read_announcements(changelog: str, tag: str) -> list[set[str]]:
    """Return the words in backticks of each line on a change that came after a tag."""
    news = re.split(rf"^## \[?{re.escape(tag.removeprefix('v'))}\b", changelog, flags=re.M)[0]
    lines = re.findall(r"^- (?:Change|Remove)\b(?:.|\n(?=  ))*", news, re.M)
    return [set(re.findall(r"\w+", " ".join(re.findall(r"`(.+?)`", line)))) for line in lines]


def find_unannounced(breaks: dict[str, str], announcements: list[set[str]]) -> dict[str, str]:
    return {
        words: text
        for words, text in breaks.items()
        if not any(set(words.split()) <= named for named in announcements)
    }


def git(repository: Path, *words: str) -> bytes:
    return subprocess.run(("git", "-C", repository, *words), check=True, capture_output=True).stdout


def find_last_tag(repository: Path) -> str | None:
    """Return the last release's tag, or None without tags, without git, or outside a checkout."""
    try:
        top = Path(git(repository, "rev-parse", "--show-toplevel").decode().strip())
        if top.resolve() != repository.resolve():
            return None
        return git(repository, "describe", "--tags", "--abbrev=0", "--match", "v*").decode().strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def load_tag(repository: Path, tag: str, name: str, folder: Path) -> griffe.Object:
    archive = io.BytesIO(git(repository, "archive", "--format=zip", tag, name))
    zipfile.ZipFile(archive).extractall(folder)
    return load_package(folder, name)


def write_package(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        file = folder / "sample" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")
    return folder


@pytest.fixture
def repository(tmp_path):
    """A repository with a tag, and later changes that are not committed."""
    folder = write_package(tmp_path / "repository", OLD)
    git(folder, "init", "-q")
    git(folder, "add", ".")
    author = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    git(folder, *author, "commit", "-q", "-m", "Add sample")
    git(folder, *author, "tag", "-a", "-m", "0.1.0", "v0.1.0")
    return write_package(folder, NEW)


@pytest.fixture(scope="module")
def current():
    return load_package(PACKAGE.parent, "locplan")


def test_api_changes_since_tag_are_announced(current, tmp_path):
    tag = find_last_tag(ROOT)
    if tag is None:
        pytest.skip("no tag to compare with: none yet, a shallow clone, or no checkout")
    breaks = find_breaks(load_tag(ROOT, tag, "locplan", tmp_path), current)
    announcements = read_announcements((ROOT / "CHANGELOG.md").read_text("utf-8"), tag)
    unannounced = find_unannounced(breaks, announcements)
    lines = "\n".join(f"{text}, needs the names: {names}" for names, text in unannounced.items())
    assert not unannounced, (
        "add a line `- Change` or `- Remove` to CHANGELOG.md under Unreleased that has each of "
        f"these names in backticks:\n{lines}"
    )


def test_comparison_finds_breaks_since_tag(repository, tmp_path):
    assert find_last_tag(repository) == "v0.1.0"
    old = load_tag(repository, "v0.1.0", "sample", tmp_path / "old")
    breaks = find_breaks(old, load_package(repository, "sample"))
    assert sorted(breaks) == BREAKS
    assert breaks["Robot radius"] == (
        "- `Robot.__init__(radius)`: *Parameter default was changed*: `0.2` -> `0.3`"
    )


@pytest.mark.parametrize(
    ("line", "missing"),
    [
        ("- Change `plan`: `goal` is now `target`.", ["save"]),
        ("- Change `plan(goal=)`,\n  now `target`.\n- Remove `maps.save`.", []),
        (
            "- Fix `plan`: `goal` and `target`.\n- Remove save.",
            ["plan goal", "plan target", "save"],
        ),
        ("## 0.1.0\n\n- Change `plan`, `goal` to `target`.", ["plan goal", "plan target", "save"]),
    ],
)
def test_change_is_announced_by_its_names(line, missing):
    """Lines on the tagged version and earlier announce nothing that came after it."""
    changelog = f"# Changelog\n\n## Unreleased\n\n{line}\n\n## 0.1.0 (2026-01-01)\n"
    breaks = dict.fromkeys(["plan goal", "plan target", "save"], "")
    assert sorted(find_unannounced(breaks, read_announcements(changelog, "v0.1.0"))) == missing


def test_folder_without_own_tags_is_skipped(repository, tmp_path):
    """A source archive may lie inside another project's checkout."""
    assert find_last_tag(tmp_path) is None
    assert find_last_tag(repository / "sample") is None


def test_every_exported_name_is_compared(current, tmp_path):
    """The lazy names of `locplan` and those of its packages are public to griffe."""
    shutil.copytree(PACKAGE, tmp_path / "locplan", ignore=shutil.ignore_patterns("page", "*.pyc"))
    stub = tmp_path / "locplan" / "__init__.pyi"
    stub.write_text(stub.read_text("utf-8").replace("import Sad as Sad", "import Sad"), "utf-8")
    module = tmp_path / "locplan" / "simulation" / "recommender.py"
    text = module.read_text("utf-8").replace("    goal: Position,", "    target: Position,", 1)
    module.write_text(text, "utf-8")
    breaks = find_breaks(current, load_package(tmp_path, "locplan"))
    assert sorted(breaks) == ["Sad", "recommend_path goal", "recommend_path target"]
    assert {name for name, member in current.members.items() if member.is_public} >= set(
        locplan.__all__
    )
