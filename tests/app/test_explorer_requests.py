"""The explorer's long answers as the page asks for them, and the page that is handed on."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from support.explorer_views import (
    GOAL,
    MIDDLE,
    ROBOT,
    START,
    WAY,
    Interrupted,
    Session,
    ask_session,
    corridors,
    interrupt_after,
    open_session,
)
from support.machine import TIMEOUT

from locplan.app.explorer.scene import Opening
from locplan.errors import ConfigError, LocplanError

LONG = ("simulate", "export")


@pytest.fixture(scope="module")
def session():
    made = open_session()
    yield made
    made.close()


def test_a_simulation_is_answered_with_intervals_and_profiles(session):
    told = ask_session(
        session, "simulate", **{**WAY, "via": [list(MIDDLE)], "weight": 12}, drives=3
    )
    assert told["taken"] in {each["name"] for each in told["candidates"]}
    for each in told["candidates"]:
        assert len(each["driven"]["error"]) == len(each["driven"]["lost_rate"]) == 3
        distance, median, _, high = np.array(each["driven"]["profile"]).T
        assert distance[-1] == pytest.approx(each["metrics"]["length"], abs=0.2)
        assert (high >= median).all()


def test_the_robot_of_the_command_line_is_simulated():
    session = open_session(robot=ROBOT.changed({"laser_model_type": "likelihood_field_prob"}))
    told = ask_session(
        session, "simulate", **{**WAY, "via": [list(MIDDLE)], "weight": 12}, drives=2
    )
    assert "likelihood_field_prob" in told["driven"]
    session.close()


def test_exports_go_to_the_folder_of_the_command_line_only(session, tmp_path):
    with pytest.raises(ConfigError, match="folder"):
        ask_session(session, "export", **WAY)
    with_folder = open_session(folder=tmp_path)
    told = ask_session(with_folder, "export", **WAY, to="path")
    (file,) = told["files"]
    assert {each.name for each in tmp_path.iterdir()} == {file, f"{file}.run.yaml"}
    with_folder.close()


@pytest.mark.parametrize("do", LONG)
@pytest.mark.parametrize(
    "wrong",
    [
        {"start": None},
        {"start": [1.0]},
        {"start": ["2", 3]},
        {"goal": [1e12, 0]},
        {"goal": {"x": 1}},
        {"via": [[1, 2, 3]]},
        {"via": "all"},
        {"via": [[2.0, 3.0]] * 51},
        {"weight": -1},
        {"weight": 1e9},
        {"weight": "much"},
        {"start": [-500.0, -500.0]},
    ],
)
def test_malformed_ways_are_refused_in_one_line(session, do, wrong):
    with pytest.raises(LocplanError) as error:
        ask_session(session, do, **{**WAY, **wrong})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("do", "wrong"),
    [
        ("simulate", {"drives": 10**6}),
        ("simulate", {"drives": 2.5}),
        ("export", {"to": "../../x"}),
        ("export", {"distro": "melodic"}),
        ("share", {"view": [1]}),
        ("share", {"view": {"start": "here", "goal": [1, 2]}}),
    ],
)
def test_malformed_settings_are_refused_in_one_line(tmp_path, session, do, wrong):
    before = session.opening
    session.opening = dataclasses.replace(before, folder=tmp_path)
    try:
        with pytest.raises(LocplanError) as error:
            ask_session(session, do, **{**WAY, **wrong})
        assert "\n" not in str(error.value)
        assert not list(tmp_path.iterdir())
    finally:
        session.opening = before


@pytest.mark.parametrize("do", [*LONG, "share"])
def test_without_a_field_every_long_ask_says_so(do, tmp_path):
    bare = open_session(with_field=False, folder=tmp_path)
    with pytest.raises(ConfigError, match="field"):
        ask_session(bare, do, **WAY, view=WAY)
    bare.close()


@pytest.mark.parametrize("do", ["simulate", "share", "export"])
def test_a_cancelled_ask_goes_no_further(session, do, tmp_path):
    progress, seen = interrupt_after(1)
    with pytest.raises(Interrupted):
        ask_session(session, do, progress=progress, **WAY, view=WAY)
    assert len(seen) == 1
    assert not list(tmp_path.iterdir())


@pytest.fixture
def own():
    """A session whose map may be changed."""
    made = open_session()
    yield made
    made.close()


# The page that is handed on


def shared_file(session: Session, folder: Path) -> Path:
    """A shared page on the disk."""
    told = ask_session(session, "share", view={**WAY, "layer": "sigma"})
    found = session.download(told["download"])
    assert (found.name, len(found.content)) == (told["name"], told["bytes"])
    assert found.media_type == "text/html"
    file = folder / told["name"]
    file.write_bytes(found.content)
    return file


def test_a_shared_page_tells_no_folder_of_the_machine(tmp_path):
    session = open_session(folder=tmp_path / "secret-place")
    text = shared_file(session, tmp_path).read_text()
    assert "secret-place" not in text
    assert '"aware":{"xy":' in text.replace('"aware":{"length"', '"aware":{"xy":')
    session.close()


def test_a_view_that_changes_while_it_is_packed_is_not_shared(own, monkeypatch):
    def edited(session, ask, work):
        session.scene = dataclasses.replace(session.scene, serial=session.scene.serial + 1)

    monkeypatch.setattr("locplan.app.explorer.sharing.plan", edited)
    with pytest.raises(ConfigError, match="share the view again"):
        ask_session(own, "share", view={"start": list(START), "goal": list(GOAL)})


@pytest.mark.long
def test_a_shared_page_opens_from_the_disk_and_paints(tmp_path):
    api = pytest.importorskip("playwright.sync_api")
    browser_file = next((f for f in map(Path, CHROMIUMS) if f.exists()), None)
    if browser_file is None:
        pytest.skip("no Chromium is here")
    grid, field = corridors()
    name = "</script><img src=x onerror=alert(1)>"
    named = dataclasses.replace(grid, name=name)
    session = Session(named, Opening(field.config))
    session.begin().result()
    file = shared_file(session, tmp_path)
    asked, faults = [], []
    with api.sync_playwright() as playwright:
        arguments = ["--no-sandbox"]
        browser = playwright.chromium.launch(executable_path=browser_file, args=arguments)
        page = browser.new_page(viewport={"width": 900, "height": 700})
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda said: said.type == "error" and faults.append(said.text))
        page.on("dialog", lambda dialog: faults.append("a dialog"))
        page.goto(file.as_uri())
        page.locator("html[data-state=ready]").wait_for(timeout=1000 * TIMEOUT)
        page.locator("canvas").first.wait_for()
        shot = page.locator("#stage").screenshot()
        browser.close()
    assert asked == [file.as_uri()]
    assert faults == []
    assert colours_of(shot) > 50
    session.close()


CHROMIUMS = ("/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome")


def colours_of(png: bytes) -> int:
    """Number of colours of a picture."""
    import cv2

    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    return len(np.unique(pixels.reshape(-1, 3), axis=0))
