"""The explorer's socket: answers, events, and messages of every malformed kind."""

from __future__ import annotations

import dataclasses
import itertools
import json
import random
import threading

import pytest
from support.explorer_server import Page, connect_socket, fetch, serve
from support.machine import TIMEOUT
from support.maps import random_rooms

import locplan
from locplan.app.explorer.questions import QUESTIONS
from locplan.app.explorer.scene import Limits
from locplan.errors import LocplanError
from locplan.field import FieldConfig
from locplan.maps import OCCUPIED, OccupancyGrid

CONFIG = FieldConfig(locplan.Sad(range=1.0), stride=0.4)
SEED = 20


def room() -> OccupancyGrid:
    cells = random_rooms((40, 50), 2)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.1, (0.0, 0.0, 0.3), "room")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explorer")
    given = {
        "cache_dir": folder / "cache",
        "folder": folder / "out",
        "robot": locplan.Robot(footprint=0.1, margin=0.0),
    }
    with serve(room(), CONFIG, **given) as server:
        yield server


@pytest.fixture
def page(server):
    with connect_socket(server) as link:
        yield Page(link)


def replace_handler(monkeypatch, question, handler):
    """Let a function answer a kind of questions."""
    entry = dataclasses.replace(QUESTIONS[question], handler=handler)
    monkeypatch.setitem(QUESTIONS, question, entry)


@pytest.fixture
def held(monkeypatch):
    """Fronts and edits that are answered when they are let go."""
    begun, let_go = threading.Semaphore(0), threading.Event()

    def wait(session, ask, work):
        begun.release()
        assert let_go.wait(TIMEOUT)
        work.cancel.check()
        return {"n": ask.whole("n", 0, 100, 0)}

    replace_handler(monkeypatch, "simulate", wait)
    replace_handler(monkeypatch, "edit", wait)
    yield begun, let_go
    let_go.set()


def test_a_plan_is_answered_with_both_paths(page):
    state = page.state
    told = page.ask("plan", start=state["start"], goal=state["goal"], via=[], weight=3.0, hold=None)
    assert told["start"] == state["start"]
    for name in ("aware", "shortest"):
        path = told[name]
        assert path["xy"][0] == pytest.approx(state["start"])
        assert path["xy"][-1] == pytest.approx(state["goal"])
        profile = path["profile"]
        assert len(profile["s"]) == len(profile["u"]) == len(profile["sigma_cm"])
    assert told["shortest"]["length"] <= told["aware"]["length"]


def test_of_waiting_questions_of_a_kind_the_newest_is_answered(page, held):
    begun, let_go = held
    first = page.send("simulate", n=1)
    assert begun.acquire(timeout=TIMEOUT)
    others = [page.send("simulate", n=n) for n in (2, 3, 4)]
    assert page.ask("at", x=1.0, y=1.0)["re"]  # another lane answers meanwhile
    let_go.set()
    told = {}
    for number in (first, *others):
        told[number] = page.wait(number)
    assert [told[n].get("stale") for n in (first, *others)] == [True, True, True, None]
    assert told[others[-1]]["n"] == 4


def test_an_overtaken_question_hears_of_it_by_its_progress(page, monkeypatch):
    begun, let_go = threading.Semaphore(0), threading.Event()

    def work_on(session, ask, work):
        begun.release()
        assert let_go.wait(TIMEOUT)
        work.progress(1, 2)
        return {"n": ask.whole("n", 0, 100, 0)}

    replace_handler(monkeypatch, "simulate", work_on)
    first = page.send("simulate", n=1)
    assert begun.acquire(timeout=TIMEOUT)
    second = page.send("simulate", n=2)
    assert page.ask("at", x=1.0, y=1.0)["re"]
    let_go.set()
    told = {number: page.wait(number) for number in (first, second)}
    assert told[first].get("stale")
    assert told[second]["n"] == 2


def test_every_edit_is_answered_though_newer_ones_wait(page, held):
    begun, let_go = held
    numbers = [page.send("edit", n=n) for n in (1, 2, 3)]
    assert begun.acquire(timeout=TIMEOUT)
    let_go.set()
    assert [page.wait(number)["n"] for number in numbers] == [1, 2, 3]


def test_questions_of_one_page_do_not_overtake_those_of_another(server, page, held):
    begun, let_go = held
    with connect_socket(server) as link:
        other = Page(link)
        one, two = page.send("simulate", n=1), other.send("simulate", n=2)
        assert begun.acquire(timeout=TIMEOUT)
        assert other.ask("at", x=1.0, y=1.0)["re"] == 2
        let_go.set()
        assert page.wait(one)["n"] == 1
        assert other.wait(two)["n"] == 2


def test_a_cancelled_question_ends(page, held):
    begun, let_go = held
    number = page.send("simulate")
    assert begun.acquire(timeout=TIMEOUT)
    assert page.ask("cancel", of=number) == {"re": 2, "ok": True}
    let_go.set()
    assert page.wait(number) == {"re": number, "cancelled": True}
    assert page.ask("cancel", of=number)["ok"]  # too late, and no harm


def test_a_page_that_goes_ends_its_work(server, monkeypatch):
    begun, let_go, seen = threading.Semaphore(0), threading.Event(), threading.Event()

    def wait(session, ask, work):
        begun.release()
        assert let_go.wait(TIMEOUT)
        if work.cancel.cancelled:
            seen.set()
        return {}

    replace_handler(monkeypatch, "simulate", wait)
    before = len(server.session.listeners)
    with connect_socket(server) as link:
        page = Page(link)
        page.send("simulate")
        assert begun.acquire(timeout=TIMEOUT)
    with connect_socket(server) as link:
        while len(server.session.listeners) > before + 1:
            Page(link).ask("at", x=0.0, y=0.0)
    let_go.set()
    assert seen.wait(TIMEOUT)


def test_too_many_waiting_questions_are_refused(server, page, held, monkeypatch):
    limited = dataclasses.replace(server.session.opening, limits=Limits(waiting=3))
    monkeypatch.setattr(server.session, "opening", limited)
    _, let_go = held
    numbers = [page.send("edit") for _ in range(4)]
    assert "too many" in page.wait(numbers[3])["error"]
    let_go.set()
    assert [page.wait(number)["n"] for number in numbers[:3]] == [0, 0, 0]


def test_an_id_that_is_under_way_is_refused(page, held):
    begun, let_go = held
    number = page.send("simulate", n=7)
    assert begun.acquire(timeout=TIMEOUT)
    page.link.send(json.dumps({"do": "at", "id": number, "x": 0, "y": 0}))
    assert "under way" in page.wait(number)["error"]
    let_go.set()
    assert page.wait(number)["n"] == 7


def test_a_fault_within_an_answer_is_one_line(page, monkeypatch):
    def fail(session, ask, work):
        raise ZeroDivisionError("no\nway")

    replace_handler(monkeypatch, "simulate", fail)
    told = page.ask("simulate")
    assert "ZeroDivisionError" in told["error"]
    assert "\n" not in told["error"]
    assert page.ask("at", x=0.0, y=0.0)["re"] == 2


def test_an_edit_is_seen_by_all_pages_and_undone_by_any(server):
    with connect_socket(server) as one, connect_socket(server) as other:
        first, second = Page(one), Page(other)
        before = first.state
        x, y = before["start"]
        stroke = {"tool": "pole", "points": [[x + 0.3, y]], "width": 0.3}
        assert first.ask("edit", strokes=[stroke])["changed"]

        def is_new(state):
            whole = state["field"]["whole"] and state["busy"] is None
            return state["map"]["digest"] != before["map"]["digest"] and whole

        seen = [page.state_when(is_new) for page in (first, second)]
        assert seen[0]["map"] == seen[1]["map"]
        assert seen[0]["map"]["can_undo"]
        assert seen[0]["map"]["edited"]
        assert fetch(server, f"/data/cells/{seen[0]['map']['digest']}")[0] == 200
        second.ask("undo")
        for page in (first, second):
            page.state_when(lambda state: state["field"]["digest"] == before["field"]["digest"])
        assert "no edit" in second.ask("undo")["error"]


def test_other_settings_tell_of_their_progress(page):
    told = page.ask("configure", range=0.7)
    assert told == {"re": 1, "ok": True}
    progress = [event for event in page.events if "progress" in event]
    assert all(event["progress"] == 1 for event in progress)
    state = page.state_when(lambda state: state["field"]["range"] == 0.7)
    assert [layer["name"] for layer in state["layers"]] == ["sigma", "heading", "degeneracy", "e"]
    assert page.ask("configure", range=1.0)["ok"]


def test_states_come_in_their_order(page, server, monkeypatch):
    numbers, last_came = itertools.count(1), threading.Event()

    def numbered(session):
        number = next(numbers)
        if number == 1:  # it takes long, unless it is the only one under way
            last_came.wait(0.5)
        else:
            last_came.set()
        return {"number": number}

    monkeypatch.setattr("locplan.app.explorer.state.state", numbered)
    seen = []
    for _ in range(3):
        server.session.tell({"event": "state"})
        page.ask("at", x=0.0, y=0.0)
    while not seen or seen[-1] < 2:
        seen = [e["number"] for e in page.events if "number" in e]
        page.ask("at", x=0.0, y=0.0)
    assert seen == sorted(seen)


def test_a_page_that_comes_back_finds_the_session_as_it_is(server):
    with connect_socket(server) as link:
        before = Page(link).state
    with connect_socket(server) as link:
        assert Page(link).state == before


HOSTILE = (
    *("", "null", "1", "[]", '"plan"', "{", "{}", "not json", "\x00", "[" * 100_000, "{" * 5000),
    *('{"do":"at"}', '{"id":1}', '{"do":"at","id":-1}', '{"do":"at","id":1.5}', '{"id":"1"}'),
    *('{"do":"at","id":true}', '{"do":"at","id":NaN}', '{"do":"at","id":1e400,"x":0,"y":0}'),
    *('{"do":"at","id":' + "9" * 5000 + "}", '{"do":["at"],"id":1}', '{"do":{},"id":1}'),
    *('{"do":"__init__","id":1}', '{"do":"' + "x" * 1000 + '","id":1}', '{"do":"cancel","id":1}'),
    *('{"do":"cancel","id":1,"of":"x"}', '{"do":"cancel","id":2,"of":{}}', "\ud7ff\uffff"),
)
VALUES = (
    *(None, True, False, 0, -1, 1.5, 1e308, -1e308, 1e-320, 2**70, "", "x", "start", "via:0"),
    *("via:99", "\u202e", "a\nb", "x" * 300, [], [[]], {}, {"a": 1}, [1], [1, 2], [1, 2, 3]),
    *([None, None], ["a", "b"], [[1, 2]] * 60, [1e300, 1e300], [True, False], [[1, 2], 3]),
    *([{"tool": "wall"}], [{"tool": "pole", "points": [[1, 1]], "width": -1}], [[[[[]]]]]),
    *([{"tool": "box", "points": [[1e9, 1]], "width": [1, "x"]}], "../x", "/etc/passwd", "sad"),
    *([{"tool": "erase", "points": [[1, 1]] * 9, "width": 1e9, "heading": 1e9}], "lds-01", 12345),
)
NAMES = (
    *("start", "goal", "via", "weight", "hold", "draft", "x", "y", "estimator", "lidar", "range"),
    *("headings", "strokes", "name", "of", "time_limit", "to", "distro", "id2"),
)
QUICK = ("plan", "at", "idle", "configure", "edit", "undo", "redo", "save", "cancel")


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text[:20]))
def test_malformed_messages_are_answered_in_one_line(page, text):
    page.link.send(text)
    told = page.wait(None) if not _numbered(text) else page.wait(_numbered(text))
    assert told["error"]
    assert "\n" not in told["error"]
    assert page.ask("at", x=0.0, y=0.0)["x"] == 0.0


def _numbered(text: str) -> int | None:
    """The number of a question that has one."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        return None
    number = values.get("id") if isinstance(values, dict) else None
    return number if type(number) is int and number >= 0 else None


def test_malformed_bytes_do_not_end_the_page(page):
    page.link.send(b"\xff\x00\x01")
    assert page.wait(None)["error"]
    assert page.ask("at", x=0.0, y=0.0)["x"] == 0.0


def test_random_questions_are_answered_by_a_result_or_one_line(server):
    chance, start = random.Random(SEED), None
    with connect_socket(server) as link:
        page = Page(link)
        start, goal = page.state["start"], page.state["goal"]
        for _ in range(300):
            values = {"start": start, "goal": goal, "weight": 4.0, "x": 1.0, "y": 1.0}
            for name in chance.sample(NAMES, chance.randint(0, 4)):
                values[name] = chance.choice(VALUES)
            do = chance.choice(QUICK)
            if do in ("configure", "edit") and chance.random() < 0.5:
                continue  # these take longest
            told = page.ask(do, **values)
            assert "failed" not in told.get("error", ""), (do, values, told)
            assert "\n" not in told.get("error", "")
        assert page.ask("at", x=0.0, y=0.0)["x"] == 0.0
        while server.session.edits:
            page.ask("undo")


def test_values_of_a_question_are_checked_by_name(server, monkeypatch):
    asked = []
    replace_handler(monkeypatch, "simulate", lambda session, ask, work: asked.append(ask) or {})
    values = {"n": 3, "x": "1", "far": [1e9, 0], "t": "a\u202eb", "big": 2**80}
    server.session.answer("simulate", **values)
    (ask,) = asked
    assert ask.whole("n", 0, 5, None) == 3
    assert ask.whole("none", 0, 5, None) is None
    assert ask.number("none", 0, 5, 2.5) == 2.5
    for name, read in (
        ("x", lambda: ask.number("x", 0, 5, None)),
        ("n", lambda: ask.whole("n", 4, 5, None)),
        ("n", lambda: ask.one_of("n", ("a", "b"), None)),
        ("n", lambda: ask.flag("n")),
        ("n", lambda: ask.text("n", None)),
        ("t", lambda: ask.text("t", None)),
        ("far", lambda: ask.position("far")),
        ("big", lambda: ask.number("big", 0, 5, None)),
        ("n", lambda: ask.mapping("n")),
        ("n", lambda: ask.items("n", 5)),
    ):
        with pytest.raises(LocplanError, match=rf"^{name} must"):
            read()
