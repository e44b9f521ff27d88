"""The simulation of a route, against the library's recommendation."""

from __future__ import annotations

import re

import numpy as np
import pytest
from support.explorer_sessions import (
    GOAL,
    MIDDLE,
    ROBOT,
    ROUTE,
    START,
    Interrupted,
    ask,
    corridors,
    interrupt_after,
    open_corridors,
)

from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.session import Session
from locplan.errors import ConfigError, LocplanError
from locplan.maps import FREE, OccupancyGrid, Zone, Zones
from locplan.planning import Path
from locplan.simulation import RecommendationSettings, recommend_path

BAND = [[0.5, 8.0], [39.5, 8.0], [39.5, 12.0], [0.5, 12.0]]
"""A zone in the upper corridor."""


@pytest.fixture(scope="module")
def session():
    session = open_corridors()
    yield session
    session.close()


def test_simulation_equals_library_simulation(session):
    shown = ask(session, "plan", **ROUTE)["recommended"]["xy"]
    answer = ask(session, "simulate", **ROUTE, path=shown, drives=4)
    grid, field = corridors()
    paths = {"shown": Path(shown)}
    choice = recommend_path(
        grid,
        START,
        GOAL,
        ROBOT,
        costs=field.config,
        settings=RecommendationSettings(weight=3.0, drives=4),
        candidates=paths,
    )
    assert answer["verdict"] == choice.answer[0]
    assert answer["evidence"] == choice.reached_text
    assert answer["recommended"] == choice.recommended_name
    assert [c["name"] for c in answer["candidates"]] == [c.name for c in choice.candidates]
    for ours, candidate in zip(answer["candidates"], choice.candidates, strict=True):
        assert ours["error"] == candidate.driven.error.value
        assert ours["lost"] == candidate.driven.lost_rate.value
        assert ours["is_recommended"] == (candidate is choice.recommended_candidate)
    along = answer["along"]["shortest"]
    assert along["s"][-1] == pytest.approx(choice.shortest.path.length, abs=0.2)
    assert (np.array(along["high_cm"]) >= along["median_cm"]).all()


def test_simulation_races_shown_path(session):
    """The page shows a path that no planner would find."""
    detour = [list(START), list(MIDDLE), [MIDDLE[0] + 1.0, MIDDLE[1]], list(GOAL)]
    answer = ask(session, "simulate", **ROUTE, drives=2, path=detour)
    shown = next(c for c in answer["candidates"] if c["name"] == "shown")
    assert shown["xy"] == detour
    assert shown["error"] > 0
    texts = [answer["verdict"], answer["evidence"], *answer["advice"]]
    assert [text for text in texts if re.search("--|`|locplan ", text)] == []


def test_simulated_paths_respect_waypoints_and_zones(session):
    zone = {"kind": "zone", "zone": "no-go", "polygon": BAND}
    route = ROUTE | {"via": [list(MIDDLE)], "weight": 12.0}
    ask(session, "change", changes=[zone])
    answer = ask(session, "simulate", **route, drives=2)
    ask(session, "change", changes=[])
    closed = Zones([Zone("no-go", BAND)]).cells(corridors()[0], "no-go")
    for candidate in answer["candidates"]:
        path = Path(candidate["xy"])
        assert np.hypot(*(path.xy - MIDDLE).T).min() < 1e-3
        cells = corridors()[0].world_to_grid(*path.resample(0.05).xy.T)
        assert not closed[tuple(np.floor(cells).astype(int))].any()


@pytest.mark.parametrize("calls", [2, 4])
def test_cancelled_simulation_ends(session, calls):
    progress, seen = interrupt_after(calls)
    route = ROUTE | {"via": [list(MIDDLE)], "weight": 12.0}
    with pytest.raises(Interrupted):
        ask(session, "simulate", progress=progress, **route, drives=60)
    assert len(seen) == calls


def test_simulation_without_path_is_refused():
    cells = np.full((20, 40), FREE, np.uint8)
    cells[:, 20] = 0
    session = Session(OccupancyGrid(cells, 0.1), StartSettings(corridors()[1].config))
    session.begin()
    session.wait()
    with pytest.raises(ConfigError, match="no path"):
        ask(session, "simulate", start=[0.5, 1.0], goal=[3.5, 1.0])
    session.close()


@pytest.mark.parametrize("do", ["simulate", "export", "share"])
def test_simulate_export_share_need_field(do, tmp_path):
    grid, field = corridors()
    session = Session(grid, StartSettings(field.config, ROBOT, folder=tmp_path))
    with pytest.raises(ConfigError, match="field"):
        ask(session, do, **ROUTE)


@pytest.mark.parametrize(
    "wrong",
    [
        {"start": None},
        {"start": ["2", 3]},
        {"goal": [1e12, 0]},
        {"via": [[1, 2, 3]]},
        {"via": [[2.0, 3.0]] * 51},
        {"weight": -1},
        {"weight": 1e9},
        {"drives": 10**6},
        {"path": [[1, 2]] * 5001},
        {"start": [-500.0, -500.0]},
    ],
)
def test_simulation_refuses_wrong_route(session, wrong):
    with pytest.raises(LocplanError) as error:
        ask(session, "simulate", **{**ROUTE, **wrong})
    assert "\n" not in str(error.value)
