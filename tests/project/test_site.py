"""The site of the documentation: a page for each public name, a search index, no broken links."""

from __future__ import annotations

import importlib.util
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

from locplan._support.records import Result
from locplan.app.cli.application import COMMANDS
from locplan.robots import LIDARS

PROJECT = Path(__file__).resolve().parents[2]
EXAMPLES = PROJECT / "examples"

pytest.importorskip("sphinx", reason="the packages of the extra docs are not installed")


def load_program(name, monkeypatch):
    """Return a program of the folder examples as a module."""
    spec = importlib.util.spec_from_file_location(f"locplan_{name}", EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    monkeypatch.syspath_prepend(EXAMPLES)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def site(monkeypatch):
    """The program that builds the site."""
    return load_program("site", monkeypatch)


@pytest.fixture
def reference(monkeypatch):
    """The program that makes the pages of the reference."""
    return load_program("reference", monkeypatch)


@pytest.fixture(scope="module")
def built_site(tmp_path_factory):
    """The folder of the built site, without gallery and results."""
    folder = tmp_path_factory.mktemp("site")
    line = [sys.executable, EXAMPLES / "site.py", folder, "--quick"]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.long
def test_site_is_searchable_and_complete(built_site):
    assert (built_site / "searchindex.js").stat().st_size > 100_000
    for page in ("index", "evidence", "gallery/index", "results", "api/index"):
        assert (built_site / f"{page}.html").is_file()
    for name in COMMANDS:
        page = (built_site / f"reference/commands/{name}.html").read_text("utf-8")
        assert f"locplan {name}" in page
        assert 'id="usage"' in page


@pytest.mark.long
def test_every_public_name_has_page(built_site, site, tmp_path):
    sources = site.Site(tmp_path, tmp_path)
    modules = sources.modules
    assert {"locplan", "locplan.planning.ompl", "locplan.maps.environments"} <= modules.keys()
    for name, module in modules.items():
        listing = (built_site / "api" / f"{name}.html").read_text("utf-8")
        for last in site.list_names(module):
            thing = getattr(module, last)
            if not inspect.ismodule(thing):
                home = sources.homes[site.make_key(last, thing)]
                assert f'href="{home}.html"' in listing
                assert f'id="{home}"' in (built_site / "api" / f"{home}.html").read_text("utf-8")


def test_site_reports_broken_links(site, tmp_path):
    (tmp_path / "a.html").write_text('<a href="b.html#x">1</a><a href="b.html#y">2</a>')
    (tmp_path / "b.html").write_text('<p id="x"></p><img src="c.png"><a href="https://d.e">3</a>')
    assert site.find_broken_links(tmp_path) == [
        "a.html: broken link b.html#y",
        "b.html: broken link c.png",
    ]


def test_file_links_become_page_links(site, tmp_path):
    sources = site.Site(tmp_path, tmp_path)
    sources.pages = {PROJECT / "README.md": "index", PROJECT / "locplan/maps": "api/locplan.maps"}
    text = "[a](../../README.md#x) [b](../../locplan/maps) `[c](d.md)` [e](https://f.g) [h](#i)"
    assert sources.rewrite_links(text, EXAMPLES / "guides", "guides/start") == (
        "[a](../index.md#x) [b](../api/locplan.maps.rst) `[c](d.md)` [e](https://f.g) [h](#i)"
    )
    linked = sources.rewrite_links("![k](../choice.png)", EXAMPLES / "guides", "guides/start")
    assert linked == "![k](../pictures/examples/choice.png)"
    assert (tmp_path / "sources/pictures/examples/choice.png").is_file()


def test_site_never_replaces_other_files(site, tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(SystemExit, match="holds other files"):
        site.Site(tmp_path, tmp_path).clear()
    (tmp_path / ".buildinfo").touch()
    (tmp_path / ".cache").mkdir()
    site.Site(tmp_path, tmp_path).clear()
    assert [file.name for file in tmp_path.iterdir()] == [".cache"]


def test_site_keeps_results_until_changes(site, tmp_path, monkeypatch):
    made = []
    sources = site.Site(tmp_path, tmp_path)
    for _ in range(2):
        sources.keep("gallery", made.append)
    monkeypatch.setattr(site, "PROJECT", tmp_path)
    sources.keep("gallery", made.append)
    assert len(made) == 2


def test_source_page_shows_linked_program(site, tmp_path):
    sources = site.Site(tmp_path, tmp_path)
    linked = sources.rewrite_links("[c](../compare.py)", EXAMPLES / "guides", "guides/start")
    assert linked == "[c](../source/examples/compare.py.md)"
    sources.write_source_page(sources.waiting.pop())
    page = (tmp_path / "sources/source/examples/compare.py.md").read_text("utf-8")
    assert (EXAMPLES / "compare.py").read_text("utf-8") in page


def test_hidden_file_has_visible_page(site, tmp_path):
    """The action that uploads the site to GitHub leaves out hidden files and folders."""
    linked = site.Site(tmp_path, tmp_path).rewrite_links("[c](.ci/run)", PROJECT, "contributing")
    assert linked == "[c](source/ci/run.md)"


def test_page_signature_has_no_types(site):
    args = "(costs: Costmap, *, seed: int = 1, limits: Limits = <factory>) -> Plan"
    signature = site.remove_types(None, "function", "", None, None, args.partition(" ->")[0], "")
    assert signature == ("(costs, *, seed=1, limits=...)", "")


def test_reference_explains_every_file_and_name(reference):
    declared = [files for by_words in reference.RESULTS.values() for files in by_words.values()]
    for files in declared:
        listed = dict(reference.list_files(files))
        assert all(listed[f"`{name}`"] for name in files.names)
    assert f"`{next(iter(LIDARS))}`" in reference.make_lidars_page()
    assert "| `alpha1` |" in reference.make_settings_page()
    assert "`time_limit`" in reference.make_planners_page()
    assert "`--slowest` | 0.3" in reference.make_formats_page()


def test_help_becomes_tables(reference):
    box = (
        "╭─ Options ──────╮\n│ *  --a X|Y  Word `b`.  [required] │\n│    --c -d   Text. │\n╰────╯\n"
    )
    text = f"Usage: locplan x [OPTIONS]\n\nDo\nit.\n\nExamples\n  locplan x 1 \\\n      2\n\n{box}"
    page = reference.convert_help(text)
    assert page.startswith("Do it.\n\n```sh\nlocplan x 1 \\\n    2\n```\n")
    assert "## Usage\n\n```text\nlocplan x [OPTIONS]\n```" in page
    assert r"| `--a X\|Y` | Word `b`. [required] |" in page
    assert "| `--c -d` | Text. |" in page


def test_reference_lists_files_of_results(reference):
    declared = [files for by_words in reference.RESULTS.values() for files in by_words.values()]
    only_in_python = {"faults", "path-check", "plan", "trajectory"}
    kinds = {
        kind.files.kind
        for kind in find_subclasses(Result)
        if "files" in vars(kind) and kind.__module__.startswith("locplan.")
    }
    assert kinds - {files.kind for files in declared} == only_in_python


def find_subclasses(kind):
    """Yield a class's subclasses, their subclasses, and so on."""
    for subclass in kind.__subclasses__():
        yield subclass
        yield from find_subclasses(subclass)
