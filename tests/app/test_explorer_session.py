"""The session: its state, its first route, its weak spots, and random changes."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from support.explorer_sessions import (
    GOAL,
    POINT,
    ROUTE,
    SAD,
    START,
    ask,
    ask_plan,
    free_places,
    open_corridors,
    open_session,
    rooms,
)

import locplan
from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.session import Session
from locplan.app.explorer.state import describe_session, describe_state
from locplan.errors import LocplanError
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

SEED = 20


@pytest.fixture(scope="module")
def session():
    session = open_corridors()
    yield session
    session.close()


def test_first_route_avoids_degenerate_metres(session):
    """Start and goal lie where both paths differ, not merely far apart."""
    route = describe_state(session)["route"]
    answer = ask(session, "plan", **route)
    recommended, shortest = answer["recommended"], answer["shortest"]
    assert recommended["degenerate"] < 0.5 * shortest["degenerate"]
    assert route["start"] < route["goal"]


def test_first_route_keeps_ends_of_user():
    session = open_corridors(start=START)
    assert session.route.start == START
    assert math.dist(session.route.goal, START) > 10
    session = open_corridors(start=START, goal=GOAL, via=((20.0, 3.0),))
    route = {"start": list(START), "goal": list(GOAL), "via": [[20.0, 3.0]]}
    assert describe_state(session)["route"] == route


def test_weak_spot_has_name_and_reason(session):
    (spot, *_) = describe_state(session)["weak_spots"]
    assert spot["letter"] == "A"
    assert spot["title"].startswith("Long corridor, ")
    assert spot["reason"].startswith("No features along x within 6 m: ")
    assert spot["sigma_cm"] > 10
    assert len(spot["outline"]) > 3
    place = ask(session, "at", x=spot["x"], y=spot["y"])
    assert place["reason"] == spot["reason"]
    assert ask(session, "at", x=3.0, y=12.0)["reason"] is None


def test_zones_keep_weak_spots():
    session = open_corridors()
    before = describe_state(session)["weak_spots"]
    wall = {"kind": "wall", "points": [[1.0, 1.0], [1.2, 1.0]], "width": 0.1}
    ask(session, "change", changes=[wall])
    session.wait()
    with_wall = describe_state(session)["weak_spots"]
    session.files.forget()
    square = [[9.0, 0.0], [9.0, 6.0], [10.0, 6.0], [10.0, 0.0]]
    zone = {"kind": "zone", "zone": "no-go", "polygon": square}
    ask(session, "change", changes=[wall, zone])
    session.wait()
    assert describe_state(session)["weak_spots"] == with_wall
    ask(session, "change", changes=[])
    session.wait()
    assert describe_state(session)["weak_spots"] == before


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (3, 3)])
@pytest.mark.parametrize("level", [FREE, UNKNOWN, OCCUPIED])
def test_tiny_and_unknown_maps_have_state(shape, level):
    session = open_session(OccupancyGrid(np.full(shape, level), 0.1), robot=POINT)
    state = describe_state(session)
    assert (state["route"] is None) == (level != FREE)
    assert state["field"]["is_whole"]
    if level == FREE:
        assert ask(session, "plan", **state["route"])["shortest"]["length"] is not None
    else:
        with pytest.raises(LocplanError, match="no free cell"):
            ask(session, "plan", start=[0.0, 0.0], goal=[0.1, 0.1])
    assert describe_session(session)["map"]["rows"] == shape[0]


def test_place_has_covariance_of_field():
    session = open_session(rooms())
    for x, y in free_places(session, 5):
        answer = ask(session, "at", x=x, y=y)
        covariance = session.field.at((x, y), "covariance")
        major, minor, angle = locplan.field.position_axes(covariance)
        assert answer["axes"] == [pytest.approx(100 * major), pytest.approx(100 * minor)]
        assert answer["angle"] == pytest.approx(float(angle))
        assert answer["heading_deg"] == pytest.approx(math.degrees(math.sqrt(covariance[2, 2])))
    far = ask(session, "at", x=-1e6, y=5.0)
    assert not far["known"]
    assert "axes" not in far


def test_clearance_needs_no_array_of_map():
    session = Session(rooms(), StartSettings(SAD, POINT))
    places = free_places(session, 20, seed=3)
    clearance = [ask(session, "at", x=x, y=y)["clearance"] for x, y in places]
    assert "clearance" not in vars(session.grid)
    assert clearance == [session.grid.clearance[session.grid.cell(xy)] for xy in places]
    free = Session(OccupancyGrid(np.full((4, 4), FREE), 0.1), StartSettings(SAD, POINT))
    assert ask(free, "at", x=0.1, y=0.1)["clearance"] is None


@pytest.mark.parametrize(
    ("change", "digests"),
    [
        ({"kind": "wall", "points": [[5.0, 3.0], [6.0, 3.0]], "width": 0.2}, {"map", "field"}),
        ({"kind": "erase", "points": [[20.0, 1.9]], "width": 0.5}, {"map", "field"}),
        ({"kind": "pole", "points": [[5.0, 3.0]], "width": 0.2}, {"map", "field"}),
        ({"kind": "lidar", "lidar": None, "range": 4.0}, {"robot", "field"}),
        ({"kind": "zone", "zone": "slow", "polygon": [[2, 2], [3, 2], [3, 3]]}, {"zones"}),
    ],
)
def test_change_alters_basis_until_undo(session, change, digests):
    before = ask(session, "plan", **ROUTE, route="key")
    ask(session, "change", changes=[change])
    after = ask(session, "plan", **ROUTE, route="other key")
    different = {name for name, digest in after["basis"].items() if before["basis"][name] != digest}
    assert different == {*digests, "route"}
    ask(session, "change", changes=[])
    assert ask(session, "plan", **ROUTE, route="key") == before


def test_refused_change_changes_nothing():
    session = open_session(rooms())
    before = session.scene
    pole = {"kind": "pole", "points": [free_places(session, 1)[0]], "width": 0.3}
    with pytest.raises(LocplanError, match="width must"):
        ask(session, "change", changes=[pole, {**pole, "width": "wide"}])
    assert session.scene is before
    assert session.changes == ()


def test_session_ends_during_computation(tmp_path):
    session = open_session(rooms(), cache_dir=tmp_path)
    ask(session, "change", changes=[{"kind": "lidar", "range": 2.0}])
    session.close()
    with pytest.raises(RuntimeError):
        ask(session, "change", changes=[])


def test_turned_map_has_paths_in_world():
    session = open_session(rooms(3, yaw=0.9))
    start, goal = free_places(session, 2, seed=11)
    path = ask_plan(session, [start, goal], 4.0)["recommended"]
    expected = locplan.plan(session.scene.costs, start, goal)
    assert path["length"] == pytest.approx(expected.metrics.length, rel=0.2)
    np.testing.assert_allclose(path["xy"][0], start, atol=1e-3)
    assert describe_session(session)["map"]["origin"] == [1.0, -2.0, 0.9]


def random_change(chance: random.Random, places) -> dict:
    kind = chance.choice(["wall", "erase", "pole", "zone", "zone", "lidar"])
    (x, y), other = chance.sample(places, 2)
    if kind == "lidar":
        return {"kind": kind, "lidar": None, "range": chance.choice([1.0, 1.5])}
    if kind == "zone":
        a, b = chance.uniform(0.3, 1.5), chance.uniform(0.3, 1.5)
        polygon = [[x, y], [x + a, y], [x + a, y + b], [x, y + b]]
        zone = chance.choice(["no-go", "slow", "prefer"])
        return {"kind": kind, "zone": zone, "polygon": polygon, "percent": 30}
    points = [[x, y]] if kind == "pole" else [[x, y], list(other)]
    return {"kind": kind, "points": points, "width": chance.uniform(0.1, 0.4)}


def act_at_random(session: Session, n_actions: int) -> None:
    """Draw, undo, redo and plan at random; then compare with a fresh session."""
    chance, places = random.Random(SEED), free_places(session, 40)
    changes, undone = [], []
    for n in range(n_actions):
        action = chance.choice(["draw", "undo", "redo", "plan", "plan", "at"])
        if action == "draw" and len(changes) < 8:
            changes, undone = [*changes, random_change(chance, places)], []
        elif action == "undo" and changes:
            undone.append(changes.pop())
        elif action == "redo" and undone:
            changes.append(undone.pop())
        elif action == "at":
            x, y = chance.choice(places)
            ask(session, "at", x=x, y=y)
            continue
        else:
            held = chance.choice([None, 0, 1])
            ask_plan(session, chance.sample(places, 2), chance.choice([2.0, 8.0]), held=held)
            continue
        answer = ask(session, "change", changes=changes)
        assert len(answer["changes"]) == len(changes)
        if n % (n_actions // 10) == 0:
            compare_with_fresh(session, changes, places[:2])
    compare_with_fresh(session, changes, places[:2])


def compare_with_fresh(session: Session, changes, stops) -> None:
    session.wait()
    fresh = open_session(rooms(), cache_dir=session.opening.cache_dir)
    ask(fresh, "change", changes=changes)
    fresh.wait()
    ours, expected = describe_state(session), describe_state(fresh)
    assert ours == {**expected, "route": ours["route"]}
    for name in ("density", "u", "e"):
        np.testing.assert_array_equal(
            getattr(session.scene.costs, name), getattr(fresh.scene.costs, name)
        )
    try:
        plan = ask_plan(fresh, stops, 8.0)
    except LocplanError as error:  # a stop may have no free cell near it any more
        with pytest.raises(LocplanError, match=str(error)[:20]):
            ask_plan(session, stops, 8.0)
    else:
        session.searches.forget()
        assert ask_plan(session, stops, 8.0) == plan
    fresh.close()


def test_random_actions_match_fresh_session(tmp_path):
    act_at_random(open_session(rooms(), cache_dir=tmp_path), 60)


@pytest.mark.long
def test_many_random_actions_match_fresh_session(tmp_path):
    act_at_random(open_session(rooms(), cache_dir=tmp_path), 2000)
