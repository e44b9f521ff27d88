"""The choice of a path: its candidates, its answer, its command, its files and its picture."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import re
import shlex

import numpy as np
import pytest
from support.cases import sample_cases
from support.command_line import check_refusal
from support.recommendations import recommend

from locplan import (
    Costmap,
    FieldConfig,
    Fisher,
    Fused,
    LocplanError,
    OccupancyGrid,
    Path,
    Recommendation,
    Sad,
    Scan,
    covariance_field,
    pareto_front,
    plan,
    save_map,
)
from locplan._support.drawing import break_title
from locplan.errors import ConfigError, PoseError
from locplan.field.config import SHORT_LIDAR
from locplan.maps import FREE, OCCUPIED, Zone, Zones, environments
from locplan.maps.figures import crop_map
from locplan.planning import PlannerResult, check_path
from locplan.planning.any_angle import AnyAngle
from locplan.planning.plans import plan_with_shortest
from locplan.robots import Amcl, Footprint, Kinematics, Lidar, Robot
from locplan.robots.parts import Inflation
from locplan.simulation import Arrivals, Simulator, drive_closed
from locplan.simulation.arrivals import LEAVES, ClosedLoopDrive
from locplan.simulation.figures import MARK_LABELS, recommendation_figure
from locplan.simulation.problem import MINIMISED, RecommendationSettings
from locplan.simulation.race import compute_log_errors

START, GOAL = (1.0, 3.0), (11.0, 3.0)
FEW = Amcl(min_particles=100, max_particles=100)
ROBOT = Robot(Lidar(range=3.0), filter=FEW, footprint=0.2, margin=0.0)
QUICK = {"robot": ROBOT, "drives": 4, "rival": None}


@pytest.fixture(autouse=True)
def _wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "110")


@pytest.fixture
def one_steered_drive(monkeypatch):
    """Only one robot is steered along each path: for tests of candidates, not of arrivals."""
    monkeypatch.setattr("locplan.simulation.problem.CLOSED_DRIVES", 1)


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
    return Costmap.blank(grid, robot=0.2)


@pytest.fixture(scope="module")
def fielded(grid):
    field = covariance_field(grid, FieldConfig(Fisher(ROBOT.lidar), stride=0.5))
    return Costmap.from_field(field, robot=0.2)


@pytest.fixture(scope="module")
def choice(grid, costs):
    return recommend(grid, START, GOAL, costs=costs, **QUICK)


@pytest.fixture(scope="module")
def corridors():
    return Costmap.blank(environments.make("two_corridors", resolution=0.1))


def two_ways(corridors, **options):
    """The choice between a featureless corridor and a well-marked way around."""
    robot = Robot(Lidar(range=6.0), filter=Amcl(min_particles=300, max_particles=300))
    options = {"robot": robot, "drives": 8, "rival": None, **options}
    return recommend(corridors.grid, (2.0, 3.0), (38.0, 3.0), costs=corridors, **options)


@pytest.fixture(scope="module")
def better(corridors):
    return two_ways(corridors)


def names_of(choice):
    return [each.name for each in choice.candidates]


# Scores


def test_log_errors_equal_plain_formula():
    """The error at the goal is that of the last metre."""
    distance = np.array([0.0, 1.0, 1.5, 2.0, 2.5])
    errors = np.zeros((2, 5, 3))
    errors[0, :, :2] = [(3, 4), (0, 0), (0, 0), (0.6, 0.8), (0, 2)]
    errors[1, :, 2] = 0.5
    squares, least = [25, 0, 0, 1, 4], 1e-6  # that of the least error that counts, a millimetre
    expected = {
        "rmse": [0.5 * math.log(np.mean(squares) + least), 0.5 * math.log(least)],
        "goal-error": [0.5 * math.log(np.mean(squares[2:]) + least), 0.5 * math.log(least)],
        "heading": [0.5 * math.log(least), 0.5 * math.log(0.25 + least)],
    }
    expected["lost"] = expected["rmse"]
    assert set(expected) == set(MINIMISED)
    for minimise, values in expected.items():
        found = compute_log_errors(distance, errors, minimise, 100.0)
        np.testing.assert_allclose(found, values, err_msg=minimise)
    clipped = compute_log_errors(distance, errors, "rmse", 1.5)
    np.testing.assert_allclose(clipped, [0.5 * math.log(1.5**2 + least), 0.5 * math.log(least)])


# Candidates


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_keep_length_limit(choice):
    shortest = choice.shortest.path
    assert names_of(choice)[0] == "shortest"
    assert "clear of walls" in names_of(choice)
    assert len(choice.candidates) >= 4
    for each in choice.candidates:
        assert shortest.length - 1e-6 <= each.path.length <= 1.5 * shortest.length
        np.testing.assert_allclose(each.path.xy[[0, -1]], [START, GOAL], atol=1e-6)
    longest = max(each.path.length for each in choice.candidates) / shortest.length
    fewer = recommend(choice.costs.grid, START, GOAL, costs=choice.costs, longest=1.05, **QUICK)
    assert longest > 1.05
    assert all(each.path.length <= 1.05 * shortest.length for each in fewer.candidates)


@pytest.mark.usefixtures("one_steered_drive")
def test_inflated_path_uses_robot_inflation(grid, costs):
    """It is the path that Nav2 would plan."""
    wide = dataclasses.replace(
        ROBOT, inflation=Inflation(inflation_radius=1.5, cost_scaling_factor=1.0)
    )
    found = recommend(grid, START, GOAL, costs=costs, **{**QUICK, "robot": wide})
    inflated = next(each for each in found.candidates if each.name == "inflated")
    assert inflated.metrics.clearance > found.shortest.metrics.clearance + 0.2
    none = dataclasses.replace(ROBOT, inflation=Inflation(inflation_radius=0.0))
    found = recommend(grid, START, GOAL, costs=costs, **{**QUICK, "robot": none})
    assert "inflated" not in names_of(found)  # it is the shortest


@pytest.mark.usefixtures("one_steered_drive")
def test_aware_paths_are_always_candidates(grid, fielded):
    """They may be close to another candidate."""
    found = recommend(grid, START, GOAL, costs=fielded, weight=30.0, **QUICK)
    aware = [name for name in names_of(found) if name.startswith("aware")]
    assert "aware, weight 30" in aware
    assert len(aware) > 1
    for name in aware:
        weight = name.removeprefix("aware, weight ")
        if weight != name:
            own = plan(fielded.with_weight(float(weight)), START, GOAL)
            path = next(each for each in found.candidates if each.name == name)
            assert path.metrics.length == pytest.approx(own.path.length, rel=0.02)


@pytest.mark.usefixtures("one_steered_drive")
def test_shortest_path_ignores_costmap_weight(grid, fielded):
    heavy = fielded.with_weight(50.0)
    found = recommend(grid, START, GOAL, costs=heavy, **QUICK)
    own = plan(Costmap.blank(grid, robot=0.2), START, GOAL).path
    assert found.shortest.path.length == pytest.approx(own.length)
    assert plan(heavy, START, GOAL).path.length > own.length + 0.1


@pytest.mark.usefixtures("one_steered_drive")
def test_default_costmap_uses_fused_field(grid):
    found = recommend(grid, START, GOAL, **QUICK)
    assert found.costs.settings.config.estimator == Fused(ROBOT.lidar)
    assert found.costs.robot_radius == ROBOT.radius
    of_field = recommend(
        grid, START, GOAL, Robot(), costs=FieldConfig(Fisher(SHORT_LIDAR)), drives=0
    )
    assert of_field.robot.lidar == SHORT_LIDAR


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_include_arrays_fronts_and_planners(grid, fielded):
    front = pareto_front(fielded, START, GOAL)
    array = np.array([START, (3, 5), (9, 5), GOAL])
    given = {"mine": array, "front": front, "by grid": "grid"}
    found = recommend(grid, START, GOAL, costs=fielded, candidates=given, **QUICK)
    own = [name for name in names_of(found) if name.startswith(("mine", "front", "by grid"))]
    assert own == ["mine", *(f"front {n}" for n in range(1, len(own) - 1)), "by grid"]
    assert len(own) == 7 < len(front)
    mine = next(each for each in found.candidates if each.name == "mine")
    assert mine.path.xy.tolist() == array.tolist()
    also = recommend(grid, START, GOAL, costs=fielded, front=True, **QUICK)
    assert [name for name in names_of(also) if name.startswith("front")] == own[1:-1]
    with pytest.raises(ConfigError, match="two candidates are called 'grid'"):
        recommend(grid, START, GOAL, costs=fielded, candidates=["grid", "grid"], **QUICK)


@pytest.mark.usefixtures("one_steered_drive")
def test_user_paths_are_never_dropped(grid, costs):
    """They may be long, or have the name of a planned candidate."""
    long = Path([START, (1, 5), (11, 4.5), (1, 5), (11, 4.5), GOAL])
    own = dict.fromkeys(("shortest", "detour 2", "aware and clear"), long)
    found = recommend(grid, START, GOAL, costs=costs, candidates=own, **QUICK)
    assert names_of(found)[-3:] == [f"own {name}" for name in own]


@pytest.mark.usefixtures("one_steered_drive")
def test_requested_paths_ignore_length_limit(grid, costs, fielded):
    class Winding(AnyAngle):
        name = "winding"

        def solve(self, costs, start, goal):
            xy = [start, (1, 5), (11, 4.5), (1, 5), (11, 4.5), goal]
            return PlannerResult(Path(xy), "solved")

    asked = {"candidates": Winding(), "longest": 1.0}
    for drives in (QUICK["drives"], 0):
        own = {**QUICK, "drives": drives, "costs": costs}
        found = recommend(grid, START, GOAL, **own, **asked)
        assert found.candidates[-1].name == "winding"
        assert "winding" not in found.left_out
    asked |= {"costs": fielded, "front": True, "weight": 40.0}
    found = recommend(grid, START, GOAL, **QUICK, **asked)
    requested = {"winding", "front 5", "aware, weight 8", "aware, weight 40"}
    assert requested <= {*names_of(found), *found.left_out}
    for name in requested & {*found.left_out}:
        assert "same path as" in found.left_out[name]
    lengths = {each.name: each.path.length for each in found.candidates}
    assert lengths["aware, weight 40"] > lengths["shortest"]


PLANNED = {
    *("shortest", "inflated", "clear of walls", "along walls", "a metre off walls"),
    *("detour 1", "detour 2", "detour 3", "detour 4", "detour 5"),
    *("aware, weight 4", "aware, weight 8", "aware, weight 12", "aware and clear"),
}


@pytest.mark.usefixtures("one_steered_drive", "undrawn")
@pytest.mark.parametrize(
    ("longest", "reason"),
    [
        (1.5, r"(nearly the )?same path as '[a-z0-9 ]+'"),
        pytest.param(
            1.0, r"\d+\.\d m, more than 1 times the shortest path", marks=pytest.mark.long
        ),
    ],
)
def test_choose_reports_every_dropped_candidate(grid, fielded, tmp_path, longest, reason):
    found = recommend(grid, START, GOAL, costs=fielded, longest=longest, **QUICK)
    assert {*names_of(found), *found.left_out} == PLANNED
    assert not {*names_of(found)} & {*found.left_out}
    assert any(re.fullmatch(reason, why) for why in found.left_out.values())
    report = " ".join(found.report().split())
    assert all(name in report and why in report for name, why in found.left_out.items())
    found.save(tmp_path)
    assert json.loads((tmp_path / "choice.json").read_text())["left_out"] == found.left_out
    assert Recommendation.load(tmp_path).report() == found.report()


@pytest.mark.long
def test_choose_verdict_ignores_length_limit(corridors):
    """The aware path from end to end of the lower corridor is 1.5 times as long as the shortest."""
    robot = Robot(Lidar(range=6.0), filter=Amcl(min_particles=300, max_particles=300))
    field = covariance_field(corridors.grid, FieldConfig(Fisher(robot.lidar), stride=0.5))
    asked = {"costs": Costmap.from_field(field), "drives": 8, "rival": None}
    ends = (5.0, 3.0), (34.0, 3.0)
    limited, free = (
        recommend(corridors.grid, *ends, robot, longest=longest, **asked) for longest in (1.2, 3.0)
    )
    assert "aware, weight 8" in names_of(limited)
    assert limited.verdict == free.verdict == "better"
    assert limited.path.length > 1.4 * limited.shortest.path.length


def test_shortest_path_wins_without_drives(grid, costs):
    """Without a field, no path is known to be better."""
    own = {"mine": Path([START, (2.0, 1.0), (10.0, 1.0), GOAL])}
    found = recommend(grid, START, GOAL, costs=costs, candidates=own, **{**QUICK, "drives": 0})
    assert names_of(found) == ["shortest", "mine"]
    assert found.recommended_candidate is found.shortest


def test_rival_settings_keep_particles_and_beams():
    own = Amcl(max_particles=700, max_beams=31, alpha1=0.4)
    rival = RecommendationSettings().find_rival_settings(own)
    assert (rival.max_particles, rival.max_beams, rival.alpha1) == (700, 31, 0.4)
    assert (rival.update_min_d, rival.update_min_a) == (0.1, 0.1)
    assert RecommendationSettings().find_rival_settings(rival) is None
    assert RecommendationSettings(rival=own).find_rival_settings(Amcl()) == own
    assert RecommendationSettings(rival=None).find_rival_settings(own) is None


@dataclasses.dataclass(frozen=True)
class Wrapped:
    """AMCL as a filter of a user's own."""

    amcl: Amcl = FEW
    title = "a wrapped AMCL"

    def start(self, *about):
        return self.amcl.start(*about)


def test_custom_filter_has_no_rival_settings():
    assert RecommendationSettings().find_rival_settings(Wrapped()) is None
    assert RecommendationSettings(rival=Amcl()).find_rival_settings(Wrapped()) is None


@pytest.mark.long
def test_loaded_recommendation_names_custom_filter(grid, costs, tmp_path):
    robot = dataclasses.replace(ROBOT, filter=Wrapped())
    found = recommend(grid, START, GOAL, robot, costs=costs, drives=4)
    assert found.rival is None
    found.save(tmp_path)
    loaded = Recommendation.load(tmp_path)
    assert loaded == found
    assert loaded.report() == found.report()
    assert loaded.robot.digest == robot.digest
    with pytest.raises(ConfigError, match="does not hold the code of a wrapped AMCL"):
        recommend(grid, START, GOAL, loaded.robot, costs=costs, drives=4)


@pytest.mark.usefixtures("one_steered_drive")
def test_candidate_without_path_is_dropped(grid, costs):
    no_path = plan(costs, START, (11.6, 5.6))  # it ends in the closed cell
    found = recommend(grid, START, GOAL, costs=costs, candidates={"none": no_path}, **QUICK)
    assert "none" not in names_of(found)
    assert "no path joins" in found.left_out["none"]
    assert "left out (no path joins" in found.report()


@pytest.mark.usefixtures("one_steered_drive")
def test_user_path_replaces_planned_twin(grid, costs, choice):
    """The answer is then about the user's path, and its drives are not made twice."""
    (planned,) = (each for each in choice.candidates if each.name == "clear of walls")
    own = {"mine": Path(planned.path.xy)}
    found = recommend(grid, START, GOAL, costs=costs, candidates=own, **QUICK)
    assert "mine" in names_of(found)
    assert "clear of walls" not in names_of(found)
    assert found.left_out["clear of walls"] == "same path as 'mine'"


def crosses(zones, grid, xy) -> bool:
    """True if a line enters a cell of a no-go zone."""
    closed = zones.cells(grid, "no-go")
    fine = Path(np.asarray(xy)[:, :2]).resample(grid.resolution / 20).xy
    return bool(closed[grid.cell(fine)].any())


@pytest.mark.usefixtures("one_steered_drive")
def test_no_candidate_crosses_no_go_zone(grid, fielded):
    """The way along the lower side of the box is closed; the upper one is free but for a corner."""
    zones = Zones(
        [
            Zone("no-go", [[5.0, 0.0], [5.5, 0.0], [5.5, 2.0]]),
            Zone("no-go", [[2, 2], [2, 4], [2.3, 4]]),
        ]
    )
    straight = Path(np.array([START, (1.5, 0.8), (10.0, 0.8), GOAL]))
    costs = Costmap.from_layers(
        grid, u=fielded.u, e=fielded.e, weight=4.0, robot=ROBOT.radius, zones=zones
    )
    choice = recommend(grid, START, GOAL, costs=costs, candidates={"mine": straight}, **QUICK)
    assert choice.left_out["mine"] == "crosses a no-go zone"
    assert len(choice.candidates) > 1
    for each in choice.candidates:
        assert not crosses(zones, grid, each.path.xy)
    texts = [text.get_text() for text in recommendation_figure(choice).legends[0].get_texts()]
    assert "no-go zone" in texts
    # A choice that was loaded, and the costmap of its path, have the zones, too.
    assert choice.costmap().zones == zones
    assert Zones.from_json(choice.about["zones"]) == zones
    for wrong in ({"costs": costs, "zones": zones}, {"zones": "zones.geojson"}):
        with pytest.raises(ConfigError, match="zones"):
            recommend(grid, START, GOAL, **wrong, **QUICK)


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_pay_outside_preferred_zones(grid, fielded):
    """The longer way round the box is preferred; the shortest path does not take it."""
    zones = Zones([Zone("prefer", [[0, 0], [12, 0], [12, 3.2], [0, 3.2]])])
    costs = Costmap.from_layers(grid, u=0 * fielded.u, weight=4.0, robot=0.2, zones=zones)
    planned = recommend(grid, START, GOAL, Robot(footprint=0.2, margin=0.0), costs=costs)
    for choice in (planned, recommend(grid, START, GOAL, costs=costs, **QUICK)):
        shortest, next_one, *_ = (each.path.xy[:, 1].max() for each in choice.candidates)
        assert shortest > 4.0
        assert next_one < 3.1


@pytest.mark.usefixtures("one_steered_drive")
def test_waypoints_bind_all_candidates(grid, costs):
    above, own = (6.0, 5.0), Path([START, (2.0, 1.0), (10.0, 1.0), GOAL])
    found = recommend(
        grid, START, GOAL, costs=costs, via=[above], candidates={"below": own}, **QUICK
    )
    assert len(found.candidates) > 1
    for each in found.candidates:
        assert np.hypot(*(each.path.xy - above).T).min() < 1e-9
    assert found.left_out["below"] == "does not visit 6,5"


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_keep_field_limits(grid, fielded):
    free = recommend(grid, START, GOAL, costs=fielded, **QUICK)
    degenerate = sorted(each.metrics.integrated_u for each in free.candidates)
    budget = 0.5 * (degenerate[0] + degenerate[-1])
    found = recommend(grid, START, GOAL, costs=fielded, budget=budget, **QUICK)
    assert max(each.metrics.integrated_u for each in found.candidates) <= budget * 1.001
    assert found.shortest.name == "shortest"
    assert found.shortest.path.length == min(each.path.length for each in found.candidates)
    assert min(each.metrics.integrated_u for each in free.candidates) <= budget
    levels = sorted(each.metrics.max_e for each in free.candidates)
    max_e = 0.5 * (levels[0] + levels[-1])
    found = recommend(grid, START, GOAL, costs=fielded, max_e=max_e, candidates="grid", **QUICK)
    assert max(each.metrics.max_e for each in found.candidates) <= max_e
    nowhere = recommend(grid, START, GOAL, costs=fielded, max_e=1e-9, **QUICK)
    assert (nowhere.status, nowhere.path) == ("infeasible", None)
    assert "every path enters cells with e above" in nowhere.sentence


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_keep_outline_clear_of_walls(grid, costs):
    ends = (1.5, 3.0), (10.5, 3.0)
    long = Footprint([(0.7, 0.3), (0.7, -0.3), (-0.7, -0.3), (-0.7, 0.3)])
    robot = dataclasses.replace(ROBOT, footprint=long)
    own = {"tight": Path([ends[0], (2.5, 0.5), (9.5, 0.5), ends[1]])}
    asked = {"costs": costs, "drives": 2, "rival": None}
    found = recommend(grid, *ends, robot, candidates=own, **asked)
    assert found.path is not None
    for each in found.candidates:
        assert long.find_first_collision(grid, each.path) is None
    assert found.left_out["tight"].startswith("cannot be driven: collision near")
    square = Footprint([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
    none = recommend(grid, *ends, dataclasses.replace(robot, footprint=square), **asked)
    assert none.path is None
    assert none.status in ("not found", "infeasible", "unreachable")
    assert none.note


# The answer


def test_better_path_is_recommended(better):
    assert better.verdict == "better"
    assert better.path.length > 44
    chosen, shortest = better.recommended_candidate.driven, better.shortest.driven
    assert chosen.numbers == shortest.numbers == range(8)
    ratio = math.exp(np.mean(chosen.log_error - shortest.log_error))
    assert chosen.ratio.value == pytest.approx(ratio)
    assert chosen.ratio.high < 1
    longer = f"{better.path.length - better.shortest.path.length:.1f} m longer"
    less = [f"{100 * (1 - end):.0f}" for end in chosen.ratio]
    change = f"{less[0]} % [{less[2]}, {less[1]}] less localization error"
    assert better.sentence == (
        f"Take 'detour 1' ({better.path.length:.1f} m): {change} than on the shortest"
        f" path, {longer}."
    )
    assert (
        better.report().splitlines()[:2] == better.answer == [better.sentence, better.reached_text]
    )


LESS, MORE = (0.5, 0.4, 0.6), (1.5, 1.2, 1.8)
KEPT = "Take the shortest path (27.9 m). "
OTHER = KEPT + "Path NAME (37.3 m) "


def lengths_of(choice, *lengths):
    """The choice, as if its candidates had these lengths."""
    pairs = zip(choice.candidates, lengths, strict=False)
    candidates = [
        dataclasses.replace(each, path=Path([(0.0, 0.0), (length, 0.0)])) for each, length in pairs
    ]
    return dataclasses.replace(choice, candidates=(*candidates, *choice.candidates[len(lengths) :]))


def judged_as(
    choice, verdict, ratio, *, more_lost=False, arriving_count=16, lengths=(), **settings
):
    """The choice, as if candidate 1 had led the race and got this verdict in 8 drives."""
    made = {
        "leader": 1,
        "verdict": verdict,
        "ratio": type(choice.judgement.ratio)(*ratio),
        "more_lost": more_lost,
    }
    choice = lengths_of(choice, *(lengths or (27.9, 37.3)))
    choice = dataclasses.replace(
        choice,
        judgement=dataclasses.replace(choice.judgement, **made),
        settings=dataclasses.replace(choice.settings, **settings),
    )
    return with_arrivals(choice, 16, arriving_count)


@pytest.mark.parametrize(
    ("verdict", "ratio", "more", "sentence"),
    [
        (
            *("better", LESS, {}),
            "Take NAME (37.3 m): 50 % [40, 60] less localization error than on the shortest"
            " path, 9.4 m longer.",
        ),
        (
            *("better", LESS, {"lengths": (27.9, 27.92), "minimise": "heading"}),
            "Take NAME (27.9 m): 50 % [40, 60] less heading error than on the shortest"
            " path, equally long.",
        ),
        (
            *("better", LESS, {"lengths": (27.9, 26.0), "minimise": "goal-error"}),
            "Take NAME (26.0 m): 50 % [40, 60] less localization error at the goal than"
            " on the shortest path, 1.9 m shorter.",
        ),
        (
            *("better", (0.8, 0.5, 1.3), {}),
            "Take NAME (37.3 m): the robot gets lost in 0 of 8 drives, on the shortest path"
            " in 5 of 8. It is 9.4 m longer.",
        ),
        (
            *("undecided", LESS, {"bold": True}),
            "Take NAME (37.3 m), undecided after 8 drives: 50 % [40, 60] less localization"
            " error than on the shortest path, 9.4 m longer.",
        ),
        (
            *("undecided", (0.9, 0.7, 1.2), {}),
            OTHER + "is undecided after 8 drives: 10 % [-20, 30] less localization error.",
        ),
        (
            *("undecided", (0.9, 0.7, 1.2), {"time_limit": 1.0, "drives": 64}),
            KEPT + "Time was up after 8 drives. Path NAME (37.3 m) is undecided:"
            " 10 % [-20, 30] less localization error.",
        ),
        (
            *("no difference", (1.0, 0.9, 1.1), {"bold": True}),
            OTHER + "makes no difference: 0 % [-10, 10] less localization error.",
        ),
        (
            *("worse", MORE, {"bold": True}),
            OTHER + "is worse: 50 % [20, 80] more localization error.",
        ),
        (
            *("better", (0.95, 0.92, 0.98), {}),
            OTHER + "gains too little: 5 % [2, 8] less localization error.",
        ),
        (
            *("better", LESS, {"more_lost": True}),
            OTHER + "has 50 % [40, 60] less localization error, but the robot gets lost more"
            " often.",
        ),
        (
            *("better", LESS, {"arriving_count": 13}),
            OTHER + "has 50 % [40, 60] less localization error, but the robot reaches the goal less"
            " often.",
        ),
    ],
)
def test_choice_sentence_follows_verdict(better, verdict, ratio, more, sentence):
    lost = np.arange(8) < 5
    shortest, *others = better.candidates
    driven = dataclasses.replace(shortest.driven, lost=lost)
    others[0] = dataclasses.replace(
        others[0], driven=dataclasses.replace(driven, lost=lost & False)
    )
    candidates = (dataclasses.replace(shortest, driven=driven), *others)
    better = dataclasses.replace(better, candidates=candidates)
    choice = judged_as(better, verdict, ratio, **more)
    assert choice.sentence == sentence.replace("NAME", repr(choice.leader.name))
    assert choice.best == (not sentence.startswith(KEPT))
    assert choice.is_undecided == ("undecided" in sentence and not choice.best)


def test_choice_sentence_without_leader(better):
    judgement = dataclasses.replace(better.judgement, leader=0)
    choice = lengths_of(dataclasses.replace(better, judgement=judgement), 27.9)
    assert choice.sentence == f"{KEPT}No other candidate was better in up to 8 drives each."
    alone = dataclasses.replace(choice, candidates=choice.candidates[:1])
    assert alone.sentence == f"{KEPT}There is no other candidate."


@pytest.mark.parametrize(
    ("status", "sentence"),
    [
        ("unreachable", "The goal is unreachable: a wall."),
        ("infeasible", "No path keeps the limits: a wall."),
        ("timeout", "Time was up before a path was found: a wall."),
        ("not found", "No path was found: a wall."),
    ],
)
def test_choice_sentence_without_path(better, status, sentence):
    nothing = {"candidates": (), "judgement": None, "note": "a wall"}
    choice = dataclasses.replace(better, status=status, **nothing)
    assert choice.report() == choice.sentence == sentence


@pytest.mark.long
def test_recommendation_ignores_thread_count(grid, costs, choice):
    """Another seed gives another recommendation."""
    again = recommend(grid, START, GOAL, costs=costs, threads=1, **QUICK)
    other = recommend(grid, START, GOAL, costs=costs, seed=2, **QUICK)
    assert again == choice
    assert hash(again) == hash(choice)
    assert other != choice
    first = zip(other.shortest.driven.log_error, choice.shortest.driven.log_error, strict=False)
    assert all(one != two for one, two in first)


@pytest.mark.parametrize("minimise", sample_cases([*MINIMISED], 0))
def test_report_shows_minimised_error(corridors, minimise):
    found = two_ways(corridors, minimise=minimise, drives=32)
    if minimise != "heading":
        assert (
            found.recommended_candidate.driven.error.value < 0.9 * found.shortest.driven.error.value
        )
    shown = found.report()
    assert ("error [deg]" in shown) == (minimise == "heading")
    assert ("error at the goal" in shown) == (minimise == "goal-error")


@pytest.mark.long
def test_high_price_keeps_path_short(corridors, better):
    priced = two_ways(corridors, price=10.0)
    assert better.best
    assert priced.recommended_candidate.path.length <= 1.1 * priced.shortest.path.length


@pytest.mark.usefixtures("one_steered_drive")
def test_time_limit_leaves_single_look(corridors, better):
    ratio = better.judgement.ratio
    found = two_ways(corridors, time_limit=1e-9, drives=64)
    assert len(found.judgement.drives) == 8
    assert found.judgement.ratio.value == pytest.approx(ratio.value, rel=0.5)


def test_progress_total_is_largest_drive_count(grid, costs):
    """Fewer drives suffice if they decide early."""
    calls = []
    found = recommend(
        grid, START, GOAL, costs=costs, progress=lambda *at: calls.append(at), **QUICK
    )
    count = len(found.candidates)
    total = 4 * count + 4 * min(6, count) + 4 * min(4, count) + 8 + 2 * 16
    done = [done for done, _ in calls]
    assert done == [*range(1, len(done) + 1)]
    assert {every for _, every in calls} == {total}
    assert len(done) <= total


@pytest.mark.long
def test_advice_names_better_filter_settings(corridors):
    calm = Amcl(**{f"alpha{n}": 0.02 for n in range(1, 6)}, min_particles=300, max_particles=300)
    noisy = Amcl(**{f"alpha{n}": 1.0 for n in range(1, 6)}, min_particles=300, max_particles=300)
    robot = Robot(Lidar(range=6.0), filter=noisy)
    ends = (3.0, 10.0), (12.0, 12.0)
    found = recommend(corridors.grid, *ends, robot, costs=corridors, drives=8, rival=calm)
    assert found.rival.ratio.high < 1
    advice = found.advice[0]
    assert advice.startswith("Tune the filter first: with AMCL's alpha1 0.02")
    assert found.is_tuning_first
    assert found.report().replace("\n", " ").startswith(f"{advice} Without tuning, take")
    assert advice in found.figure().get_suptitle().replace("\n", " ")
    same = recommend(corridors.grid, *ends, robot, costs=corridors, drives=8, rival=noisy)
    assert same.rival is None


@dataclasses.dataclass(frozen=True)
class Odometer:
    """A filter that is not AMCL."""

    title: str = "odometry alone"

    def start(self, *_):
        raise NotImplementedError


@pytest.mark.parametrize(
    ("gain", "lost", "is_first"),
    [(1.0, 0.0, False), (4.0, 0.0, True), (4.0, 1.0, False)],
    ids=["less than the path", "more than the path", "but lost"],
)
def test_tuning_comes_first_if_better(better, gain, lost, is_first):
    """The gain is in multiples of the path's, in logarithms of paired drives."""
    path_gain = -math.log(better.judgement.ratio.value)
    shortest = better.shortest.driven
    rival = dataclasses.replace(
        shortest,
        log_error=shortest.log_error - gain * path_gain + 0.1 * np.arange(8),
        lost=np.full(8, bool(lost)),
    )
    settings = dataclasses.replace(better.settings, rival=RecommendationSettings().rival)
    choice = dataclasses.replace(better, settings=settings, rival=rival)
    assert choice.is_tuning_first == is_first
    assert choice.answer[0].startswith("Tune the filter first" if is_first else "Take 'detour 1'")
    assert ("safe settings (update_min_d 0.1, update_min_a 0.1)" in choice.answer[0]) == is_first
    assert ("That is also less error than on path 'detour 1'" in choice.answer[0]) == is_first
    assert "shortest, tuned" in choice.report()


@pytest.mark.parametrize(("own", "whose"), [(Odometer(), "AMCL, safe"), (Amcl(), "safe")])
def test_tuning_advice_names_filter_of_settings(better, own, whose):
    shortest = better.shortest.driven
    rival = dataclasses.replace(
        shortest, log_error=shortest.log_error - 9, lost=shortest.lost & False
    )
    settings = dataclasses.replace(better.settings, rival=RecommendationSettings().rival)
    robot = Robot(Lidar(range=6.0), filter=own)
    found = dataclasses.replace(better, robot=robot, settings=settings, rival=rival)
    assert found.advice[0].startswith(f"Tune the filter first: with {whose} settings (")


def test_recommendation_reports_unreachable_goal(grid, costs):
    found = recommend(grid, START, (11.5, 5.5), costs=costs, **QUICK)
    assert (found.status, found.path, found.recommended_candidate) == ("unreachable", None, None)
    assert found.report().startswith("The goal is unreachable: no path joins start and goal")
    assert found.summary()["candidates"] == []
    assert len(found._repr_png_()) > 1000


@pytest.mark.usefixtures("one_steered_drive")
def test_recommend_path_computes_no_unneeded_field(grid, costs):
    def compute(*_):
        raise AssertionError

    more = {"compute": compute, **QUICK}
    assert recommend(grid, START, (11.5, 5.5), **more).status == "unreachable"
    assert recommend(grid, START, GOAL, costs=costs, **more).status == "solved"
    with pytest.raises(AssertionError):
        recommend(grid, START, GOAL, **more)


# Where nothing is driven


def test_recommendation_without_lidar_is_untested(corridors):
    grid = corridors.grid
    found = recommend(grid, (2.0, 3.0), (38.0, 3.0), costs=FieldConfig(Sad(), stride=0.5))
    assert names_of(found) == ["shortest", "localizability-aware"]
    assert found.path is found.candidates[1].path
    assert found.candidates[1].metrics.integrated_u < found.shortest.metrics.integrated_u
    assert found.verdict == ""
    assert found.sentence.startswith("Untested: take 'localizability-aware' (")
    assert "--lidar" in found.answer[1]
    labels = [each.get_text() for each in found.figure().legends[0].get_texts()]
    assert sum(each.startswith("untested: localizability-aware") for each in labels) == 1
    same = recommend(grid, (2.0, 3.0), (3.0, 3.0), costs=FieldConfig(Sad(), stride=0.5))
    assert len(same.candidates) == 2
    assert same.sentence == "Untested: take the shortest path (1.0 m)."
    robot = Robot(Lidar(range=6.0))
    coarse = FieldConfig(Fisher(robot.lidar), stride=1.0)
    undriven = recommend(grid, (2.0, 3.0), (38.0, 3.0), robot, costs=coarse, drives=0)
    assert "drives=0" in undriven.answer[1]
    assert all(each.driven is None for each in undriven.candidates)
    blank = recommend(grid, (2.0, 3.0), (38.0, 3.0), costs=corridors)
    assert names_of(blank) == ["shortest"]


@pytest.mark.usefixtures("one_steered_drive")
def test_custom_degeneracy_has_aware_paths(grid):
    u = np.zeros(grid.shape)
    u[:14] = 1.0  # the way below the box, which is the shorter one
    costs = Costmap.from_layers(grid, u=u, e=u, robot=0.2)
    ends = (1.0, 2.5), (11.0, 2.5)
    found = recommend(grid, *ends, costs=costs)
    assert names_of(found) == ["shortest", "localizability-aware"]
    assert found.path is found.candidates[1].path
    assert found.path.xy[:, 1].max() > 4.0 > found.shortest.path.xy[:, 1].max()
    assert recommend(grid, *ends, costs=costs, max_e=0.5).path == found.path
    driven = recommend(grid, *ends, costs=costs, **QUICK)
    assert any("aware" in name for name in names_of(driven))


@pytest.mark.parametrize("limit", ["max_e", "budget"])
@pytest.mark.parametrize("robot", [None, ROBOT])
def test_blank_costmap_rejects_field_limits(grid, costs, robot, limit):
    with pytest.raises(ConfigError, match="no e or u to limit"):
        recommend(grid, START, GOAL, robot, costs=costs, **{limit: 1.0})


CAR = dataclasses.replace(ROBOT, kinematics=Kinematics(drive="car-like", turning_radius=0.5))


@pytest.mark.long
def test_car_can_drive_all_candidates(grid, costs):
    sharp = [START, (1.0, 4.6), (11.0, 4.6), GOAL]
    found = recommend(
        *(grid, (*START, 1.5), GOAL, CAR),
        costs=costs,
        drives=4,
        rival=None,
        candidates={"sharp": sharp},
    )
    assert found.judgement is not None
    assert len(found.candidates) > 1
    for each in found.candidates:
        assert check_path(grid, each.path, CAR).drivable
        assert each.path.heading is not None
    assert "cannot be driven: tight turn" in found.left_out["sharp"]


@pytest.mark.long
def test_outline_accepts_paths_without_headings(grid, costs):
    box = Footprint([(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
    robot = dataclasses.replace(ROBOT, footprint=box)
    ends = (*START, 1.5), (*GOAL, 0.5)
    found = recommend(
        grid, *ends, robot, costs=costs, drives=4, rival=None, candidates=["lattice", "grid"]
    )
    assert all(each.driven for each in found.candidates)
    paths = {each.name: each.path for each in found.candidates}
    assert paths["lattice"].heading[[0, -1]] == pytest.approx([1.5, 0.5])
    assert paths["shortest"].heading is not None
    assert paths["grid"].heading is None


def test_car_paths_within_budget_stay_untested(grid, fielded):
    """They may turn more sharply than the car can."""
    found = recommend(grid, START, GOAL, CAR, costs=fielded, budget=50.0)
    assert found.judgement is None
    assert "turning radius" in found.answer[1]


# Bad input


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"goal": START}, ConfigError, "the same place"),
        ({"start": (4.0, 2.0)}, PoseError, "start 4,2 lies in a wall"),
        ({"longest": 0.9}, ConfigError, "longest must be at least 1"),
        ({"price": -1.0}, ConfigError, "price must be at least 0"),
        ({"time_limit": -1}, ConfigError, "time_limit must be positive"),
        ({"drives": 1}, ConfigError, "must be a whole number in 2..1024"),
        ({"bold": 1}, ConfigError, "bold must be a bool"),
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
        recommend(grid, given.pop("start"), given.pop("goal"), **given)
    assert "\n" not in str(caught.value)


def test_recommend_path_rejects_foreign_costmap(grid):
    cells = grid.cells.copy()
    cells[50, 50] = OCCUPIED
    foreign = Costmap.blank(OccupancyGrid(cells, 0.1))
    with pytest.raises(ConfigError, match="of another map"):
        recommend(grid, START, GOAL, costs=foreign, **QUICK)


# The command and its files


@pytest.mark.usefixtures("undrawn")
def test_loaded_recommendation_equals_saved_recommendation(better, tmp_path):
    better.save(tmp_path / "a")
    loaded = Recommendation.load(tmp_path / "a")
    assert loaded == better
    assert loaded.report() == better.report()
    assert Recommendation.load(tmp_path / "a" / "choice.json").path.length == better.path.length
    assert dataclasses.replace(loaded, seed=2) != better
    content = json.loads((tmp_path / "a" / "choice.json").read_text())
    former = {**content, "taken": better.recommended_name, "arrives": better.reached_text}
    (tmp_path / "former.json").write_text(json.dumps(former))
    assert Recommendation.load(tmp_path / "former.json") == better
    for broken, words in (
        ({**content, "version": 99}, "of a newer locplan"),
        ({}, "not a choice saved by locplan"),
    ):
        (tmp_path / "b.json").write_text(json.dumps(broken))
        with pytest.raises(LocplanError, match=words):
            Recommendation.load(tmp_path / "b.json")


@pytest.fixture
def box(grid, tmp_path):
    save_map(grid, tmp_path / "box.yaml")
    return tmp_path / "box.yaml"


ENDS = "--start", "1,3", "--goal", "11,3"
SETTINGS = "--drives", "4", "--set", "min_particles=100", "--set", "max_particles=100"
SETTINGS += "--stride", "0.5", "--set", "range=3"


@pytest.mark.usefixtures("one_steered_drive")
def test_plan_warns_about_bad_parameters(run, box):
    silly = "--set", "z_hit=0.9", "--set", "z_rand=0.5"
    code, _, err = run("plan", box, *ENDS, *SETTINGS, *silly)
    assert code == 0
    assert err.count("locplan: warning: z_hit") == 1


@pytest.mark.usefixtures("one_steered_drive")
def test_plan_writes_paths_tables_and_picture(run, box, tmp_path):
    params = "amcl: {ros__parameters: {alpha1: 0.1, beam_count: 3}}"
    (tmp_path / "nav2.yaml").write_text(params)
    Path([START, (2, 5), (10, 5), GOAL]).save(tmp_path / "my way?.csv")
    own = "--path", tmp_path / "my way?.csv", "--planner", "grid"
    options = *own, "--robot", tmp_path / "nav2.yaml", "--set", "outliers=0.1"
    code, out, err = run("plan", box, *ENDS, *SETTINGS, *options, "-o", tmp_path / "out")
    assert code == 0
    assert "nav2.yaml: not simulated: beam_count" in err
    about = json.loads((tmp_path / "out" / "choice.json").read_text())
    names = [each["name"] for each in about["candidates"]]
    at = names.index("my way?")
    assert names[at : at + 2] == ["my way?", "grid"]
    files = {file.name for file in (tmp_path / "out").iterdir()}
    assert {*Recommendation.files.names, "01-shortest.csv", f"{at + 1:02}-my-way-.csv"} < files
    with (tmp_path / "out" / "candidates.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == names
    for row, found in zip(rows, about["candidates"], strict=True):
        assert float(row["error"]) == pytest.approx(found["driven"]["error"][0])
        assert (row["name"] == about["recommended_name"]) == (row["chosen"] == ">")
    chosen = Path.load(tmp_path / "out" / "chosen.csv")
    taken = about["candidates"][names.index(about["recommended_name"])]
    np.testing.assert_allclose(chosen.xy, taken["path"]["xy"], atol=1e-6)
    with (tmp_path / "out" / "errors.csv").open() as file:
        assert {row["path"] for row in csv.DictReader(file)} == set(names)
    assert (tmp_path / "out" / "choice.png").stat().st_size > 10_000
    lines = out.splitlines()
    assert sum(line.startswith("> ") for line in lines) == 1
    text = " ".join(out.split())
    settings = "AMCL's alpha1 0.1, max_particles 100, min_particles 100, outliers 0.1"
    assert f"drives with lidar, 3 m, 360°; radius 0.2 m, margin 0.05 m; {settings}" in text
    assert max(len(line) for line in lines if not line.startswith(("  locplan ", "wrote "))) <= 110


@pytest.mark.long
def test_plan_equals_recommend_path(run, box, grid):
    more = "--longest", "1.4", "--seed", "4", "--json"
    code, out, _ = run("plan", box, *ENDS, *SETTINGS, *more, "--field", "scan")
    assert code == 0
    lidar = Lidar(range=3.0)
    config = FieldConfig(Scan(lidar), stride=0.5)
    robot = Robot(lidar, filter=FEW)
    choice = recommend(grid, START, GOAL, robot, costs=config, drives=4, longest=1.4, seed=4)
    assert json.loads(out) == json.loads(json.dumps(choice.summary()))


def next_commands(out):
    """The commands that `plan` prints last."""
    lines = out.splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("Next: "))
    return [shlex.split(line) for line in lines[at + 1 :]]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("verdict", "output", "command", "option"),
    [
        ("tune", False, "tune", "tuned"),
        ("better", False, "plan", "planned"),
        ("better", True, "export", "nav2-keepout"),
        ("undecided", False, "plan", "--drives=128"),
        ("lost", False, "check", "--set=range=3"),
    ],
)
def test_plan_prints_next_command(
    run, box, tmp_path, monkeypatch, better, verdict, output, command, option
):
    """A choice is drawn for each verdict, in place of one that is driven."""
    driven = better.shortest.driven
    driven = dataclasses.replace(driven, lost=driven.lost & False)
    same = [dataclasses.replace(each, driven=driven) for each in better.candidates]
    rival = dataclasses.replace(driven, log_error=driven.log_error - 9)
    choice = dataclasses.replace(
        better, candidates=tuple(same), rival=rival if verdict == "tune" else None
    )
    word = "undecided" if verdict == "undecided" else "better"
    choice = judged_as(choice, word, LESS, drives=64)
    if verdict == "lost":
        choice = with_arrivals(choice, 8, 8)
    monkeypatch.setattr("locplan.recommend_path", lambda *_, **__: choice)
    folder = ("-o", tmp_path / "out") * output
    Robot(Lidar()).save(tmp_path / "robot.yaml")
    robot_options = "--robot", tmp_path / "robot.yaml", "--set", "range=3"
    code, out, _ = run("plan", box, *ENDS, *robot_options, *folder)
    assert code == 0
    assert out.startswith(choice.answer[0][:60])
    first, *more = next_commands(out)
    assert first[:2] == ["locplan", command]
    assert option in first
    assert f"--robot={tmp_path / 'robot.yaml'}" in first
    assert [words[-1] for words in more] == ["--robot=tuned/nav2_params.yaml"] * (verdict == "tune")


def test_plan_suggests_lidar_option_if_missing(run, box):
    code, out, _ = run("plan", box, *ENDS, "--stride", "0.5")
    assert code == 0
    assert out.startswith("Untested: ")
    assert next_commands(out)[0][-1] == "--lidar=turtlebot4"


@pytest.mark.usefixtures("undrawn")
def test_plan_command_reports_unreachable_goal(run, box, tmp_path):
    ends = "--start", "1,3", "--goal", "11.5,5.5"
    code, out, _ = run("plan", box, *ends, *SETTINGS, "-o", tmp_path / "out")
    assert code == 0
    assert out.startswith("The goal is unreachable: no path joins start and goal")
    assert out.splitlines()[-1].startswith("  locplan info ")
    files = {file.name for file in (tmp_path / "out").iterdir()}
    assert files == {"run.yaml", *Recommendation.files.names} - {"chosen.csv"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--start", "4,2", "--goal", "11,3"), "start 4,2 lies in a wall"),
        (("--start", "1,3", "--goal", "1,3"), "the same place"),
        ((*ENDS, "--longest", "0.5"), "longest"),
        ((*ENDS, "--path", "wall.csv"), "candidate wall: leaves the free cells"),
        ((*ENDS, "--path", "far.csv"), "'far' has its goal"),
        ((*ENDS, "--path", "grid.csv", "--planner", "grid"), "both named grid; rename the file"),
        ((*ENDS, "--planner", "fastest"), "planner must be one of"),
        ((*ENDS, "--set", "alpha9=1"), "a robot has no setting 'alpha9'"),
        ((*ENDS, "--zones", "grid.csv"), "grid.csv: is not JSON"),
        ((*ENDS, "--zones", "away.geojson"), "away.geojson: no zone overlaps the map, which"),
        ((*ENDS, "--field", "paper"), "--field must be one of"),
        ((*ENDS, "--budget", "2", "--via", "6,5"), "a budget is for planner 'grid', without via"),
    ],
)
def test_plan_rejects_bad_input_early(run, box, tmp_path, monkeypatch, options, words):
    """No field is computed before."""
    monkeypatch.chdir(tmp_path)
    Path([START, GOAL]).save("wall.csv")
    Path([START, (1, 4)]).save("far.csv")
    Zones([Zone("prefer", [(99, 0), (99, 1), (98, 1)])]).save("away.geojson")
    Path([START, (2, 5), (10, 5), GOAL]).save("grid.csv")
    monkeypatch.setattr("locplan.field.load_or_compute", None)
    code, out, err = run("plan", box, *options, "--lidar", "rplidar-a1", "-o", "out")
    said = check_refusal(
        (code, out, err[err.index("locplan: error: ") :])
    )  # the walls are black inside
    assert words in said
    assert not (tmp_path / "out").exists()


# The picture


def test_recommended_path_is_drawn_last(better):
    """It has the widest line, on top of the others."""
    figure = recommendation_figure(better)
    lines = [line for line in figure.axes[0].lines if line.get_linestyle() != "None"]
    widths = [line.get_linewidth() for line in lines]
    assert widths == sorted(widths)
    assert widths[-1] > widths[-2] > widths[0]
    np.testing.assert_allclose(lines[-1].get_xydata()[[0, -1]], better.path.xy[[0, -1]])
    np.testing.assert_allclose(lines[-2].get_xydata()[-1], better.shortest.path.xy[-1])
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    label = (
        f"recommended: {better.recommended_candidate.name}, {better.path.length:.1f} m, 0 % lost"
    )
    assert texts[0].startswith(label)
    assert f"{len(better.candidates) - 2} other candidates" in texts


def test_figure_shows_error_profiles_of_drives(better):
    lower = recommendation_figure(better).axes[1]
    both = [line.get_xydata() for line in lower.lines if len(line.get_xdata()) > 2]
    for found, each in zip(both, (better.shortest, better.recommended_candidate), strict=True):
        np.testing.assert_allclose(found, each.driven.profile[:, :2])


def test_figure_shows_profile_of_shortest_path(better):
    """It is the only profile if the shortest path is recommended."""
    judgement = dataclasses.replace(better.judgement, verdict="no difference")
    kept = dataclasses.replace(better, judgement=judgement)
    lower = recommendation_figure(kept).axes[1]
    (found,) = [line.get_xydata() for line in lower.lines if len(line.get_xdata()) > 2]
    np.testing.assert_allclose(found, better.shortest.driven.profile[:, :2])


def test_loaded_recommendation_draws_without_map(better, tmp_path):
    better.save(tmp_path)
    assert len(Recommendation.load(tmp_path)._repr_png_()) > 1000


def test_crop_map_keeps_area_of_paths():
    cells = np.full((400, 600), FREE, np.uint8)
    cells[100, 150] = OCCUPIED
    large = OccupancyGrid(cells, 0.1, (5.0, -3.0, 0.3))
    xy = np.column_stack(large.grid_to_world(np.array([90.5, 110.5]), np.array([140.5, 160.5])))
    part = crop_map(large, [Path(xy)])
    assert part.shape == (81, 81)
    (row,), (col,) = np.nonzero(part.cells == OCCUPIED)
    expected = large.position(100, 150)
    np.testing.assert_allclose(part.position(int(row), int(col)), expected, atol=1e-9)
    corners = np.column_stack(large.grid_to_world(np.array([1.0, 399.0]), np.array([1.0, 599.0])))
    assert crop_map(large, [Path(corners)]).shape == large.shape


def test_filter_title_names_changed_parameters():
    assert Amcl().title == "Nav2's defaults"
    many = {f"alpha{n}": 0.05 for n in range(1, 6)} | {"max_beams": 30, "half_cell": False}
    listed = "alpha1 0.05, alpha2 0.05, alpha3 0.05, alpha4 0.05, alpha5 0.05"
    assert Amcl(**many).title == f"AMCL's {listed} and 2 more"
    assert Amcl(max_particles=1_000_000).title == "AMCL's max_particles 1000000"


@pytest.mark.usefixtures("one_steered_drive")
def test_shortest_path_equals_path_of_simulate(grid, fielded):
    found = recommend(grid, START, GOAL, costs=fielded, **QUICK)
    paths = plan_with_shortest(fielded, START, GOAL)
    assert found.shortest.path == paths["shortest"].path


# Closed-loop drives


def arriving(count, drives=16):
    """Closed-loop drives of which some arrive."""
    here = (0.0, 0.0, 0.0)
    outcomes = ["arrived"] * count + ["aborted"] * (drives - count)
    return Arrivals(tuple(ClosedLoopDrive(each, 1.0, here, here) for each in outcomes))


def with_arrivals(choice, shortest, leader):
    """The choice, as if so many robots arrived along both paths."""
    made = {0: arriving(shortest), choice.judgement.leader: arriving(leader)}
    candidates = tuple(
        dataclasses.replace(each, arrivals=made.get(n)) for n, each in enumerate(choice.candidates)
    )
    return dataclasses.replace(choice, candidates=candidates)


@pytest.mark.usefixtures("undrawn")
def test_recommended_path_has_closed_loop_drives(better, corridors, tmp_path):
    leader = better.judgement.leader
    assert better.best == leader > 0
    driven = [n for n, each in enumerate(better.candidates) if each.arrivals]
    assert driven == [0, leader]
    shortest, taken = (better.candidates[n].arrivals for n in driven)
    assert len(shortest.drives) == len(taken.drives) == 16
    assert abs(taken.n_reached - shortest.n_reached) <= 1
    fewer = (
        f"But in closed loop, fewer drives reach the goal: {taken.n_reached} of 16, on the shortest"
    )
    as_many = (
        f"In closed loop, the robot reaches the goal in {taken.n_reached} of 16 drives, on the"
    )
    is_fewer = taken.n_reached < shortest.n_reached
    assert better.reached_text.startswith(fewer if is_fewer else as_many)
    assert better.reached_text.endswith(f" {shortest.n_reached} of 16.")
    assert with_arrivals(better, 12, taken.n_reached).reached_text == (
        f"{as_many} shortest path in 12 of 16."
    )
    assert " ".join(better.reached_text.split()) in " ".join(better.report().split())
    assert better.summary()["reached_text"] == better.reached_text
    paths = {better.recommended_name: better.path, "shortest": better.shortest.path}
    again = drive_closed(Simulator(corridors.grid, better.robot, seed=9), paths, range(2))
    assert [each.outcome for each in again[better.recommended_name].drives] == ["arrived"] * 2
    better.save(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "choice.json").read_text())["version"] == 4
    loaded = Recommendation.load(tmp_path / "out")
    assert loaded == better
    assert loaded.candidates[leader].arrivals == taken
    with (tmp_path / "out" / "candidates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[leader]["arrived"]) == taken.arrival_rate.value
    assert all(row["arrived"] == "" for n, row in enumerate(rows) if n not in driven)


def test_answer_reports_fewer_reached_goals(better):
    assert better.best
    fewer = with_arrivals(better, 16, 14).answer
    assert fewer[0].startswith("Take 'detour 1'")
    assert fewer[1] == (
        "But in closed loop, fewer drives reach the goal: 14 of 16, on the shortest path 16 of 16."
    )


@pytest.mark.usefixtures("undrawn")
def test_recommendation_loads_file_of_version_1(better, tmp_path):
    """Such a file has no closed-loop drives."""
    better.save(tmp_path / "out")
    file = tmp_path / "out" / "choice.json"
    tree = json.loads(file.read_text()) | {"version": 1}
    for each in tree["candidates"]:
        del each["arrivals"], each["driven"]["off_at_end"], each["driven"]["off_at_end_rate"]
        # Until version 3 these had another definition.
        each["driven"] |= {"off": [True], "off_at_goal": [1.0, 0.2, 1.0]}
    del tree["settings"]["thorough"], tree["reached_text"]
    tree["judgement"]["verdict"] = "clearly better"
    file.write_text(json.dumps(tree))
    old = Recommendation.load(file)
    assert old.recommended_name == better.recommended_name
    assert old.reached_text == ""
    assert math.isnan(old.recommended_candidate.driven.off_at_end_rate.value)


def test_shortest_path_reports_reached_goals(choice):
    assert choice.best == 0
    steered = [each for each in choice.candidates if each.arrivals]
    assert steered == [choice.shortest]
    count = choice.shortest.arrivals.n_reached
    assert (
        choice.reached_text
        == f"In closed loop, the robot reaches the goal in {count} of 16 drives."
    )


def test_report_errors_agree_with_ratios(better):
    lines = [line[2:] for line in better.report().splitlines()]
    rows = {cells[0]: cells for line in lines if len(cells := re.split(r"\s{2,}", line)) > 4}
    errors = {each.name: rows[each.name][2].split(" ") for each in better.candidates}
    assert [name for name in rows if name in errors][:2] == [better.recommended_name, "shortest"]
    confirmed = [name for name, error in errors.items() if not error[0].startswith("~")]
    assert confirmed == ["shortest", better.recommended_name]
    assert len(errors) > 2  # those of the race alone had other drives
    shortest = better.shortest.driven.error.value
    for each in better.candidates[1:]:
        error = float(errors[each.name][0].removeprefix("~"))
        assert error / shortest == pytest.approx(each.driven.ratio.value, rel=0.05)


@pytest.mark.parametrize("count", [0, 3])
def test_report_shows_drives_off_at_end(better, count):
    """The column is left out if there are none."""
    off = np.arange(8) < count
    candidates = [
        dataclasses.replace(each, driven=dataclasses.replace(each.driven, off_at_end=off))
        for each in better.candidates
    ]
    choice = dataclasses.replace(better, candidates=tuple(candidates))
    assert ("off at the end" in choice.report()) == (count > 0)


@pytest.mark.parametrize(("shortest", "leader", "taken"), [(16, 14, True), (16, 13, False)])
def test_guard_rejects_fewer_reached_goals(better, shortest, leader, taken):
    choice = with_arrivals(better, shortest, leader)
    assert (choice.best > 0) == taken
    assert f"{leader} of 16" in choice.reached_text
    assert ("reaches the goal less often" in choice.sentence) == (not taken)
    assert choice.sentence.startswith("Take the shortest path") == (not taken)


@pytest.mark.long
def test_thorough_setting_adds_closed_loop_drives(corridors):
    thorough = two_ways(corridors, thorough=True)
    assert [len(e.arrivals.drives) for e in thorough.candidates if e.arrivals] == [40, 40]


def test_figure_shades_places_without_features(better):
    """The shade and the lidar's range show why the shortest path fails; a long range shows not."""

    def count_reasons(choice):
        texts = [each.get_text() for each in choice.figure().legends[0].get_texts()]
        return [
            sum(text.startswith(beginning) for text in texts)
            for beginning in ("too few features within", "no wall within", "the lidar's range")
        ]

    degenerate = dataclasses.replace(better.costs, u=np.ones(better.costs.grid.shape))
    better = dataclasses.replace(better, costs=degenerate)
    for reach, reasons in ((6.0, [1, 0, 1]), (200.0, [1, 0, 0]), (0.8, [0, 1, 1])):
        choice = dataclasses.replace(better, robot=Robot(Lidar(range=reach)))
        assert count_reasons(choice) == reasons


def test_figure_marks_closed_loop_failures(better):
    for choice in (better, with_arrivals(better, 14, 16), with_arrivals(better, 16, 16)):
        every = [each.arrivals for each in choice.candidates if each.arrivals]
        rows = [row for each in every for row in each.places().rows]
        kinds = {MARK_LABELS[row[1]] for row in rows if row[1] != LEAVES}
        texts = [each.get_text() for each in choice.figure().legends[0].get_texts()]
        assert {each for each in texts if each.startswith("a robot")} == kinds
        marked = {
            line.get_marker() for line in choice.figure().axes[0].lines if len(line.get_xdata())
        }
        assert ("x" in marked) == any(each.n_reached < 16 for each in every)


def test_failure_marks_stay_within_figure(better):
    """The marks of start and goal stay on top."""
    choice = with_arrivals(better, 14, 16)
    axes = choice.figure().axes[0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    every = [
        row for each in choice.candidates if each.arrivals for row in each.arrivals.places().rows
    ]
    assert every
    for _, _, x, y, _ in every:
        assert left < x < right
        assert low < y < high
    orders = {
        mark: {e.get_zorder() for e in axes.lines if e.get_marker() == mark} for mark in "xs.*"
    }
    assert max(set.union(*(orders[mark] for mark in "xs."))) < min(orders["*"])


@pytest.mark.parametrize("width", [2.0, 4.5, 8.6])
def test_title_breaks_into_even_lines(width):
    text = "take the way around: better than the shortest, x.03 [.01, .04] of its error " * 3
    lines = break_title(text, width)
    assert " ".join(lines) == text.strip()
    assert max(map(len, lines)) <= 11.5 * width
    assert len(lines[-1]) >= 0.4 * len(lines[0])


def test_length_handicaps_count_excess_in_full():
    settings = RecommendationSettings(longest=1.5, price=0.3)
    allowed = 0.3 * math.log(1.5)
    expected = [0.0, allowed, allowed + math.log(2)]
    assert settings.compute_length_handicaps([1.0, 1.5, 3.0]) == pytest.approx(expected)
