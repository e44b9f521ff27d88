"""Time the explorer in a real browser, such as the delay from pointer to painted path.

pytest tests/benchmarks/bench_explorer.py --benchmark-only -s

The map is one hall of 1000 x 1000 cells, or 4 x 4 of them with passages. The page measures the
times itself. Read the extra figures, not the least time of a round.
"""

import contextlib
import math

import numpy as np
import pytest
from support.browser import FLAGS, Window, browser_file

from locplan.app.explorer.explorer import open_explorer
from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.sharing import PAGE
from locplan.field import FieldConfig, Fisher, covariance_field
from locplan.maps import FREE, UNKNOWN, OccupancyGrid
from locplan.maps.environments import make
from locplan.planning.plans import plan_with_shortest
from locplan.robots import Lidar

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.skipif(browser_file() is None, reason="no chromium on this machine")
SIZES = (1000, 4000)
MOVES = 60
FRAMES = """() => {
    window.frames_seen = [];
    const seen = (now) => { window.frames_seen.push(now); requestAnimationFrame(seen); };
    requestAnimationFrame(seen);
}"""
ANSWERS = """() => {
    const asked = new Map();
    const { send } = WebSocket.prototype;
    window.full_plans = [];
    WebSocket.prototype.send = function (text) {
        const question = JSON.parse(text);
        if (question.do === "plan" && !question.draft) asked.set(question.id, performance.now());
        if (!asked.hears) this.addEventListener("message", ({ data }) => {
            const { re, recommended } = JSON.parse(data);
            if (recommended && asked.has(re)) full_plans.push(performance.now() - asked.get(re));
        });
        asked.hears = true;
        return send.call(this, text);
    };
}"""
DRAGS = "() => performance.getEntriesByName('locplan:drag').map((each) => each.duration)"


def halls(size: int) -> OccupancyGrid:
    """A map of halls of 1000 x 1000 cells each, joined by passages."""
    hall = make("hall")
    cells = np.full((1000, 1000), UNKNOWN, np.uint8)
    cells[49 : 49 + hall.shape[0], 56 : 56 + hall.shape[1]] = hall.cells
    count = size // 1000
    cells = np.tile(cells, (count, count))
    for passage in range(490, size, 1000) if count > 1 else ():
        cells[passage : passage + 20, 100:-100] = FREE
        cells[100:-100, passage : passage + 20] = FREE
    return OccupancyGrid(cells, hall.resolution, name=f"halls {size}")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=browser_file(), args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module", params=SIZES)
def parts(request):
    """What a server begins with: a map, its opening and its field."""
    grid = halls(request.param)
    config = FieldConfig(Fisher(Lidar(range=6.0)), stride=0.2)
    far = request.param * grid.resolution
    opening = StartSettings(config, start=(8.0, 10.0), goal=(far - 12.0, far - 12.0))
    return grid, opening, covariance_field(grid, config)


def begun(parts):
    """A server whose field and costs are there."""
    grid, opening, field = parts
    explorer = open_explorer(grid, opening, field=field)
    explorer.session.wait()
    return explorer


@pytest.fixture(scope="module")
def server(parts):
    with begun(parts) as explorer:
        yield explorer


@pytest.fixture
def seen(browser, server):
    context = browser.new_context(viewport={"width": 1400, "height": 900})
    page = Window(context.new_page())
    page.page.set_default_timeout(120_000)
    yield page.open(server.address)
    assert page.faults == []
    context.close()


def kept(benchmark, milliseconds, seconds=None, **figures):
    """Leave the median and the 95 % quantile beside a benchmark."""
    assert milliseconds
    middle, high = np.quantile(milliseconds, (0.5, 0.95))
    told = {"median_ms": round(float(middle), 1), "at_95_percent_ms": round(float(high), 1)}
    if seconds:
        told["paths_a_second"] = round(len(milliseconds) / seconds, 1)
    benchmark.extra_info.update(told, no_peer="figures of the page", **figures)
    print(benchmark.name, told, figures)


def test_drag(benchmark, seen, server):
    """A goal that is dragged on a circle."""
    x, y = seen.middle(".marker.goal")
    seen.page.mouse.move(x, y)
    seen.page.mouse.down()
    painted = seen.value("painted")
    seen.page.mouse.move(x - 5, y)  # what follows finds the searches of this end done
    seen.wait_for_change("painted", painted)
    seen.page.evaluate("() => performance.clearMeasures()")

    def dragged():
        for k in range(MOVES):
            angle = 2 * math.pi * k / MOVES
            seen.page.mouse.move(x - 40 + 40 * math.cos(angle), y + 40 * math.sin(angle))
        return seen.page.evaluate(DRAGS)

    found = benchmark.pedantic(dragged, rounds=1)
    painted = seen.value("painted")
    seen.page.mouse.up()
    seen.wait_for_change("painted", painted)
    seen.settle()
    costs = server.session.scene.costs
    start, goal = seen.place("start"), seen.place("goal")
    length = float(seen.text("tr:nth-child(2) td:nth-child(2)").split()[0])
    plain = plan_with_shortest(costs, start, goal)["shortest"]
    assert length == pytest.approx(plain.path.length, rel=0.02)
    kept(benchmark, found, benchmark.stats.stats.total)


@pytest.mark.parametrize("waited", [0, 5], ids=["at once", "after 5 s"])
@pytest.mark.parametrize("held", ["start", "goal"])
def test_full_plans_of_a_drag(benchmark, seen, server, held, waited):
    """A drag's first draft, its first full plan, the next one, and the one at its release.

    Full plans count from the question to its answer in the page. The drag begins as soon as the
    page is ready and nothing is searched yet, or after a while.
    """
    server.session.searches.forget(lambda key: False)
    seen.page.evaluate(ANSWERS)
    x, y = seen.middle(f".marker.{held}")
    back = -1 if held == "goal" else 1

    def answered(count):
        for _ in range(2000):
            found = seen.page.evaluate("() => full_plans")
            if len(found) >= count:
                return found
            seen.page.wait_for_timeout(10)
        raise AssertionError("no full plan came")

    def dragged():
        seen.page.mouse.move(x, y)
        seen.page.mouse.down()
        found = []
        for stop in (20, 40):
            for k in range(20):
                seen.page.mouse.move(x + back * (stop + k / 2), y)
                seen.page.wait_for_timeout(10)
            before = len(found)
            found = answered(before + 1)  # large maps: once the drag rests
        moved = len(found)
        seen.page.mouse.move(x + back * 70, y)
        seen.page.mouse.up()
        seen.settle()
        return [found[0], found[moved - 1], answered(moved + 1)[-1]]

    seen.page.locator(f".marker.{held}").focus()
    seen.page.keyboard.press("ArrowRight")  # this plan makes the costmaps anew
    answered(1)
    seen.page.wait_for_timeout(1000 * waited)
    seen.page.evaluate("() => { full_plans.length = 0; performance.clearMeasures(); }")
    first, later, release = benchmark.pedantic(dragged, rounds=1)
    draft = seen.page.evaluate(DRAGS)[0]
    milliseconds = {"draft_ms": draft, "first_ms": first, "later_ms": later, "release_ms": release}
    figures = {name: round(value, 1) for name, value in milliseconds.items()}
    kept(benchmark, [first, later, release], **figures)
    start, goal = seen.place("start"), seen.place("goal")
    plans = plan_with_shortest(server.session.scene.costs, start, goal)
    length = float(seen.text("tr.best td:nth-child(2)").split()[0])
    assert length == pytest.approx(plans["localizability-aware"].path.length, rel=0.02)


def test_weight(benchmark, seen):
    """The weight's slider, pushed by its keys."""
    seen.page.locator("aside input[type=range]").focus()

    def pushed():
        for _ in range(MOVES // 3):
            painted = seen.value("painted")
            seen.page.keyboard.press("ArrowRight")
            seen.wait_for_change("painted", painted)
        return seen.page.evaluate(DRAGS)

    kept(benchmark, benchmark.pedantic(pushed, rounds=1), benchmark.stats.stats.total)


def test_edit(benchmark, seen):
    """A pole put in, until the map that holds it is painted; and until its field is whole."""
    seen.page.locator("#map").focus()
    seen.page.keyboard.press("p")
    before = seen.value("map")

    def put():
        seen.page.keyboard.press("Enter")
        seen.wait_for_change("map", before)

    benchmark.pedantic(put, rounds=1)
    seen.page.keyboard.press("Control+z")
    seen.wait(f'html[data-map="{before}"]')
    kept(benchmark, [1000 * benchmark.stats.stats.total])


def test_ready(benchmark, browser, parts):
    """From the address to the first painted paths, on a server that nobody asked anything before.

    Each round has its own, so that neither other tests nor other rounds have made what is kept, or
    left a page or a search behind. The first round, which starts the browser's parts, does not
    count.
    """
    left = contextlib.ExitStack()

    def start():
        left.close()
        explorer = left.enter_context(begun(parts))
        context = browser.new_context(viewport={"width": 1400, "height": 900})
        left.callback(context.close)
        return (context.new_page(), explorer.address), {}

    def opened_page(page, address):
        seen = Window(page)
        page.set_default_timeout(120_000)
        seen.open(address)

    with left:
        benchmark.pedantic(opened_page, setup=start, rounds=3, warmup_rounds=1)
    size = sum(file.stat().st_size for file in PAGE.iterdir())
    kept(benchmark, [1000 * each for each in benchmark.stats.stats.data], page_kB=size / 1000)


@pytest.mark.parametrize("zoom", ["whole", "near"])
def test_frames_while_panning(benchmark, seen, zoom):
    """The time between frames while the map is dragged."""
    x, y = 560, 400
    seen.page.mouse.move(x, y)
    for _ in range(12 if zoom == "near" else 0):
        seen.page.mouse.wheel(0, -200)
    seen.page.evaluate(FRAMES)
    seen.page.mouse.down()

    def panned():
        for k in range(3 * MOVES):
            seen.page.mouse.move(x + 60 * math.sin(k / 10), y + 60 * math.cos(k / 10))
        return seen.page.evaluate("() => window.frames_seen")

    found = np.diff(benchmark.pedantic(panned, rounds=1))
    seen.page.mouse.up()
    kept(benchmark, found.tolist(), frames_a_second=round(1000 / float(np.mean(found)), 1))
