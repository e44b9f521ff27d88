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
from locplan.app.explorer.messages import Cancelled
from locplan.app.explorer.questions import QUESTIONS
from locplan.app.explorer.session import Session
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
    """Simulations and changes that are answered once they may go on."""
    begun, let_go = threading.Semaphore(0), threading.Event()

    def wait(session, scene, question, job):
        begun.release()
        assert let_go.wait(TIMEOUT)
        job.check()
        return {"n": question.number("n", 0, 100, 0)}

    replace_handler(monkeypatch, "simulate", wait)
    replace_handler(monkeypatch, "change", wait)
    yield begun, let_go
    let_go.set()


def test_plan_is_answered_with_both_paths(page):
    state = page.state
    route = state["route"]
    told = page.ask("plan", **route, route="key", weight=3.0, hold=None)
    assert told["start"] == route["start"]
    assert told["basis"] == {**state["basis"], "route": "key"}
    for name in ("recommended", "shortest"):
        path = told[name]
        assert path["xy"][0] == pytest.approx(route["start"], abs=1e-3)
        assert path["xy"][-1] == pytest.approx(route["goal"], abs=1e-3)
        assert len(path["profile"]["s"]) == len(path["profile"]["sigma_cm"])
    assert told["shortest"]["length"] <= told["recommended"]["length"]


def test_server_answers_newest_waiting_question(page, held):
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


def test_overtaken_question_ends_at_its_progress(page, monkeypatch):
    begun, let_go = threading.Semaphore(0), threading.Event()

    def work_on(session, scene, question, job):
        begun.release()
        assert let_go.wait(TIMEOUT)
        job.progress(1, 2)
        return {"n": question.number("n", 0, 100, 0)}

    replace_handler(monkeypatch, "simulate", work_on)
    first = page.send("simulate", n=1)
    assert begun.acquire(timeout=TIMEOUT)
    second = page.send("simulate", n=2)
    assert page.ask("at", x=1.0, y=1.0)["re"]
    let_go.set()
    told = {number: page.wait(number) for number in (first, second)}
    assert told[first].get("stale")
    assert told[second]["n"] == 2


def test_all_changes_are_answered(page, held):
    begun, let_go = held
    numbers = [page.send("change", n=n) for n in (1, 2, 3)]
    assert begun.acquire(timeout=TIMEOUT)
    let_go.set()
    assert [page.wait(number)["n"] for number in numbers] == [1, 2, 3]


def test_pages_do_not_overtake_each_other(server, page, held):
    begun, let_go = held
    with connect_socket(server) as link:
        other = Page(link)
        one, two = page.send("simulate", n=1), other.send("simulate", n=2)
        assert begun.acquire(timeout=TIMEOUT)
        assert other.ask("at", x=1.0, y=1.0)["re"] == 2
        let_go.set()
        assert page.wait(one)["n"] == 1
        assert other.wait(two)["n"] == 2


def test_plan_of_another_page_ends_preparation(server, page, monkeypatch):
    begun = threading.Semaphore(0)

    def prepare(session, scene, question, job):
        begun.release()
        while True:
            job.check()

    entry = dataclasses.replace(QUESTIONS["plan"], follow_up=prepare)
    monkeypatch.setitem(QUESTIONS, "plan", entry)
    route = page.state["route"]
    assert page.ask("plan", **route)["recommended"]
    assert begun.acquire(timeout=TIMEOUT)
    with connect_socket(server) as link:
        assert Page(link).ask("plan", **route)["recommended"]
        assert begun.acquire(timeout=TIMEOUT)  # a page that closes prepares nothing
    monkeypatch.undo()
    assert page.ask("plan", **route)["recommended"]


def test_cancelled_question_ends(page, held):
    begun, let_go = held
    number = page.send("simulate")
    assert begun.acquire(timeout=TIMEOUT)
    assert page.ask("cancel", of=number) == {"re": 2, "ok": True}
    let_go.set()
    assert page.wait(number) == {"re": number, "cancelled": True}
    assert page.ask("cancel", of=number)["ok"]  # too late, and no harm


def test_closed_page_ends_its_work(server, monkeypatch):
    begun, let_go, seen = threading.Semaphore(0), threading.Event(), threading.Event()

    def wait(session, scene, question, job):
        begun.release()
        assert let_go.wait(TIMEOUT)
        try:
            job.check()
        except Cancelled:
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


def test_waiting_id_is_refused(page, held):
    begun, let_go = held
    number = page.send("simulate", n=7)
    assert begun.acquire(timeout=TIMEOUT)
    page.link.send(json.dumps({"do": "at", "id": number, "x": 0, "y": 0}))
    assert "is already waiting" in page.wait(number)["error"]
    let_go.set()
    assert page.wait(number)["n"] == 7


def test_error_within_answer_is_one_line(page, monkeypatch):
    def fail(session, scene, question, job):
        raise ZeroDivisionError("no\nway")

    replace_handler(monkeypatch, "simulate", fail)
    told = page.ask("simulate")
    assert "ZeroDivisionError" in told["error"]
    assert "\n" not in told["error"]
    assert page.ask("at", x=0.0, y=0.0)["re"] == 2


def test_pages_share_changes_and_undo(server):
    with connect_socket(server) as one, connect_socket(server) as other:
        first, second = Page(one), Page(other)
        before = first.state
        x, y = before["route"]["start"]
        pole = {"kind": "pole", "points": [[x + 0.3, y]], "width": 0.3}
        answer = first.ask("change", changes=[pole])
        assert answer["basis"]["map"] != before["basis"]["map"]

        def is_new(state):
            return state["changes"] == [pole] and state["field"]["is_whole"]

        states = [page.state_when(is_new) for page in (first, second)]
        assert states[0]["basis"] == states[1]["basis"]
        assert fetch(server, f"/cells/{states[0]['basis']['map']}")[0] == 200
        basis = second.ask("change", changes=[])["basis"]
        assert basis == {**before["basis"], "route": None} or basis == before["basis"]
        for page in (first, second):
            page.state_when(lambda state: state["basis"] == before["basis"])


def test_new_lidar_starts_without_field(page):
    before = page.state
    lidar = {"kind": "lidar", "lidar": None, "range": 0.7}
    basis = page.ask("change", changes=[lidar])["basis"]
    assert basis["field"] is None
    assert basis["map"] == before["basis"]["map"]
    state = page.state_when(lambda state: state["field"] and state["robot"]["range"] == 0.7)
    assert [layer["name"] for layer in state["layers"]] == ["degeneracy", "deviation"]
    assert any(event.get("event") == "progress" for event in page.events)
    assert page.ask("change", changes=[])["basis"]["field"] == before["basis"]["field"]


def test_states_come_in_their_order(page, server, monkeypatch):
    numbers, last_came = itertools.count(1), threading.Event()

    def numbered(session):
        number = next(numbers)
        if number == 1:  # it takes long, unless it is the only one under way
            last_came.wait(0.5)
        else:
            last_came.set()
        return {"number": number}

    monkeypatch.setattr("locplan.app.explorer.socket.describe_state", numbered)
    seen = []
    for _ in range(3):
        server.session.send_event({"event": "state"})
        page.ask("at", x=0.0, y=0.0)
    while not seen or seen[-1] < 2:
        seen = [e["number"] for e in page.events if "number" in e]
        page.ask("at", x=0.0, y=0.0)
    assert seen == sorted(seen)


def test_reopened_page_finds_same_state(server):
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
    *([{"kind": "wall"}], [{"kind": "pole", "points": [[1, 1]], "width": -1}], [[[[[]]]]]),
    *([{"kind": "box", "points": [[1e9, 1]], "width": [1, "x"]}], "../x", "/etc/passwd", "sad"),
    *([{"kind": "erase", "points": [[1, 1]] * 9, "width": 1e9}], "lds-01", 12345),
    [{"kind": "pole", "points": [[1, 1]], "width": 0.2}],
    [{"kind": "zone", "zone": "no-go", "polygon": [[1, 1], [2, 1], [2, 2]]}],
    [{"kind": "zone", "zone": "slow", "polygon": [[1, 1], [1, 1], [1, 1]]}],
)
NAMES = (
    *("start", "goal", "via", "weight", "hold", "draft", "x", "y", "changes", "route"),
    *("of", "distro", "id2"),
)
QUICK = ("plan", "at", "change", "cancel")


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text[:20]))
def test_malformed_message_gets_error_line(page, text):
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


def test_malformed_bytes_keep_page_open(page):
    page.link.send(b"\xff\x00\x01")
    assert page.wait(None)["error"]
    assert page.ask("at", x=0.0, y=0.0)["x"] == 0.0


def test_random_questions_never_crash_server(server):
    chance = random.Random(SEED)
    with connect_socket(server) as link:
        page = Page(link)
        before, route = page.state["basis"], page.state["route"]
        for _ in range(300):
            values = {**route, "weight": 4.0, "x": 1.0, "y": 1.0, "changes": []}
            for name in chance.sample(NAMES, chance.randint(0, 4)):
                values[name] = chance.choice(VALUES)
            do = chance.choice(QUICK)
            answer = page.ask(do, **values)
            assert "failed" not in answer.get("error", ""), (do, values, answer)
            assert "\n" not in answer.get("error", "")
        page.ask("change", changes=[])
        page.state_when(lambda state: state["basis"] == before)


def test_random_changes_match_fresh_session(server):
    """Two pages change one session, and both see the state of a session with these changes."""
    chance, changes = random.Random(SEED), []
    with connect_socket(server) as one, connect_socket(server) as other:
        pages = [Page(one), Page(other)]
        (x, y), route = pages[0].state["route"]["start"], pages[0].state["route"]
        for _ in range(40):
            page = chance.choice(pages)
            if chance.random() < 0.3:
                page.ask("plan", **route, weight=4.0, hold=chance.choice([None, "goal"]))
                continue
            at = [x + chance.uniform(-0.5, 1.0), y + chance.uniform(-0.5, 1.0)]
            pole = {"kind": "pole", "points": [at], "width": 0.2}
            corner = [at, [at[0] + 0.4, at[1]], [at[0], at[1] + 0.4]]
            zone = {"kind": "zone", "zone": "prefer", "polygon": corner, "percent": None}
            changes = (
                changes[:-1] if chance.random() < 0.5 else [*changes, chance.choice([pole, zone])]
            )
            assert page.ask("change", changes=changes)["changes"] == changes
        session = Session(room(), server.session.opening)
        session.begin()
        session.apply_changes(server.session.changes)
        session.wait()
        expected = session.scene.basis
        for page in pages:
            state = page.state_when(lambda state: state["basis"] == expected)
            assert state["changes"] == changes
        for page in pages:
            page.ask("change", changes=[])
        session.close()
