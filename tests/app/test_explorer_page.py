"""The explorer's page, as people use it: in a real browser, on a real server."""

from __future__ import annotations

import itertools
import math
import random
import re
from pathlib import Path

import pytest
from support.browser import Window, browser_file, corridors, serve
from support.cases import sample_cases

import locplan.app.explorer

pytest.importorskip("starlette", reason="the explorer's server is not installed")
pytestmark = pytest.mark.skipif(browser_file() is None, reason="no chromium on this machine")

BLUE = (0, 114, 178)
"""Colour of the recommended path on a light page."""
AXE = Path(locplan.app.explorer.__file__).parent / "page/node_modules/axe-core/axe.min.js"
MOVED = """([x, y]) => {
    const { left, top } = document.querySelector(".marker.start").getBoundingClientRect();
    return left < x && top < y;
}"""
APART = """(least) => {
    const boxes = [".start", ".goal"].map((name) => document.querySelector(`.marker${name}`));
    const [a, b] = boxes.map((marker) => marker.getBoundingClientRect());
    return Math.hypot(a.left - b.left, a.top - b.top) > least;
}"""
NOTE_STATUSES = """() => {
    window.noted = new Set();
    const note = (changes) => {
        for (const { attributeName } of changes) {
            const name = attributeName.slice(5);
            if (document.documentElement.dataset[name] !== "fresh") noted.add(name);
        }
    };
    new MutationObserver(note).observe(document.documentElement, { attributes: true });
}"""
CANDIDATE = {"error": 0.1, "error_interval": [0.08, 0.2], "lost": 0.0, "lost_interval": [0, 0.2]}


def simulate(question, basis):
    """Answer that the path shown is the recommended one, without a drive."""
    xy = question["path"]
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(xy))
    path = {**CANDIDATE, "xy": xy, "length": length}
    names = {"is_recommended": "weight 8", "is_shortest": "shortest"}
    roles = [{**path, "name": name, "title": name, role: True} for role, name in names.items()]
    line = {"s": [0, length], "median_cm": [5, 9], "low_cm": [4, 8], "high_cm": [6, 12]}
    return {
        "verdict": "Take the longer route.",
        "evidence": "The error is 0.10 m instead of 0.60 m.",
        "recommended": "weight 8",
        "candidates": roles,
        "along": {"recommended": line, "shortest": line},
        "advice": [],
    }


def report(question, basis):
    """Answer with a small report."""
    route = {"name": "1", "title": "Left to right", "start": [3, 1], "goal": [39, 1]}
    return {
        "next": "Change the AMCL settings.",
        "baseline": {"lost": [0.09, 0.02, 0.2]},
        "routes": [{**route, "xy": [[3, 1], [39, 1]], "chosen": None, "lost": [0.4, 0.2, 0.6]}],
        "fixes": [
            {"kind": "settings", "title": "Settings", "lost": [0, 0, 0.11], "settings": {"a": 1}}
        ],
        "recommended": ["settings"],
        "poles": [[20, 1]],
    }


def export(question, basis):
    return {"folder": "out", "files": ["keepout.yaml"], "warnings": []}


def add_report(route):
    return {**route.fetch().json(), "has_report": True}


STUBS = {"simulate": simulate, "report": report, "export": export}


def statuses(window: Window) -> dict[str, str]:
    names = ("plan", "simulated", "report", "receipt", "spots")
    return {name: window.value(name) for name in names}


# For each change: the action, and what each result but the plan depends on.
def move_weight(window):
    window.page.locator("aside input[type=range]").focus()
    window.page.keyboard.press("ArrowRight")


def move_goal(window):
    window.page.locator(".marker.goal").focus()
    window.page.keyboard.press("ArrowLeft")


def choose_lidar(window):
    window.page.get_by_label("Lidar", exact=True).select_option("turtlebot4")


CHANGES = {
    "wall": (lambda window: window.draw("wall"), {"simulated", "receipt", "report", "spots"}),
    "zone": (lambda window: window.draw("no-go"), {"simulated", "receipt", "report"}),
    "lidar": (choose_lidar, {"simulated", "receipt", "report", "spots"}),
    "weight": (move_weight, {"simulated", "receipt"}),
    "goal": (move_goal, {"simulated", "receipt"}),
    "waypoint": (lambda window: window.page.keyboard.press("a"), {"simulated", "receipt"}),
}


def test_changes_outdate_results_until_undo(visit):
    """Five results times six changes, on one page."""
    window = visit(answers=STUBS, about=add_report)
    window.wait('html[data-report="fresh"][data-spots="fresh"]')
    window.page.locator("aside .main").click()  # shows the fix
    window.page.locator('[data-do="simulate"]').click()
    window.page.locator('[data-do="export"]').click()
    window.wait('html[data-receipt="fresh"]')
    window.page.evaluate(NOTE_STATUSES)
    for name, (act, outdated) in CHANGES.items():
        window.page.evaluate("() => noted.clear()")
        act(window)
        window.wait("#undo:enabled")
        if name == "lidar":  # its field takes long
            window.wait('html[data-report="robot"]')
        else:
            window.settle()
            window.wait('html[data-spots="fresh"]')  # after a wall they are new ones
        seen = {key for key, value in statuses(window).items() if value != "fresh"}
        assert seen - {"plan", "spots"} == outdated - {"spots"}, name
        assert set(window.page.evaluate("() => [...noted]")) >= outdated | {"plan"}, name
        strips = window.page.locator("aside .strip").all_inner_texts()
        assert len([text for text in strips if "Outdated" in text]) == len(outdated - {"spots"})
        assert window.text(".tag") == "predicted" if name != "lidar" else True
        window.page.locator("#undo").click()
        window.wait('html[data-simulated="fresh"][data-receipt="fresh"][data-report="fresh"]')
        window.wait('html[data-spots="fresh"]')
        window.settle()
        assert window.page.locator("aside .strip").count() == 0, name
        assert window.text(".tag") == "simulated", name


def test_page_hides_results_during_change(visit, browser):
    window = visit(answers={"change": lambda question, basis: None})
    window.wait_for_colour(BLUE)
    window.draw("wall")
    assert set(statuses(window).values()) <= {"none", "waiting"}
    assert not window.has_colour(BLUE)
    assert "–" in window.text("aside table")


def test_page_shows_shortest_path_without_field(visit):
    xy = [[3, 1], [39, 1]]
    path = {"xy": xy, "length": 36.0, "degenerate": None, "mean_sigma_cm": None}
    path |= {"profile": {"s": [0, 36], "sigma_cm": [None, None]}}
    empty = {
        "recommended": None,
        "shortest": path,
        "why": "The field is not there.",
        "draft": False,
    }
    stops = {"start": xy[0], "goal": xy[1], "via": []}
    state = {"field": None, "layers": [], "weak_spots": None}
    window = visit(answers={"state": lambda *_: state, "plan": lambda *_: {**empty, **stops}})
    assert "Computing" in window.text("aside .head")
    assert window.text("aside tbody") == "Aware – – – Shortest 36.0 m – –"
    assert window.page.locator("aside .main").count() == 0


def test_failed_plan_names_reason(visit):
    window = visit(answers={"plan": lambda *_: {"error": "Start and goal are too close."}})
    assert window.text("aside .head") == "Start and goal are too close."


def test_refused_change_is_taken_back(visit):
    window = visit(answers={"change": lambda question, basis: {"error": "The wall is too long."}})
    window.draw("wall")
    window.page.locator(".toast", has_text="The wall is too long.").wait_for()
    window.settle()
    assert window.page.locator('section[aria-label="Changes"] li, #undo:enabled').count() == 0


def test_small_first_view_names_next_step(visit):
    window = visit(viewport={"width": 1400, "height": 900})
    window.wait('html[data-spots="fresh"]')
    counts = window.counts()
    assert counts["controls"] <= 20, counts
    assert counts["words"] <= 180, counts
    assert window.text("aside .main") == "Simulate this route"
    assert re.search(r"A.*corridor", window.text('section[aria-label="Weak spots"]'))


@pytest.mark.parametrize("width", sample_cases([390, 320]))
def test_narrow_page_keeps_map_and_button(visit, width):
    window = visit(viewport={"width": width, "height": 800}, is_mobile=True, has_touch=True)
    assert window.counts()["map_share"] >= 0.45
    assert window.page.evaluate("document.documentElement.scrollWidth") <= width
    box = window.page.locator("aside .main").bounding_box()
    assert box["y"] + box["height"] <= 800
    for name in ("start", "goal"):
        x, y = window.middle(f".marker.{name}")
        assert 0 < x < width
        assert 0 < y < 800 * 0.6


@pytest.mark.long
def test_touch_zooms_and_adds_waypoint(visit):
    window = visit(viewport={"width": 390, "height": 800}, is_mobile=True, has_touch=True)
    fingers = window.page.context.new_cdp_session(window.page)

    def touch(kind, *points):
        places = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    x, y = window.middle("main")
    first, last = (window.middle(f".marker.{name}") for name in ("start", "goal"))
    touch("touchStart", (x - 40, y), (x + 40, y))
    for reach in (60, 90, 120):
        touch("touchMove", (x - reach, y), (x + reach, y))
    touch("touchEnd")
    window.page.wait_for_function(APART, arg=1.5 * math.dist(first, last))
    window.page.keyboard.press("0")
    touch("touchStart", (x, y))
    window.wait(".marker.via")
    touch("touchEnd")


@pytest.mark.long
def test_marker_dragged_outside_stays_on_map(visit):
    window = visit()
    window.drag(window.middle(".marker.start"), -3000, -3000)
    window.settle()
    x, y = window.place("start")
    assert x >= 1.0
    assert y <= 13.8
    x, y = window.middle(".marker.start")
    assert 0 < x < 1200
    assert 0 < y < 800


def test_paths_follow_dragged_goal(visit):
    window = visit()
    painted, length = window.value("painted"), window.text("tr:nth-child(2) td:nth-child(2)")
    window.drag(window.middle(".marker.goal"), -160, 0, drop=False)
    window.wait_for_change("painted", painted)
    window.page.mouse.up()
    window.settle()
    assert window.text("tr:nth-child(2) td:nth-child(2)") != length
    x, y = window.place("goal")
    assert 30 < x < 39
    assert -2 < y < 16
    window.page.keyboard.press("Control+z")
    window.settle()
    assert window.place("goal") == pytest.approx((39.0, 1.0), abs=0.11)


def test_keyboard_moves_markers_and_draws(visit):
    window = visit()
    keyboard = window.page.keyboard
    x, y = window.place("start")
    window.page.locator(".marker.start").focus()
    keyboard.press("ArrowRight")
    window.settle()
    assert window.place("start") == pytest.approx((x + 0.4, y), abs=0.11)
    keyboard.press("Shift+ArrowRight")
    window.settle()
    assert window.place("start") == pytest.approx((x + 2.4, y), abs=0.21)
    keyboard.press("a")
    window.wait('.marker[data-name="via:0"]:focus')
    window.settle()
    keyboard.press("Delete")
    window.wait(".marker.via", "detached")
    keyboard.press("n")
    window.wait('[data-tool="no-go"][aria-pressed="true"]')
    window.page.locator("#map").focus()
    keyboard.press("Enter")
    x, y = window.middle(".marker.start")
    for key, place in (("ArrowRight", [x - 60, y + 60]), ("ArrowDown", [x - 60, y - 60])):
        keyboard.press(key)
        window.page.wait_for_function(MOVED, arg=place)
    keyboard.press("Enter")
    window.wait('section[aria-label="Changes"] li')
    keyboard.press("Escape")
    window.wait('[data-tool="move"][aria-pressed="true"]')
    keyboard.press("?")
    window.wait("dialog[open]")
    keyboard.press("Escape")
    window.page.locator("#chart").focus()
    keyboard.press("End")
    assert "along" in window.page.locator("#chart").get_attribute("aria-valuetext")


def test_zone_is_exported_in_four_actions(visit, server):
    window = visit()
    window.page.locator('[data-tool="no-go"]').click()  # 1
    x, y = window.middle("main")
    window.drag((x - 300, y + 20), 60, 40)  # 2
    window.settle()
    window.page.locator('[data-do="export"]').click()  # 3
    window.wait(".receipt")
    files = [file.name for file in server.session.opening.folder.rglob("*")]
    assert {"zones.geojson", "mask.pgm", "mask.yaml"} <= set(files)


def test_undo_removes_changes_of_opened_page(visit, server):
    window = visit()
    window.draw("no-go")
    window.settle()
    again = visit()
    again.page.locator('[data-tool="slow"]').click()
    again.page.locator(".hint", has_text="draw a zone").wait_for()
    again.page.locator("#undo").click()
    again.settle()
    assert server.session.changes == ()
    again.wait("#undo:disabled")


def test_zone_is_edited_and_removed(visit, server):
    window = visit()
    window.draw("slow")
    window.settle()
    row = 'section[aria-label="Changes"] li'
    before = window.text(row)
    window.page.locator(f"{row} input").fill("30")
    window.page.keyboard.press("Tab")
    window.settle()
    assert server.session.changes[0]["percent"] == 30
    x, y = window.middle("main")
    window.page.mouse.move(x - 299, y + 21)
    window.page.mouse.move(x - 300, y + 20)
    window.drag((x - 300, y + 20), -40, -30)  # a corner
    window.page.locator(f"{row}:not(:text-is('{before}'))").wait_for()
    window.settle()
    assert server.session.changes[0]["percent"] == 30
    window.page.locator(f"{row} button").click()
    window.wait(row, "detached")
    window.settle()
    assert server.session.changes == ()


def test_probe_shows_ellipse_and_reason(visit):
    window = visit()
    x, y = window.middle(".marker.start")
    right, _ = window.middle(".marker.goal")
    window.page.mouse.move((x + right) / 2, y)
    window.page.locator(".readout", has_text="Position ±").wait_for()
    assert "corridor" in window.text(".readout") or "features" in window.text(".readout")


def test_primary_button_shows_fix_of_report(visit):
    window = visit(answers=STUBS, about=add_report)
    window.wait('html[data-report="fresh"]')
    window.page.locator("aside .main", has_text="Show the fix").click()
    assert "a: 1" in window.text('section[aria-label="Check report"] pre')
    window.page.locator("#report th button").click()
    window.settle()
    assert window.text("aside .main") == "Simulate this route"


def test_long_question_can_be_cancelled(visit):
    window = visit()
    window.page.locator("aside .main").click()
    window.page.locator('[data-do="cancel"]').click()
    window.page.locator("aside .main", has_text="Simulate this route").wait_for()
    assert window.value("simulated") == "none"


@pytest.mark.parametrize("is_edited", sample_cases([False, True]))
def test_shared_page_works_from_disk(visit, tmp_path, is_edited):
    window = visit()
    if is_edited:
        window.draw("no-go")
        window.settle()
    with window.page.expect_download() as download:
        window.page.locator("#share").click()
    file = tmp_path / "shared.html"
    download.value.save_as(file)
    shared = visit(file.as_uri())
    assert shared.text("aside table") == window.text("aside table")
    assert shared.page.locator("aside .main, .tools, #undo").count() == 0
    shared.wait_for_colour(BLUE)
    x, y = shared.middle(".marker.start")
    shared.page.mouse.move(x + 60, y)
    shared.page.locator(".readout", has_text="Position ±").wait_for()
    assert [url for url in shared.addresses if not re.match("file:|blob:|data:", url)] == []


def test_dark_page_follows_system(visit):
    window = visit(color_scheme="dark")
    window.wait_for_colour((86, 180, 233))
    window.page.emulate_media(color_scheme="light")
    window.wait_for_colour(BLUE)


def test_page_returns_after_restart_of_server(browser, server):
    grid, field = corridors()
    context = browser.new_context()
    window = Window(context.new_page())
    with serve(grid, field) as first:
        window.open(first.address)
        window.page.evaluate("performance.now()")
    window.wait('html[data-state="offline"]')
    assert "does not answer" in window.text("header")
    context.close()


@pytest.mark.long
def test_arrow_keys_follow_turned_map(visit):
    yaw = 0.5
    with serve(*corridors(yaw)) as turned:
        window = visit(turned.address)
        x, y = window.place("start")
        window.page.locator(".marker.start").focus()
        window.page.keyboard.press("Shift+ArrowRight")
        window.settle()
        step = 2.0 * math.cos(yaw), 2.0 * math.sin(yaw)
        assert window.place("start") == pytest.approx((x + step[0], y + step[1]), abs=0.2)


@pytest.mark.parametrize("count", sample_cases([40, 2000]))
def test_page_equals_server_after_random_actions(visit, server, count):
    window = visit(answers={"simulate": simulate, "export": export})
    page, choice = window.page, random.Random(5)
    tools = ("wall", "pole", "erase", "no-go", "slow", "prefer")

    def place():
        return choice.uniform(40, 760), choice.uniform(120, 560)

    def draw():
        page.locator(f'[data-tool="{choice.choice(tools)}"]').click()
        window.drag(place(), choice.uniform(-80, 80), choice.uniform(-80, 80))
        page.keyboard.press("v")

    def drag_marker():
        name = choice.choice(("start", "goal"))
        window.drag(window.middle(f".marker.{name}"), choice.uniform(-50, 50), 10)

    def click(selector):
        page.evaluate("(all) => [...document.querySelectorAll(all)].at(-1)?.click()", selector)

    def press(key):
        page.locator(choice.choice(("#map", ".marker.start", "#chart"))).focus()
        page.keyboard.press(key)

    actions = [
        *(draw, drag_marker, lambda: page.mouse.move(*place())),
        *(lambda: click("#undo"), lambda: click("#redo"), lambda: click("aside .main")),
        lambda: click('section[aria-label="Changes"] li button'),
        lambda: window.drag(place(), 30, 20),
        lambda: page.mouse.wheel(0, choice.choice((-100, 100))),
        *(
            lambda key=key: press(key)
            for key in ("ArrowLeft", "Shift+ArrowUp", "Delete", "a", "l", "+", "-", "0", "Escape")
        ),
    ]
    for number in range(count):
        choice.choice(actions)()
        if number % 20 == 19:
            page.keyboard.press("0")
            if page.locator('section[aria-label="Changes"] li').count() > 8:
                for _ in range(6):
                    click("#undo")
    window.settle()
    server.session.wait()
    window.wait(f'html[data-map="{server.session.scene.basis["map"]}"]')
    window.settle()
    changes = page.locator('section[aria-label="Changes"] li').count()
    assert changes == len(server.session.changes)


def test_page_passes_accessibility_check(visit):
    if not AXE.is_file():
        pytest.skip("axe-core is not installed; run npm ci in the folder of the page")
    for scheme in ("light", "dark"):
        window = visit(answers=STUBS, about=add_report, color_scheme=scheme)
        window.draw("slow")
        window.page.locator('[data-do="simulate"]').click()
        window.wait('html[data-simulated="fresh"]')
        window.page.evaluate(AXE.read_text())
        findings = window.page.evaluate("async () => (await axe.run()).violations")
        serious = [one["id"] for one in findings if one["impact"] in ("serious", "critical")]
        assert serious == [], [one["nodes"][0]["html"] for one in findings]
