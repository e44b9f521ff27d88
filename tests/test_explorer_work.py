"""The explorer's long answers: the front, the simulated choice, landmarks."""

import dataclasses
import json
import math

import numpy as np
import pytest
from explorer_views import (
    GOAL,
    MIDDLE,
    ROBOT,
    START,
    WAY,
    Ended,
    answered,
    corridors,
    costs_of,
    ending_after,
    paths_of,
    session_of,
)

from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.explorer import Opening, Session
from locplan.landmarks import Box, Pole, place_landmarks
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import AWARE, pareto_front, plan
from locplan.simulation import choose


@pytest.fixture(scope="module")
def session():
    made = session_of()
    yield made
    made.close()


# The front


def test_the_front_is_that_of_the_library(session):
    shown, own = answered(session, "front", **WAY), pareto_front(costs_of(), START, GOAL)
    points = shown["points"]
    assert shown["complete"]
    assert shown["paths"] == len(own)
    assert points[0]["length"] == own.length[0]
    assert points[-1]["degenerate"] == own.integral[-1]
    assert points[shown["knee"]]["length"] == own.length[own.knee]
    assert {point["length"] for point in points} <= set(own.length.tolist())
    n = own.length.tolist().index(points[3]["length"])
    np.testing.assert_allclose(points[3]["xy"], own.plan(n).path.xy, atol=1e-3)


def test_at_the_weight_of_a_point_of_a_front_the_grid_planner_finds_its_cost(session):
    points = answered(session, "front", **WAY)["points"]
    some = [point for point in points if point["weight"] and point["weight"] < 50]
    assert len(some) > 2
    for point in some[:3]:
        costs = costs_of().with_weight(point["weight"])
        cheapest = plan(costs, START, GOAL, planner="grid").metrics.cost
        cost = point["length"] + point["weight"] * point["degenerate"]
        assert cost == pytest.approx(cheapest, abs=0.2)
        others = [each["length"] + point["weight"] * each["degenerate"] for each in points]
        assert cost <= min(others) + 1e-9


def test_through_waypoints_the_front_is_the_best_of_all_sums(session):
    shown = answered(session, "front", **WAY | {"via": [list(MIDDLE)]})
    legs = [pareto_front(costs_of(), *ends) for ends in ((START, MIDDLE), (MIDDLE, GOAL))]
    sums = [
        (a + c, b + d)
        for a, b in zip(legs[0].length, legs[0].integral, strict=True)
        for c, d in zip(legs[1].length, legs[1].integral, strict=True)
    ]
    best, least = [], math.inf
    for length, integral in sorted(sums):
        if integral < least:
            best.append(length)
            least = integral
    points = shown["points"]
    assert shown["paths"] == len(best)
    assert [points[0]["length"], points[-1]["length"]] == [best[0], best[-1]]
    for point in points:
        assert np.isclose(point["xy"], MIDDLE).all(axis=1).any()


def test_of_a_long_front_both_ends_and_the_knee_are_shown(session):
    stops = [[10.0, 3.0], [20.0, 12.0], [30.0, 3.0]]
    shown = answered(session, "front", **WAY | {"via": stops})
    assert shown["paths"] > 60 >= len(shown["points"]) > 30
    lengths = [point["length"] for point in shown["points"]]
    assert lengths == sorted(lengths)
    assert 0 < shown["knee"] < len(lengths) - 1


class NoFront(list):
    """A front that was not found in time."""

    status = "timeout"


def test_a_front_without_paths_is_refused_with_the_reason(session, monkeypatch):
    monkeypatch.setattr("locplan.explorer._plans.pareto_front", lambda *_, **__: NoFront())
    with pytest.raises(ConfigError, match="within 5"):
        answered(session, "front", **WAY)
    NoFront.status = "unreachable"
    with pytest.raises(ConfigError, match="no path joins"):
        answered(session, "front", **WAY)


def test_a_front_cut_short_says_so(session, monkeypatch):
    own = dataclasses.replace(pareto_front(costs_of(), START, GOAL), epsilon=0.1)
    monkeypatch.setattr("locplan.explorer._plans.pareto_front", lambda *_, **__: own)
    shown = answered(session, "front", **WAY)
    assert (shown["complete"], shown["epsilon"]) == (False, 0.1)


def test_a_cancelled_front_ends_with_its_leg(session):
    progress, seen = ending_after(2)
    with pytest.raises(Ended):
        answered(session, "front", progress=progress, **WAY | {"via": [list(MIDDLE), [21.0, 3.0]]})
    assert seen == [(0, 3), (1, 3)]


# The simulated choice


def test_the_simulated_choice_is_that_of_the_library(session):
    shown = answered(session, "simulate", **WAY | {"weight": 6.0}, drives=4)
    grid, field = corridors()
    own = choose(grid, START, GOAL, ROBOT, costs=field.config, weight=6.0, drives=4)
    expected = json.loads(json.dumps(own.summary()))
    assert {name: shown[name] for name in expected} == expected
    assert shown["driven"] == own.driven


def test_while_the_field_follows_an_edit_the_simulated_choice_takes_none_of_it(session):
    _, field = corridors()
    stale = field.of({name: 2 * array for name, array in field.values.items()}, *field_of(field))
    made = []
    for known, whole in ((stale, True), (stale, False), (field, True)):
        session.show(Costmap.from_field(known.grid, known), known, whole=whole)
        made.append(answered(session, "simulate", **WAY, drives=2))
    kept, computed, own = made
    assert kept != computed == own


def field_of(field):
    return field.grid, field.config


def test_waypoints_bind_the_candidates(session):
    asked = WAY | {"via": [list(MIDDLE)], "weight": 12.0}
    for each in answered(session, "simulate", **asked, drives=3)["candidates"]:
        assert np.hypot(*(np.array(each["path"]["xy"]) - MIDDLE).T).min() < 1e-3


@pytest.mark.parametrize("calls", [2, 4])
def test_a_cancelled_simulation_drives_no_further(session, calls):
    progress, seen = ending_after(calls)
    asked = WAY | {"via": [list(MIDDLE)], "weight": 12.0}
    with pytest.raises(Ended):
        answered(session, "simulate", progress=progress, **asked, drives=60)
    assert len(seen) == calls


def test_without_a_path_there_is_no_verdict_on_one():
    cells = np.full((20, 40), FREE, np.uint8)
    cells[:, 20] = 0
    session = Session(OccupancyGrid(cells, 0.1), Opening(corridors()[1].config))
    session.begin().result(60)
    with pytest.raises(ConfigError, match="no path"):
        answered(session, "simulate", start=[0.5, 1.0], goal=[3.5, 1.0])
    session.close()


# Landmarks


def test_landmarks_are_those_of_the_library():
    robot = ROBOT.changed({"laser_model_type": "likelihood_field_prob"})
    session = session_of(robot=robot)
    asked = {"object": "pole:0.3", "count": 2, "drives": 0}
    shown = answered(session, "landmarks", **WAY | {"weight": 0.0}, **asked)
    aware = paths_of(0.0)[AWARE]
    own = place_landmarks(corridors()[0], Pole(0.3), 2, paths={"shown": aware}, robot=robot)
    expected = json.loads(json.dumps(own.summary()))
    assert {name: shown[name] for name in expected} == expected
    assert shown["verification"] is None
    session.close()


def test_drives_verify_landmarks(session):
    asked = {"object": "box:0.5,0.2", "count": 1, "drives": 4}
    shown = answered(session, "landmarks", **WAY | {"weight": 0.0}, **asked)
    aware = paths_of(0.0)[AWARE]
    own = place_landmarks(corridors()[0], Box(0.5, 0.2), 1, paths={"shown": aware}, robot=ROBOT)
    verified = own.verify(4, random_sets=1)
    assert shown["verification"] == verified.summary()
    assert shown["verification"]["before"]["drives"] == 4
    assert shown["object"] == {"kind": "box", "length": 0.5, "width": 0.2}


def test_cancelled_landmarks_end_at_a_step_or_a_drive(session):
    progress, seen = ending_after(2)
    asked = WAY | {"weight": 0.0, "count": 2, "drives": 50}
    with pytest.raises(Ended):
        answered(session, "landmarks", progress=progress, **asked)
    assert len(seen) == 2


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"object": "tree:1"}, "pole:DIAMETER"),
        ({"object": "pole:" + "1" * 999}, "object"),
        ({"object": "pole:nan"}, "diameter"),
        ({"object": 3}, "object"),
        ({"count": 0}, "count"),
        ({"count": 21}, "count"),
        ({"drives": 1}, "drives"),
        ({"drives": 257}, "drives"),
        ({"drives": True}, "drives"),
    ],
)
def test_landmarks_refuse_what_is_no_setting(session, asked, named):
    with pytest.raises(ConfigError, match=named):
        answered(session, "landmarks", **WAY, **asked)
