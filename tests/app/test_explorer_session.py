"""The explorer's session: plans, snapping, edits and what is kept, without the web."""

from __future__ import annotations

import dataclasses
import gc
import itertools
import json
import math
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numba
import numpy as np
import pytest
from support.explorer_views import Interrupted, Session, interrupt_after
from support.machine import TIMEOUT
from support.maps import ascii_map, random_rooms

import locplan
from locplan._support.kernels import search
from locplan.app.explorer.scene import Limits, Opening
from locplan.errors import LocplanError
from locplan.field import FieldConfig
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from locplan.planning import Costmap
from locplan.planning.any_angle import any_angle_path
from locplan.planning.grid import bordered_index
from locplan.planning.plans import AWARE, SHORTEST, plan_beside_shortest

SAD = FieldConfig(locplan.Sad(range=1.5), stride=0.4)
SMALL = locplan.Robot(footprint=0.15, margin=0.0)
POINT = locplan.Robot(footprint=0.0, margin=0.0)


def rooms(seed: int = 3, yaw: float = 0.0) -> OccupancyGrid:
    cells = random_rooms((60, 90), seed)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.1, (1.0, -2.0, yaw), "rooms")


def session_of(grid: OccupancyGrid, config: FieldConfig = SAD, **opening) -> Session:
    session = Session(grid, Opening(config, **{"robot": SMALL, **opening}))
    session.begin().result()
    return session


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Session:
    return session_of(rooms(), cache_dir=tmp_path_factory.mktemp("cache"))


def answer(session: Session, do: str, progress=lambda *_: None, **values):
    told = session.answer(do, progress=progress, **json.loads(json.dumps(values)))
    return json.loads(json.dumps(told, allow_nan=False))


def planned(session, stops, weight: float, *, held: int | None = None, draft: bool = False):
    """The answer to the ask for both paths over some stops, of which one may be held."""
    (start, *via, goal), last = stops, len(stops) - 1
    hold = None if held is None else {0: "start", last: "goal"}.get(held, f"via:{held - 1}")
    asked = {"start": start, "via": via, "goal": goal, "weight": weight}
    return answer(session, "plan", **asked, hold=hold, draft=draft)


def bare(grid: OccupancyGrid, **limits) -> Session:
    """A session without a field, of a robot that is a point."""
    return Session(grid, Opening(SAD, POINT, limits=Limits(**limits)))


def limit(monkeypatch, session: Session, **limits) -> None:
    """Give a session other limits for the rest of a test."""
    opening = dataclasses.replace(session.opening, limits=Limits(**limits))
    monkeypatch.setattr(session, "opening", opening)


def is_path(found, path) -> bool:
    """Whether an answer has this path; its positions have four decimals."""
    return found["xy"] == np.round(path.xy, 4).tolist()


def free_places(session: Session, count: int, seed: int = 1) -> list[tuple[float, float]]:
    """Random places, off the cells' centres, of the largest part of the free space."""
    parts, rng = session.scene.parts, np.random.default_rng(seed)
    largest = 1 + np.bincount(parts.labels.ravel())[1:].argmax()
    cells = np.argwhere(parts.labels == largest)
    chosen = cells[rng.integers(0, len(cells), count)] + rng.uniform(0.2, 0.8, (count, 2))
    return [tuple(map(float, xy)) for xy in zip(*parts.grid.grid_to_world(*chosen.T), strict=True)]


@pytest.mark.parametrize("weight", [4.0, 11.0])
@pytest.mark.parametrize("over", [0, 2])
def test_released_plans_are_those_of_the_library(session, weight, over):
    places = free_places(session, 4 + 2 * over, seed=over)
    for stops in (places[: 2 + over], places[2 + over :]):
        found = planned(session, stops, weight)
        start, *via, goal = stops
        expected = plan_beside_shortest(session.costs(weight), start, goal, via=via)
        for name, path in ((SHORTEST, found["shortest"]), (AWARE, found["aware"])):
            assert is_path(path, expected[name].path)
            metrics = expected[name].metrics
            assert (path["length"], path["cost"]) == (metrics.length, metrics.cost)
            assert path["degenerate"] == metrics.integrated_u
            assert path["integrated_e"] == metrics.integrated_e


def test_plans_after_a_drag_of_the_goal_are_those_of_the_library(session):
    start, goal, other = free_places(session, 3, seed=5)
    for held in (1, 1, None):
        planned(session, [start, other if held else goal], 4.0, held=held)
    planned(session, [start, goal], 4.0, held=1)
    found = planned(session, [start, goal], 4.0)
    expected = plan_beside_shortest(session.costs(4.0), start, goal)
    assert is_path(found["aware"], expected[AWARE].path)
    assert is_path(found["shortest"], expected[SHORTEST].path)


@pytest.mark.parametrize("held", [0, 1, 2])
def test_while_a_stop_is_held_the_paths_are_those_of_its_release(session, held):
    for seed in range(7, 10):
        stops = free_places(session, 3, seed=seed)
        session.kept.forget()
        released = planned(session, stops, 4.0)
        session.kept.forget()
        dragged = planned(session, stops, 4.0, held=held)
        for name in ("aware", "shortest"):
            assert dragged[name]["xy"] == released[name]["xy"]


def test_a_kept_search_gives_the_planners_path_in_both_directions():
    rng, differ = np.random.default_rng(2), 0
    for _ in range(40):
        grid = OccupancyGrid(np.full((20, 20), FREE), 1.0)
        costs = Costmap.from_density(grid, rng.integers(1, 3, (20, 20)) ** rng.integers(2))
        session = bare(grid)
        session.show(costs, None, whole=True)
        start, goal = (tuple(map(float, xy)) for xy in rng.integers(20, size=(2, 2)) + 0.5)
        for held in (0, 1):  # the search is kept from the other one
            found = planned(session, [start, goal], 4.0, held=held)["shortest"]
            assert is_path(found, locplan.plan(costs, start, goal).path)
            session.kept.forget()
        back = locplan.plan(costs, goal, start).path.xy[::-1]
        differ += found["xy"] != np.round(back, 4).tolist()
    assert differ  # the way there is another one than the way back


def test_the_kernels_of_a_drag_are_loaded_before_it(session, monkeypatch):
    from locplan._support.kernels import ways

    used = []
    for name in ("greatest_cost", "steps_back", "cheapest_cells"):
        kernel = getattr(ways, name)

        def noted(*given, kernel=kernel):
            used.append((kernel, [numba.typeof(value) for value in given]))
            return kernel(*given)

        monkeypatch.setattr(ways, name, noted)
    session.prepare()
    before, used[:] = list(used), []
    session.kept.forget()
    planned(session, free_places(session, 2), 4.0, held=0)
    assert len(before) == 3
    assert all(one in before for one in used)


def floods(session) -> list[tuple[float, int]]:
    """Weights of the searches that are kept, and the cells that they began in."""
    return [key[2:] for key in session.kept.keys if key[0] == "flood"]


def test_kept_searches_hold_no_costmap_that_is_dropped(session, monkeypatch):
    start, goal = free_places(session, 2, seed=9)
    planned(session, [start, goal], 4.0)
    kind = type(session.kept.get(("halved", session.scene.serial, 4.0)))
    made, halve = [], kind.halved

    def noted(costs):
        halved = halve(costs)
        made.append(weakref.ref(halved.bordered.half))
        return halved

    monkeypatch.setattr(kind, "halved", noted)
    size = 4 * session.costs().density.nbytes
    monkeypatch.setattr(session, "kept", type(session.kept)(size))
    for weight in range(1, 11):
        planned(session, [start, goal], float(weight), held=0)
        answer(session, "idle", start=start, goal=goal, weight=weight)
    gc.collect()
    kept = sum(key[0] == "halved" for key in session.kept.keys)
    assert len({weight for weight, _ in floods(session)}) > kept
    assert sum(each() is not None for each in made) == kept < len(made)


@pytest.mark.parametrize("held", [0, 1])
def test_after_a_drag_no_map_is_searched(session, held, monkeypatch):
    stops, (elsewhere,) = free_places(session, 2, seed=9), free_places(session, 1, seed=10)
    session.kept.forget()
    planned(session, stops, 4.0, held=held)
    begun = []
    monkeypatch.setattr(search, "search", lambda *_, **__: begun.append(1))
    stops[held] = elsewhere
    found = planned(session, stops, 4.0)
    assert begun == []
    monkeypatch.undo()
    expected = plan_beside_shortest(session.costs(4.0), *stops)
    assert is_path(found["aware"], expected[AWARE].path)
    assert is_path(found["shortest"], expected[SHORTEST].path)


def test_idle_searches_from_the_stops_that_a_drag_leaves_at_rest(session, monkeypatch):
    places = free_places(session, 4, seed=9)
    start, *via, goal = places
    asked = {"start": start, "via": via, "goal": goal, "weight": 4.0}
    cells = [bordered_index(session.costs(), place, "place") for place in places]
    for hold, among in (("start", [1]), ("via:0", [0, 2]), ("goal", [2]), (None, range(4))):
        session.kept.forget()
        assert answer(session, "idle", **asked, hold=hold) == {"ok": True}
        assert sorted(floods(session)) == sorted(
            (weight, cells[n]) for weight in (1e-6, 4.0) for n in among
        )
    half = session.kept.get(("halved", session.scene.serial, 4.0)).bordered.half.nbytes
    for share, count in ((3.8, 1), (4.3, 3), (3.7, 0)):
        monkeypatch.setattr(session.kept, "limit", share * half)
        session.kept.forget()
        answer(session, "idle", **asked)
        assert len(floods(session)) == 2 * count


def test_idle_ends_where_one_of_its_searches_is_ended(session, monkeypatch):
    def ended(*_, **__):
        raise Interrupted

    start, goal = free_places(session, 2, seed=9)
    session.kept.forget()
    monkeypatch.setattr(search, "search", ended)
    with pytest.raises(Interrupted):
        answer(session, "idle", start=start, goal=goal, weight=4.0)


def test_idle_prepares_the_drafts_of_large_maps(session, monkeypatch):
    start, goal = free_places(session, 2, seed=13)
    asked = {"start": start, "goal": goal, "weight": 4.0}
    for cells, hold, prepared in ((50, None, 2), (50, "goal", 0), (1500, None, 0)):
        limit(monkeypatch, session, draft_cells=cells)
        session.kept.forget()
        answer(session, "idle", **asked, hold=hold)
        assert sum(key[0] == "coarse" for key in session.kept.keys) == prepared


def test_only_the_legs_beside_the_held_stop_are_planned_again(session, monkeypatch):
    (moved, *stops), planned_legs = free_places(session, 5, seed=9), []
    planned(session, stops, 4.0)

    def counted(costs, bordered, cells, start, goal):
        planned_legs.append((start, goal))
        return any_angle_path(costs, bordered, cells, start, goal)

    monkeypatch.setattr("locplan.app.explorer.searches.any_angle_path", counted)
    for held in (0, None):
        planned(session, [moved, *stops[1:]], 4.0, held=held)
        assert planned_legs == 2 * [(moved, stops[1])]


def test_before_there_is_a_field_the_shortest_path_is_there():
    session = Session(rooms(), Opening(SAD, SMALL))
    start, goal = free_places(session, 2)
    found = planned(session, [start, goal], 4.0)
    assert found["aware"] is None
    assert "computed" in found["why"]
    assert found["shortest"]["degenerate"] is None
    assert set(found["shortest"]["profile"]["u"]) == {None}


def test_profiles_are_short_and_keep_the_greatest_value(session):
    start, goal = free_places(session, 2, seed=11)
    path = planned(session, [start, goal], 4.0)["aware"]
    steps = path["profile"]
    assert len(steps["s"]) == len(steps["u"]) == len(steps["sigma_cm"]) <= 400
    assert steps["s"][-1] == pytest.approx(path["length"], abs=1e-3)
    assert (np.diff(steps["s"]) >= 0).all()
    costs = session.costs(4.0)
    route = plan_beside_shortest(costs, start, goal)[AWARE].path
    _, values = locplan.planning.metrics.profile(costs, route, costs.u)
    assert max(steps["u"]) == pytest.approx(values.max(), abs=1e-4)
    assert path["worst_sigma_cm"] >= path["mean_sigma_cm"] > 0


def test_many_steps_are_joined_by_their_greatest():
    grid = OccupancyGrid(np.full((3, 1500), FREE, np.uint8), 0.1)
    session, ends = bare(grid), [(0.05, 0.15), (149.9, 0.15)]
    steps = planned(session, ends, 4.0)["shortest"]["profile"]
    assert len(steps["s"]) == 400
    assert steps["s"][-1] == pytest.approx(149.85)
    u = np.zeros(grid.shape)
    u[1, 7:1500:50] = 0.9  # one cell in many
    costs = dataclasses.replace(session.scene.costs, u=u)
    session.show(costs, None, whole=True)
    assert planned(session, ends, 4.0)["shortest"]["profile"]["u"].count(0.9) == 30


def test_coarse_drafts_join_the_same_stops(session, monkeypatch):
    limit(monkeypatch, session, draft_cells=50)
    start, goal = free_places(session, 2, seed=13)
    for held in (0, 1, None):
        found = planned(session, [start, goal], 4.0, held=held, draft=True)
        fine = planned(session, [start, goal], 4.0)
        if found["draft"]:
            ends = [found["aware"]["xy"][n] for n in (0, -1)]
            np.testing.assert_allclose(ends, [start, goal], atol=1e-4)
            assert found["shortest"]["length"] < 1.3 * fine["shortest"]["length"]
        assert not fine["draft"]


@pytest.mark.parametrize("free", range(1, 5))
def test_a_stop_whose_coarse_cell_is_blocked_has_a_draft(free):
    cells = np.full((40, 60), FREE)
    cells[: 4 - free] = OCCUPIED
    start, goal = (0.55, (4 - free) / 10 + 0.05), (5.05, 3.05)
    found = planned(bare(OccupancyGrid(cells, 0.1), draft_cells=50), [start, goal], 4.0, draft=True)
    assert found["draft"]
    assert found["shortest"]["xy"][0] == pytest.approx(start)
    assert found["shortest"]["length"] < 1.1 * math.dist(start, goal)


def test_drafts_cost_what_they_would_at_the_weight_of_the_aware_path(session, monkeypatch):
    limit(monkeypatch, session, draft_cells=50)
    found = planned(session, free_places(session, 2, seed=14), 11.0, draft=True)
    assert found["draft"]
    for path in (found["shortest"], found["aware"]):
        assert path["degenerate"] > 0
        assert path["cost"] == pytest.approx(path["length"] + 11.0 * path["degenerate"])


def test_positions_in_walls_move_to_the_nearest_cell_of_the_same_part():
    grid = ascii_map(
        "..........",
        "##########",
        "##########",
        "#........#",
        "##########",
    )

    def snapped(stops, held=None):
        found = planned(bare(grid), stops, 4.0, held=held)
        return [tuple(xy) for xy in (found["start"], *found["via"], found["goal"])]

    lower, upper = (1.5, 1.5), (1.5, 4.5)
    in_wall = (5.2, 3.4)  # nearer to the upper part
    assert snapped([upper, in_wall]) == [upper, (5.5, 4.5)]
    assert snapped([lower, in_wall]) == [lower, (5.5, 1.5)]
    assert snapped([in_wall, lower], held=0) == [(5.5, 1.5), lower]
    assert snapped([upper, in_wall, lower], held=0)[1] == (5.5, 1.5)
    assert snapped([in_wall, in_wall])[0] == (5.5, 4.5)
    assert snapped([lower, upper]) == [lower, upper]  # free ones stay, whatever joins them


def test_positions_far_from_free_cells_are_refused():
    session = bare(ascii_map(".....###########"))
    assert planned(session, [(0.5, 0.5), (4.5 + 3.0, 0.5)], 4.0)["goal"] == [4.5, 0.5]
    with pytest.raises(LocplanError, match=r"the goal .* no free cell within 3 m"):
        planned(session, [(0.5, 0.5), (4.6 + 3.0, 0.5)], 4.0)
    with pytest.raises(LocplanError, match="the start"):
        planned(session, [(-1e7, 1e7), (0.5, 0.5)], 4.0)


@pytest.mark.parametrize("seed", range(5))
def test_snapping_finds_what_a_search_of_all_cells_finds(seed):
    grid, rng = rooms(seed, yaw=0.4), np.random.default_rng(seed)
    robot = locplan.Robot(footprint=0.2, margin=0.0)
    parts = Session(grid, Opening(SAD, robot)).scene.parts
    x, y = grid.grid_to_world(*rng.uniform(0, (60, 90), (30, 2)).T)
    for xy in zip(x.tolist(), y.tolist(), strict=True):
        for label in (0, 1, int(parts.labels.max())):
            wanted = parts.labels == label if label else parts.labels > 0
            centres = np.column_stack(grid.grid_to_world(*(np.argwhere(wanted) + 0.5).T))
            apart = np.hypot(*(centres - xy).T)
            found = parts.nearest(xy, label)
            if found is None:
                assert apart.min() > 3.0
            else:
                assert math.dist(found, xy) == pytest.approx(apart.min())


def test_unreachable_goals_have_no_path_and_a_reason():
    grid = ascii_map("......#......", "......#......", resolution=0.5)
    session = session_of(grid)
    found = planned(session, [(0.3, 0.3), (5.0, 0.3)], 4.0)
    assert found["aware"] is found["shortest"] is None
    assert "no path" in found["why"]


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (3, 3)])
@pytest.mark.parametrize("level", [FREE, UNKNOWN, OCCUPIED])
def test_tiny_and_unknown_maps_have_a_state(shape, level):
    session = session_of(OccupancyGrid(np.full(shape, level), 0.1), robot=POINT)
    told = session.state()
    assert (told["start"] is None) == (level != FREE)
    assert told["field"]["whole"]
    if level == FREE:
        found = answer(session, "plan", start=told["start"], goal=told["goal"])
        assert found["shortest"]["length"] is not None
    else:
        with pytest.raises(LocplanError, match="no free cell"):
            answer(session, "plan", start=[0.0, 0.0], goal=[0.1, 0.1])
    assert session.about()["map"]["rows"] == shape[0]


def test_edits_are_undone_and_redone_to_the_digest(session):
    session = session_of(rooms(4))
    start, goal = free_places(session, 2)
    digests = [(session.grid.digest, session.scene.digest)]
    fields = [session.field]
    for k in range(3):
        stroke = {"tool": "wall", "points": [start, goal], "width": 0.2 + 0.2 * k}
        answer(session, "edit", strokes=[stroke])
        session.latest.result()
        digests.append((session.grid.digest, session.scene.digest))
        fields.append(session.field)
    assert len(set(digests)) == 4
    for do, order in (("undo", [2, 1, 0]), ("redo", [1, 2, 3])):
        for k in order:
            answer(session, do)
            session.latest.result()
            assert (session.grid.digest, session.scene.digest) == digests[k]
            np.testing.assert_array_equal(session.field.covariance, fields[k].covariance)
        with pytest.raises(LocplanError, match=f"no edit to {do}"):
            answer(session, do)


@pytest.mark.parametrize("tool", ["wall", "erase", "pole"])
def test_fields_and_costs_after_an_edit_are_those_of_the_new_map(tool, monkeypatch):
    session = session_of(rooms(5), limits=Limits(min_points=5, first_seconds=0.0))
    (x, y), *_ = free_places(session, 1)
    scenes = []
    session.listeners.append(lambda event: scenes.append(session.scene))
    points = [[x - 3, y - 3], [x + 3, y + 3]] if tool == "erase" else [[x, y], [x + 1, y + 1]]
    width = 4.0 if tool == "erase" else 0.6
    stroke = {"tool": tool, "points": points, "width": width}
    changed = answer(session, "edit", strokes=[stroke])["changed"]
    session.latest.result()
    assert changed
    assert session.scene.whole
    assert any(not scene.whole for scene in scenes)
    assert not any(scene.field.lacking.any() for scene in scenes)
    expected = locplan.covariance_field(session.grid, SAD)
    np.testing.assert_array_equal(session.field.covariance, expected.covariance)
    costs = locplan.Costmap.from_field(session.grid, expected, robot=0.15)
    np.testing.assert_array_equal(session.scene.costs.density, costs.density)
    assert session.scene.costs.grid.digest == session.grid.digest


@pytest.mark.parametrize("kind", ["Fisher", "Scan", "Fused"])
def test_fields_of_rays_after_an_edit_are_those_of_the_new_map(kind):
    config = FieldConfig(getattr(locplan, kind)(locplan.Lidar(range=2.0, beams=36)), stride=0.6)
    limits = Limits(min_points=30, first_seconds=0.0)
    session = session_of(rooms(5, yaw=0.4), config, limits=limits)
    (place,) = free_places(session, 1)
    whole = []
    session.listeners.append(lambda event: whole.append(session.scene.whole))
    answer(session, "edit", strokes=[{"tool": "pole", "points": [place], "width": 0.5}])
    session.latest.result()
    assert False in whole
    expected = locplan.covariance_field(session.grid, config)
    np.testing.assert_array_equal(session.field.covariance, expected.covariance)


def test_edits_that_come_while_values_are_computed_end_in_the_last_map(monkeypatch):
    session = session_of(rooms(6), limits=Limits(min_points=5, first_seconds=0.0))
    for n, (x, y) in enumerate(free_places(session, 6)):
        answer(session, "edit", strokes=[{"tool": "pole", "points": [[x, y]], "width": 0.3}])
        if n % 3 == 2:
            answer(session, "undo")
    session.latest.result()
    expected = locplan.covariance_field(session.grid, SAD)
    np.testing.assert_array_equal(session.field.covariance, expected.covariance)
    costs = locplan.Costmap.from_field(session.grid, expected, robot=0.15)
    for name in ("density", "u", "e"):
        np.testing.assert_array_equal(getattr(session.scene.costs, name), getattr(costs, name))


def test_before_there_is_a_field_the_paths_follow_edits(monkeypatch):
    session = Session(rooms(), Opening(SAD, SMALL))
    monkeypatch.setattr(session, "_whole", lambda *_: None)
    start, goal = free_places(session, 2, seed=3)
    before = planned(session, [start, goal], 4.0)["shortest"]
    x, y = np.mean([start, goal], axis=0).tolist()
    strokes = [{"tool": "pole", "points": [before["xy"][len(before["xy"]) // 2]], "width": 0.6}]
    strokes += [{"tool": "pole", "points": [[x, y]], "width": 0.6}]
    answer(session, "edit", strokes=strokes)
    session.latest.result()
    assert session.scene.costs.grid.digest == session.grid.digest != session.original.digest
    assert planned(session, [start, goal], 4.0)["shortest"]["length"] > before["length"]


def test_an_old_field_follows_the_map_while_another_is_computed(monkeypatch):
    session = session_of(rooms())
    monkeypatch.setattr(session, "_whole", lambda *_: None)
    session.config = FieldConfig(locplan.Sad(range=1.0), stride=0.4)
    (x, y), *_ = free_places(session, 1)
    answer(session, "edit", strokes=[{"tool": "pole", "points": [[x, y]], "width": 0.3}])
    session.latest.result()
    expected = locplan.covariance_field(session.grid, SAD)
    np.testing.assert_array_equal(session.field.covariance, expected.covariance)


def test_the_points_nearest_to_an_edit_come_first():
    grid = OccupancyGrid(np.pad(np.full((60, 90), FREE), 4), 0.1)
    session = session_of(grid, limits=Limits(min_points=8, first_seconds=0.0))
    shown = [session.field]
    session.listeners.append(lambda event: shown.append(session.field))
    answer(session, "edit", strokes=[{"tool": "pole", "points": [[3.0, 3.0]], "width": 0.3}])
    session.latest.result()
    centre, stride = np.array(grid.cell((3.0, 3.0))) / SAD.stride * 0.1, []
    for before, after in itertools.pairwise(shown):
        new = (before.covariance != after.covariance).any(axis=(-1, -2))
        new = new.any(axis=-1) if new.ndim > 2 else new
        if (new & before.evaluated).any():
            apart = np.hypot(*(np.argwhere(new & before.evaluated) - centre).T)
            stride.append((apart.min(), apart.max()))
    assert len(stride) > 2
    for (_, farthest), (nearest, _) in itertools.pairwise(stride):
        assert nearest > farthest - 1.5  # distances are within a few per cent, and from cells


def test_a_stroke_fills_the_cells_whose_centres_it_covers():
    grid = OccupancyGrid(np.full((20, 30), FREE), 0.1, (0.5, 0.5, 0.7))
    session, points = bare(grid), ((1.0, 1.5), (1.6, 2.0), (1.2, 2.4))
    answer(session, "edit", strokes=[{"tool": "wall", "points": points, "width": 0.3}])
    for row, col in itertools.product(range(20), range(30)):
        at = np.array(grid.position(row, col))
        near = min(
            math.dist(at, np.array(a) + np.clip((at - a) @ d / (d @ d), 0, 1) * d)
            for a, b in itertools.pairwise(points)
            if (d := np.subtract(b, a)) is not None
        )
        assert (session.grid.cells[row, col] == OCCUPIED) == (near <= 0.15), (row, col)
    session.close()


def test_thin_walls_have_no_gaps():
    session = bare(OccupancyGrid(np.full((40, 40), FREE), 0.1))
    points = [[0.0, 0.31], [4.0, 3.67]]
    answer(session, "edit", strokes=[{"tool": "wall", "points": points, "width": 0.01}])
    session.latest.result()
    parts = session.scene.parts
    assert parts.label((2.0, 0.2)) != parts.label((2.0, 3.8)) > 0


def test_cells_kept_for_undoing_are_bounded():
    edits = ["wall", "erase"] * 5
    asked = {"points": [[1.0, 1.0], [3.0, 3.0]], "width": 0.2}
    for limits, count in (
        ({}, 10),
        ({"undo_bytes": 3.5 * 968}, 3),
        ({"undo_bytes": 0}, 1),
        ({"undo": 4}, 4),
    ):
        session = bare(OccupancyGrid(np.full((40, 40), FREE), 0.1), **limits)
        for tool in edits:
            answer(session, "edit", strokes=[{"tool": tool, **asked}])
        assert session.edits[-1].bytes == 968
        assert len(session.edits) == count
        session.close()
    assert Limits().undo == 200


def test_an_edit_outside_the_map_changes_nothing(session):
    stroke = {"tool": "pole", "points": [[500.0, 500.0]], "width": 0.3}
    before = session.grid.digest
    assert answer(session, "edit", strokes=[stroke]) == {"changed": False}
    assert session.grid.digest == before
    assert not session.edits


def test_maps_are_saved_under_the_folder_only(tmp_path):
    session = session_of(rooms(), folder=tmp_path / "out")
    (x, y), *_ = free_places(session, 1)
    answer(session, "edit", strokes=[{"tool": "pole", "points": [[x, y]], "width": 0.3}])
    assert session.edited
    hidden, other = (".x", ".yaml", " .yaml", " .x"), ("", " ", "x\0", "a" * 300, "x\n", None, 3)
    for name in ("../x", "a/b", "/etc/x", "..", *hidden, *other):
        with pytest.raises(LocplanError):
            answer(session, "save", name=name)
    assert not (tmp_path / "out").exists()
    answer(session, "save", name="new room")
    answer(session, "save", name="new room.yaml")  # its own file is replaced
    assert locplan.load_map(tmp_path / "out" / "new room.yaml") == session.grid
    assert not session.edited
    (tmp_path / "out" / "other.pgm").write_bytes(b"mine")
    with pytest.raises(LocplanError, match="there already"):
        answer(session, "save", name="other")
    with pytest.raises(LocplanError, match="--output"):
        answer(session_of(rooms()), "save", name="room")


def test_what_is_kept_stays_within_its_bytes():
    kept = type(bare(OccupancyGrid(np.full((4, 4), FREE), 0.1)).kept)(100)
    for n in range(30):
        kept.put(n, np.zeros(3), 24)
        assert kept.bytes <= 100
    assert [n for n in range(30) if kept.get(n) is not None] == [26, 27, 28, 29]
    kept.get(26)
    kept.put(30, "new", 24)
    assert kept.get(26) is not None
    assert kept.get(27) is None
    kept.put(31, "larger than all", 500)
    assert kept.get(31) is not None
    assert kept.bytes == 500
    kept.put(31, "again", 10)
    assert kept.bytes == 10
    kept.forget()
    assert kept.bytes == 0


def test_searches_of_many_drags_stay_within_their_bytes():
    session = session_of(rooms(), limits=Limits(kept_bytes=1e6))
    places = free_places(session, 30)
    for n, (start, goal) in enumerate(itertools.pairwise(places)):
        planned(session, [start, goal], 4.0 + n, held=n % 2)
        assert session.kept.bytes <= 1e6 + 100_000


def test_a_place_has_the_covariance_of_the_field(session):
    for x, y in free_places(session, 5):
        told = answer(session, "at", x=x, y=y)
        covariance = session.field.at((x, y), "covariance")
        major, minor, angle = locplan.field.position_axes(covariance)
        assert told["axes"] == [pytest.approx(100 * major), pytest.approx(100 * minor)]
        assert told["angle"] == pytest.approx(float(angle))
        assert told["heading_deg"] == pytest.approx(math.degrees(math.sqrt(covariance[2, 2])))
        cell = session.grid.cell((x, y))
        assert told["u"] == session.scene.costs.u[cell]
        assert told["clearance"] == session.grid.clearance[cell]
    plain = bare(rooms())
    places = free_places(session, 20, seed=3)
    before = [answer(plain, "at", x=x, y=y)["clearance"] for x, y in places]
    assert "clearance" not in vars(plain.grid)
    cells = [session.grid.cell((x, y)) for x, y in places]
    assert before == [plain.grid.clearance[cell] for cell in cells]
    assert before == [answer(plain, "at", x=x, y=y)["clearance"] for x, y in places]
    nothing = bare(OccupancyGrid(np.full((4, 4), FREE), 0.1))
    assert answer(nothing, "at", x=0.1, y=0.1)["clearance"] is None
    far = answer(session, "at", x=-1e6, y=5.0)
    assert not far["known"]
    assert "u" not in far


def test_other_settings_give_the_field_of_the_library():
    session = session_of(rooms())
    for given, expected in (
        ({"range": 1.0}, locplan.Sad(range=1.0)),
        ({"lidar": "lds-01"}, locplan.Sad().with_lidar(locplan.Lidar.preset("lds-01"))),
        ({"lidar": None, "range": 1.5}, locplan.Sad(range=1.5)),
    ):
        assert answer(session, "configure", **given) == {"ok": True}
        assert session.field.config.stride == SAD.stride
        config = FieldConfig(expected, stride=SAD.stride)
        assert session.config == config
        field = locplan.covariance_field(session.grid, config)
        np.testing.assert_array_equal(session.field.covariance, field.covariance)
    assert session.costs().weight == 4.0


def test_cancelled_settings_leave_the_old_field():
    session = session_of(rooms())
    before, (progress, _) = session.scene, interrupt_after(1)
    with pytest.raises(Interrupted):
        answer(session, "configure", progress, range=2.0)
    session.latest.result()
    assert session.config == SAD
    assert session.scene.digest == before.digest
    assert session.scene.whole


def test_settings_hear_of_their_own_field_only(tmp_path):
    session = session_of(rooms(), cache_dir=tmp_path)
    for cancelled in (False, True):
        progress, told = interrupt_after(1 if cancelled else 10**6)
        with suppress(Interrupted):
            answer(session, "configure", progress, range=2.0 if cancelled else 1.2)
        assert told
        told.clear()
        (place,) = free_places(session, 1)
        answer(session, "edit", strokes=[{"tool": "pole", "points": [place], "width": 0.3}])
        session.latest.result()
        assert told == []
        assert session.scene.whole
        assert session.config.estimator.range == 1.2


def test_settings_end_with_the_session(tmp_path):
    session, begun = session_of(rooms(), cache_dir=tmp_path), threading.Event()

    def progress(done, total):
        begun.set()
        time.sleep(0.01)

    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(answer, session, "configure", progress, range=2.0)
        assert begun.wait(TIMEOUT)
        session.close()
        assert type(asked.exception(TIMEOUT)).__name__ == "Cancelled"


def test_released_plans_end_within_their_searches(session, monkeypatch):
    places = free_places(session, 40, seed=5)
    start, goal = min(places), max(places)

    def looks(stretch, most):
        monkeypatch.setattr(search, "STRETCH", stretch)
        session.kept.forget(lambda key: key[0] == "halved")
        left = itertools.count(1)

        def check(cancel):
            if next(left) > most:
                raise Interrupted

        monkeypatch.setattr("locplan.app.explorer.requests.Cancel.check", check)
        return planned(session, [start, goal], 4.0), next(left) - 1

    few = looks(10**6, 10**6)[1]
    found, many = looks(10, 10**6)
    assert many > few + 5
    plans = plan_beside_shortest(session.costs(4.0), start, goal)
    assert is_path(found["aware"], plans[AWARE].path)
    for most in range(0, many, 5):
        with pytest.raises(Interrupted):
            looks(10, most)
        assert not any(key[0] == "flood" for key in session.kept.keys)


def test_drives_along_a_turned_map_are_in_the_world():
    yaw = 0.9
    session = session_of(rooms(3, yaw=yaw))
    start, goal = free_places(session, 2, seed=11)
    path = planned(session, [start, goal], 4.0)["aware"]
    expected = locplan.plan(session.costs(4.0), start, goal)
    assert path["length"] <= expected.metrics.length * 1.2
    np.testing.assert_allclose(path["xy"][0], start, atol=1e-4)
    told = session.about()["map"]
    assert told["origin"] == [1.0, -2.0, yaw]
