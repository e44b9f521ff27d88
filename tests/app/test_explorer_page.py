"""The explorer's page, as people use it: in a real browser, on a real server."""

from __future__ import annotations

import json
import math
import re

import pytest
from support.cases import sample_cases
from support.explorer_page import STATIC, Seen, browser_file, corridors, serve

from locplan.field import load_or_compute
from locplan.maps import OccupancyGrid

pytest.importorskip("starlette", reason="the explorer's server is not installed")
pytestmark = pytest.mark.skipif(browser_file() is None, reason="no chromium on this machine")


TEAL, RED = (8, 122, 126), (178, 20, 66)
"""Colours of the aware path, and of the simulated path with the greatest error, on a light page."""


def test_the_paths_follow_while_the_goal_is_dragged(visit):
    seen = visit()
    painted, length = seen.value("painted"), seen.text("#shortest-length")
    seen.drag(".marker.goal", -160, 0, release=False)
    seen.await_change("painted", painted)
    assert seen.text("#shortest-length") != length
    assert seen.page.locator(".marker.goal.held").count() == 1
    seen.page.mouse.up()
    seen.page.locator("#live", has_text="Aware path").wait_for(state="attached")
    x, y = seen.place("goal")
    assert seen.text("#shortest-length").endswith("m")
    assert seen.page.locator(".marker.held").count() == 0
    assert 0 < x < 42
    assert -2 < y < 16


@pytest.mark.long
def test_arrows_move_a_marker_by_4_cells_and_with_shift_by_20(visit):
    seen = visit()
    seen.page.locator(".marker.start").focus()
    painted, (x, y) = seen.value("painted"), seen.place("start")
    seen.page.keyboard.press("ArrowRight")
    seen.await_change("painted", painted)
    assert seen.place("start") == pytest.approx((x + 0.4, y), abs=0.11)
    seen.page.keyboard.press("Shift+ArrowRight")
    assert seen.place("start") == pytest.approx((x + 2.4, y), abs=0.21)


def test_a_greater_weight_buys_fewer_degenerate_metres(visit):
    seen = visit()
    seen.page.locator("#weight").fill("0")
    seen.page.locator("#aware-degenerate", has_text=seen.text("#shortest-degenerate")).wait_for()
    without = metres_of(seen.text("#aware-degenerate"))
    painted = seen.value("painted")
    seen.page.locator("#weight").fill("600")
    seen.await_change("painted", painted)
    seen.page.locator("#verdict", has_text="longer").wait_for()
    assert metres_of(seen.text("#aware-degenerate")) < without
    assert "metres of detour" in seen.page.locator("#weight").get_attribute("aria-valuetext")


def test_a_double_click_adds_a_waypoint_and_delete_removes_it(visit):
    seen = visit()
    x, y = seen.middle(".marker.start")
    painted = seen.value("painted")
    seen.page.mouse.dblclick(x + 80, y)
    seen.wait('.marker[data-name="via:0"]:focus')
    painted = seen.await_change("painted", painted)
    seen.page.keyboard.press("Delete")
    seen.wait(".marker.via", "detached")
    seen.await_change("painted", painted)


def test_hovering_reads_the_place_out_and_marks_the_profile(visit):
    seen = visit()
    x, y = seen.middle(".marker.start")
    seen.page.mouse.move(x + 60, y)
    seen.wait("#readout", "visible")
    assert re.search(
        r"position deviation .* cm.*heading deviation .*°.*degeneracy [01]\.\d\d",
        seen.text("#readout"),
    )
    chart = seen.page.locator("#profile-chart")
    chart.hover(position={"x": 300, "y": 40})
    seen.wait('#profile-chart[aria-valuetext*="along: degeneracy shortest"]')
    chart.focus()
    seen.page.keyboard.press("Home")
    seen.wait('#profile-chart[aria-valuenow="0.0"]')


def test_a_simulation_is_cancelled_while_the_page_goes_on(visit):
    seen = visit()
    seen.unfold("simulate-group")
    assert seen.text("#robot").startswith("lidar, 6 m, 360°; radius 0.2 m")
    seen.page.locator("#drives-each").select_option("128")
    seen.page.locator("#simulate").click()
    task = seen.wait('#tasks [data-kind="simulate"]')
    painted = seen.value("painted")
    seen.drag(".marker.goal", -60, 0)
    seen.await_change("painted", painted)
    task.get_by_role("button").click()
    seen.page.locator("#toast", has_text="Simulation cancelled").wait_for()
    assert task.count() == 0


@pytest.mark.long
def test_a_goal_within_a_wide_wall_leaves_no_old_path(visit):
    seen = visit()
    metre = (seen.middle(".marker.goal")[0] - seen.middle(".marker.start")[0]) / 36.0
    seen.drag(".marker.goal", -11.25 * metre, -4.75 * metre)
    reason = seen.page.locator("#verdict.error", has_text="has no free cell within 3 m")
    reason.wait_for()
    assert seen.text("#verdict").startswith("The goal ")
    for name in ("aware", "shortest"):
        assert seen.text(f"#{name}-length") == "–"
        assert seen.text(f"#{name}-degenerate") == seen.text(f"#{name}-sigma") == ""
    assert not seen.has_drawn(TEAL)
    seen.wait('#profile-chart[aria-valuemax="0.1"]')
    assert seen.page.locator("#toast").is_hidden()
    seen.drag(".marker.goal", 11.25 * metre, 4.75 * metre)
    reason.wait_for(state="detached")
    seen.page.locator("#aware-length", has_text="m").wait_for()
    assert seen.has_drawn(TEAL)


@pytest.mark.long
def test_a_marker_that_is_dragged_out_of_the_window_stays_on_the_map(visit):
    seen = visit()
    seen.drag(".marker.start", -3000, -3000)
    seen.page.locator("#zoom-fit").click()
    seen.page.locator("#overlay").evaluate("() => new Promise(requestAnimationFrame)")
    assert seen.place("start")[0] >= 1.0
    assert seen.place("start")[1] <= 13.8
    x, y = seen.middle(".marker.start")
    assert 0 < x < 1200
    assert 0 < y < 800


def test_intervals_and_verdicts_read_as_people_speak(browser, server):
    path = {"path": {"xy": [[3, 1], [39, 1]]}, "metrics": {"length": 36.0}}
    profile = {"profile": [[36.0, 0.09, 0.05, 0.12]]}
    first = {"error": [1.3, 0.0, 137.9], "lost_rate": [0.0, 0.0, 0.168]}
    other = {"error": [0.2, 0.0304, 2.1], "lost_rate": [0.5, 0.2, 0.8]}
    third = {"error": [1.5, 1.2, 2.1], "lost_rate": None}
    candidates = [
        {"name": name, "driven": profile | each, **path}
        for name, each in (("a", first), ("b", other), ("c", third))
    ]
    context = browser.new_context(viewport={"width": 1200, "height": 800})
    seen = Seen(context.new_page())
    answers = {
        "simulate": {
            **{"answer": ["no matter"], "driven": "3 drives"},
            **{"taken": "a", "candidates": candidates},
        },
    }
    seen.answer(answers)
    seen.open(server.address)
    seen.unfold("simulate-group")
    seen.page.locator("#simulate").click()
    seen.wait("#candidates tr.chosen")
    small = [re.sub(r"\s", " ", each) for each in seen.page.locator("td small").all_inner_texts()]
    errors = seen.page.locator("#candidates td:nth-child(4)").all_inner_texts()
    assert [each.split("\u202f")[0] for each in errors] == ["1.3", "0.20", "1.5"]
    assert small == ["up to 138 m", "up to 17 %", "0.030–2.1 m", "20–80 %", "1.2–2.1 m"]
    shown = seen.legend()
    assert sum("recommended" in each for each in shown) == 1
    assert shown[0].startswith("1 a: 36.0 m, error 1.3 m")
    assert not any(each.startswith(("aware", "shortest")) for each in shown)
    seen.page.locator("#export-to").select_option("path")
    which = seen.page.locator("#export-which", has_text="aware path at weight 8, ")
    which.filter(has_text="recommends another").wait_for()
    weight = seen.page.locator("#weight").input_value()
    seen.page.locator("#weight").fill("900")
    which.wait_for(state="detached")
    assert "recommends" not in seen.text("#export-which")
    seen.page.locator("#weight").fill(weight)
    # What was simulated leaves the map with the route or the map that it is for, and comes back.
    old = seen.page.locator("#simulated-old")
    old.wait_for(state="hidden")
    assert seen.has_drawn(RED)
    seen.drag(".marker.goal", -30, 0, release=False)
    old.wait_for()
    assert not seen.has_drawn(RED)
    assert seen.page.locator("#profile-kind").input_value() == "u"
    seen.page.mouse.up()
    seen.page.locator("#simulate").click()
    old.wait_for(state="hidden")
    seen.page.locator("#weight").fill("900")
    old.wait_for()
    seen.page.locator("#weight").fill(weight)
    old.wait_for(state="hidden")
    seen.page.locator("#overlay").focus()
    seen.page.keyboard.press("p")
    seen.page.keyboard.press("Enter")
    old.wait_for()
    assert not seen.has_drawn(RED)
    seen.page.keyboard.press("Control+z")
    old.wait_for(state="hidden")
    assert seen.faults == []
    context.close()


@pytest.mark.long
def test_a_simulation_tells_its_verdict_and_draws_bands(visit):
    seen = visit()
    seen.unfold("simulate-group")
    seen.page.locator("#drives-each").select_option("16")
    seen.page.locator("#simulate").click()
    seen.page.locator("#simulated-verdict", has_text="drives").wait_for()
    assert seen.page.locator("#candidates tbody tr, #candidates > tr").count() >= 2
    assert seen.page.locator("#profile-kind").input_value() == "error"


def test_a_wall_is_drawn_undone_and_drawn_again_in_every_tab(visit, server):
    seen, other = visit(), visit()
    before, place = seen.value("map"), other.place("start")
    seen.page.keyboard.press("w")
    seen.wait('#edit-tools [data-tool="wall"][aria-pressed="true"]')
    x, y = seen.middle(".marker.start")
    seen.page.mouse.move(x + 70, y - 25)
    seen.page.mouse.down()
    seen.page.mouse.move(x + 110, y - 25)
    seen.page.mouse.up()
    drawn = seen.await_change("map", before)
    other.wait(f'html[data-map="{drawn}"]')
    assert other.place("start") == place
    seen.page.keyboard.press("Control+z")
    seen.wait(f'html[data-map="{before}"]')
    other.wait("#redo:enabled")
    other.page.keyboard.press("Control+Shift+Z")
    for each in (seen, other):
        each.wait(f'html[data-map="{drawn}"]')
    other.page.keyboard.press("Control+z")
    other.wait(f'html[data-map="{before}"]')
    assert server.grid.digest == before


@pytest.mark.long
def test_a_pole_is_put_by_keys(visit):
    seen = visit()
    before = seen.value("map")
    seen.page.locator("#overlay").focus()
    seen.page.keyboard.press("p")
    seen.page.keyboard.press("Enter")
    seen.await_change("map", before)
    seen.page.keyboard.press("Control+z")
    seen.wait(f'html[data-map="{before}"]')


def test_the_page_comes_back_after_a_break(visit, browser, server):
    context = browser.new_context()
    seen = Seen(context.new_page())
    sockets = []

    def passed_on(socket):
        sockets.append(socket)
        socket.connect_to_server()

    seen.page.route_web_socket(re.compile("/socket$"), passed_on)
    seen.open(server.address)
    seen.page.locator(".marker.goal").focus()
    length, painted = seen.text("#aware-length"), seen.value("painted")
    sockets[-1].close()
    seen.wait('html[data-state="offline"]')
    assert "does not answer" in seen.text("#status")
    seen.page.keyboard.press("ArrowLeft")
    place = seen.place("goal")
    assert seen.text("#aware-length") == length
    assert seen.has_drawn(TEAL)
    seen.wait('html[data-state="ready"]')
    painted = seen.await_change("painted", painted)  # the path to where the goal is by now
    assert seen.place("goal") == pytest.approx(place, abs=0.11)
    seen.page.keyboard.press("ArrowLeft")
    seen.await_change("painted", painted)
    assert len(sockets) >= 2
    assert seen.faults == []
    context.close()


@pytest.mark.long
def test_on_a_large_map_a_drag_searches_ahead_once_and_its_release_goes_on(browser, server):
    context = browser.new_context()
    seen = Seen(context.new_page())
    asks = []

    def sockets(socket):
        behind = socket.connect_to_server()

        def asked(text):
            ask = json.loads(text)
            asks.append(ask)
            if ask["do"] == "cancel" and any(one["id"] == ask["of"] for one in idle()):
                socket.send(json.dumps({"re": ask["of"], "cancelled": True}))
            elif ask["do"] != "idle":  # as if searches took long
                behind.send(text)

        socket.on_message(asked)

    def idle():
        return [ask for ask in asks if ask["do"] == "idle" and ask.get("hold")]

    def cancelled():
        return {ask["of"] for ask in asks if ask["do"] == "cancel"}

    seen.page.route_web_socket(re.compile("/socket$"), sockets)
    seen.open(server.address)
    seen.page.evaluate(
        "import(new URL('static/store.js', document.baseURI))"
        ".then(({ model }) => { model.about.map.cols = 4000; })"
    )
    for name, count in (("goal", 1), ("start", 2)):
        painted = seen.value("painted")
        seen.drag(f".marker.{name}", 20 if name == "start" else -20, 0, release=False)
        painted = seen.await_change("painted", painted)
        x, y = seen.middle(f".marker.{name}")
        seen.page.mouse.move(x + 3, y)
        painted = seen.await_change("painted", painted)
        seen.page.mouse.up()
        seen.await_change("painted", painted)
        assert [ask["hold"] for ask in idle()] == ["goal", "start"][:count]
        assert idle()[-1]["id"] not in cancelled()
    painted = seen.value("painted")
    seen.page.locator(".marker.goal").focus()
    seen.page.keyboard.press("ArrowLeft")
    seen.await_change("painted", painted)
    assert {ask["id"] for ask in idle()} <= cancelled()
    assert seen.faults == []
    context.close()


@pytest.mark.long
def test_a_server_started_anew_is_told_apart_from_one_that_is_silent(browser):
    grid, field = corridors()
    context = browser.new_context()
    seen = Seen(context.new_page())
    with serve(grid, field) as first:
        seen.open(first.address)
        port = int(re.search(r":(\d+)/", first.address).group(1))
    seen.page.locator("#status", has_text="does not answer").wait_for()
    with serve(grid, field, port=port) as second:
        seen.page.locator("#status", has_text="open the address that it printed").wait_for()
        seen.open(second.address)
        assert seen.page.locator("#status").is_hidden()
    context.close()


@pytest.mark.long
def test_before_the_field_the_page_says_what_it_knows(visit, browser, server):
    context = browser.new_context()
    seen = Seen(context.new_page())

    def without_field(socket):
        behind = socket.connect_to_server()

        def answered(text):
            told = json.loads(text)
            if told.get("event") == "state":
                told |= {"field": None, "layers": []}
            if told.get("aware"):
                path = told["shortest"]
                path["profile"] |= {key: [None] * len(path["xy"]) for key in ("u", "sigma_cm")}
                told |= {"aware": None, "why": "the field is still being computed"}
            socket.send(json.dumps(told))

        behind.on_message(answered)

    seen.page.route_web_socket(re.compile("/socket$"), without_field)
    seen.page.goto(server.address)
    seen.page.locator("#verdict", has_text="only the shortest path is known so far").wait_for()
    assert seen.text("#verdict").startswith("The field is still being computed;")
    assert seen.page.locator("#verdict.error").count() == 0
    assert seen.text("#aware-length") == "–"
    assert seen.text("#layer") == "no field yet"
    assert seen.faults == []
    context.close()


@pytest.mark.long
def test_dark_follows_the_system_until_someone_chooses(visit):
    seen = visit(color_scheme="dark")
    seen.wait('html[data-theme="dark"]')
    seen.page.keyboard.press("d")
    seen.wait('html[data-theme="light"]')
    seen.page.reload()
    seen.wait('html[data-theme="light"]')


@pytest.mark.long
def test_two_fingers_zoom_and_a_long_press_adds_a_waypoint(visit):
    seen = visit(viewport={"width": 390, "height": 780}, has_touch=True, is_mobile=True)
    fingers = seen.page.context.new_cdp_session(seen.page)

    def touch(kind, *points):
        places = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    seen.page.locator("#hint-close").click()
    x, y = seen.middle(".marker.start")
    before = seen.page.locator("#scale-bar").bounding_box()["width"], seen.text("#scale-bar")
    touch("touchStart", (150, 240), (250, 240))
    touch("touchMove", (100, 240), (300, 240))
    touch("touchMove", (60, 240), (340, 240))
    touch("touchEnd")
    seen.page.locator("#scale-bar").evaluate("() => new Promise(requestAnimationFrame)")
    after = seen.page.locator("#scale-bar").bounding_box()["width"], seen.text("#scale-bar")
    assert after != before
    seen.page.locator("#zoom-fit").click()
    touch("touchStart", (x + 80, y - 20))
    seen.wait(".marker.via")
    touch("touchEnd")


@pytest.mark.long
def test_the_map_keeps_still_while_the_first_drag_takes_the_hint_away(visit):
    seen = visit(viewport={"width": 390, "height": 780})
    before = seen.page.locator(".marker.start").bounding_box()
    seen.drag(".marker.goal", -40, 0)
    seen.wait("#hint", "hidden")
    assert seen.page.locator(".marker.start").bounding_box() == before


@pytest.fixture(scope="module")
def tall_server(server):
    """A server on a map three times as high as wide, with the ends at its top and bottom."""
    wide, field = corridors()
    grid = OccupancyGrid(wide.cells.T.copy(), wide.resolution, name="tall")
    ends = {"start": (3.0, 41.0), "goal": (3.0, 1.0)}
    with serve(grid, load_or_compute(grid, field.config), **ends) as explorer:
        yield explorer


@pytest.mark.parametrize(
    ("width", "height"),
    sample_cases([(390, 844), (320, 640), (760, 450), (1280, 720)], are_rows=True),
)
def test_the_map_lies_beside_all_cards(visit, tall_server, width, height):
    seen = visit(tall_server.address, viewport={"width": width, "height": height})
    seen.wait("#hint", "visible")
    seen.page.locator("#scale-bar").evaluate("() => new Promise(requestAnimationFrame)")
    markers = [seen.middle(f".marker.{name}") for name in ("start", "goal")]
    for card in ("#panel", "#profile", "#tools", "#hint"):
        box = seen.page.locator(card).bounding_box()
        for x, y in markers:
            beside = not box["x"] < x < box["x"] + box["width"]
            assert beside or not box["y"] - 20 < y < box["y"] + box["height"], card
    tools = seen.page.locator("#tools").bounding_box()
    profile = seen.page.locator("#profile").bounding_box()
    assert tools["y"] + tools["height"] <= profile["y"]


@pytest.mark.long
def test_a_turned_map_is_drawn_along_its_own_axes(visit, tmp_path):
    yaw = 0.5
    with serve(*corridors(yaw)) as turned:
        seen = visit(turned.address)
        seen.page.locator(".marker.start").focus()
        x, y = seen.place("start")
        painted = seen.value("painted")
        seen.page.keyboard.press("Shift+ArrowRight")
        seen.await_change("painted", painted)
        step = 2.0 * math.cos(yaw), 2.0 * math.sin(yaw)
        assert seen.place("start") == pytest.approx((x + step[0], y + step[1]), abs=0.15)
        x, y = seen.middle(".marker.start")
        seen.page.mouse.move(x + 30, y)
        seen.page.locator("#readout", has_text="degeneracy").wait_for()


@pytest.mark.parametrize(
    ("distro", "minds"), sample_cases([("kilted", True), ("humble", False)], are_rows=True)
)
def test_an_export_says_where_it_went_and_what_to_mind(visit, distro, minds):
    seen = visit()
    seen.unfold("share-group")
    seen.page.locator("#distro").select_option(distro)
    seen.page.locator("#export").click()
    seen.page.locator("#export-note", has_text="corridors-nav2-keepout").wait_for()
    assert ("Mind: kilted: AMCL" in seen.text("#export-note")) == minds
    assert ("Mind the warning" in seen.text("#toast")) == minds


@pytest.mark.long
def test_a_picture_is_saved(visit):
    seen = visit()
    seen.unfold("share-group")
    assert [each.split(":")[0] for each in seen.legend()][:2] == ["aware", "shortest"]
    with seen.page.expect_download() as download:
        seen.page.locator("#picture").click()
    content = download.value.path().read_bytes()
    assert content.startswith(b"\x89PNG")
    assert len(content) > 10_000


def test_a_shared_page_works_from_the_disk(visit, tmp_path):
    seen = visit()
    seen.unfold("share-group")
    with seen.page.expect_download() as download:
        seen.page.locator("#share").click()
    file = tmp_path / "shared.html"
    download.value.save_as(file)
    shared = visit(file.as_uri())
    assert shared.text("#aware-length") == seen.text("#aware-length")
    assert shared.page.locator("#simulate").is_hidden()
    x, y = shared.middle(".marker.start")
    shared.page.mouse.move(x + 60, y)
    shared.page.locator("#readout", has_text="position deviation at most").wait_for()
    shared.page.locator("#layer").select_option("sigma")
    assert [url for url in shared.addresses if not url.startswith("file:")] == []


def test_a_narrow_window_needs_no_sideways_scrolling(visit):
    seen = visit(viewport={"width": 320, "height": 640})
    wide = seen.page.evaluate("() => document.documentElement.scrollWidth")
    seen.page.locator("#sheet-handle").click()
    seen.wait('#sheet-handle[aria-expanded="true"]')
    for group in ("sensor-group", "simulate-group", "share-group", "edit-group"):
        seen.unfold(group)
    inside = seen.page.locator("#panel").evaluate("(panel) => panel.scrollWidth")
    assert wide == 320
    assert inside <= 320
    for button in seen.page.locator("#tools button").all():
        box = button.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 320
        assert min(box["width"], box["height"]) >= 36


@pytest.mark.long
def test_a_cancelled_computation_leaves_the_field(visit):
    seen = visit()
    before = seen.value("field")
    seen.unfold("sensor-group")
    seen.page.locator("#range").fill("3")
    seen.page.locator("#configure button").click()
    seen.wait('#tasks [data-kind="configure"]')
    seen.page.locator("#tasks").get_by_role("button").click()
    seen.page.locator("#toast", has_text="stays as it was").wait_for()
    assert seen.value("field") == before


@pytest.mark.long
def test_long_work_says_how_much_time_is_left(browser, server):
    context = browser.new_context()
    seen = Seen(context.new_page())
    seen.page.clock.install()
    asked = []
    seen.answer({"simulate": lambda *ask: asked.append(ask)})
    seen.open(server.address)
    seen.unfold("simulate-group")
    seen.page.locator("#simulate").click()
    words = seen.wait('#tasks [data-kind="simulate"]').locator("span")
    seen.page.wait_for_timeout(0)
    ((number, tell),) = asked
    for after, done, said in (
        *((0, 0, "at 0"), (9000, 10, "at 10"), (1000, 20, "at 20")),
        *((9000, 110, ": 1 min left"), (0, 510, re.compile(r": \d+ s left"))),
        *((0, 5, "at 5"), (1000, 300, "at 300")),
    ):
        seen.page.clock.run_for(after)
        tell({"progress": number, "done": done, "total": 1000, "doing": f"at {done}"})
        words.filter(has_text=said).wait_for()
    context.close()


def test_help_lists_the_keys_and_every_control_has_a_name(visit):
    seen = visit()
    seen.page.keyboard.press("?")
    seen.wait("dialog#help[open]")
    seen.page.keyboard.press("Escape")
    unnamed = seen.page.evaluate(
        "() => [...document.querySelectorAll('button, input, select')].filter((each) =>"
        " !each.labels?.length && !each.ariaLabel && !each.title && !each.textContent.trim())"
        ".map((each) => each.outerHTML)"
    )
    assert unnamed == []


def test_a_save_is_refused_or_made_in_one_line(visit, server):
    seen = visit()
    seen.unfold("edit-group")
    seen.page.locator("#save-name").fill("corridors_again")
    seen.page.locator("#save button").click()
    seen.page.locator("#toast", has_text="Saved as corridors_again").wait_for()


def metres_of(text: str) -> float:
    return float(re.match(r"[\d.]+", text).group())


def test_the_pages_files_are_small_and_fit_one_scope():
    sizes = {file.name: file.stat().st_size for file in STATIC.iterdir()}
    assert sum(sizes.values()) <= 200_000, sizes
    names: dict[str, str] = {}
    exported: dict[str, str] = {}
    imported: dict[str, set[str]] = {}
    for file in sorted(STATIC.glob("*.js")):
        text = file.read_text()
        assert text.startswith("// "), f"{file.name} says what it is"
        assert "default" not in re.findall(r"^export (\w+)", text, re.M)
        for name in re.findall(r"^(?:export )?(?:async )?(?:function|const|let) (\w+)", text, re.M):
            assert names.setdefault(name, file.name) == file.name, f"{name} stands twice"
        used = re.findall(r'^import \{([^}]*)\} from "\./([\w-]+\.js)";$', text, re.M)
        assert len(used) == len(re.findall(r"^import", text, re.M))
        rest = re.sub(r"^import.*\n", "", text, flags=re.M)
        imported[file.name] = {name.strip() for group, _ in used for name in group.split(",")}
        for name in imported[file.name]:
            assert re.search(rf"\b{name}\b", rest), f"{file.name} imports {name} in vain"
        found = re.findall(r"^export (?:async )?(?:function|const) (\w+)", text, re.M)
        exported |= dict.fromkeys(found, file.name)
    for file in STATIC.glob("*.js"):
        called = set(
            re.findall(r"(?<![.\w])(\w+)\(", re.sub(r'"[^"\n]*"|//.*', "", file.read_text()))
        )
        others = {name for name in called & exported.keys() if exported[name] != file.name}
        assert others <= imported[file.name], f"{file.name} lacks imports"


def test_the_page_has_no_inline_style_and_no_foreign_address():
    page = (STATIC / "index.html").read_text()
    assert " style=" not in page
    assert "<style" not in page
    assert re.findall(r" on\w+=", page) == []
    for file in STATIC.iterdir():
        text = file.read_text().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://|//[\w.-]+\.(com|org|net)\b", text), file.name
