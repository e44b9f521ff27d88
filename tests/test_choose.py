"""The simulated choice: its rules, its candidates, its command and its picture."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math

import numpy as np
import pytest
from conftest import refused
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from locplan import (
    Costmap,
    FieldConfig,
    Fisher,
    Fused,
    LocplanError,
    OccupancyGrid,
    Path,
    Scan,
    choose,
    covariance_field,
    load_or_compute,
    pareto_front,
    plan,
    save_map,
)
from locplan.errors import ConfigError, PoseError
from locplan.field import SHORT_LIDAR
from locplan.maps import FREE, OCCUPIED, environments
from locplan.planners._alternatives import LEAST_SHARE, alternatives, is_another_way
from locplan.plotting import map_around
from locplan.robots import Amcl, Footprint, Lidar, Robot
from locplan.simulation import Choice, choice_figure, simulate
from locplan.simulation._scores import (
    CLEARLY,
    FLOOR,
    MINIMISED,
    front_of,
    is_settled,
    log_error_range,
    log_errors,
    price_of,
    selected,
)
from locplan.simulation.choice import _choose as module
from locplan.simulation.choice._candidates import CandidateWarning
from locplan.simulation.choice._choice import at_length, gain
from locplan.simulation.choice._figures import places_of_numbers
from locplan.simulation.choice._reports import COLUMNS, choice_table, write_choice

START, GOAL = (1.0, 3.0), (11.0, 3.0)
FEW = Amcl(min_particles=100, max_particles=100)
ROBOT = Robot(filter=FEW, footprint=0.2, margin=0.0)
QUICK = {"robot": ROBOT, "drives": 3}


@pytest.fixture(autouse=True)
def _wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "110")


@pytest.fixture(scope="module")
def grid():
    """A room of 12 x 6 m with a box in its middle, and a closed cell in a corner."""
    cells = np.full((60, 120), FREE, np.uint8)
    cells[[0, -1]], cells[:, [0, -1]] = OCCUPIED, OCCUPIED
    cells[14:40, 30:90] = OCCUPIED
    cells[50, 110:], cells[50:, 110] = OCCUPIED, OCCUPIED
    return OccupancyGrid(cells, 0.1, name="box")


@pytest.fixture(scope="module")
def costs(grid):
    return Costmap.blank(grid, robot_radius=0.2)


@pytest.fixture(scope="module")
def choice(grid, costs):
    return choose(grid, START, GOAL, costs=costs, **QUICK)


@pytest.fixture(scope="module")
def many(grid, costs):
    """Nine candidates, one of which has a long name, and one a name of the alternatives."""
    above = [(1, 3), (2, 5), (10, 5), (11, 3)]
    own = {f"{'a long name ' * 6}{n}": Path(np.array(above) + 0.05 * n) for n in range(4)}
    own |= {"shortest": Path([(1, 3), (2.5, 1), (9.5, 1), (11, 3)]), "w": "grid", "$x$": "grid"}
    noisy = {"outliers": 0.1, "occlusion": 0.3, "boundary_noise": 0.2, "worlds": 3}
    robot = ROBOT.changed({f"alpha{n}": 0.12345 for n in range(1, 6)} | noisy)
    other = {**QUICK, "robot": robot}
    return choose(grid, START, GOAL, costs=costs, candidates=own, **other)


@pytest.fixture(scope="module")
def corridors():
    return Costmap.blank(environments.make("two_corridors", resolution=0.1))


def two_ways(corridors, **options):
    """The choice between a featureless corridor and a well-marked way around."""
    robot = Robot(filter=Amcl(min_particles=300, max_particles=300))
    options = {"robot": robot, "drives": 4, **options}
    return choose(corridors.grid, (2.0, 3.0), (38.0, 3.0), costs=corridors, **options)


# Scores


def test_without_a_costmap_the_field_is_fused_for_the_lidar(grid):
    robot = dataclasses.replace(ROBOT, lidar=Lidar(range=3.0, beams=20))
    settings = choose(grid, START, GOAL, robot, drives=3).costs.settings
    assert settings.config.estimator == Fused.of(robot.lidar)


def test_each_minimised_error_is_that_of_its_part_of_the_drive():
    distance = np.array([0.0, 1.0, 1.5, 2.0, 2.5])
    errors = np.zeros((2, 5, 3))
    errors[0, :, :2] = [(3, 4), (0, 0), (0, 0), (0.6, 0.8), (0, 2)]
    errors[1, :, 2] = 0.5
    squares = [25, 0, 0, 1, 4]
    expected = {
        "rmse": [0.5 * math.log(np.mean(squares) + FLOOR), 0.5 * math.log(FLOOR)],
        "goal-error": [0.5 * math.log(np.mean(squares[2:]) + FLOOR), 0.5 * math.log(FLOOR)],
        "heading": [0.5 * math.log(FLOOR), 0.5 * math.log(0.25 + FLOOR)],
    }
    expected["lost"] = expected["rmse"]
    assert set(expected) == set(MINIMISED)
    for minimise, values in expected.items():
        found = log_errors(distance, errors, minimise, 100.0)
        np.testing.assert_allclose(found, values, err_msg=minimise)
    low, high = log_error_range(1.5)
    np.testing.assert_allclose(log_errors(distance, errors, "rmse", 1.5), [high, low])


TENTH = -CLEARLY


@pytest.mark.parametrize(
    ("scores", "lost", "minimise", "expected"),
    [
        ([0.0, -2 * TENTH, -3 * TENTH], [0, 0, 0], "rmse", (2, True)),
        ([0.0, -0.9 * TENTH, 1.0], [1, 0, 0], "rmse", (0, False)),
        ([0.0, -1.1 * TENTH], [0, 1], "goal-error", (1, True)),
        ([-1.0, 0.0], [1, 0], "heading", (0, False)),
        ([0.0, 1.0, 2.0], [0.5, 0.25, 0.25], "lost", (1, True)),
        ([0.0, 2.0, 1.0], [0.5, 0.25, 0.25], "lost", (2, True)),
        ([0.0, -9.0], [0.5, 0.375], "lost", (0, False)),
        ([0.0, 1.0], [7 / 20, 2 / 20], "lost", (1, True)),  # whatever the rounding
        ([0.0], [1.0], "lost", (0, False)),
        ([0.0], [1.0], "rmse", (0, False)),
    ],
)
def test_the_shortest_stays_unless_another_is_clearly_better(scores, lost, minimise, expected):
    assert selected(np.array(scores, float), np.array(lost, float), minimise) == expected


@pytest.mark.parametrize("minimise", ["rmse", "lost"])
def test_what_is_settled_no_completion_of_the_drives_changes(minimise):
    random, settled, worst, paths = np.random.default_rng(3), 0, 0.003, 3
    ends = log_error_range(worst)
    for _ in range(400):
        drives = int(random.integers(2, 9))
        done = int(random.integers(1, drives + 1))
        scores = random.uniform(*ends, paths)
        sums = done * np.clip(scores + random.normal(0, 0.5, paths), *ends)
        lost = random.integers(0, done + 1, paths)
        prices = np.array([0.0, *random.uniform(0, 0.3, 2)])
        says = is_settled(sums, lost, prices, done, drives, minimise, worst)
        left = drives - done
        now = selected(sums / done + prices, lost / done, minimise)[0]
        finals = set()
        for corner in itertools.product(itertools.product(ends, (0, left)), repeat=paths):
            more, more_lost = np.array(corner).T
            score = (sums + left * more) / drives + prices
            finals.add(selected(score, (lost + more_lost) / drives, minimise)[0])
        settled += says and left > 0
        assert not says or finals == {now}
        if minimise == "rmse":  # and it ends as soon as nothing can change
            assert says == (finals == {now})
    assert settled > 20


def test_the_front_is_of_the_paths_that_none_is_better_than():
    random = np.random.default_rng(5)
    for _ in range(50):
        lengths, scores = random.integers(0, 6, (2, 8)).astype(float)
        front = front_of(lengths, scores)
        best = {
            (a, b)
            for a, b in zip(lengths, scores, strict=True)
            if not any((lengths <= a) & (scores <= b) & ((lengths < a) | (scores < b)))
        }
        assert {(lengths[n], scores[n]) for n in front} == best
        assert len(front) == len(best)
        assert (np.diff(lengths[front]) > 0).all()


def test_a_price_is_the_detour_for_half_the_error():
    assert price_of(np.array([0.0, 5.0]), None).tolist() == [0, 0]
    np.testing.assert_allclose(price_of(np.array([0.0, 5.0]), 5.0), [0, math.log(2)])


# Candidates


def test_another_way_lies_beside_each_other_for_a_fifth_of_its_points():
    straight = Path([(0.0, 0.0), (10.0, 0.0)])

    def bulged(metres, aside=1.0):
        return Path([(0, 0), (0, aside), (metres, aside), (metres, 0), (10, 0)])

    assert not is_another_way(straight, [straight])
    assert is_another_way(bulged(4.0), [straight])
    assert not is_another_way(bulged(4.0, aside=0.7), [straight])
    assert not is_another_way(bulged(4.0), [straight, bulged(4.2)])
    assert 2.5 / (10 + 2) > LEAST_SHARE > 2.0 / (10 + 2)
    assert is_another_way(bulged(2.5), [straight])
    assert not is_another_way(bulged(1.75), [straight])
    many_corners = [(x, 0.0) for x in np.linspace(2.5, 10, 500)]
    assert is_another_way(Path([*bulged(2.5).xy[:-1], *many_corners]), [straight])


def test_alternatives_are_dissimilar_and_not_much_longer(costs):
    paths = alternatives(costs, START, GOAL)
    (first, shortest), *others = paths.items()
    assert first == "shortest"
    assert others
    assert shortest.length == min(path.length for path in paths.values())
    for n, (_, path) in enumerate(others, 1):
        assert path.length <= 1.5 * shortest.length
        assert is_another_way(path, list(paths.values())[:n])
        np.testing.assert_allclose(path.xy[[0, -1]], [START, GOAL], atol=1e-6)
    longest = max(path.length for path in paths.values()) / shortest.length
    fewer = alternatives(costs, START, GOAL, longest=0.5 * (1 + longest))
    assert 0 < len(fewer) < len(paths)


def test_a_users_paths_are_kept_whatever_their_names_and_lengths(costs):
    long = Path([START, (1, 5), (11, 4.5), (1, 5), (11, 4.5), GOAL])
    others = {"shortest": long, "way around 1": long, "own shortest": long}
    paths = alternatives(costs, START, GOAL, others=others)
    added = ["own shortest", "own way around 1", "own own shortest"]
    assert list(paths) == [*alternatives(costs, START, GOAL), *added]
    assert [path is long for path in paths.values()] == [False] * (len(paths) - 3) + [True] * 3


def test_a_shorter_path_that_does_nearly_as_well_is_named(choice):
    first, *_ = choice.candidates
    length = first.path.length
    longer = [
        dataclasses.replace(first, name=name, path=_stretched(first.path, extra), log_error=error)
        for name, extra, error in (
            ("a", 1, -1.0),
            ("b", 2, -1.95),
            ("c", 3, -2.0),
            ("d", 1.5, -1.9),
        )
    ]
    first = dataclasses.replace(first, log_error=-1.0)
    made = dataclasses.replace(choice, candidates=(first, *longer), best=3, minimise="rmse")
    assert made.nearly is longer[3]
    assert "d does nearly as well, for 1.5 m more" in choice_table(made)
    assert made.candidates[4].path.length == pytest.approx(length + 1.5)
    alone = dataclasses.replace(made, candidates=(first, *longer[:3]), best=2)
    assert alone.nearly is None
    assert dataclasses.replace(made, best=0).nearly is None


def _stretched(path, extra):
    """A path with another of half this length [m] out and back at its end."""
    return Path([*path.xy, path.xy[-1] + (0, extra / 2), path.xy[-1]])


def test_candidates_are_paths_plans_fronts_planners_and_arrays(grid):
    lidar = dataclasses.replace(SHORT_LIDAR, range=2.0)
    field = covariance_field(grid, FieldConfig(Fisher(lidar), stride=0.5))
    costs = Costmap.from_field(grid, field, robot_radius=0.2)
    front = pareto_front(costs, START, GOAL)
    array = np.array([START, (3, 5), (9, 5), GOAL])
    given = {"mine": array, "front": front, "by grid": "grid"}
    found = choose(grid, START, GOAL, costs=costs, candidates=given, **QUICK)
    names = [each.name for each in found.candidates]
    count = sum(name.startswith("front ") for name in names)
    own = ["mine", *(f"front {n}" for n in range(1, count + 1)), "by grid"]
    assert names == [*alternatives(costs, START, GOAL), *own]
    assert (count, len(front) > 5) == (5, True)
    mine, *of_front, _ = found.candidates[-7:]
    lengths = [each.path.length for each in of_front]
    assert lengths == sorted(lengths)
    np.testing.assert_allclose([lengths[0], lengths[-1]], front.length[[0, -1]], atol=0.01)
    assert mine.path.xy.tolist() == array.tolist()
    with pytest.raises(ConfigError, match="two candidates are called 'grid'"):
        choose(grid, START, GOAL, costs=costs, candidates=["grid", "grid"], **QUICK)


def test_a_candidate_without_a_path_is_warned_of(grid, costs):
    no_path = plan(costs, START, (11.6, 5.6))  # it ends in the closed cell
    assert no_path.path is None
    with pytest.warns(CandidateWarning, match="candidate 'none' has no path"):
        found = choose(grid, START, GOAL, costs=costs, candidates={"none": no_path}, **QUICK)
    assert "none" not in [each.name for each in found.candidates]


# The choice


def by_hand(drives, minimise):
    squares = drives.errors[..., 2] ** 2
    if minimise != "heading":
        squares = drives.errors[..., 0] ** 2 + drives.errors[..., 1] ** 2
    if minimise == "goal-error":
        squares = squares[:, drives.distance >= drives.distance[-1] - 1]
    return np.mean([0.5 * math.log(each.mean() + 1e-6) for each in squares])


@pytest.mark.parametrize("minimise", MINIMISED)
def test_the_chosen_is_the_best_by_what_is_minimised(grid, costs, minimise):
    found = choose(grid, START, GOAL, costs=costs, minimise=minimise, **QUICK)
    scores = [by_hand(each.drives, minimise) for each in found.candidates]
    np.testing.assert_allclose([each.log_error for each in found.candidates], scores)
    lost = np.array([each.drives.lost.mean() for each in found.candidates])
    assert found.best == selected(np.array(scores), lost, minimise)[0]
    assert found.path is found.candidates[found.best].path
    unit = {"heading": "heading", "goal-error": "at goal"}.get(minimise, "degen.")
    assert unit in choice_table(found)


def test_equal_seeds_give_equal_choices_on_any_number_of_threads(grid, costs, choice):
    again = choose(grid, START, GOAL, costs=costs, threads=1, **QUICK)
    other = choose(grid, START, GOAL, costs=costs, seed=2, **QUICK)
    for one, two, three in zip(choice.candidates, again.candidates, other.candidates, strict=True):
        np.testing.assert_array_equal(one.drives.errors, two.drives.errors)
        assert (one.drives.errors != three.drives.errors).any()
    assert again.summary() == choice.summary()


def test_a_path_is_driven_as_it_is_alone_by_simulate(grid, choice):
    last = choice.candidates[-1]
    alone = simulate(grid, {"alone": last.path}, robot=Robot(filter=FEW), drives=3)
    np.testing.assert_array_equal(alone.drives["alone"].errors, last.drives.errors)


def test_a_high_price_of_metres_keeps_the_shortest(corridors):
    free, dear = (two_ways(corridors, price=price) for price in (None, 0.5))
    assert free.chosen.name == "way around 2"
    extra = free.chosen.path.length - free.shortest.path.length
    assert extra > 5
    assert free.why == f"0% of drives lost instead of 25%, for {extra:.1f} m more"
    assert dear.chosen is dear.shortest
    assert dear.why == "no alternative is worth its length: the shortest"
    fewest = dataclasses.replace(dear, minimise="lost")
    assert fewest.why == "no alternative loses clearly fewer of 4 drives: the shortest"
    assert "0.5 m of detour count as much as half the error" in choice_table(dear)
    assert "of detour" not in choice_table(free)
    assert dear.candidates[free.best].price == pytest.approx(math.log(2) * extra / 0.5)
    assert dear.candidates[free.best].log_error == free.chosen.log_error


def test_the_reason_tells_what_was_minimised(corridors):
    free = two_ways(corridors)
    before, after = free.shortest, free.chosen
    errors = [f"{math.exp(each.log_error):.2g}" for each in (after, before)]
    degrees = [f"{math.degrees(math.exp(each.log_error)):.2g}" for each in (after, before)]
    lost = "0% of drives lost instead of 25%"
    assert gain(before, after, "rmse") == gain(before, after, "lost") == lost
    assert gain(before, before, "rmse") == f"an error of {errors[1]} m instead of {errors[1]} m"
    assert gain(before, after, "heading").startswith(f"a heading error of {degrees[0]} deg")
    expected = f"an error of {errors[0]} m at the goal instead of {errors[1]} m"
    assert gain(before, after, "goal-error") == expected


def test_the_reason_tells_of_more_drives_lost_and_of_shorter_paths(choice):
    first, other = choice.candidates[:2]
    errors = np.zeros((4, len(first.drives.poses), 3))
    none = dataclasses.replace(first.drives, errors=errors)
    one = dataclasses.replace(first.drives, errors=errors + np.array([0, 0, 0, 2])[:, None, None])
    before = dataclasses.replace(first, drives=none, log_error=-1.0)
    after = dataclasses.replace(other, drives=one, log_error=-2.0)
    but = ", but 25% of drives lost instead of 0%"
    assert gain(before, after, "rmse") == f"an error of 0.14 m instead of 0.37 m{but}"
    for minimise in ("goal-error", "heading"):
        assert gain(before, after, minimise).endswith(but)
    assert "but" not in gain(before, before, "rmse")
    extra = other.path.length - first.path.length
    assert at_length(first, other) == f"for {extra:.1f} m more"
    assert at_length(other, first) == f"for {extra:.1f} m less"
    assert at_length(first, first) == "at the same length"
    both = dataclasses.replace(choice, candidates=(before, after), best=1)
    assert both.why.endswith(f"{but}, for {extra:.1f} m more")


def test_a_choice_among_paths_that_are_all_lost_says_to_tune_the_filter(choice):
    for lost, says in ((0, False), (1, True)):
        made = []
        for each in choice.candidates:
            errors = np.full((2, len(each.drives.poses), 3), 0.1)
            errors[:lost] = 2.0
            drives = dataclasses.replace(each.drives, errors=errors)
            made.append(dataclasses.replace(each, drives=drives))
        told = choice_table(dataclasses.replace(choice, candidates=tuple(made)))
        assert ("drives or more are lost: tune the filter first" in told) == says


def test_drives_without_any_error_count_as_a_millimetre(choice):
    first, other = choice.candidates[:2]
    none = dataclasses.replace(first.drives, errors=np.zeros_like(first.drives.errors))
    still = dataclasses.replace(first, drives=none)
    assert still.typical_rmse == pytest.approx(0.001)
    made = dataclasses.replace(choice, candidates=(still, other), best=0)
    assert made.ratio(still).value == 1
    assert made.ratio(other).value == pytest.approx(other.typical_rmse / 0.001)


def test_drives_end_early_only_where_they_change_nothing(corridors, monkeypatch):
    early = two_ways(corridors, minimise="lost", drives=12)
    monkeypatch.setattr("locplan.simulation.choice._choose.is_settled", lambda *_: False)
    whole = two_ways(corridors, minimise="lost", drives=12)
    counts = [len(each.shortest.drives.errors) for each in (early, whole)]
    assert counts[0] < counts[1] == 12
    assert early.chosen.name == whole.chosen.name
    for one, two in zip(early.candidates, whole.candidates, strict=True):
        np.testing.assert_array_equal(one.drives.errors, two.drives.errors[: counts[0]])
    assert f"{counts[0]} of 12 drives" in " ".join(choice_table(early).split())


def test_a_time_limit_leaves_two_drives_of_each(corridors):
    found = two_ways(corridors, time_limit=1e-9)
    assert {len(each.drives.errors) for each in found.candidates} == {2}


def test_progress_counts_the_drives(grid, costs):
    calls = []
    found = choose(
        grid, START, GOAL, costs=costs, progress=lambda *call: calls.append(call), **QUICK
    )
    total = 3 * len(found.candidates)
    assert calls == [(n, total) for n in range(1, total + 1)]


def test_an_unreachable_goal_is_a_result(grid, costs):
    found = choose(grid, START, (11.5, 5.5), costs=costs, **QUICK)
    assert (found.status, found.path, found.chosen, found.front) == ("unreachable", None, None, ())
    assert choice_table(found) == "unreachable: no path leads to the goal"
    assert found.summary()["candidates"] == {}
    assert len(found._repr_png_()) > 1000


def test_no_field_is_computed_for_an_unreachable_goal(grid, run, box, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError

    monkeypatch.setattr("locplan.field._store.load_or_compute", refuse)
    monkeypatch.setattr(module, "load_or_compute", refuse)
    assert choose(grid, START, (11.5, 5.5), **QUICK).status == "unreachable"
    ends = "--start", "1,3", "--goal", "11.5,5.5"
    assert run("choose", box, *ends, *SETTINGS, "--front")[0] == 0
    with pytest.raises(AssertionError):
        choose(grid, START, GOAL, **QUICK)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"goal": START}, ConfigError, "one place"),
        ({"start": (4.0, 2.0)}, PoseError, "start 4,2 lies in a wall"),
        ({"longest": 0.9}, ConfigError, "longest must be at least 1"),
        ({"price": 0.0}, ConfigError, "price must be positive"),
        ({"time_limit": -1}, ConfigError, "time_limit must be positive"),
        ({"drives": 1}, ConfigError, "drives must be a whole number"),
        ({"minimise": "error"}, ConfigError, "minimise must be one of rmse, lost"),
        ({"candidates": {"wall": [START, GOAL]}}, LocplanError, "candidate wall: leaves the free"),
        ({"costs": "map.yaml"}, ConfigError, "costs must be a Costmap, not 'map.yaml'"),
        ({"candidates": 3}, ConfigError, "candidates must be a sequence or a mapping of paths"),
        ({"candidates": [[(1, 4), GOAL]]}, ConfigError, "'path 1' has its start at 1.00,4.00"),
        ({"candidates": [[START, (11, 4)]]}, ConfigError, "'path 1' has its goal at 11.00,4.00"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_bad_input_is_one_clear_line(grid, costs, arguments, error, words):
    given = {"start": START, "goal": GOAL, "costs": costs, **QUICK, **arguments}
    with pytest.raises(error, match=words) as caught:
        choose(grid, given.pop("start"), given.pop("goal"), **given)
    assert "\n" not in str(caught.value)


def test_a_costmap_of_another_map_is_refused(grid):
    cells = grid.cells.copy()
    cells[50, 50] = OCCUPIED
    foreign = Costmap.blank(OccupancyGrid(cells, 0.1))
    with pytest.raises(ConfigError, match="of another map"):
        choose(grid, START, GOAL, costs=foreign, **QUICK)


# The command and its files


@pytest.fixture
def box(grid, tmp_path):
    save_map(grid, tmp_path / "box.yaml")
    return tmp_path / "box.yaml"


ENDS = "--start", "1,3", "--goal", "11,3"
SETTINGS = "--drives", "2", "--set", "min_particles=100", "--set", "max_particles=100"
SETTINGS += "--stride", "0.5", "--set", "range=3"


def test_parameters_that_work_badly_are_warned_of(run, box):
    silly = "--set", "z_hit=0.9", "--set", "z_rand=0.5"
    code, _, err = run("choose", box, *ENDS, *SETTINGS, *silly)
    assert code == 0
    assert err.count("locplan: warning: z_hit") == 1


@pytest.mark.draws
def test_the_command_writes_paths_tables_and_a_picture(run, box, tmp_path):
    params = "amcl: {ros__parameters: {alpha1: 0.1, beam_count: 3}}"
    (tmp_path / "nav2.yaml").write_text(params)
    Path([START, (2, 5), (10, 5), GOAL]).save(tmp_path / "my way?.csv")
    own = "--path", tmp_path / "my way?.csv", "--planner", "grid", "--front"
    options = *own, "--robot", tmp_path / "nav2.yaml", "--set", "outliers=0.1"
    code, out, err = run("choose", box, *ENDS, *SETTINGS, *options, "-o", tmp_path / "out")
    assert code == 0
    assert "nav2.yaml: not simulated: beam_count" in err
    about = json.loads((tmp_path / "out" / "choice.json").read_text())
    names = list(about["candidates"])
    at = names.index("my way?")
    assert names[at : at + 3] == ["my way?", "grid", "front 1"]
    files = {file.name for file in (tmp_path / "out").iterdir()}
    assert {*Choice.files.names, "01-shortest.csv", f"{at + 1:02}-my-way-.csv"} < files
    assert len(files) == len(Choice.files.names) + len(names) + 1
    with (tmp_path / "out" / "candidates.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [row["candidate"] for row in rows] == names
    for row in rows:
        found = about["candidates"][row["candidate"]]
        assert float(row["typical_rmse_m"]) == pytest.approx(found["typical_rmse_m"])
        assert bool(int(row["on_front"])) == found["on_front"]
        assert (row["candidate"] == about["chosen"]) == bool(int(row["chosen"]))
        path = Path.load(tmp_path / "out" / row["file"])
        np.testing.assert_allclose(path.xy, found["xy"], atol=1e-6)
    (best,) = (row for row in rows if int(row["chosen"]))
    chosen = (tmp_path / "out" / "chosen.csv").read_bytes()
    assert chosen == (tmp_path / "out" / best["file"]).read_bytes()
    with (tmp_path / "out" / "errors.csv").open() as file:
        assert {row["path"] for row in csv.DictReader(file)} == set(names)
    assert (tmp_path / "out" / "choice.png").stat().st_size > 10_000
    lines = out.splitlines()
    assert sum(line.startswith("  >") for line in lines) == 1
    assert any(line.startswith(f"  >* {about['chosen']} ") for line in lines)
    settings = (
        "AMCL's alpha1 0.1, max_particles 100, min_particles 100, outliers 0.1; 2 drives each"
    )
    text = " ".join(out.split())
    assert f"with lidar, 3 m, 360°; radius 0.2 m, margin 0.05 m; {settings}" in text
    assert max(map(len, lines)) <= 110


def test_the_file_of_the_chosen_is_not_that_of_the_shortest(choice, tmp_path):
    assert choice.chosen is not choice.shortest
    written = write_choice(Choice.files.into(tmp_path / "out"), choice)
    assert {file.name for file in written} >= set(Choice.files.names)
    path = Path.load(tmp_path / "out" / "chosen.csv")
    np.testing.assert_allclose(path.xy, choice.path.xy, atol=1e-6)


def test_json_is_what_python_gives(run, box, grid):
    code, out, _ = run("choose", box, *ENDS, *SETTINGS, "--price", "3", "--seed", "4", "--json")
    assert code == 0
    lidar = Lidar(range=3.0)
    field = load_or_compute(grid, FieldConfig(Scan(lidar), stride=0.5))
    costs = Costmap.from_field(grid, field)
    choice = choose(
        grid, START, GOAL, robot=Robot(lidar, filter=FEW), costs=costs, drives=2, price=3.0, seed=4
    )
    expected = json.loads(json.dumps(choice.summary()))
    about = json.loads(out)
    for name in ("chosen", "why", "price_m", "seed", "minimise", "robot", "start", "goal"):
        assert about[name] == expected[name], name
    assert list(about["candidates"]) == list(expected["candidates"])
    for name, each in about["candidates"].items():
        assert each["log_error"] == pytest.approx(expected["candidates"][name]["log_error"])


def test_an_unreachable_goal_ends_the_command_well(run, box, tmp_path):
    ends = "--start", "1,3", "--goal", "11.5,5.5"
    code, out, _ = run("choose", box, *ends, *SETTINGS, "-o", tmp_path / "out")
    assert code == 0
    assert out == "unreachable: no path leads to the goal\n"
    files = {file.name for file in (tmp_path / "out").iterdir()}
    assert files == {".locplan.json", *Choice.files.names} - {"chosen.csv"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--start", "4,2", "--goal", "11,3"), "start 4,2 lies in a wall"),
        (("--start", "1,3", "--goal", "1,3"), "one place"),
        ((*ENDS, "--longest", "0.5"), "longest"),
        ((*ENDS, "--path", "wall.csv"), "candidate wall: leaves the free cells"),
        ((*ENDS, "--path", "far.csv"), "'far' has its goal"),
        ((*ENDS, "--path", "grid.csv", "--planner", "grid"), "rename it"),
        ((*ENDS, "--planner", "fastest"), "--planner must be one of"),
        ((*ENDS, "--set", "alpha9=1"), "a robot has no setting 'alpha9'"),
        ((*ENDS, "--price", "-1"), "price must be positive"),
        ((*ENDS, "--preset", "paper"), "--estimator sad"),
    ],
)
def test_bad_input_ends_the_command_before_long_work(
    run, box, tmp_path, monkeypatch, options, words
):
    monkeypatch.chdir(tmp_path)
    Path([START, GOAL]).save("wall.csv")
    Path([START, (1, 4)]).save("far.csv")
    Path([START, (2, 5), (10, 5), GOAL]).save("grid.csv")
    monkeypatch.setattr("locplan.field.load_or_compute", None)
    assert words in refused(run("choose", box, *options, "-o", "out"))
    assert not (tmp_path / "out").exists()


# The table and the picture


def test_a_narrow_terminal_gets_fewer_columns(choice, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    narrow = choice_table(choice)
    monkeypatch.setenv("COLUMNS", "110")
    whole = choice_table(choice)
    assert max(map(len, narrow.splitlines())) <= 80
    assert 80 < max(map(len, whole.splitlines())) <= 110
    for word in ("degen.", "median", "kept"):
        assert word in whole
        assert word not in narrow
    for each in choice.candidates:
        assert any(each.name in line for line in narrow.splitlines())


def drawn(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
    numbers = {id(text) for axis in figure.findobj(Axis) for text in axis.get_ticklabels()}
    texts = [text for text in texts if id(text) not in numbers]
    return [(text, text.get_window_extent(renderer)) for text in texts]


@pytest.fixture(scope="module")
def picture(many):
    """The picture of nine candidates, and its texts with the boxes that they take."""
    figure = choice_figure(many)
    return figure, drawn(figure)


def test_all_texts_of_the_picture_lie_within_it(many, picture, choice):
    assert len(many.candidates) >= 8
    few = choice_figure(choice)
    for each, (figure, texts) in ((many, picture), (choice, (few, drawn(few)))):
        width, height = figure.bbox.size
        whole = figure.get_tightbbox()  # with the numbers at the axes [inch]
        assert 0 <= whole.x0 <= whole.x1 <= width / figure.dpi
        assert 0 <= whole.y0 <= whole.y1 <= height / figure.dpi
        for text, box in texts:
            where = text.get_text(), box
            assert -2 <= box.x0 <= box.x1 <= width + 2, where
            assert -2 <= box.y0 <= box.y1 <= height + 2, where
        titles = [axes.get_title(loc="left") for axes in figure.axes]
        shown = [title for title in titles if title]
        assert len(shown) == len(each.candidates)
        assert [", chosen" in title for title in shown].index(True) == each.best
        for title, candidate in zip(shown, each.candidates, strict=True):
            assert f"{candidate.path.length:.1f} m" in title
            assert f"lost {candidate.drives.lost_rate.value:.0%}" in title
        numbers = [text.get_text() for text in figure.axes[0].texts]
        assert numbers == [str(n + 1) for n in range(len(each.candidates))]


def test_titles_of_panels_do_not_meet(picture):
    figure, _ = picture
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    boxes = [axes._left_title.get_window_extent() for axes in panels]
    for one, two in itertools.combinations(boxes, 2):
        assert not one.overlaps(two)


def test_the_panels_have_the_errors_along_the_way(choice):
    figure = choice_figure(choice)
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    for axes, each in zip(panels, choice.candidates, strict=True):
        profile = each.drives.profile()
        xy = axes.lines[-1].get_xydata()
        np.testing.assert_allclose(xy, profile[:, [0, 4]])
        assert axes.lines[0].get_ydata() == [1.0, 1.0]


def test_numbers_of_paths_stand_apart_also_where_paths_coincide():
    line = np.column_stack([np.linspace(0, 10, 41), np.zeros(41)])
    above = line + np.array([0, 3])
    places = places_of_numbers([line, line.copy(), above])
    distances = [math.dist(a, b) for a, b in itertools.combinations(places, 2)]
    assert min(distances) >= 0.3
    assert places[2][1] == 3
    assert len(places_of_numbers([line])) == 1


def test_the_picture_shows_the_part_of_the_map_with_the_candidates():
    cells = np.full((400, 600), FREE, np.uint8)
    cells[100, 150] = OCCUPIED
    large = OccupancyGrid(cells, 0.1, (5.0, -3.0, 0.3))
    xy = np.column_stack(large.grid_to_world(np.array([90.5, 110.5]), np.array([140.5, 160.5])))
    part = map_around(large, [Path(xy)])
    assert part.shape == (81, 81)
    (row,), (col,) = np.nonzero(part.cells == OCCUPIED)
    expected = large.cell_to_world(100, 150)
    np.testing.assert_allclose(part.cell_to_world(int(row), int(col)), expected, atol=1e-9)
    corners = np.column_stack(large.grid_to_world(np.array([1.0, 399.0]), np.array([1.0, 599.0])))
    assert map_around(large, [Path(corners)]).shape == large.shape


def test_the_filters_title_names_what_differs_from_the_defaults():
    assert Amcl().title == "Nav2's defaults"
    many = {f"alpha{n}": 0.05 for n in range(1, 6)} | {"max_beams": 30, "half_cell": False}
    listed = "alpha1 0.05, alpha2 0.05, alpha3 0.05, alpha4 0.05, alpha5 0.05"
    assert Amcl(**many).title == f"AMCL's {listed} and 2 more"
    assert Amcl(max_particles=1_000_000).title == "AMCL's max_particles 1000000"


def test_candidates_on_which_the_outline_meets_a_wall_are_left_out(corridors):
    ends = (2.0, 3.0), (38.0, 3.0)
    long = Footprint([(1.2, 0.3), (1.2, -0.3), (-1.2, -0.3), (-1.2, 0.3)])
    robot = Robot(footprint=long, margin=0.0)
    found = choose(corridors.grid, *ends, robot, costs=corridors, drives=2)
    assert found.left_out
    for each in found.candidates:
        assert long.first_collision(corridors.grid, each.path) is None
    assert all(each.name not in found.left_out for each in found.candidates)
    assert found.summary()["left_out"] == list(found.left_out)
    square = Footprint([(1.6, 1.6), (1.6, -1.6), (-1.6, -1.6), (-1.6, 1.6)])
    none = choose(corridors.grid, *ends, Robot(footprint=square), costs=corridors, drives=2)
    assert (none.path, none.status) == (None, "not found")
    assert "every candidate" in none.why
