"""The explorer's long answers as the page asks for them, and the page that is handed on."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from explorer_views import (
    GOAL,
    LIDAR,
    MIDDLE,
    ROBOT,
    START,
    WAY,
    Ended,
    Session,
    answered,
    corridors,
    ending_after,
    session_of,
)
from made_drives import recorded

from locplan.errors import ConfigError, LocplanError
from locplan.explorer import Opening, RecordedDrive, _long
from locplan.field import FieldConfig, Fisher
from locplan.maps import OCCUPIED
from locplan.matching import ScanDatabase, make_database
from locplan.recordings import Recording, match_scans
from locplan.robots import Lidar
from locplan.twins import PLACE_SPACING, find_twins

LONG = ("front", "simulate", "landmarks", "reproduce", "export")


@pytest.fixture(scope="module")
def session():
    made = session_of()
    yield made
    made.close()


def test_a_simulation_is_answered_with_intervals_and_profiles(session):
    told = answered(session, "simulate", **{**WAY, "via": [list(MIDDLE)], "weight": 12}, drives=3)
    assert told["taken"] in {each["name"] for each in told["candidates"]}
    for each in told["candidates"]:
        assert len(each["driven"]["error"]) == len(each["driven"]["lost_rate"]) == 3
        distance, median, _, high = np.array(each["driven"]["profile"]).T
        assert distance[-1] == pytest.approx(each["metrics"]["length"], abs=0.2)
        assert (high >= median).all()


def test_the_robot_of_the_command_line_is_simulated():
    session = session_of(robot=ROBOT.changed({"laser_model_type": "likelihood_field_prob"}))
    told = answered(session, "simulate", **{**WAY, "via": [list(MIDDLE)], "weight": 12}, drives=2)
    assert "likelihood_field_prob" in told["driven"]
    session.close()


def test_the_command_names_the_file_that_was_opened(session):
    assert "save_map" in answered(session, "reproduce", **WAY)["shell"]
    named = session_of(map_file="my maps/lab.yaml")
    told = answered(named, "reproduce", **WAY)
    assert "locplan plan 'my maps/lab.yaml' --start 2" in told["shell"]
    stroke = {"tool": "pole", "points": [[20.0, 8.0]], "width": 0.3}
    answered(named, "edit", strokes=[stroke])
    named.latest.result(60)
    for text in answered(named, "reproduce", **WAY).values():
        assert text.startswith("# my maps/lab.yaml is not the map on the page")
    named.close()


def test_exports_go_to_the_folder_of_the_command_line_only(session, tmp_path):
    with pytest.raises(ConfigError, match="folder"):
        answered(session, "export", **WAY)
    with_folder = session_of(folder=tmp_path)
    told = answered(with_folder, "export", **WAY, to="path")
    assert [each.name for each in tmp_path.iterdir()] == told["files"]
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
        answered(session, do, **{**WAY, **wrong})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("do", "wrong"),
    [
        ("front", {"time_limit": 0}),
        ("front", {"time_limit": "1"}),
        ("simulate", {"drives": 10**6}),
        ("simulate", {"drives": 2.5}),
        ("landmarks", {"object": "pole:1e9"}),
        ("landmarks", {"object": 3}),
        ("landmarks", {"count": 0}),
        ("landmarks", {"drives": 1}),
        ("export", {"to": "../../x"}),
        ("export", {"distro": "melodic"}),
        ("twins", {"x": 1.0}),
        ("twins", {"x": 1.0, "y": "2"}),
        ("share", {"view": [1]}),
        ("share", {"view": {"start": "here", "goal": [1, 2]}}),
    ],
)
def test_malformed_settings_are_refused_in_one_line(tmp_path, session, do, wrong):
    before = session.opening
    session.opening = dataclasses.replace(before, folder=tmp_path)
    try:
        with pytest.raises(LocplanError) as error:
            answered(session, do, **{**WAY, **wrong})
        assert "\n" not in str(error.value)
        assert not list(tmp_path.iterdir())
    finally:
        session.opening = before


@pytest.mark.parametrize("do", [*LONG, "share"])
def test_without_a_field_every_long_ask_says_so(do, tmp_path):
    bare = session_of(with_field=False, folder=tmp_path)
    with pytest.raises(ConfigError, match="field"):
        answered(bare, do, **WAY, view=WAY)
    bare.close()


@pytest.mark.parametrize("do", ["simulate", "landmarks", "share", "export"])
def test_a_cancelled_ask_goes_no_further(session, do, tmp_path):
    progress, seen = ending_after(1)
    with pytest.raises(Ended):
        answered(session, do, progress=progress, **WAY, view=WAY)
    assert len(seen) == 1
    assert not list(tmp_path.iterdir())


# Recorded drives


def test_a_recorded_drive_is_told_of_and_answered():
    poses = np.column_stack([np.linspace(3, 30, 40), np.full(40, 3.0), np.zeros(40)])
    ranges = np.full((40, 12), 1.0)
    drive = RecordedDrive("tour.bag", Recording(ranges, Lidar(range=6.0, beams=12), poses))
    session = session_of(drives=(drive,))
    (told,) = session.about()["drives"]
    assert (told["name"], told["scans"], told["duration"]) == ("tour.bag", 40, None)
    shown = answered(session, "drive", drive=0)
    assert shown == json.loads(json.dumps(shown_on(session), allow_nan=False))
    assert shown["timed"] is False
    assert len(shown["t"]) == len(shown["unlike"]) == 40
    session.close()


def shown_on(session: Session) -> dict[str, object]:
    """The session's drive on its present map."""
    return session.opening.drives[0].shown(session.grid)


def toured_session() -> Session:
    """A session with a drive along the corridors, of which a scan has no return."""
    grid, _ = corridors()
    poses = np.column_stack([np.linspace(3, 30, 12), np.full(12, 3.0), np.zeros(12)])
    drive = recorded(grid, poses, lidar=Lidar(range=6.0, beams=60))
    ranges = drive.ranges.copy()
    ranges[4] = np.inf
    drive = dataclasses.replace(drive, ranges=ranges)
    return session_of(with_field=False, drives=(RecordedDrive("tour", drive),))


def test_the_scans_of_a_drive_are_matched_once_a_map(monkeypatch):
    session, runs = toured_session(), []
    monkeypatch.setattr(
        "locplan.recordings.match_scans",
        lambda *given, **more: runs.append(1) or match_scans(*given, **more),
    )
    assert set(shown_on(session)["sd"]) == {None}  # the page shows it before it is matched
    assert runs == []
    calls = []
    told = answered(session, "match", progress=lambda *n: calls.append(n), drive=0)
    drive = session.opening.drives[0].recording
    expected = match_scans(drive, session.grid).position_std
    assert told["sd"] == [round(v, 4) if np.isfinite(v) else None for v in expected.tolist()]
    assert told["sd"][4] is None
    assert (told["map"], calls[-1]) == (session.grid.digest, (11, 11))
    assert told["unlike"] == shown_on(session)["unlike"]
    assert answered(session, "match", drive=0) == told
    assert len(runs) == 1
    cells = session.grid.cells.copy()
    cells[20:24, 150:160] = OCCUPIED
    session.grid = dataclasses.replace(session.grid, cells=cells)
    edited = answered(session, "match", drive=0)
    assert (edited["map"], len(runs)) == (session.grid.digest, 2)
    assert edited["sd"] != told["sd"]
    session.close()


def test_matching_is_cancelled_and_keeps_nothing():
    session, (progress, _) = toured_session(), ending_after(1)
    with pytest.raises(Ended):
        answered(session, "match", progress=progress, drive=0)
    assert session.files.get(("match", 0, session.grid.digest)) is None
    session.close()


@pytest.mark.parametrize("given", [{}, {"drive": 1}, {"drive": -1}, {"drive": "0"}, {"drive": 0.5}])
def test_a_drive_that_is_not_there_is_refused(given):
    session = toured_session()
    for do in ("drive", "match"):
        with pytest.raises(ConfigError, match="drive must be"):
            answered(session, do, **given)
    session.close()


def test_without_drives_there_is_nothing_to_match(session):
    with pytest.raises(ConfigError, match="--drive FILE"):
        answered(session, "match", drive=0)


# Look-alikes


def test_look_alikes_are_those_of_the_library_from_one_database(session, monkeypatch):
    made = []
    session.kept.forget(lambda key: key[0] != "scans")
    making = "locplan.matching._scan_database.make_database"
    monkeypatch.setattr(making, lambda *given: made.append(given) or make_database(*given))
    for x, y in ((2.0, 3.0), (2.4, 3.0), (2.0, 3.4)):
        told = answered(session, "twins", x=x, y=y)
        found = find_twins(session.grid, ROBOT, places=[(told["x"], told["y"])])
        assert told["elsewhere"] == pytest.approx(found.elsewhere[0])
        assert told["modes"] == found.modes[0]
        alike = [each for each in found.of(0) if each.excess <= 3.0]
        assert [(each["x"], each["y"]) for each in told["twins"]] == [(e.x, e.y) for e in alike]
    assert len(made) == 2  # the page's, and that of the searches beside it
    kept = session.kept._results["scans", session.scene.serial, session.grid.digest, LIDAR]
    assert kept[1] > 4 * session.grid.cells.size  # the losses alone take four bytes a cell


def test_look_alikes_can_be_cancelled_while_the_places_are_looked_from(session):
    session.kept.forget(lambda key: key[0] != "scans")
    calls = []

    def progress(done, total, doing=""):
        calls.append(doing)
        if len(calls) == 3:
            raise Ended

    with pytest.raises(Ended):
        answered(session, "twins", progress=progress, x=2.0, y=3.0)
    assert calls == ["looking from all places"] * 3
    assert not [key for key in session.kept._results if key[0] == "scans"]
    assert answered(session, "twins", x=2.0, y=3.0)["modes"] >= 0


def test_a_place_in_a_wall_is_moved(session):
    wall = session.grid.cell_to_world(*np.argwhere(session.grid.cells == 0)[0].tolist())
    told = answered(session, "twins", x=wall[0], y=wall[1])
    assert session.scene.costs.cell_of((told["x"], told["y"]))


# Look-alikes of the whole map


@pytest.fixture
def coarse(monkeypatch):
    """Few places, so that the search is quick."""
    monkeypatch.setattr("locplan.explorer._long.spacing_of", lambda database: 3.0)


@pytest.fixture
def own():
    """A session whose map may be changed."""
    made = session_of()
    yield made
    made.close()


def twins_told(session: Session) -> dict[str, object] | None:
    """What the page is told of the layer of look-alikes; None where it is not offered."""
    return next((each for each in session.state()["layers"] if each["name"] == "twins"), None)


def test_look_alikes_of_the_map_are_a_layer_beside_the_fields(own, coarse):
    events = []
    own.listeners.append(events.append)
    assert twins_told(own) is None
    calls = []
    told = answered(own, "twins_everywhere", progress=lambda *n: calls.append(n[:2]))
    stride = own.field.stride
    found = find_twins(own.grid, ROBOT, spacing=3.0)
    assert told == {
        **{"layer": "twins", "alike": 3.0, "spacing": 3.0},
        **{"share": found.share, "places": len(found)},
    }
    assert calls[-2][0] == calls[-2][1] == 2 * len(found)
    assert {"event": "state"} in events
    layer = twins_told(own)
    assert (layer["unit"], layer["anchors"], layer["scale"]) == ("nat", [12.0, 0.0], "linear")
    assert layer["present"][0] > layer["present"][1]
    texture = own.textures(layer["digest"])["twins"]
    excess = np.clip(found.layer("excess")[::stride, ::stride], 0, 12)
    np.testing.assert_array_equal(texture.values, excess)
    assert texture.values.shape == own.field.covariance.shape[:2]
    steps = texture.texels[::-1]
    assert (steps[excess == 0] == 255).all()  # the worst places have the last colour
    assert (steps[excess == 12] == 1).all()
    assert (steps[np.isnan(excess)] == 0).all()
    assert {0.0, 12.0} <= set(excess.ravel().tolist())
    page = answered(own, "share", view=WAY)
    assert '"twins":"' in own.download(page["download"]).content.decode()


def test_the_layer_of_look_alikes_goes_with_the_map_and_comes_with_undo(own, coarse):
    answered(own, "twins_everywhere")
    before = twins_told(own)
    answered(own, "edit", strokes=[{"tool": "pole", "points": [[20.0, 8.0]], "width": 0.3}])
    assert twins_told(own) is None
    own.latest.result(60)
    assert twins_told(own) is None
    answered(own, "undo")
    own.latest.result(60)
    assert twins_told(own) == before


def test_the_layer_of_look_alikes_goes_with_the_lidar(own, coarse):
    answered(own, "twins_everywhere")
    own.config = FieldConfig(Fisher(Lidar(range=5.0)), stride=0.4)
    assert twins_told(own) is None


@pytest.mark.parametrize("how", ["cancelled", "edited"])
def test_look_alikes_that_are_out_of_date_are_not_sought_to_the_end(own, coarse, how):
    answered(own, "twins", x=MIDDLE[0], y=MIDDLE[1])  # the scans of all places are made now
    calls = []

    def progress(done, total, doing=""):
        calls.append((done, total))
        if how == "cancelled" and done:
            raise Ended
        if done:
            stroke = {"tool": "pole", "points": [[20.0, 8.0]], "width": 0.3}
            answered(own, "edit", strokes=[stroke])

    error, why = {"cancelled": (Ended, None), "edited": (ConfigError, "meanwhile")}[how]
    with pytest.raises(error, match=why):
        answered(own, "twins_everywhere", progress=progress)
    assert calls[-1][0] < calls[-1][1]
    assert own.twins is None


def test_places_are_thinned_where_all_would_take_too_long():
    grid, _ = corridors()
    database = ScanDatabase(grid, Lidar(range=6.0), 0.2)
    assert _long.spacing_of(database) == PLACE_SPACING
    rooms = dataclasses.replace(grid, resolution=2.0)
    wide = ScanDatabase(rooms, Lidar(range=6.0, field_of_view_deg=90.0), 0.2)
    assert _long.spacing_of(wide) > 2.0


# The page that is handed on


def shared_file(session: Session, folder: Path) -> Path:
    """A shared page on the disk."""
    told = answered(session, "share", view={**WAY, "layer": "sigma"})
    found = session.download(told["download"])
    assert (found.name, len(found.content)) == (told["name"], told["bytes"])
    assert found.media_type == "text/html"
    file = folder / told["name"]
    file.write_bytes(found.content)
    return file


def test_a_shared_page_tells_no_folder_of_the_machine(tmp_path):
    session = session_of(
        folder=tmp_path / "secret-place", map_file=str(tmp_path / "secret-place" / "lab.yaml")
    )
    text = shared_file(session, tmp_path).read_text()
    assert "secret-place" not in text
    assert '"aware":{"xy":' in text.replace('"aware":{"length"', '"aware":{"xy":')
    session.close()


def test_a_view_that_changes_while_it_is_packed_is_not_shared(own, monkeypatch):
    def edited(session, ask, work):
        session.scene = dataclasses.replace(session.scene, serial=session.scene.serial + 1)

    monkeypatch.setattr("locplan.explorer._sharing.plan", edited)
    with pytest.raises(ConfigError, match="share the view again"):
        answered(own, "share", view={"start": list(START), "goal": list(GOAL)})


def test_a_shared_page_opens_from_the_disk_and_paints(tmp_path):
    api = pytest.importorskip("playwright.sync_api")
    browser_file = next((f for f in map(Path, CHROMIUMS) if f.exists()), None)
    if browser_file is None:
        pytest.skip("no Chromium is here")
    grid, field = corridors()
    name = "</script><img src=x onerror=alert(1)>"
    named = dataclasses.replace(grid, name=name)
    session = Session(named, Opening(field.config))
    session.begin().result(120)
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
        page.locator("html[data-state=ready]").wait_for(timeout=60_000)
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
