"""The recommended path: its candidates, answer, command, files and figure."""

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
    """Limit closed-loop drives to one per path, for tests that only read candidates."""
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
def field_costs(grid):
    field = covariance_field(grid, FieldConfig(Fisher(ROBOT.lidar), stride=0.5))
    return Costmap.from_field(field, robot=0.2)


@pytest.fixture(scope="module")
def box_recommendation(grid, costs):
    return recommend(grid, START, GOAL, costs=costs, **QUICK)


@pytest.fixture(scope="module")
def corridors():
    return Costmap.blank(environments.make("two_corridors", resolution=0.1))


def recommend_in_corridors(corridors, **options):
    """Recommend a path along a featureless corridor or along a well-marked detour."""
    robot = Robot(Lidar(range=6.0), filter=Amcl(min_particles=300, max_particles=300))
    options = {"robot": robot, "drives": 8, "rival": None, **options}
    return recommend(corridors.grid, (2.0, 3.0), (38.0, 3.0), costs=corridors, **options)


@pytest.fixture(scope="module")
def better(corridors):
    return recommend_in_corridors(corridors)


def candidate_names(recommendation):
    return [candidate.name for candidate in recommendation.candidates]


# Scores


def test_log_errors_equal_plain_formula():
    """The goal error covers the last metre."""
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
        log_errors = compute_log_errors(distance, errors, minimise, 100.0)
        np.testing.assert_allclose(log_errors, values, err_msg=minimise)
    clipped = compute_log_errors(distance, errors, "rmse", 1.5)
    np.testing.assert_allclose(clipped, [0.5 * math.log(1.5**2 + least), 0.5 * math.log(least)])


# Candidates


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_keep_length_limit(box_recommendation):
    shortest = box_recommendation.shortest.path
    assert candidate_names(box_recommendation)[0] == "shortest"
    assert "clear of walls" in candidate_names(box_recommendation)
    assert len(box_recommendation.candidates) >= 4
    for each in box_recommendation.candidates:
        assert shortest.length - 1e-6 <= each.path.length <= 1.5 * shortest.length
        np.testing.assert_allclose(each.path.xy[[0, -1]], [START, GOAL], atol=1e-6)
    longest = max(each.path.length for each in box_recommendation.candidates) / shortest.length
    fewer = recommend(
        box_recommendation.costs.grid,
        START,
        GOAL,
        costs=box_recommendation.costs,
        longest=1.05,
        **QUICK,
    )
    assert longest > 1.05
    assert all(each.path.length <= 1.05 * shortest.length for each in fewer.candidates)


@pytest.mark.usefixtures("one_steered_drive")
def test_inflated_path_uses_robot_inflation(grid, costs):
    """It is the path that Nav2 would plan."""
    wide = dataclasses.replace(
        ROBOT, inflation=Inflation(inflation_radius=1.5, cost_scaling_factor=1.0)
    )
    recommendation = recommend(grid, START, GOAL, costs=costs, **{**QUICK, "robot": wide})
    inflated = next(each for each in recommendation.candidates if each.name == "inflated")
    assert inflated.metrics.clearance > recommendation.shortest.metrics.clearance + 0.2
    none = dataclasses.replace(ROBOT, inflation=Inflation(inflation_radius=0.0))
    recommendation = recommend(grid, START, GOAL, costs=costs, **{**QUICK, "robot": none})
    assert "inflated" not in candidate_names(recommendation)  # it is the shortest


@pytest.mark.usefixtures("one_steered_drive")
def test_aware_paths_are_always_candidates(grid, field_costs):
    """They may be close to another candidate."""
    recommendation = recommend(grid, START, GOAL, costs=field_costs, weight=30.0, **QUICK)
    aware = [name for name in candidate_names(recommendation) if name.startswith("aware")]
    assert "aware, weight 30" in aware
    assert len(aware) > 1
    for name in aware:
        weight = name.removeprefix("aware, weight ")
        if weight != name:
            own = plan(field_costs.with_weight(float(weight)), START, GOAL)
            path = next(each for each in recommendation.candidates if each.name == name)
            assert path.metrics.length == pytest.approx(own.path.length, rel=0.02)


@pytest.mark.usefixtures("one_steered_drive")
def test_shortest_path_ignores_costmap_weight(grid, field_costs):
    heavy = field_costs.with_weight(50.0)
    recommendation = recommend(grid, START, GOAL, costs=heavy, **QUICK)
    own = plan(Costmap.blank(grid, robot=0.2), START, GOAL).path
    assert recommendation.shortest.path.length == pytest.approx(own.length)
    assert plan(heavy, START, GOAL).path.length > own.length + 0.1


@pytest.mark.usefixtures("one_steered_drive")
def test_default_costmap_uses_fused_field(grid):
    recommendation = recommend(grid, START, GOAL, **QUICK)
    assert recommendation.costs.settings.config.estimator == Fused(ROBOT.lidar)
    assert recommendation.costs.robot_radius == ROBOT.radius
    of_field = recommend(
        grid, START, GOAL, Robot(), costs=FieldConfig(Fisher(SHORT_LIDAR)), drives=0
    )
    assert of_field.robot.lidar == SHORT_LIDAR


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_include_arrays_fronts_and_planners(grid, field_costs):
    front = pareto_front(field_costs, START, GOAL)
    array = np.array([START, (3, 5), (9, 5), GOAL])
    candidates = {"mine": array, "front": front, "by grid": "grid"}
    recommendation = recommend(grid, START, GOAL, costs=field_costs, candidates=candidates, **QUICK)
    own = [
        name
        for name in candidate_names(recommendation)
        if name.startswith(("mine", "front", "by grid"))
    ]
    assert own == ["mine", *(f"front {n}" for n in range(1, len(own) - 1)), "by grid"]
    assert len(own) == 7 < len(front)
    mine = next(each for each in recommendation.candidates if each.name == "mine")
    assert mine.path.xy.tolist() == array.tolist()
    also = recommend(grid, START, GOAL, costs=field_costs, front=True, **QUICK)
    assert [name for name in candidate_names(also) if name.startswith("front")] == own[1:-1]
    with pytest.raises(ConfigError, match="two candidates are called 'grid'"):
        recommend(grid, START, GOAL, costs=field_costs, candidates=["grid", "grid"], **QUICK)


@pytest.mark.usefixtures("one_steered_drive")
def test_user_paths_are_never_dropped(grid, costs):
    """They may be long, or have the name of a planned candidate."""
    long = Path([START, (1, 5), (11, 4.5), (1, 5), (11, 4.5), GOAL])
    own = dict.fromkeys(("shortest", "detour 2", "aware and clear"), long)
    recommendation = recommend(grid, START, GOAL, costs=costs, candidates=own, **QUICK)
    assert candidate_names(recommendation)[-3:] == [f"own {name}" for name in own]


@pytest.mark.usefixtures("one_steered_drive")
def test_requested_paths_ignore_length_limit(grid, costs, field_costs):
    class Winding(AnyAngle):
        name = "winding"

        def solve(self, costs, start, goal):
            xy = [start, (1, 5), (11, 4.5), (1, 5), (11, 4.5), goal]
            return PlannerResult(Path(xy), "solved")

    asked = {"candidates": Winding(), "longest": 1.0}
    for drives in (QUICK["drives"], 0):
        own = {**QUICK, "drives": drives, "costs": costs}
        recommendation = recommend(grid, START, GOAL, **own, **asked)
        assert recommendation.candidates[-1].name == "winding"
        assert "winding" not in recommendation.left_out
    asked |= {"costs": field_costs, "front": True, "weight": 40.0}
    recommendation = recommend(grid, START, GOAL, **QUICK, **asked)
    requested = {"winding", "front 5", "aware, weight 8", "aware, weight 40"}
    assert requested <= {*candidate_names(recommendation), *recommendation.left_out}
    for name in requested & {*recommendation.left_out}:
        assert "same path as" in recommendation.left_out[name]
    lengths = {each.name: each.path.length for each in recommendation.candidates}
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
def test_report_names_every_dropped_candidate(grid, field_costs, tmp_path, longest, reason):
    recommendation = recommend(grid, START, GOAL, costs=field_costs, longest=longest, **QUICK)
    assert {*candidate_names(recommendation), *recommendation.left_out} == PLANNED
    assert not {*candidate_names(recommendation)} & {*recommendation.left_out}
    assert any(re.fullmatch(reason, why) for why in recommendation.left_out.values())
    report = " ".join(recommendation.report().split())
    assert all(name in report and why in report for name, why in recommendation.left_out.items())
    recommendation.save(tmp_path)
    assert json.loads((tmp_path / "choice.json").read_text())["left_out"] == recommendation.left_out
    assert Recommendation.load(tmp_path).report() == recommendation.report()


@pytest.mark.long
def test_recommendation_verdict_ignores_length_limit(corridors):
    """The aware path from end to end of the lower corridor is 1.5 times as long as the shortest."""
    robot = Robot(Lidar(range=6.0), filter=Amcl(min_particles=300, max_particles=300))
    field = covariance_field(corridors.grid, FieldConfig(Fisher(robot.lidar), stride=0.5))
    asked = {"costs": Costmap.from_field(field), "drives": 8, "rival": None}
    ends = (5.0, 3.0), (34.0, 3.0)
    limited, free = (
        recommend(corridors.grid, *ends, robot, longest=longest, **asked) for longest in (1.2, 3.0)
    )
    assert "aware, weight 8" in candidate_names(limited)
    assert limited.verdict == free.verdict == "better"
    assert limited.path.length > 1.4 * limited.shortest.path.length


def test_shortest_path_wins_without_drives(grid, costs):
    """Without a field, no path is known to be better."""
    own = {"mine": Path([START, (2.0, 1.0), (10.0, 1.0), GOAL])}
    recommendation = recommend(
        grid, START, GOAL, costs=costs, candidates=own, **{**QUICK, "drives": 0}
    )
    assert candidate_names(recommendation) == ["shortest", "mine"]
    assert recommendation.recommended_candidate is recommendation.shortest


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
    """AMCL as a custom filter."""

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
    recommendation = recommend(grid, START, GOAL, robot, costs=costs, drives=4)
    assert recommendation.rival is None
    recommendation.save(tmp_path)
    loaded = Recommendation.load(tmp_path)
    assert loaded == recommendation
    assert loaded.report() == recommendation.report()
    assert loaded.robot.digest == robot.digest
    with pytest.raises(ConfigError, match="does not hold the code of a wrapped AMCL"):
        recommend(grid, START, GOAL, loaded.robot, costs=costs, drives=4)


@pytest.mark.usefixtures("one_steered_drive")
def test_candidate_without_path_is_dropped(grid, costs):
    no_path = plan(costs, START, (11.6, 5.6))  # it ends in the closed cell
    recommendation = recommend(
        grid, START, GOAL, costs=costs, candidates={"none": no_path}, **QUICK
    )
    assert "none" not in candidate_names(recommendation)
    assert "no path joins" in recommendation.left_out["none"]
    assert "left out (no path joins" in recommendation.report()


@pytest.mark.usefixtures("one_steered_drive")
def test_user_path_replaces_planned_twin(grid, costs, box_recommendation):
    """The recommendation names the user's path, and simulates it only once."""
    candidates = box_recommendation.candidates
    (planned,) = (each for each in candidates if each.name == "clear of walls")
    own = {"mine": Path(planned.path.xy)}
    recommendation = recommend(grid, START, GOAL, costs=costs, candidates=own, **QUICK)
    assert "mine" in candidate_names(recommendation)
    assert "clear of walls" not in candidate_names(recommendation)
    assert recommendation.left_out["clear of walls"] == "same path as 'mine'"


def crosses(zones, grid, xy) -> bool:
    """True if a line enters a cell of a no-go zone."""
    closed = zones.cells(grid, "no-go")
    fine = Path(np.asarray(xy)[:, :2]).resample(grid.resolution / 20).xy
    return bool(closed[grid.cell(fine)].any())


@pytest.mark.usefixtures("one_steered_drive")
def test_no_candidate_crosses_no_go_zone(grid, field_costs):
    """A zone closes the passage below the box; another one covers a corner above the box."""
    zones = Zones(
        [
            Zone("no-go", [[5.0, 0.0], [5.5, 0.0], [5.5, 2.0]]),
            Zone("no-go", [[2, 2], [2, 4], [2.3, 4]]),
        ]
    )
    straight = Path(np.array([START, (1.5, 0.8), (10.0, 0.8), GOAL]))
    costs = Costmap.from_layers(
        grid, u=field_costs.u, e=field_costs.e, weight=4.0, robot=ROBOT.radius, zones=zones
    )
    recommendation = recommend(
        grid, START, GOAL, costs=costs, candidates={"mine": straight}, **QUICK
    )
    assert recommendation.left_out["mine"] == "crosses a no-go zone"
    assert len(recommendation.candidates) > 1
    for each in recommendation.candidates:
        assert not crosses(zones, grid, each.path.xy)
    texts = [
        text.get_text() for text in recommendation_figure(recommendation).legends[0].get_texts()
    ]
    assert "no-go zone" in texts
    # The costmap of the path and saved recommendations have the zones, too.
    assert recommendation.costmap().zones == zones
    assert Zones.from_json(recommendation.about["zones"]) == zones
    for wrong in ({"costs": costs, "zones": zones}, {"zones": "zones.geojson"}):
        with pytest.raises(ConfigError, match="zones"):
            recommend(grid, START, GOAL, **wrong, **QUICK)


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_pay_outside_preferred_zones(grid, field_costs):
    """The longer way round the box is preferred; the shortest path does not take it."""
    zones = Zones([Zone("prefer", [[0, 0], [12, 0], [12, 3.2], [0, 3.2]])])
    costs = Costmap.from_layers(grid, u=0 * field_costs.u, weight=4.0, robot=0.2, zones=zones)
    planned = recommend(grid, START, GOAL, Robot(footprint=0.2, margin=0.0), costs=costs)
    for recommendation in (planned, recommend(grid, START, GOAL, costs=costs, **QUICK)):
        shortest, next_one, *_ = (each.path.xy[:, 1].max() for each in recommendation.candidates)
        assert shortest > 4.0
        assert next_one < 3.1


@pytest.mark.usefixtures("one_steered_drive")
def test_waypoints_bind_all_candidates(grid, costs):
    above, own = (6.0, 5.0), Path([START, (2.0, 1.0), (10.0, 1.0), GOAL])
    recommendation = recommend(
        grid, START, GOAL, costs=costs, via=[above], candidates={"below": own}, **QUICK
    )
    assert len(recommendation.candidates) > 1
    for each in recommendation.candidates:
        assert np.hypot(*(each.path.xy - above).T).min() < 1e-9
    assert recommendation.left_out["below"] == "does not visit 6,5"


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_keep_field_limits(grid, field_costs):
    free = recommend(grid, START, GOAL, costs=field_costs, **QUICK)
    degenerate = sorted(each.metrics.integrated_u for each in free.candidates)
    budget = 0.5 * (degenerate[0] + degenerate[-1])
    recommendation = recommend(grid, START, GOAL, costs=field_costs, budget=budget, **QUICK)
    assert max(each.metrics.integrated_u for each in recommendation.candidates) <= budget * 1.001
    assert recommendation.shortest.name == "shortest"
    assert recommendation.shortest.path.length == min(
        each.path.length for each in recommendation.candidates
    )
    assert min(each.metrics.integrated_u for each in free.candidates) <= budget
    levels = sorted(each.metrics.max_e for each in free.candidates)
    max_e = 0.5 * (levels[0] + levels[-1])
    recommendation = recommend(
        grid, START, GOAL, costs=field_costs, max_e=max_e, candidates="grid", **QUICK
    )
    assert max(each.metrics.max_e for each in recommendation.candidates) <= max_e
    nowhere = recommend(grid, START, GOAL, costs=field_costs, max_e=1e-9, **QUICK)
    assert (nowhere.status, nowhere.path) == ("infeasible", None)
    assert "every path enters cells with e above" in nowhere.sentence


@pytest.mark.usefixtures("one_steered_drive")
def test_candidates_keep_outline_clear_of_walls(grid, costs):
    ends = (1.5, 3.0), (10.5, 3.0)
    long = Footprint([(0.7, 0.3), (0.7, -0.3), (-0.7, -0.3), (-0.7, 0.3)])
    robot = dataclasses.replace(ROBOT, footprint=long)
    own = {"tight": Path([ends[0], (2.5, 0.5), (9.5, 0.5), ends[1]])}
    asked = {"costs": costs, "drives": 2, "rival": None}
    recommendation = recommend(grid, *ends, robot, candidates=own, **asked)
    assert recommendation.path is not None
    for each in recommendation.candidates:
        assert long.find_first_collision(grid, each.path) is None
    assert recommendation.left_out["tight"].startswith("cannot be driven: collision near")
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


def with_lengths(recommendation, *lengths):
    """Return the recommendation with other lengths of its candidates."""
    pairs = zip(recommendation.candidates, lengths, strict=False)
    candidates = [
        dataclasses.replace(each, path=Path([(0.0, 0.0), (length, 0.0)])) for each, length in pairs
    ]
    return dataclasses.replace(
        recommendation, candidates=(*candidates, *recommendation.candidates[len(lengths) :])
    )


def with_verdict(
    recommendation, verdict, ratio, *, more_lost=False, arriving_count=16, lengths=(), **settings
):
    """Return the recommendation with candidate 1 as the race's leader, and with its verdict."""
    judgement = {
        "leader": 1,
        "verdict": verdict,
        "ratio": type(recommendation.judgement.ratio)(*ratio),
        "more_lost": more_lost,
    }
    recommendation = with_lengths(recommendation, *(lengths or (27.9, 37.3)))
    recommendation = dataclasses.replace(
        recommendation,
        judgement=dataclasses.replace(recommendation.judgement, **judgement),
        settings=dataclasses.replace(recommendation.settings, **settings),
    )
    return with_arrivals(recommendation, 16, arriving_count)


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
def test_recommendation_sentence_follows_verdict(better, verdict, ratio, more, sentence):
    lost = np.arange(8) < 5
    shortest, *others = better.candidates
    driven = dataclasses.replace(shortest.driven, lost=lost)
    others[0] = dataclasses.replace(
        others[0], driven=dataclasses.replace(driven, lost=lost & False)
    )
    candidates = (dataclasses.replace(shortest, driven=driven), *others)
    better = dataclasses.replace(better, candidates=candidates)
    recommendation = with_verdict(better, verdict, ratio, **more)
    assert recommendation.sentence == sentence.replace("NAME", repr(recommendation.leader.name))
    assert recommendation.best == (not sentence.startswith(KEPT))
    assert recommendation.is_undecided == ("undecided" in sentence and not recommendation.best)


def test_path_without_arrivals_is_least_bad(better):
    """No robot should take a path on which it never reached the goal."""
    recommendation = with_arrivals(with_verdict(better, "better", LESS), 0, 0)
    name = repr(recommendation.leader.name)
    assert recommendation.sentence.startswith(
        f"The least bad path is {name} (37.3 m): 50 % [40, 60] less"
    )
    assert recommendation.role == "least bad"
    kept = with_arrivals(with_verdict(better, "worse", MORE), 0, 0)
    assert kept.sentence.startswith("The least bad path is the shortest path (27.9 m). Path")


def test_report_names_overlong_candidate(better):
    recommendation = with_lengths(better, 60.0, 90.1)
    line = (
        f"\n{recommendation.candidates[1].name}: may be longer than 1.5 times the shortest path\n"
    )
    assert line in f"{recommendation.report()}\n"
    assert "may be longer" not in with_lengths(better, 60.0, 89.9).report()


def test_few_drives_have_no_interval(better):
    """Two drives gave 75 % [-451527571, 100]."""
    recommendation = with_verdict(better, "undecided", (0.9, 1e-9, 4e6))
    drives = dataclasses.replace(recommendation.judgement, drives=range(2))
    recommendation = dataclasses.replace(recommendation, judgement=drives)
    assert recommendation.sentence.endswith(
        "undecided after 2 drives: 10 % less localization error."
    )


def test_recommendation_sentence_without_leader(better):
    judgement = dataclasses.replace(better.judgement, leader=0)
    recommendation = with_lengths(dataclasses.replace(better, judgement=judgement), 27.9)
    assert recommendation.sentence == f"{KEPT}No other candidate was better in up to 8 drives each."
    alone = dataclasses.replace(recommendation, candidates=recommendation.candidates[:1])
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
def test_recommendation_sentence_without_path(better, status, sentence):
    nothing = {"candidates": (), "judgement": None, "note": "a wall"}
    recommendation = dataclasses.replace(better, status=status, **nothing)
    assert recommendation.report() == recommendation.sentence == sentence


@pytest.mark.long
def test_recommendation_ignores_thread_count(grid, costs, box_recommendation):
    """Another seed gives another recommendation."""
    again = recommend(grid, START, GOAL, costs=costs, threads=1, **QUICK)
    other = recommend(grid, START, GOAL, costs=costs, seed=2, **QUICK)
    assert again == box_recommendation
    assert hash(again) == hash(box_recommendation)
    assert other != box_recommendation
    first = zip(
        other.shortest.driven.log_error, box_recommendation.shortest.driven.log_error, strict=False
    )
    assert all(one != two for one, two in first)


@pytest.mark.parametrize("minimise", sample_cases([*MINIMISED], 0))
def test_report_shows_minimised_error(corridors, minimise):
    recommendation = recommend_in_corridors(corridors, minimise=minimise, drives=32)
    if minimise != "heading":
        assert (
            recommendation.recommended_candidate.driven.error.value
            < 0.9 * recommendation.shortest.driven.error.value
        )
    shown = recommendation.report()
    assert ("error [deg]" in shown) == (minimise == "heading")
    assert ("error at the goal" in shown) == (minimise == "goal-error")


@pytest.mark.long
def test_high_price_keeps_path_short(corridors, better):
    priced = recommend_in_corridors(corridors, price=10.0)
    assert better.best
    assert priced.recommended_candidate.path.length <= 1.1 * priced.shortest.path.length


@pytest.mark.usefixtures("one_steered_drive")
def test_time_limit_leaves_single_look(corridors, better):
    ratio = better.judgement.ratio
    recommendation = recommend_in_corridors(corridors, time_limit=1e-9, drives=64)
    assert len(recommendation.judgement.drives) == 8
    assert recommendation.judgement.ratio.value == pytest.approx(ratio.value, rel=0.5)


def test_progress_total_is_largest_drive_count(grid, costs):
    """Fewer drives suffice if they decide early."""
    calls = []
    recommendation = recommend(
        grid, START, GOAL, costs=costs, progress=lambda *at: calls.append(at), **QUICK
    )
    count = len(recommendation.candidates)
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
    recommendation = recommend(corridors.grid, *ends, robot, costs=corridors, drives=8, rival=calm)
    assert recommendation.rival.ratio.high < 1
    advice = recommendation.advice[0]
    assert advice.startswith("Tune the filter first: with AMCL's alpha1 0.02")
    assert recommendation.is_tuning_first
    assert recommendation.report().replace("\n", " ").startswith(f"{advice} Without tuning, take")
    figure = recommendation.figure()
    shown = f"{figure.get_suptitle()}\n{figure.legends[0].get_title().get_text()}"
    assert advice in shown.replace("\n", " ")
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
    """`gain` is the tuning's log-error gain as a multiple of the recommended path's."""
    path_gain = -math.log(better.judgement.ratio.value)
    shortest = better.shortest.driven
    rival = dataclasses.replace(
        shortest,
        log_error=shortest.log_error - gain * path_gain + 0.1 * np.arange(8),
        lost=np.full(8, bool(lost)),
    )
    settings = dataclasses.replace(better.settings, rival=RecommendationSettings().rival)
    recommendation = dataclasses.replace(better, settings=settings, rival=rival)
    assert recommendation.is_tuning_first == is_first
    assert recommendation.role == ("best without tuning" if is_first else "recommended")
    assert recommendation.answer[0].startswith(
        "Tune the filter first" if is_first else "Take 'detour 1'"
    )
    assert (
        "safe settings (update_min_d 0.1, update_min_a 0.1)" in recommendation.answer[0]
    ) == is_first
    assert (
        "That is also less error than on path 'detour 1'" in recommendation.answer[0]
    ) == is_first
    assert "shortest, tuned" in recommendation.report()


@pytest.mark.parametrize(("own", "whose"), [(Odometer(), "AMCL, safe"), (Amcl(), "safe")])
def test_tuning_advice_names_filter_of_settings(better, own, whose):
    shortest = better.shortest.driven
    rival = dataclasses.replace(
        shortest, log_error=shortest.log_error - 9, lost=shortest.lost & False
    )
    settings = dataclasses.replace(better.settings, rival=RecommendationSettings().rival)
    robot = Robot(Lidar(range=6.0), filter=own)
    recommendation = dataclasses.replace(better, robot=robot, settings=settings, rival=rival)
    assert recommendation.advice[0].startswith(f"Tune the filter first: with {whose} settings (")


def test_recommendation_reports_unreachable_goal(grid, costs):
    recommendation = recommend(grid, START, (11.5, 5.5), costs=costs, **QUICK)
    assert (recommendation.status, recommendation.path, recommendation.recommended_candidate) == (
        "unreachable",
        None,
        None,
    )
    assert recommendation.report().startswith(
        "The goal is unreachable: no path joins start and goal"
    )
    assert recommendation.summary()["candidates"] == []
    assert len(recommendation._repr_png_()) > 1000


@pytest.mark.usefixtures("one_steered_drive")
def test_recommend_path_computes_no_unneeded_field(grid, costs):
    def compute(*_):
        raise AssertionError

    more = {"compute": compute, **QUICK}
    assert recommend(grid, START, (11.5, 5.5), **more).status == "unreachable"
    assert recommend(grid, START, GOAL, costs=costs, **more).status == "solved"
    with pytest.raises(AssertionError):
        recommend(grid, START, GOAL, **more)


# Recommendations without drives


def test_recommendation_without_lidar_is_untested(corridors):
    grid = corridors.grid
    recommendation = recommend(grid, (2.0, 3.0), (38.0, 3.0), costs=FieldConfig(Sad(), stride=0.5))
    assert candidate_names(recommendation) == ["shortest", "localizability-aware"]
    assert recommendation.path is recommendation.candidates[1].path
    assert (
        recommendation.candidates[1].metrics.integrated_u
        < recommendation.shortest.metrics.integrated_u
    )
    assert recommendation.verdict == ""
    assert recommendation.sentence.startswith("Untested: take 'localizability-aware' (")
    assert "--lidar" in recommendation.answer[1]
    labels = [each.get_text() for each in recommendation.figure().legends[0].get_texts()]
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
    assert candidate_names(blank) == ["shortest"]


@pytest.mark.usefixtures("one_steered_drive")
def test_custom_degeneracy_has_aware_paths(grid):
    u = np.zeros(grid.shape)
    u[:14] = 1.0  # the way below the box, which is the shorter one
    costs = Costmap.from_layers(grid, u=u, e=u, robot=0.2)
    ends = (1.0, 2.5), (11.0, 2.5)
    recommendation = recommend(grid, *ends, costs=costs)
    assert candidate_names(recommendation) == ["shortest", "localizability-aware"]
    assert recommendation.path is recommendation.candidates[1].path
    assert recommendation.path.xy[:, 1].max() > 4.0 > recommendation.shortest.path.xy[:, 1].max()
    assert recommend(grid, *ends, costs=costs, max_e=0.5).path == recommendation.path
    driven = recommend(grid, *ends, costs=costs, **QUICK)
    assert any("aware" in name for name in candidate_names(driven))


@pytest.mark.parametrize("limit", ["max_e", "budget"])
@pytest.mark.parametrize("robot", [None, ROBOT])
def test_blank_costmap_rejects_field_limits(grid, costs, robot, limit):
    with pytest.raises(ConfigError, match="no e or u to limit"):
        recommend(grid, START, GOAL, robot, costs=costs, **{limit: 1.0})


CAR = dataclasses.replace(ROBOT, kinematics=Kinematics(drive="car-like", turning_radius=0.5))


@pytest.mark.long
def test_car_can_drive_all_candidates(grid, costs):
    sharp = [START, (1.0, 4.6), (11.0, 4.6), GOAL]
    recommendation = recommend(
        *(grid, (*START, 1.5), GOAL, CAR),
        costs=costs,
        drives=4,
        rival=None,
        candidates={"sharp": sharp},
    )
    assert recommendation.judgement is not None
    assert len(recommendation.candidates) > 1
    for each in recommendation.candidates:
        assert check_path(grid, each.path, CAR).drivable
        assert each.path.heading is not None
    assert "cannot be driven: tight turn" in recommendation.left_out["sharp"]


@pytest.mark.long
def test_outline_accepts_paths_without_headings(grid, costs):
    box = Footprint([(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
    robot = dataclasses.replace(ROBOT, footprint=box)
    ends = (*START, 1.5), (*GOAL, 0.5)
    recommendation = recommend(
        grid, *ends, robot, costs=costs, drives=4, rival=None, candidates=["lattice", "grid"]
    )
    assert all(each.driven for each in recommendation.candidates)
    paths = {each.name: each.path for each in recommendation.candidates}
    assert paths["lattice"].heading[[0, -1]] == pytest.approx([1.5, 0.5])
    assert paths["shortest"].heading is not None
    assert paths["grid"].heading is None


def test_car_paths_within_budget_stay_untested(grid, field_costs):
    """They may turn more sharply than the car can."""
    recommendation = recommend(grid, START, GOAL, CAR, costs=field_costs, budget=50.0)
    assert recommendation.judgement is None
    assert "turning radius" in recommendation.answer[1]


# Bad input


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"goal": START}, ConfigError, "the same place"),
        ({"start": (4.0, 2.0)}, PoseError, "start 4,2 lies in a wall"),
        ({"longest": 0.9}, ConfigError, "longest must be at least 1"),
        ({"price": -1.0}, ConfigError, "price must be at least 0"),
        ({"time_limit": -1}, ConfigError, "time_limit must be positive"),
        ({"drives": 1}, ConfigError, "drives, unless 0, must be a whole number in 2..1024"),
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
def test_recommend_path_rejects_bad_input(grid, costs, arguments, error, words):
    arguments = {"start": START, "goal": GOAL, "costs": costs, **QUICK, **arguments}
    with pytest.raises(error, match=words):
        recommend(grid, arguments.pop("start"), arguments.pop("goal"), **arguments)


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
    for row, candidate in zip(rows, about["candidates"], strict=True):
        assert float(row["error"]) == pytest.approx(candidate["driven"]["error"][0])
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
    recommendation = recommend(
        grid, START, GOAL, robot, costs=config, drives=4, longest=1.4, seed=4
    )
    assert json.loads(out) == json.loads(json.dumps(recommendation.summary()))


def next_commands(out):
    """Return the commands that `plan` prints last."""
    lines = out.splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("Next: "))
    return [shlex.split(line) for line in lines[at + 1 :]]


def edit_for_next_step(better, verdict):
    """Return a recommendation whose next step is to tune, plan, export or check."""
    driven = better.shortest.driven
    driven = dataclasses.replace(driven, lost=driven.lost & False)
    same = [dataclasses.replace(each, driven=driven) for each in better.candidates]
    rival = dataclasses.replace(driven, log_error=driven.log_error - 9)
    recommendation = dataclasses.replace(
        better, candidates=tuple(same), rival=rival if verdict == "tune" else None
    )
    word = "undecided" if verdict == "undecided" else "better"
    recommendation = with_verdict(recommendation, word, LESS, drives=64)
    return with_arrivals(recommendation, 8, 8) if verdict == "lost" else recommendation


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("verdict", "output", "command", "option"),
    [
        ("tune", False, "tune", "tuned"),
        ("better", False, "plan", "planned"),
        ("better", True, "export", "nav2-keepout"),
        ("undecided", False, "plan", "--drives=128"),
        ("lost", False, "check", "--set=range=3"),
        ("lost", False, "check", "report"),
    ],
)
def test_plan_prints_next_command(
    run, box, tmp_path, monkeypatch, better, verdict, output, command, option
):
    """An edited recommendation with each verdict replaces the simulated one."""
    recommendation = edit_for_next_step(better, verdict)
    monkeypatch.setattr("locplan.recommend_path", lambda *_, **__: recommendation)
    folder = ("-o", tmp_path / "out") * output
    Robot(Lidar()).save(tmp_path / "robot.yaml")
    robot_options = "--robot", tmp_path / "robot.yaml", "--set", "range=3"
    code, out, _ = run("plan", box, *ENDS, *robot_options, *folder)
    assert code == 0
    assert out.startswith(recommendation.answer[0][:60])
    first, *more = next_commands(out)
    assert first[:2] == ["locplan", command]
    assert option in first
    assert f"--robot={tmp_path / 'robot.yaml'}" in first
    last = ["--robot=tuned/nav2_params.yaml", "-o", "planned"]
    assert [words[-3:] for words in more] == [last] * (verdict == "tune")


def test_next_command_replaces_tuned_file(run, box, tmp_path, monkeypatch, better):
    """The tuned file is a copy of the Nav2 file. Robot files stay."""
    recommendation = edit_for_next_step(better, "tune")
    monkeypatch.setattr("locplan.recommend_path", lambda *_, **__: recommendation)
    nav2, body = tmp_path / "nav2.yaml", tmp_path / "robot.yaml"
    nav2.write_text("amcl: {ros__parameters: {alpha1: 0.1}}\n")
    Robot(Lidar()).save(body)
    code, out, _ = run("plan", box, *ENDS, "--robot", nav2, "--robot", body)
    assert code == 0
    tune, plan_again = next_commands(out)
    assert {f"--robot={nav2}", f"--robot={body}"} <= {*tune}
    robots = [word for word in plan_again if word.startswith("--robot=")]
    assert robots == [f"--robot={body}", "--robot=tuned/nav2_params.yaml"]


def test_plan_suggests_lidar_option_if_missing(run, box):
    code, out, _ = run("plan", box, *ENDS, "--stride", "0.5")
    assert code == 0
    assert out.startswith("Untested: ")
    assert next_commands(out)[0][-3:] == ["--lidar=turtlebot4", "-o", "planned"]


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
    candidates = better.shortest, better.recommended_candidate
    for profile, candidate in zip(both, candidates, strict=True):
        np.testing.assert_allclose(profile, candidate.driven.profile[:, :2])


def test_figure_shows_profile_of_shortest_path(better):
    """It is the only profile if the shortest path is recommended."""
    judgement = dataclasses.replace(better.judgement, verdict="no difference")
    kept = dataclasses.replace(better, judgement=judgement)
    lower = recommendation_figure(kept).axes[1]
    (profile,) = [line.get_xydata() for line in lower.lines if len(line.get_xdata()) > 2]
    np.testing.assert_allclose(profile, better.shortest.driven.profile[:, :2])


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
def test_shortest_path_equals_path_of_simulate(grid, field_costs):
    recommendation = recommend(grid, START, GOAL, costs=field_costs, **QUICK)
    paths = plan_with_shortest(field_costs, START, GOAL)
    assert recommendation.shortest.path == paths["shortest"].path


# Closed-loop drives


def make_arrivals(count, drives=16):
    """Return closed-loop drives, of which `count` reach the goal."""
    here = (0.0, 0.0, 0.0)
    outcomes = ["arrived"] * count + ["aborted"] * (drives - count)
    return Arrivals(tuple(ClosedLoopDrive(each, 1.0, here, here) for each in outcomes))


def with_arrivals(recommendation, shortest, leader):
    """Return the recommendation with other numbers of reached goals along both paths."""
    arrivals = {0: make_arrivals(shortest), recommendation.judgement.leader: make_arrivals(leader)}
    candidates = tuple(
        dataclasses.replace(each, arrivals=arrivals.get(n))
        for n, each in enumerate(recommendation.candidates)
    )
    return dataclasses.replace(recommendation, candidates=candidates)


def test_leader_and_shortest_have_closed_drives(better):
    assert better.best == better.judgement.leader > 0
    numbers = [n for n, each in enumerate(better.candidates) if each.arrivals]
    assert numbers == [0, better.best]
    shortest, leader = (better.candidates[n].arrivals for n in numbers)
    assert len(shortest.drives) == len(leader.drives) == 16
    assert abs(leader.n_reached - shortest.n_reached) <= 1


def test_robot_reaches_goal_on_recommended_path(better, corridors):
    paths = {"recommended": better.path}
    arrivals = drive_closed(Simulator(corridors.grid, better.robot, seed=9), paths, range(2))
    assert [drive.outcome for drive in arrivals["recommended"].drives] == ["arrived"] * 2


@pytest.mark.usefixtures("undrawn")
def test_saved_recommendation_keeps_arrivals(better, tmp_path):
    better.save(tmp_path)
    assert json.loads((tmp_path / "choice.json").read_text())["version"] == 4
    arrivals = better.recommended_candidate.arrivals
    assert Recommendation.load(tmp_path).recommended_candidate.arrivals == arrivals
    with (tmp_path / "candidates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[better.best]["arrived"]) == arrivals.arrival_rate.value
    assert all(row["arrived"] == "" for n, row in enumerate(rows) if n not in (0, better.best))


def test_answer_reports_reached_goals(better):
    recommendation = with_arrivals(better, 12, 15)
    assert recommendation.reached_text == (
        "In closed loop, the robot reaches the goal in 15 of 16 drives, on the shortest path in 12"
        " of 16."
    )
    assert recommendation.answer[1] == recommendation.reached_text
    assert recommendation.reached_text in " ".join(recommendation.report().split())
    assert recommendation.summary()["reached_text"] == recommendation.reached_text


def test_answer_reports_fewer_reached_goals(better):
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


def test_shortest_path_reports_reached_goals(box_recommendation):
    assert box_recommendation.best == 0
    steered = [each for each in box_recommendation.candidates if each.arrivals]
    assert steered == [box_recommendation.shortest]
    count = box_recommendation.shortest.arrivals.n_reached
    assert (
        box_recommendation.reached_text
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
    recommendation = dataclasses.replace(better, candidates=tuple(candidates))
    assert ("off at the end" in recommendation.report()) == (count > 0)


@pytest.mark.parametrize(("shortest", "leader", "taken"), [(16, 14, True), (16, 13, False)])
def test_guard_rejects_fewer_reached_goals(better, shortest, leader, taken):
    recommendation = with_arrivals(better, shortest, leader)
    assert (recommendation.best > 0) == taken
    assert f"{leader} of 16" in recommendation.reached_text
    assert ("reaches the goal less often" in recommendation.sentence) == (not taken)
    assert recommendation.sentence.startswith("Take the shortest path") == (not taken)


@pytest.mark.long
def test_thorough_setting_adds_closed_loop_drives(corridors):
    thorough = recommend_in_corridors(corridors, thorough=True)
    assert [len(e.arrivals.drives) for e in thorough.candidates if e.arrivals] == [40, 40]


def test_figure_shades_places_without_features(better):
    """The legend explains why the shortest path fails, and omits a range beyond the map."""

    def count_reasons(recommendation):
        texts = [each.get_text() for each in recommendation.figure().legends[0].get_texts()]
        return [
            sum(text.startswith(beginning) for text in texts)
            for beginning in ("too few features within", "no wall within", "the lidar's range")
        ]

    degenerate = dataclasses.replace(better.costs, u=np.ones(better.costs.grid.shape))
    better = dataclasses.replace(better, costs=degenerate)
    for reach, reasons in ((6.0, [1, 0, 1]), (200.0, [1, 0, 0]), (0.8, [0, 1, 1])):
        recommendation = dataclasses.replace(better, robot=Robot(Lidar(range=reach)))
        assert count_reasons(recommendation) == reasons


def test_figure_marks_closed_loop_failures(better):
    for recommendation in (better, with_arrivals(better, 14, 16), with_arrivals(better, 16, 16)):
        every = [
            candidate.arrivals for candidate in recommendation.candidates if candidate.arrivals
        ]
        rows = [row for each in every for row in each.places().rows]
        kinds = {MARK_LABELS[row[1]] for row in rows if row[1] != LEAVES}
        texts = [each.get_text() for each in recommendation.figure().legends[0].get_texts()]
        assert {each for each in texts if each in MARK_LABELS.values()} == kinds
        marked = {
            line.get_marker()
            for line in recommendation.figure().axes[0].lines
            if len(line.get_xdata())
        }
        assert ("x" in marked) == any(each.n_reached < 16 for each in every)


def test_failure_marks_show_on_their_path(better):
    axes = with_arrivals(better, 14, 16).figure().axes[0]
    marks = [line for line in axes.lines if line.get_marker() in ("x", "s")]
    assert marks
    for mark in marks:
        assert mark.get_path_effects()
        assert mark.get_markerfacecolor() == "white"


def test_failure_marks_stay_within_figure(better):
    """The marks of start and goal stay on top."""
    recommendation = with_arrivals(better, 14, 16)
    axes = recommendation.figure().axes[0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    every = [
        row
        for each in recommendation.candidates
        if each.arrivals
        for row in each.arrivals.places().rows
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


def test_title_keeps_numbers_with_units():
    text = "take 'detour 5' (19.1 m): 2 % [-2, 6] less error than on the shortest path (17.4 m) "
    for width in np.arange(1.5, 9.0, 0.25):
        lines = break_title(text * 2, width)
        assert " ".join(lines) == (text * 2).strip()
        assert not [line for line in lines if re.match(r"m\b|%|\[|6\]", line)]


def test_figure_title_has_two_lines(better):
    """The rest of a long answer stands below the panels."""
    name = "ground floor of the northern hall, with the doors closed, before the move"
    about = {**better.about, "map": {**better.map, "name": name}}
    choice = dataclasses.replace(with_arrivals(better, 16, 3), about=about)
    figure = choice.figure()
    title, caption = figure.get_suptitle(), figure.legends[0].get_title().get_text()
    assert title.count("\n") <= 1
    shown = f"{title} {caption}".replace("\n", " ")
    assert shown == " ".join(
        [f"{name}: {choice.answer[0]}", *choice.answer[1:], choice.drives_text]
    )


def test_length_handicaps_count_excess_in_full():
    settings = RecommendationSettings(longest=1.5, price=0.3)
    allowed = 0.3 * math.log(1.5)
    expected = [0.0, allowed, allowed + math.log(2)]
    assert settings.compute_length_handicaps([1.0, 1.5, 3.0]) == pytest.approx(expected)
