"""What PyPI and GitHub show: addresses, authors, README, licences, workflows."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
ADDRESS = re.compile(
    r"(?:github\.com/|githubusercontent\.com/|https://)([\w-]+)(?:\.github\.io)?/locplan\b"
)
"""An address of this project, with the account."""
PERMISSIVE = re.compile(
    r"\b(0BSD|any-OSI|Apache|BSD|CC0|HPND|ISC|MIT|MPL-2\.0|PSF|Python Software Foundation|Unlicense"
    r"|Zlib)\b"
)
"""Licences that allow use by a project under Apache-2.0."""


@cache
def read_project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def list_text_files() -> list[Path]:
    """Return the text files of the project at which a reader finds an address."""
    suffixes = {".md", ".toml", ".cff", ".yml", ".yaml", ".xml", ".py", ".rst"}
    folders = (ROOT, *(ROOT / name for name in (".github", "examples", "locplan", "tests")))
    files = {file for folder in folders[1:] for file in folder.rglob("*") if file.is_file()}
    files |= {file for file in ROOT.iterdir() if file.is_file()}
    return sorted(
        file
        for file in files
        if file.suffix in suffixes and "node_modules" not in file.parts and file != Path(__file__)
    )


def test_addresses_name_one_account():
    """One command of pyproject.toml replaces the account in all files."""
    accounts: dict[str, list[str]] = {}
    for file in list_text_files():
        for account in ADDRESS.findall(file.read_text("utf-8")):
            accounts.setdefault(account, []).append(file.relative_to(ROOT).as_posix())
    assert len(accounts) == 1, accounts
    (files,) = accounts.values()
    assert {"pyproject.toml", "CITATION.cff", ".github/SECURITY.md"} <= {*files}


def test_citation_names_package_authors():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    project = read_project()["project"]

    def full_name(author: dict[str, str]) -> str:
        parts = (author.get("given-names"), author.get("family-names"))
        return author.get("name") or " ".join(filter(None, parts))

    assert [full_name(author) for author in citation["authors"]] == [
        author["name"] for author in project["authors"]
    ]
    assert citation["repository-code"] == project["urls"]["Source"]


def make_readme_of_pypi() -> str:
    """Return the README as the build edits it."""
    hook = read_project()["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    text = "".join((ROOT / part["path"]).read_text("utf-8") for part in hook["fragments"])
    for rule in hook["substitutions"]:
        text = re.sub(rule["pattern"], rule["replacement"], text)
    return text


def test_readme_of_pypi_needs_no_checkout():
    """Its first command installs the package, and all commands but the tests' use built-in maps."""
    text = make_readme_of_pypi()
    first = re.search(r"```sh\n(.+)\n```", text)
    assert first is not None
    assert "pip install locplan --no-compile && " in first[1]
    assert " plan hall --start" in first[1]
    assert "maps/" not in text


def test_pypi_readme_has_absolute_links():
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "README.md").read_text("utf-8"))
    text = make_readme_of_pypi()
    absolute = re.findall(r"\]\(([^)]+)\)", text)
    assert len(absolute) == len(links)
    assert all(link.startswith("https://") for link in absolute)
    for link, address in zip(links, absolute, strict=True):
        assert address.endswith(link)
        is_raw = "raw.githubusercontent.com" in address
        assert is_raw == link.endswith((".gif", ".png"))
    assert "<!-- evidence" not in text


def test_licences_of_dependencies_are_permissive(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "examples")
    import reference

    licences = reference.list_licences()
    assert {"numpy", "numba", "opencv-python-headless", "contourpy"} <= licences.keys()
    assert {name: text for name, text in licences.items() if not PERMISSIVE.search(text)} == {}


@pytest.mark.parametrize("file", WORKFLOWS, ids=lambda file: file.stem)
def test_workflows_name_files_that_exist(file):
    jobs = yaml.safe_load(file.read_text("utf-8"))["jobs"]
    steps = [step for job in jobs.values() for step in job.get("steps", ())]
    text = "\n".join(step.get("run", "") for step in steps)
    for name in re.findall(r"(?:\.ci|examples)/[\w./]+", text):
        assert (ROOT / name).exists(), name
    for named in re.findall(r"[).]\[((?:\w+,?)+)\$?", text):
        extras = {*filter(None, named.split(","))}
        assert extras <= read_project()["project"]["optional-dependencies"].keys()


def test_workflows_pin_actions():
    """A commit cannot change under us, and one version of an action serves all workflows."""
    text = "\n".join(file.read_text("utf-8") for file in WORKFLOWS)
    actions = set(re.findall(r"uses: (?!\./)(.+)", text))
    pinned = {action for action in actions if re.fullmatch(r".+@[0-9a-f]{40} # v[\d.]+", action)}
    assert actions == pinned
    assert len({action.partition("@")[0] for action in actions}) == len(actions) > 5


def test_workflow_tests_declared_pythons():
    workflow = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text("utf-8"))
    tested = workflow["jobs"]["suite"]["strategy"]["matrix"]["python"]
    classifiers = read_project()["project"]["classifiers"]
    declared = re.findall(r"Python :: (3\.\d+)", "\n".join(classifiers))
    assert declared == tested


def test_matrix_tests_every_extra():
    """A new extra joins the cells of `.ci/matrix` and the uses of `.ci/smoke.py`."""
    extras = read_project()["project"]["optional-dependencies"].keys() - {"docs", "test"}
    matrix = (ROOT / ".ci" / "matrix").read_text("utf-8")
    listed = re.search(r'EXTRAS="([\w ]+)"', matrix)
    assert listed
    assert {*listed[1].split(), "ompl"} == extras
    smoke = (ROOT / ".ci" / "smoke.py").read_text("utf-8")
    uses = re.search(r"^USES.*?^}", smoke, re.M | re.S)
    assert uses
    assert {*re.findall(r'"(\w+)":', uses[0])} == extras
