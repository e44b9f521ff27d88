"""The explorer's long answers: the front, the simulated choice, landmarks."""

import json
import math

import numpy as np
import pytest
from explorer_views import GOAL, MIDDLE, ROBOT, START, view

from locplan.costs import Costmap
from locplan.errors import ConfigError, PoseError
from locplan.explorer._cancelling import Cancel, Cancelled
from locplan.explorer._front import SHOWN, front_of, spread, undominated, weights_of
from locplan.explorer._landmarks import landmarks_of
from locplan.explorer._simulating import PATH_SHOWN, ErrorProfile, simulated
from locplan.explorer._view import STEPS, View
from locplan.landmarks import Box, Pole, place_landmarks
from locplan.maps import FREE, OccupancyGrid
from locplan.planners import pareto_front, plan
from locplan.simulation import Drives, choose, verdict as verdict_on


def as_json(answer):
    """What the page gets; NaN is refused."""
    return json.loads(json.dumps(answer.summary(), allow_nan=False))


def stopping_after(calls: int):
    """A progress callback that cancels at a call, and the list of all calls."""
    token, seen = Cancel(), []

    def note(done: int, total: int) -> None:
        seen.append((done, total))
        if len(seen) == calls:
            token.cancel()

    return token.watching(note), seen


def walled() -> View:
    """A view without any path: a wall between start and goal."""
    cells = np.full((20, 40), FREE, np.uint8)
    cells[:, 20] = 0
    grid = OccupancyGrid(cells, 0.1, name="walled")
    costs = view().costs
    blank = Costmap.blank(grid, robot_radius=0.1)
    zero = np.zeros(grid.shape)
    known = Costmap(grid, blank.density, 1.0, 0.1, zero, zero, settings=costs.settings)
    return View(grid, view().field, known, ROBOT, (0.5, 1.0), (3.5, 1.0))


# The front


def test_the_front_is_that_of_the_library():
    shown, own = front_of(view()), pareto_front(view().costs, START, GOAL)
    assert shown.complete
    assert shown.paths == len(own)
    assert shown.points[0].length == own.length[0]
    assert shown.points[-1].degenerate == own.integral[-1]
    assert shown.points[shown.knee].length == own.length[own.knee]
    assert {point.length for point in shown.points} <= set(own.length.tolist())
    n = own.length.tolist().index(shown.points[3].length)
    assert np.array_equal(shown.points[3].xy, own.plan(n).path.xy)


def test_at_the_weight_of_a_point_no_point_costs_less():
    length = np.array([1.0, 2.0, 4.0, 5.0, 9.0])
    integral = np.array([9.0, 5.0, 4.5, 3.0, 2.9])
    weights = weights_of(length, integral)
    assert np.isnan(weights).tolist() == [False, False, True, False, False]
    for n in np.flatnonzero(np.isfinite(weights)):
        assert (length + weights[n] * integral).argmin() == n
    assert weights_of(length[:1], integral[:1]).tolist() == [0.0]


def test_at_the_weight_of_a_point_of_a_front_the_grid_planner_finds_its_cost():
    shown = front_of(view())
    some = [point for point in shown.points if point.weight and point.weight < 50]
    assert len(some) > 2
    for point in some[:3]:
        costs = view().costs.with_weight(point.weight)
        cheapest = plan(costs, START, GOAL, planner="grid").metrics.cost
        assert point.length + point.weight * point.degenerate == pytest.approx(cheapest, abs=0.2)


def test_through_waypoints_the_front_is_the_best_of_all_sums():
    shown = front_of(view(via=[MIDDLE]))
    legs = [pareto_front(view().costs, *ends) for ends in ((START, MIDDLE), (MIDDLE, GOAL))]
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
    assert shown.paths == len(best)
    assert [shown.points[0].length, shown.points[-1].length] == [best[0], best[-1]]
    for point in shown.points:
        assert np.isclose(point.xy, MIDDLE).all(axis=1).any()


def test_of_equal_lengths_the_least_degenerate_is_undominated():
    kept = undominated(np.array([2.0, 1.0, 1.0, 3.0]), np.array([1.0, 5.0, 4.0, 1.0]))
    assert kept.tolist() == [2, 0]


def test_of_a_long_front_both_ends_and_the_knee_are_shown():
    length, integral = np.arange(5000.0), np.sqrt(np.arange(5000.0))[::-1]
    shown = spread(length, integral, np.zeros(5000, bool), 1234)
    assert {0, 1234, 4999} <= set(shown.tolist())
    assert SHOWN / 2 < len(shown) <= SHOWN


def test_a_front_cut_short_says_so():
    shown = front_of(view(), time_limit=0.005)
    assert not shown.complete
    assert as_json(shown)["complete"] is False


def test_an_unreachable_goal_has_an_empty_front():
    shown = front_of(walled())
    assert (shown.status, shown.points, shown.knee) == ("unreachable", (), None)
    assert as_json(shown)["epsilon"] is None


def test_a_cancelled_front_ends_with_its_leg():
    progress, seen = stopping_after(2)
    with pytest.raises(Cancelled):
        front_of(view(via=[MIDDLE, (21.0, 3.0)]), progress=progress)
    assert seen == [(0, 3), (1, 3)]


@pytest.mark.parametrize("limit", [0, -1, math.nan, math.inf, "5", None])
def test_a_front_refuses_a_time_limit_that_is_none(limit):
    with pytest.raises(ConfigError, match="time_limit"):
        front_of(view(), time_limit=limit)


# The simulated choice


def test_the_simulated_choice_is_that_of_the_library():
    shown = simulated(view(), drives=4, seed=3)
    aware, shortest = view().paths()
    own = choose(
        *(view().grid, START, GOAL),
        robot=ROBOT,
        costs=view().costs,
        candidates={PATH_SHOWN: aware},
        drives=4,
        seed=3,
    )
    assert shown.chosen == own.chosen.name
    assert own.why in shown.verdict
    assert [each.name for each in shown.candidates] == [each.name for each in own.candidates]
    for one, other in zip(shown.candidates, own.candidates, strict=True):
        assert one.error.value == pytest.approx(other.typical_rmse)
        assert one.lost == other.drives.lost_rate
    first = as_json(shown)["candidates"][0]
    assert first["length"] == pytest.approx(shortest.length, abs=0.05)
    assert first["error_m"][0] == shown.candidates[0].error.value


def test_the_filter_of_the_ask_is_simulated():
    some = {"laser_model_type": "likelihood_field_prob", "max_particles": 600, "outliers": 0.2}
    through = view(via=[MIDDLE], weight=12.0)
    shown, default = (simulated(through, drives=2, filter=each) for each in (some, None))
    assert "likelihood_field_prob" in shown.verdict
    assert shown.candidates[0].error != default.candidates[0].error


def test_through_waypoints_both_paths_are_driven():
    shown = simulated(view(via=[MIDDLE], weight=12.0), drives=3)
    through = view(via=[MIDDLE], weight=12.0)
    own = verdict_on(through.costs, through.plans(), ROBOT, drives=3)
    assert (shown.verdict, shown.chosen, shown.drives) == (own.text, own.recommended, 3)
    assert [each.name for each in shown.candidates] == ["shortest", "localizability-aware"]
    for each in shown.candidates:
        assert np.hypot(*(each.path.xy - MIDDLE).T).min() < 1e-9


def test_one_way_through_waypoints_is_driven_alone():
    shown = simulated(view(via=[MIDDLE], weight=0.1), drives=3)
    assert "same path as the shortest" in shown.verdict
    assert [each.name for each in shown.candidates] == ["shortest"]
    assert shown.drives == 3


def test_the_profile_keeps_the_largest_errors():
    poses = np.column_stack([np.linspace(0, 50, 1001), np.zeros(1001), np.zeros(1001)])
    errors = np.zeros((20, 1001, 3))
    errors[:, 777, 0] = np.arange(20) / 10
    profile = ErrorProfile.of(Drives(poses, errors))
    assert len(profile.distance) == len(profile.median) == len(profile.high) <= STEPS
    place = int(profile.median.argmax())
    assert profile.median[place] == pytest.approx(0.95)
    assert profile.high[place] == pytest.approx(np.quantile(np.arange(20) / 10, 0.95))
    assert profile.distance[place] == pytest.approx(50 * 777 / 1000, abs=0.2)
    assert (np.diff(profile.distance) > 0).all()


def test_a_cancelled_simulation_drives_no_further():
    progress, seen = stopping_after(3)
    with pytest.raises(Cancelled):
        simulated(view(via=[MIDDLE], weight=12.0), drives=60, progress=progress)
    assert len(seen) == 3
    progress, seen = stopping_after(1)
    with pytest.raises(Cancelled):
        simulated(view(), drives=60, progress=progress)
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"drives": 1}, "drives"),
        ({"drives": 101}, "drives"),
        ({"drives": 2.5}, "drives"),
        ({"filter": {"no_such": 1}}, "no_such"),
        ({"filter": {"alpha1": "much"}}, "alpha1"),
        ({"filter": {"max_particles": 10**9}}, "max_particles"),
        ({"filter": [1]}, "filter"),
    ],
)
def test_a_simulation_refuses_what_is_no_setting(asked, named):
    with pytest.raises(ConfigError, match=named):
        simulated(view(), **asked)


def test_without_a_path_there_is_no_verdict_on_one():
    with pytest.raises(ConfigError, match="no path"):
        simulated(walled())


def test_a_start_in_a_wall_is_refused():
    from dataclasses import replace

    with pytest.raises(PoseError, match="start"):
        simulated(replace(view(), start=(0.0, 0.0)))


# Landmarks


def test_landmarks_are_those_of_the_library():
    robot = ROBOT.changed({"laser_model_type": "likelihood_field_prob"})
    shown = landmarks_of(view(weight=0.0, robot=robot), object="pole:0.3", count=2, drives=0)
    aware, _ = view(weight=0.0).paths()
    own = place_landmarks(view().grid, Pole(0.3), 2, paths=aware, robot=robot)
    assert np.array_equal(shown.made.poses, own.poses)
    told = as_json(shown)
    assert told["curve"] == pytest.approx(100 * own.expected)
    assert sum(told["gains"]) == pytest.approx(told["curve"][0] - told["curve"][-1])
    assert (told["tool"], told["size"]) == ("pole", [0.3])
    assert told["verdict"] == "not verified: nothing was driven"
    assert told["helps"] is None


def test_drives_verify_landmarks():
    shown = landmarks_of(view(weight=0.0), object="box:0.5,0.2", count=1, drives=4, seed=2)
    own = shown.made.verify(4, seed=2, random_sets=1)
    assert own.verdict in shown.verdict
    assert "4 drives" in shown.verdict
    assert as_json(shown)["helps"] is own.helps
    assert shown.made.setting.kind == Box(0.5, 0.2)
    assert as_json(shown)["size"] == [0.5, 0.2]


def test_cancelled_landmarks_end_at_a_step_or_a_drive():
    progress, seen = stopping_after(1)
    with pytest.raises(Cancelled):
        landmarks_of(view(weight=0.0), count=2, drives=50, progress=progress)
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"object": "tree:1"}, "pole:DIAMETER"),
        ({"object": "pole:" + "1" * 99}, "object"),
        ({"object": "pole:nan"}, "diameter"),
        ({"object": None}, "object"),
        ({"count": 0}, "count"),
        ({"count": 21}, "count"),
        ({"drives": 1}, "drives"),
        ({"drives": 101}, "drives"),
        ({"drives": True}, "drives"),
    ],
)
def test_landmarks_refuse_what_is_no_setting(asked, named):
    with pytest.raises(ConfigError, match=named):
        landmarks_of(view(), **asked)


def test_a_token_stays_cancelled():
    token = Cancel()
    token.check()
    token.cancel()
    token.cancel()
    assert token.cancelled
    with pytest.raises(Cancelled):
        token.check()
    with pytest.raises(Cancelled):
        token.watching()(0, 1)
