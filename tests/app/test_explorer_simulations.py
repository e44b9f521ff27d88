"""The explorer's long answer: the simulated choice."""

import json

import numpy as np
import pytest
from support.explorer_views import (
    GOAL,
    MIDDLE,
    ROBOT,
    START,
    WAY,
    Interrupted,
    ask_session,
    corridors,
    interrupt_after,
    open_session,
)

from locplan.app.explorer.scene import Opening
from locplan.app.explorer.session import Session
from locplan.errors import ConfigError
from locplan.maps import FREE, OccupancyGrid
from locplan.planning import Costmap
from locplan.simulation import choose


@pytest.fixture(scope="module")
def session():
    made = open_session()
    yield made
    made.close()


def test_the_simulated_choice_is_that_of_the_library(session):
    shown = ask_session(session, "simulate", **WAY | {"weight": 6.0}, drives=4)
    grid, field = corridors()
    own = choose(grid, START, GOAL, ROBOT, costs=field.config, weight=6.0, drives=4)
    expected = json.loads(json.dumps(own.summary()))
    assert {name: shown[name] for name in expected} == expected
    assert shown["driven"] == own.driven


def test_simulated_choice_races_shown_path(session):
    """The page shows a path that no planner of `choose` would find."""
    detour = [list(START), list(MIDDLE), [MIDDLE[0] + 1.0, MIDDLE[1]], list(GOAL)]
    answer = ask_session(session, "simulate", **WAY, drives=2, path=detour)
    shown = next(each for each in answer["candidates"] if each["name"] == "shown path")
    assert shown["path"]["xy"] == detour
    assert shown["driven"]["error"][0] > 0


@pytest.mark.long
def test_while_the_field_follows_an_edit_the_simulated_choice_takes_none_of_it(session):
    _, field = corridors()
    stale = field.of({name: 2 * array for name, array in field.values.items()}, *field_of(field))
    made = []
    for known, whole in ((stale, True), (stale, False), (field, True)):
        session.show(Costmap.from_field(known.grid, known), known, whole=whole)
        made.append(ask_session(session, "simulate", **WAY, drives=2))
    kept, computed, own = made
    assert kept != computed == own


def field_of(field):
    return field.grid, field.config


def test_waypoints_bind_the_candidates(session):
    asked = WAY | {"via": [list(MIDDLE)], "weight": 12.0}
    for each in ask_session(session, "simulate", **asked, drives=3)["candidates"]:
        assert np.hypot(*(np.array(each["path"]["xy"]) - MIDDLE).T).min() < 1e-3


@pytest.mark.parametrize("calls", [2, 4])
def test_a_cancelled_simulation_drives_no_further(session, calls):
    progress, seen = interrupt_after(calls)
    asked = WAY | {"via": [list(MIDDLE)], "weight": 12.0}
    with pytest.raises(Interrupted):
        ask_session(session, "simulate", progress=progress, **asked, drives=60)
    assert len(seen) == calls


def test_without_a_path_there_is_no_verdict_on_one():
    cells = np.full((20, 40), FREE, np.uint8)
    cells[:, 20] = 0
    session = Session(OccupancyGrid(cells, 0.1), Opening(corridors()[1].config))
    session.begin().result()
    with pytest.raises(ConfigError, match="no path"):
        ask_session(session, "simulate", start=[0.5, 1.0], goal=[3.5, 1.0])
    session.close()
