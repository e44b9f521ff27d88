"""Both paths while a marker is dragged, against the library's."""

from __future__ import annotations

import dataclasses
import gc
import itertools
import math
import weakref

import numpy as np
import pytest
from support.explorer_sessions import (
    POINT,
    SAD,
    SMALL,
    Interrupted,
    ask,
    ask_plan,
    free_places,
    open_session,
    rooms,
)
from support.maps import ascii_map

import locplan
from locplan._support.kernels import search
from locplan.app.explorer.messages import Question, QuestionJob
from locplan.app.explorer.plans import prepare_searches
from locplan.app.explorer.scene import SceneLimits, StartSettings
from locplan.app.explorer.searches import PathSearches, ResultStore, SearchGrid
from locplan.app.explorer.session import Session
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap
from locplan.planning.any_angle import make_any_angle_path
from locplan.planning.plans import AWARE, SHORTEST, plan_with_shortest


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Session:
    return open_session(rooms(), cache_dir=tmp_path_factory.mktemp("cache"))


def bare_session(grid: OccupancyGrid, **limits) -> Session:
    """Return a session without a field, of a robot that is a point."""
    return Session(grid, StartSettings(SAD, POINT, limits=SceneLimits(**limits)))


def set_limits(monkeypatch, session: Session, **limits) -> None:
    opening = dataclasses.replace(session.opening, limits=SceneLimits(**limits))
    monkeypatch.setattr(session, "opening", opening)


def is_path(answer, path) -> bool:
    """Return whether an answer has this path; its positions have three decimals."""
    return answer["xy"] == np.round(path.xy, 3).tolist()


def prepare(session: Session, stops, weight: float = 4.0, check=lambda: None) -> None:
    start, *via, goal = map(list, stops)
    question = Question("plan", 1, {"start": start, "via": via, "goal": goal, "weight": weight})
    prepare_searches(session, session.scene, question, QuestionJob(lambda *_: None, check))


def count_searches(monkeypatch) -> list[int]:
    calls = []
    monkeypatch.setattr(search, "search_grid", lambda *_, **__: calls.append(1))
    return calls


@pytest.mark.parametrize("weight", [4.0, 11.0])
@pytest.mark.parametrize("over", [0, 2])
def test_paths_at_rest_equal_library_paths(session, weight, over):
    places = free_places(session, 4 + 2 * over, seed=over)
    costs = session.scene.costs.with_weight(weight)
    for stops in (places[: 2 + over], places[2 + over :]):
        answer = ask_plan(session, stops, weight)
        start, *via, goal = stops
        expected = plan_with_shortest(costs, start, goal, via=via)
        for name, path in ((SHORTEST, answer["shortest"]), (AWARE, answer["recommended"])):
            assert is_path(path, expected[name].path)
            metrics = expected[name].metrics
            assert path["length"] == metrics.length
            assert path["cost"] == pytest.approx(metrics.cost)
            assert path["degenerate"] == pytest.approx(metrics.integrated_u)


def test_zones_change_paths_as_in_library():
    session = open_session(rooms())
    start, goal = free_places(session, 2, seed=9)
    before = ask_plan(session, [start, goal], 4.0)["recommended"]
    x, y = before["xy"][len(before["xy"]) // 2]
    square = [[x - 0.4, y - 0.4], [x + 0.4, y - 0.4], [x + 0.4, y + 0.4], [x - 0.4, y + 0.4]]
    for kind in ("no-go", "prefer"):
        ask(session, "change", changes=[{"kind": "zone", "zone": kind, "polygon": square}])
        answer = ask_plan(session, [start, goal], 4.0)
        expected = plan_with_shortest(session.scene.costs, start, goal)
        assert session.scene.costs.zones
        assert is_path(answer["recommended"], expected[AWARE].path)
        assert is_path(answer["shortest"], expected[SHORTEST].path)
        assert answer["recommended"]["cost"] == pytest.approx(expected[AWARE].metrics.cost)


@pytest.mark.parametrize("held", [0, 1, 2])
def test_dragged_paths_equal_paths_at_rest(session, held):
    for seed in range(7, 10):
        stops = free_places(session, 3, seed=seed)
        session.searches.forget()
        at_rest = ask_plan(session, stops, 4.0)
        session.searches.forget()
        dragged = ask_plan(session, stops, 4.0, held=held)
        for name in ("recommended", "shortest"):
            assert dragged[name]["xy"] == at_rest[name]["xy"]
            assert "profile" in at_rest[name]
            assert "profile" not in dragged[name]


def test_stored_search_gives_planner_path():
    """The search may begin at either end."""
    rng, n_different = np.random.default_rng(2), 0
    for _ in range(40):
        grid = OccupancyGrid(np.full((20, 20), FREE), 1.0)
        costs = Costmap.from_density(grid, rng.integers(1, 3, (20, 20)) ** rng.integers(2))
        scene = dataclasses.replace(bare_session(grid).scene, costs=costs)
        start, goal = (tuple(map(float, xy)) for xy in rng.integers(20, size=(2, 2)) + 0.5)
        for held in (0, 1):  # the search begins at the other one
            path = PathSearches(ResultStore(1e9), scene).path([start, goal], None, held)
            expected = locplan.plan(costs, start, goal).path
            np.testing.assert_array_equal(path.xy, expected.xy)
        back = locplan.plan(costs, goal, start).path.xy[::-1]
        n_different += not np.array_equal(path.xy, back)
    assert n_different  # a path and the one back may differ


@pytest.mark.parametrize("held", [0, 1])
def test_no_map_is_searched_after_drag(session, held, monkeypatch):
    stops, (elsewhere,) = free_places(session, 2, seed=9), free_places(session, 1, seed=10)
    session.searches.forget()
    ask_plan(session, stops, 4.0, held=held)
    calls = count_searches(monkeypatch)
    stops[held] = elsewhere
    answer = ask_plan(session, stops, 4.0)
    assert calls == []
    monkeypatch.undo()
    expected = plan_with_shortest(session.scene.costs, *stops)
    assert is_path(answer["recommended"], expected[AWARE].path)
    assert is_path(answer["shortest"], expected[SHORTEST].path)


def test_prepared_drag_needs_no_search(session, monkeypatch):
    stops = free_places(session, 4, seed=9)
    session.searches.forget()
    prepare(session, stops)
    calls = count_searches(monkeypatch)
    for held, xy in enumerate(free_places(session, 4, seed=10)):
        moved = [xy if n == held else stop for n, stop in enumerate(stops)]
        ask_plan(session, moved, 4.0, held=held)
    assert calls == []


@pytest.mark.parametrize(("share", "n_searches"), [(3.8, 2), (4.3, 6), (3.7, 0)])
def test_preparation_keeps_within_memory(session, monkeypatch, share, n_searches):
    stops = free_places(session, 4, seed=9)
    prepare(session, stops)
    half = PathSearches(session.searches, session.scene).grid(4.0).bordered.half.nbytes
    monkeypatch.setattr(session.searches, "limit", share * half)
    session.searches.forget()
    found, run = [], search.search_grid
    monkeypatch.setattr(search, "search_grid", lambda *a, **k: found.append(1) or run(*a, **k))
    prepare(session, stops)
    assert len(found) == n_searches


def test_preparation_ends_if_cancelled(session):
    def interrupt():
        raise Interrupted

    session.searches.forget()
    with pytest.raises(Interrupted):
        prepare(session, free_places(session, 2, seed=9), check=interrupt)


def test_dropped_costmaps_leave_memory(session, monkeypatch):
    start, goal = free_places(session, 2, seed=9)
    grids, halve = [], SearchGrid.from_half_costs

    def note(costs):
        halved = halve(costs)
        grids.append(weakref.ref(halved.bordered.half))
        return halved

    monkeypatch.setattr(SearchGrid, "from_half_costs", note)
    limit = 4 * session.scene.costs.density.nbytes
    monkeypatch.setattr(session, "searches", ResultStore(limit))
    for weight in range(1, 11):
        ask_plan(session, [start, goal], float(weight), held=0)
        prepare(session, [start, goal], weight)
        assert session.searches.bytes <= 1.5 * limit
    gc.collect()
    assert sum(grid() is not None for grid in grids) < len(grids)


def test_kernels_of_drag_are_loaded_before(session, monkeypatch):
    import numba

    from locplan._support.kernels import ways

    calls = []
    for name in ("find_greatest_cost", "find_backward_steps", "trace_cheapest_path"):
        kernel = getattr(ways, name)

        def note(*values, kernel=kernel):
            calls.append((kernel, [numba.typeof(value) for value in values]))
            return kernel(*values)

        monkeypatch.setattr(ways, name, note)
    session.prepare()
    before, calls[:] = list(calls), []
    session.searches.forget()
    ask_plan(session, free_places(session, 2), 4.0, held=0)
    assert len(before) == 3
    assert all(call in before for call in calls)


def test_drag_replans_only_adjacent_legs(session, monkeypatch):
    (moved, *stops), legs = free_places(session, 5, seed=9), []
    ask_plan(session, stops, 4.0)

    def note(costs, bordered, cells, start, goal):
        legs.append((start, goal))
        return make_any_angle_path(costs, bordered, cells, start, goal)

    monkeypatch.setattr("locplan.app.explorer.searches.make_any_angle_path", note)
    for held in (0, None):
        ask_plan(session, [moved, *stops[1:]], 4.0, held=held)
        assert legs == 2 * [(moved, stops[1])]


def test_plan_without_field_has_shortest_path():
    session = Session(rooms(), StartSettings(SAD, SMALL))
    answer = ask_plan(session, free_places(session, 2), 4.0)
    assert answer["recommended"] is None
    assert "computed" in answer["why"]
    assert answer["shortest"]["degenerate"] is None
    assert answer["basis"]["field"] is None


def test_short_profile_keeps_greatest_value(session):
    path = ask_plan(session, free_places(session, 2, seed=11), 4.0)["recommended"]
    profile = path["profile"]
    assert len(profile["s"]) == len(profile["sigma_cm"]) <= 400
    assert profile["s"][-1] == pytest.approx(path["length"], abs=1e-3)
    assert (np.diff(profile["s"]) >= 0).all()
    assert max(profile["sigma_cm"]) >= path["mean_sigma_cm"] > 0
    middles = locplan.Path(path["xy"]).resample(0.02).xy
    worst = 100 * np.nanmax(session.field.at(middles, "position_std"))
    assert max(profile["sigma_cm"]) == pytest.approx(worst, rel=0.05)


def test_draft_paths_join_exact_stops(session, monkeypatch):
    set_limits(monkeypatch, session, draft_cells=50)
    start, goal = free_places(session, 2, seed=13)
    for held in (0, 1, None):
        draft = ask_plan(session, [start, goal], 11.0, held=held, draft=True)
        fine = ask_plan(session, [start, goal], 11.0)
        assert draft["draft"]
        ends = [draft["recommended"]["xy"][n] for n in (0, -1)]
        np.testing.assert_allclose(ends, [start, goal], atol=1e-3)
        assert draft["shortest"]["length"] < 1.3 * fine["shortest"]["length"]
        for path in (draft["shortest"], draft["recommended"]):
            assert path["cost"] == pytest.approx(path["length"] + 11.0 * path["degenerate"])
        assert not fine["draft"]


@pytest.mark.parametrize("n_free", range(1, 5))
def test_draft_starts_in_blocked_coarse_cell(n_free):
    cells = np.full((40, 60), FREE)
    cells[: 4 - n_free] = OCCUPIED
    start, goal = (0.55, (4 - n_free) / 10 + 0.05), (5.05, 3.05)
    session = bare_session(OccupancyGrid(cells, 0.1), draft_cells=50)
    path = ask_plan(session, [start, goal], 4.0, draft=True)["shortest"]
    assert path["xy"][0] == pytest.approx(start, abs=1e-3)
    assert path["length"] < 1.1 * math.dist(start, goal)


def test_unreachable_goal_has_reason():
    session = open_session(ascii_map("......#......", "......#......", resolution=0.5))
    answer = ask_plan(session, [(0.3, 0.3), (5.0, 0.3)], 4.0)
    assert answer["recommended"] is answer["shortest"] is None
    assert "No path" in answer["why"]


def test_plan_at_rest_ends_within_searches(session, monkeypatch):
    places = free_places(session, 40, seed=5)
    monkeypatch.setattr(search, "STRETCH", 10)
    calls = itertools.count(1)

    def check():
        if next(calls) > 20:
            raise Interrupted

    with pytest.raises(Interrupted):
        PathSearches(ResultStore(1e9), session.scene, check).path([min(places), max(places)], 4.0)


def test_store_stays_within_its_bytes():
    store = ResultStore(100)
    for n in range(30):
        store.put(n, np.zeros(3), 24)
        assert store.bytes <= 100
    assert [n for n in range(30) if store.get(n) is not None] == [26, 27, 28, 29]
    store.get(26)
    store.put(30, "new", 24)
    assert store.get(26) is not None
    assert store.get(27) is None
    store.put(31, "larger than all", 500)
    assert store.get(31) is not None
    assert store.bytes == 500
    store.put(31, "again", 10)
    assert store.bytes == 10
    store.forget()
    assert store.bytes == 0
