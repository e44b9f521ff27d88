"""The shared page: one file that needs no server."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import re
import zlib

import numpy as np
import pytest
from support.explorer_sessions import (
    ROUTE,
    Interrupted,
    ask,
    corridors,
    interrupt_after,
    open_corridors,
)

from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.session import Session
from locplan.errors import ConfigError
from locplan.maps import FREE, OCCUPIED, UNKNOWN


@pytest.fixture
def small_page(tmp_path, monkeypatch):
    """The files of a page of one line."""
    (tmp_path / "index.html").write_text(
        '<!doctype html><html><head>\n<title>x</title>\n<link rel="icon" href="icon.svg">\n'
        '<link rel="stylesheet" href="page.css">\n</head><body><p id="p"></p>\n'
        '<script type="module" src="page.js"></script>\n</body></html>\n'
    )
    (tmp_path / "icon.svg").write_text("<svg/>")
    (tmp_path / "page.css").write_text("p { color: red }")
    (tmp_path / "page.js").write_text('f("</script><!--");\r\n')
    monkeypatch.setattr("locplan.app.explorer.sharing.PAGE", tmp_path)
    return tmp_path


def share(name: str = "two_corridors", **values) -> str:
    """Return a shared page of the corridors."""
    grid, field = corridors()
    grid = dataclasses.replace(grid, name=name)
    field = dataclasses.replace(field, grid=grid)
    session = Session(grid, StartSettings(field.config, folder=None))
    session.begin(field)
    session.wait()
    answer = ask(session, "share", **ROUTE, route="key", view={"layer": "deviation"}, **values)
    download = session.files.get(("download", answer["download"]))
    assert download.name.endswith("-locplan.html")
    session.close()
    return download.content.decode()


def read_data(page: str) -> dict:
    return json.loads(re.search(r"window\.LOCPLAN = (.*?);</script>", page).group(1))


def test_shared_page_contains_map_and_plan(small_page):
    page, (grid, field) = share(), corridors()
    data = read_data(page)
    cells = np.frombuffer(zlib.decompress(base64.b64decode(data["cells"])), np.uint8)
    levels = np.array([UNKNOWN, FREE, OCCUPIED])[cells].reshape(grid.shape)
    np.testing.assert_array_equal(levels[::-1], grid.cells)
    assert set(data["layers"]) == {"degeneracy", "deviation"}
    deviation = zlib.decompress(base64.b64decode(data["layers"]["deviation"]))
    assert len(deviation) == field.is_evaluated.size
    assert data["plan"]["recommended"]["length"] > data["plan"]["shortest"]["length"]
    assert data["plan"]["basis"] == {**data["state"]["basis"], "route": "key"}
    assert data["view"] == {"layer": "deviation"}
    assert not data["about"]["can_export"]
    assert data["state"]["busy"] is None
    assert "<title>two_corridors – locplan</title>" in page


def test_equal_views_make_equal_pages(small_page):
    assert share() == share()


def test_policy_allows_only_inline_texts(small_page):
    page = share()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    for kind, pattern in (("script", r"<script[^>]*>(.*?)</script>"), ("style", "<style>(.*?)</s")):
        texts = re.findall(pattern, page, re.S)
        digests = [base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() for t in texts]
        assert rules[f"{kind}-src"].split() == [f"'sha256-{digest}'" for digest in digests]
    assert page.index("Content-Security-Policy") < page.index("<script")
    assert 'f("\\x3c/script>\\x3c!--");\n' in page
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)


def test_user_text_cannot_end_script(small_page):
    hostile = '</script><script>alert("&")</script>\u2028<!-- <b>"&'
    page = share(name=hostile)
    assert read_data(page)["about"]["map"]["name"].startswith('</script><script>alert("&")')
    assert page.count("<script") == page.count("</script>") == 2
    assert "<title>&lt;/script&gt;&lt;script&gt;alert(&quot;&amp;&quot;)" in page
    data = re.search(r"window\.LOCPLAN = (.*?);</script>", page).group(1)
    assert not set("<>&\u2028") & set(data)


def test_built_page_can_be_shared():
    page = share()
    assert page.count("window.LOCPLAN = ") >= 1
    assert page.count("<title>") == 1


def test_shared_page_names_no_folder(small_page, tmp_path):
    session = open_corridors(folder=tmp_path / "secret-place")
    answer = ask(session, "share", **ROUTE, view={})
    assert b"secret-place" not in session.files.get(("download", answer["download"])).content
    session.close()


def test_share_refuses_change_during_packing(small_page, monkeypatch):
    session = open_corridors()

    def change(session, scene, question, job):
        session.scene = dataclasses.replace(scene)

    monkeypatch.setattr("locplan.app.explorer.sharing.plan_route", change)
    with pytest.raises(ConfigError, match="share the page again"):
        ask(session, "share", **ROUTE, view={})


def test_cancelled_share_ends(small_page):
    progress, seen = interrupt_after(1)
    session = open_corridors()
    with pytest.raises(Interrupted):
        ask(session, "share", progress=progress, **ROUTE, view={})
    assert len(seen) == 1
