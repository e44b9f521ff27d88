"""What a view is handed on as: exports, and a page."""

import base64
import contextlib
import dataclasses
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from support.explorer_views import MIDDLE, WAY, ask_session, corridors, open_session

import locplan
from locplan.errors import ConfigError, LocplanError
from locplan.export import nav2_keepout
from locplan.maps import FREE, OCCUPIED, UNKNOWN
from locplan.planning import Costmap
from locplan.robots import Robot

# Exports


PAGE_FORMATS = ("nav2-keepout", "nav2-speed", "path")


def exported(folder, *, force=False, grid=None, progress=lambda *_: None, **asked):
    """What the page gets of an export into a folder."""
    with contextlib.ExitStack() as ends:
        session = open_session(with_field=grid is None, folder=folder, force=force)
        ends.callback(session.close)
        if grid is not None:
            session.original = session.grid = grid
            own = dataclasses.replace(corridors()[1], grid=grid)
            session.begin(own).result()
        return ask_session(session, "export", progress=progress, **(WAY | asked))


def test_an_export_is_that_of_the_library(tmp_path):
    made = exported(tmp_path / "out", to="nav2-keepout", distro="kilted")
    assert "kilted" in " ".join(made["warnings"])  # what Nav2 does wrong there
    costs = Costmap.from_field(*corridors(), weight=3.0, robot=Robot())
    with pytest.warns(UserWarning, match="kilted"):
        nav2_keepout(tmp_path / "own", costs, distro="kilted")
    own = {each.name for each in (tmp_path / "own").iterdir()}
    folder = "two_corridors-nav2-keepout"
    assert set(made["files"]) == {f"{folder}/{name}" for name in own}
    for name in own:
        mine = (tmp_path / "out" / folder / name).read_bytes()
        assert mine == (tmp_path / "own" / name).read_bytes(), name


@pytest.mark.parametrize("to", PAGE_FORMATS)
def test_each_format_is_written(tmp_path, to):
    files = exported(tmp_path, to=to)["files"]
    assert files
    assert all((tmp_path / name).is_file() for name in files)


def test_a_path_is_exported_through_its_waypoints(tmp_path):
    (file,) = exported(tmp_path, to="path", via=[list(MIDDLE)])["files"]
    xy = locplan.Path.load(tmp_path / file).xy
    assert np.isclose(xy, MIDDLE, atol=1e-6).all(axis=1).any()


def test_an_export_beside_another_gets_a_number(tmp_path):
    first, second = (exported(tmp_path, to="path")["files"] for _ in range(2))
    before = (tmp_path / first[0]).read_bytes()
    assert (first, second) == (["two_corridors-path.csv"], ["two_corridors-path-2.csv"])
    (tmp_path / second[0]).write_text("mine")
    forced = exported(tmp_path, to="path", via=[list(MIDDLE)], force=True)
    assert forced["files"] == first
    assert (tmp_path / first[0]).read_bytes() != before
    assert (tmp_path / second[0]).read_text() == "mine"


def test_a_link_to_nowhere_is_in_the_way(tmp_path):
    (tmp_path / "two_corridors-path.csv").symlink_to(tmp_path / "gone")
    assert exported(tmp_path, to="path")["files"] == ["two_corridors-path-2.csv"]


def test_force_keeps_other_files_of_a_folder(tmp_path):
    made = exported(tmp_path, to="nav2-speed")
    mine = tmp_path / made["files"][0]
    before = mine.read_bytes()
    mine.write_text("mine")
    mine.with_name("mine").write_text("mine")
    exported(tmp_path, to="nav2-speed", force=True)
    assert mine.read_bytes() == before
    assert mine.with_name("mine").read_text() == "mine"


@pytest.mark.parametrize("name", ["../../etc", "a/b", "..", "", "naïve map", "x" * 500, "\ufffd"])
def test_no_name_of_a_map_leaves_the_folder(tmp_path, name):
    grid, _ = corridors()
    named = dataclasses.replace(grid, name=name)
    (file,) = exported(tmp_path / "o", grid=named, to="path")["files"]
    assert [each.name for each in tmp_path.iterdir()] == ["o"]
    assert Path(file).name == file
    assert (tmp_path / "o" / file).is_file()


@pytest.mark.parametrize(
    ("folder", "asked", "named"),
    [
        (None, {}, "folder"),
        ("out", {"to": "no-such"}, "to must be one of"),
        ("out", {"to": ["path"]}, "to must be one of"),
        ("out", {"distro": "no-such"}, "distro"),
    ],
)
def test_exports_refuse_what_is_unknown(tmp_path, folder, asked, named):
    with pytest.raises(ConfigError, match=named):
        exported(folder and tmp_path / folder, **asked)
    assert not list(tmp_path.iterdir())


# The page to share


def tiny(folder: Path) -> Path:
    """A page of two modules."""
    folder.mkdir()
    (folder / "index.html").write_text(
        '<!doctype html><html><head>\n<title>x</title>\n<link rel="icon" href="static/i.svg">\n'
        '<link rel="stylesheet" href="static/s.css">\n</head><body><p id="p"></p>\n'
        '<script type="module" src="static/main.js"></script>\n</body></html>\n'
    )
    (folder / "i.svg").write_text("<svg/>")
    (folder / "s.css").write_text("p { color: red }")
    (folder / "main.js").write_text('import { a } from "./a.js";\n\na("</script><!--");\n')
    (folder / "a.js").write_text("export function a(x) {\n  return x;\n}\nexport const b = 1;\n")
    return folder


def page_of(monkeypatch=None, static=None, **named) -> str:
    """A page of the corridors that is handed on, of the files in another folder perhaps."""
    if static is not None:
        monkeypatch.setattr("locplan.app.explorer.sharing.STATIC", static)
    session = open_session()
    session.original = dataclasses.replace(session.original, **named)
    told = ask_session(session, "share", view={**WAY, "layer": "sigma"})
    content = session.download(told["download"]).content
    assert told["bytes"] == len(content)
    session.close()
    return content.decode()


def page_data(page: str) -> dict:
    """What a page carries."""
    return json.loads(re.search(r"window\.LOCPLAN = (.*?);</script>", page).group(1))


def modules_of(page: str) -> str:
    """The modules of a page as one script."""
    return re.search(r'<script type="module">(.*?)</script>', page, re.S).group(1)


def test_modules_are_joined_in_the_order_of_their_imports(tmp_path, monkeypatch):
    page = page_of(monkeypatch, tiny(tmp_path / "static"))
    expected = 'function a(x) {\n  return x;\n}\nconst b = 1;\n\n\na("\\x3c/script>\\x3c!--");\n'
    assert modules_of(page) == expected


@pytest.mark.parametrize(
    ("file", "text", "named"),
    [
        ("a.js", "export default 3;\n", "export default"),
        ("index.html", '<html><head></head><img src="static/a.png"></html>', "no page"),
    ],
)
def test_a_page_that_cannot_be_joined_is_refused(tmp_path, monkeypatch, file, text, named):
    folder = tiny(tmp_path / "static")
    (folder / file).write_text(text)
    with pytest.raises(LocplanError, match=named):
        page_of(monkeypatch, folder)


def test_no_text_within_ends_the_script(tmp_path, monkeypatch):
    hostile = '</script><script>alert("&")</script>\u2028<!-- <b>"&'
    page = page_of(monkeypatch, tiny(tmp_path / "static"), name=hostile)
    named = page_data(page)["about"]["map"]["name"]
    assert named.startswith('</script><script>alert("&")</script>')
    assert page.count("<script") == page.count("</script>") == 2
    assert "alert(" in page
    assert "<title>&lt;/script&gt;&lt;script&gt;alert(&quot;&amp;&quot;)" in page
    data = re.search(r"window\.LOCPLAN = (.*?);</script>", page).group(1)
    assert not set("<>&\u2028") & set(data)


def test_the_policy_allows_just_what_is_inside():
    import hashlib

    page = page_of()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    rules = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert rules["default-src"] == "'none'"
    for kind, pattern in (("script", r"<script[^>]*>(.*?)</script>"), ("style", "<style>(.*?)</s")):
        inside = re.findall(pattern, page, re.S)
        digests = [base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() for t in inside]
        assert rules[f"{kind}-src"].split() == [f"'sha256-{each}'" for each in digests]
    assert page.index("Content-Security-Policy") < page.index("<script")


def test_a_shared_page_carries_map_layers_and_answer():
    page, (grid, field) = page_of(), corridors()
    data = page_data(page)
    cells = np.frombuffer(zlib.decompress(base64.b64decode(data["cells"])), np.uint8)
    levels = np.array([UNKNOWN, FREE, OCCUPIED])[cells].reshape(grid.shape)
    np.testing.assert_array_equal(levels[::-1], grid.cells)
    sigma = zlib.decompress(base64.b64decode(data["layers"]["sigma"]))
    assert len(sigma) == field.evaluated.size
    assert data["answer"]["aware"]["length"] > data["answer"]["shortest"]["length"]
    assert data["view"]["layer"] == "sigma"
    assert data["about"]["can"] == {}
    assert data["state"]["busy"] is None
    assert "<title>two_corridors · fisher · locplan</title>" in page
    assert page_of() == page


def test_a_shared_page_asks_nobody_for_anything():
    text = page_of()
    outside = set(re.findall(r"(?:https?:)?//[\w.-]+\.\w+[^\s\"'`]*", text))
    assert not {each for each in outside if not each.startswith("http://www.w3.org/")}
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    assert "@import" not in text
    assert not re.search(r"url\((?!['\"]?(?:data:|#))", text)


def test_modules_of_the_page_name_no_two_things_alike():
    script = modules_of(page_of())
    names = re.findall(r"^(?:async )?(?:function\*?|const|let|class) ([\w$]+)", script, re.M)
    pairs = re.findall(r"^(?:const|let) [\[{]([^\]}]*)[\]}] =", script, re.M)
    names += [
        each.split(":")[-1].split("=")[0].strip() for pair in pairs for each in pair.split(",")
    ]
    assert names
    assert not {name for name in names if names.count(name) > 1}


# The notebook


@pytest.mark.parametrize("kernel", [None, object()])
def test_in_a_notebook_alone_the_page_is_a_frame(monkeypatch, kernel):
    import sys
    import types

    shell = types.SimpleNamespace(kernel=kernel)
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    with locplan.explore(*corridors(), open_browser=False) as page:
        html = page._repr_html_()
    assert (html is None) == (kernel is None)
    if html:
        assert html.count(page.address) == 2
