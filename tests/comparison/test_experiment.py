"""Comparisons in one call, and on the command line."""

import csv
import dataclasses
import json
import math
import pickle
import re
import types

import numpy as np
import pytest
from support.fields import change_estimator
from support.maps import random_rooms

import locplan
from locplan import save_map
from locplan.comparison import Execution, RandomQueries
from locplan.comparison.planners import PlannerSpec
from locplan.errors import ConfigError, LocplanError
from locplan.field import FieldConfig, Fisher, Sad
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, Zone, Zones
from locplan.planning import Costmap, Path, PlannerResult, Query
from locplan.planning.requests import find_changed_options, with_options
from locplan.robots import Amcl, Footprint, Kinematics, Lidar, Robot
from locplan.robots.nav2 import ParameterWarning
from locplan.simulation import RecommendationSettings

pytestmark = pytest.mark.usefixtures("undrawn")

QUICK = FieldConfig(Sad(range=1.0), stride=0.4)
ONE = Execution(workers=1)
SMALL = Robot(footprint=0.1, margin=0.0)


def rooms(name="rooms", seed=6):
    return OccupancyGrid(random_rooms((60, 90), seed=seed), 0.1, (2.0, -1.0, 0.0), name=name)


def detour(costs, start, goal, *, time_limit=None, seed=0):
    """A planner of a user's: the grid's path at half the weight."""
    half = costs.with_weight(costs.weight / 2)
    found = locplan.plan(half, start, goal, planner="grid")
    return dataclasses.replace(found, note=f"{time_limit:g} s, seed {seed}")


def raising(costs, start, goal):
    raise ValueError("no idea\nat all")


@pytest.fixture(scope="module")
def comparison():
    return locplan.compare(
        [rooms("one"), rooms("two", 9)],
        ["grid", "any-angle", "RRTConnect:iterations=400", detour],
        RandomQueries(5, min_distance=3.0),
        SMALL,
        weights=[0.0, 4.0],
        seeds=[1, 2],
        configs={"1 m": QUICK, "2 m": change_estimator(QUICK, range=2.0)},
        execution=Execution(workers=1, time_limit=60.0),
    )


def test_every_combination_is_run_once(comparison):
    tasks = [run.task for run in comparison.runs]
    per_query = 1 + 1 + 2 + 2  # those with random numbers have two seeds
    assert len(tasks) == len(set(tasks)) == 2 * 2 * 2 * 5 * per_query
    assert {task.config for task in tasks} == {"1 m", "2 m"}
    assert {run.status for run in comparison.runs if run.task.planner == "any-angle"} == {"solved"}


def test_queries_are_equal_across_settings(comparison):
    """They also keep the minimum distance."""
    for name in ("one", "two"):
        first, second = (comparison.cases[name, label].queries for label in ("1 m", "2 m"))
        assert first == second
        assert min(math.dist(query.start, query.goal) for query in first) >= 3.0


def test_grid_costs_more_than_any_angle(comparison):
    """Any-angle is the baseline by default."""
    assert comparison.baseline == "any-angle"
    costs = [
        contrast
        for contrast in comparison.contrasts()
        if (contrast.measure, contrast.planner) == ("cost", "grid")
    ]
    assert len(costs) == 8  # two maps, two ranges, two weights
    assert all(contrast.estimate.value > 1 for contrast in costs)
    assert all("costlier than any-angle" in contrast.sentence for contrast in costs)
    assert set(comparison.answers()) == {"one", "two"}
    answer = comparison.answers()["one"]
    assert "At weight 4, 1 m: grid: " in answer
    assert "At weight 4, 2 m: " in answer
    assert answer.count("grid: ") == 2
    pooled = comparison.contrasts(pooled=True)
    assert {contrast.setting.map for contrast in pooled} == {None}
    assert max(contrast.pairs for contrast in pooled) == 10


def test_compared_planners_keep_out_of_zones():
    grid, plain = rooms(), {"configs": QUICK, "execution": ONE}
    zones = Zones(
        [
            Zone("no-go", [(4.0, 0.0), (5.0, 0.5), (4.0, 1.5)]),
            Zone("prefer", [(2.0, -1.0), (6.0, -1.0), (6.0, 5.0)]),
        ]
    )
    found = locplan.compare(grid, "grid", RandomQueries(6, 3.0), SMALL, zones=zones, **plain)
    costs, _ = found.cases["rooms", "sad, 1 m"].costmap()
    assert costs.zones == zones
    solved = [run for run in found.runs if run.status == "solved"]
    assert len(solved) > 2
    for run in solved:
        assert not zones.cells(grid, "no-go")[grid.cell(Path(run.xy).resample(0.01).xy)].any()
        assert run.measures["cost"] == pytest.approx(locplan.planning.path_cost(costs, run.xy))
    for wrong in (Costmap.blank(grid), OccupancyGrid(grid.cells, 0.1, (99.0, 0.0, 0.0))):
        with pytest.raises(ConfigError, match=r"remove zones|no zone overlaps the map"):
            locplan.compare(wrong, "grid", 1, zones=zones, execution=ONE)


def test_user_planner_is_measured_equally(comparison):
    by_task = {run.task: run for run in comparison.runs}
    own = [run for run in comparison.runs if run.task.planner == "detour"]
    assert {run.task.seed for run in own} == {1, 2}
    for run in own:  # its path is the best for half the weight
        least = by_task[dataclasses.replace(run.task, planner="grid", seed=0)]
        assert run.measures["cost"] >= least.measures["cost"] - 1e-9
        assert run.measures["length"] <= least.measures["length"] + 1e-9


@pytest.mark.usefixtures("inline_workers")
def test_report_names_exception_of_failing_planner():
    result = locplan.compare(
        rooms(), ["grid", raising], RandomQueries(2), SMALL, configs=QUICK, execution=ONE
    )
    fault = "raising raises in all 2 runs, first ValueError: no idea"
    assert fault in result.report()
    assert repr(result) == f"Comparison(4 runs of grid, raising; {fault})"


def test_planner_cannot_change_measured_costmap():
    def path_of(costs, start, goal):
        return locplan.plan(costs, start, goal, planner="grid").path

    def honest(costs, start, goal):
        return path_of(costs, start, goal)

    def writer(costs, start, goal):
        found = path_of(costs, start, goal)
        for layer in (costs.density, costs.u, costs.e, costs.grid.clearance):
            layer.setflags(write=True)
            layer *= 0.5
        return found

    def replacer(costs, start, goal):
        found = path_of(costs, start, goal)
        object.__setattr__(costs, "density", np.ones(costs.grid.shape))
        object.__setattr__(costs, "e", costs.e / 2)
        object.__setattr__(costs.grid, "resolution", 1.0)
        costs.grid.__dict__["clearance"] = costs.grid.clearance * 2
        return found

    class Vandal:
        name, minimises, space = "vandal", None, "R2"

        def check(self):
            pass

        def prepare(self):
            pass

        def solve(self, costs, start, goal):
            return PlannerResult(replacer(costs, start, goal))

    planners = [writer, replacer, Vandal(), honest, "grid"]
    settings = {"weights": [4.0], "configs": QUICK, "execution": ONE, "baseline": "grid"}
    runs = locplan.compare(rooms(), planners, RandomQueries(3, 2.0), **settings).runs
    by_query = {}
    for run in runs:
        assert run.status == "solved", run.note
        by_query.setdefault(run.task.query, []).append(dict(run.measures))
    for measures in by_query.values():
        assert len(measures) == 5
        assert all(one == measures[-1] for one in measures)
    costs = Costmap.blank(rooms(), robot=0.1)
    before = costs.copy()
    query = locplan.planning.random_queries(costs, 1, 1, min_distance=2.0)[0]
    spoilt = locplan.plan(costs, query.start, query.goal, planner=writer)
    metrics = locplan.planning.path_metrics(before, spoilt.path)
    assert spoilt.metrics.cost == metrics.cost
    assert spoilt.metrics.clearance == metrics.clearance


def test_hung_run_is_repeated(tmp_path):
    awake = tmp_path / "awake"

    def napping(costs, start, goal):
        while not awake.exists():
            pass
        return locplan.plan(costs, start, goal)

    execution = Execution(workers=1, journal=tmp_path / "runs.jsonl")
    one, hasty = RandomQueries(1, min_distance=2.0), dataclasses.replace(execution, patience=0.3)
    (first,) = locplan.compare(rooms(), napping, one, configs=QUICK, execution=hasty).runs
    awake.touch()
    (again,) = locplan.compare(rooms(), napping, one, configs=QUICK, execution=execution).runs
    assert (first.status, again.status) == ("hung", "solved")


@pytest.mark.usefixtures("inline_workers")
def test_compare_tolerates_invalid_history_and_note(tmp_path):
    def odd(costs, start, goal):
        found = locplan.plan(costs, start, goal)
        return dataclasses.replace(found, history=((0.1, math.inf), (0.2, 9.0)), note=b"\xff")

    execution = Execution(workers=1, journal=tmp_path / "r.jsonl")
    one = RandomQueries(1, min_distance=2.0)
    (run,) = locplan.compare(rooms(), odd, one, configs=QUICK, execution=execution).runs
    assert (run.status, run.history) == ("solved", ((0.2, 9.0),))


@pytest.mark.usefixtures("inline_workers")
def test_random_queries_have_headings_if_needed():
    planners = ["grid", "RRTConnect:space=SE2,iterations=300"]
    settings = {"weights": [0.0], "configs": QUICK, "execution": ONE}
    found = locplan.compare(rooms(), planners, RandomQueries(2, 2.0), **settings)
    assert {run.status for run in found.runs if run.task.planner == "grid"} == {"solved"}
    assert all(len(query.start) == 3 for query in next(iter(found.cases.values())).queries)


@pytest.mark.usefixtures("inline_workers")
def test_logs_have_memory_limit_in_megabytes(tmp_path):
    execution = Execution(workers=1, memory=2e9)
    locplan.compare(rooms(), "grid", 1, configs=QUICK, execution=execution).save(tmp_path)
    (log,) = (tmp_path / "ompl_logs").glob("*.log")
    assert "2000.0 MB per run" in log.read_text()


def test_all_files_are_written(comparison, tmp_path):
    dataclasses.replace(comparison, command="locplan compare").save(tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("report.html", "comparison.csv", "runs.csv", "ompl_logs", "run.yaml"),
    }
    with (tmp_path / "out" / "runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(comparison.runs)
    assert float(rows[0]["cost"]) == pytest.approx(comparison.runs[0].measures["cost"], rel=1e-8)
    with (tmp_path / "out" / "comparison.csv").open(newline="") as file:
        standings = list(csv.DictReader(file))
    assert len(standings) == 2 * 2 * 2 * 4
    ratio = next(row.cost.estimate.value for row in comparison.standings())
    assert float(standings[0]["ratio"]) == pytest.approx(ratio, rel=1e-8)
    about = json.loads(json.dumps(comparison.summary(), allow_nan=False))
    assert about["locplan"] == locplan.__version__
    cases = {(case["map"], case["field"]): case for case in about["cases"]}
    assert cases["two", "2 m"]["config"]["estimator"]["range"] == 2.0
    assert cases["one", "1 m"]["robot_radius"] == 0.1
    assert cases["one", "1 m"]["queries"][0]["start"] == list(
        comparison.cases["one", "1 m"].queries[0].start
    )
    assert about["planners"]["RRTConnect:iterations=400"] == ["RRTConnect", {"iterations": 400}]
    assert len(about["summaries"]) == 2 * 2 * 2 * 4
    (contrast, *_) = about["contrasts"]
    assert contrast["setting"] == {"map": "one", "config": "1 m", "weight": about["weights"][0]}
    assert contrast["pairs"] > 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == 2
    for text in (
        "locplan compare",
        "No planner beats any-angle",
        "degenerate metres (∫u ds) [m]",
        "detour: ",
    ):
        assert text in page
    assert len(list((tmp_path / "out" / "ompl_logs").glob("*.log"))) == 2 * 2 * 2 * 5
    pandas = pytest.importorskip("pandas")
    assert isinstance(comparison.to_frame(), pandas.DataFrame)
    assert ": the baseline\n" in comparison.report()


def test_report_table_has_median_times(comparison, tmp_path):
    """Its last column has milliseconds."""
    comparison.save(tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    keys = re.findall(r'data-key="([^"]*)">[^<]*</td>\s*</tr>', page)
    for key, row in zip(keys, comparison.standings(), strict=True):
        if row.summary.planner == "grid":
            seconds = [
                run.seconds
                for run in comparison.runs
                if run.task.planner == "grid"
                and (run.task.map, run.task.config, run.task.weight) == row.setting
            ]
            assert float(key) == pytest.approx(1000 * np.median(seconds), rel=1e-6)


@pytest.mark.usefixtures("inline_workers")
def test_compare_accepts_costmap_without_e(tmp_path):
    grid = rooms()
    own = Costmap.from_density(grid, np.where(grid.free, 2.0, np.inf))
    found = locplan.compare({"mine": own}, "grid", RandomQueries(2, min_distance=1.0))
    assert {run.task.config for run in found.runs} == {"own cost"}
    assert all(math.isnan(run.measures["integrated_e"]) for run in found.runs)
    found.save(tmp_path / "out")
    assert (tmp_path / "out" / "report.html").read_text().count("<img") == 2  # paths on the map


@pytest.mark.usefixtures("inline_workers")
def test_estimator_sets_weight_and_criterion(monkeypatch):
    monkeypatch.setattr(Fisher, "weight", 8.0)
    monkeypatch.setattr(Fisher, "criterion", "position_std")
    configs = {"sad": QUICK, "fisher": FieldConfig(Fisher(Lidar(range=1.0)), stride=0.5)}
    one = RandomQueries(1, min_distance=2.0)
    found = locplan.compare(rooms(), ["grid", "any-angle"], one, SMALL, configs=configs)
    assert {(run.task.config, run.task.weight) for run in found.runs} == {("sad", 4), ("fisher", 8)}
    about = found.summary()
    assert about["weights"] == [4.0, 8.0]
    assert [case["criterion"] for case in about["cases"]] == ["e", "position_std"]
    assert "At weight 4, sad: grid" in found.answers()["rooms"]
    assert "At weight 8, fisher: grid" in found.answers()["rooms"]


@pytest.mark.usefixtures("inline_workers")
def test_random_queries_differ_by_seed():
    costs = {"mine": Costmap.blank(rooms())}
    first, again, other = (
        locplan.compare(costs, "grid", RandomQueries(2, 2.0, seed))
        .cases["mine", "own cost"]
        .queries
        for seed in (1, 1, 2)
    )
    assert first == again
    assert {*first}.isdisjoint(other)


@pytest.mark.usefixtures("inline_workers")
def test_queries_come_in_every_form(tmp_path):
    ends = ((2.5, -0.5), (6.0, 3.0))
    (tmp_path / "q.csv").write_text("name,start_x,start_y,goal_x,goal_y\nthere,2.5,-0.5,6.0,3.0\n")
    room = OccupancyGrid(np.full((60, 90), FREE), 0.1, (2.0, -1.0, 0.0), name="room")
    settings = {"weights": 0.0, "configs": QUICK}
    lengths = {
        round(locplan.compare(room, ["grid"], queries, **settings).runs[0].measures["length"], 9)
        for queries in (
            tmp_path / "q.csv",
            [ends],
            [Query("there", *ends)],
            {"room": [ends]},
        )
    }
    assert len(lengths) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"maps": []}, "at least one map"),
        ({"maps": [3]}, "a map must be"),
        ({"maps": [rooms(), rooms()]}, "two maps are called 'rooms'"),
        ({"planners": ["grid", "grid"]}, "appears twice"),
        ({"planners": ["B*"]}, "planner must be one of"),
        ({"planners": ["BITstar:foo=1"]}, "has no option"),
        ({"queries": 3.5}, "queries must be a number"),
        ({"queries": [(1, 2)]}, "queries must be a number"),
        ({"queries": [((-50.0, 0.0), (6.0, 3.0))]}, "query 'query 1': start"),
        ({"weights": []}, "at least one weight"),
        ({"baseline": "RRT"}, "baseline must be one of"),
        ({"configs": {}}, "configs must be"),
        ({"queries": RandomQueries(min_distance=500.0)}, "no two connected positions"),
        ({"robot": "robot.yaml"}, "robot must be a Robot"),
        ({"seeds": 3}, "seeds must be several whole numbers"),
        ({"configs": [QUICK]}, "configs must be"),
        ({"seeds": [0]}, "each seed must be a whole number"),
        ({"queries": {"other": 3}}, "no queries for map 'rooms'"),
        ({"queries": True}, "queries must be a number"),
        ({"planners": ["BITstar:settings=3"]}, "by their names"),
    ],
)
def test_compare_rejects_wrong_input(changes, message):
    arguments = {"maps": rooms(), "planners": ["grid"], "queries": 2, "configs": QUICK} | changes
    with pytest.raises(LocplanError, match=message) as fault:
        locplan.compare(**arguments)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"workers": 0}, "workers must be"),
        ({"workers": 1.5}, "workers must be"),
        ({"memory": math.nan}, "memory must be"),
        ({"memory": "2GB"}, "memory must be"),
        ({"patience": 0.0}, "patience must be"),
    ],
)
def test_execution_rejects_invalid_settings(settings, message):
    with pytest.raises(ConfigError, match=message):
        Execution(**settings)


def test_with_time_limit_depends_on_planner():
    """Grid searches and planners with iterations get no limit."""
    limited = {
        name: PlannerSpec.parse(name).with_time_limit(0.7).time_limit
        for name in ("grid", "BITstar", "BITstar:time_limit=2", "RRTstar:iterations=10")
    }
    assert limited == {
        "grid": None,
        "BITstar": 0.7,
        "BITstar:time_limit=2": 2.0,
        "RRTstar:iterations=10": None,
    }
    limited = PlannerSpec.parse(detour).with_time_limit(0.7)
    assert find_changed_options(limited.planner) == {"time_limit": 0.7}
    with pytest.raises(ConfigError):
        PlannerSpec.parse("BITstar").with_time_limit(-1.0)


@pytest.mark.usefixtures("inline_workers")
def test_compare_command_resumes_journal(run, tmp_path, small_field):
    save_map(rooms(), tmp_path / "rooms.yaml")
    common = (
        "compare",
        tmp_path / "rooms.yaml",
        "-o",
        tmp_path / "out",
        "--random",
        3,
        "--field",
        small_field,
    )
    common += ("--min-distance", 2, "--stride", 0.4, "--workers", 1)
    common += ("--set", "footprint=0.1", "--set", "margin=0")
    code, out, err = run(*common, "--weight", 0, "--weight", 4)
    assert code == 0, err
    assert "any-angle" in out
    assert "planner and baseline both" in " ".join(out.split())
    lines = (tmp_path / "out" / "runs.jsonl").read_text().splitlines()
    assert len(lines) == 1 + 3 * 2 * 2
    code, _, err = run(*common)
    assert code == 2
    assert "has runs with other settings (weights)" in err
    (tmp_path / "out" / "runs.jsonl").write_text("\n".join(lines[:8]) + "\n{")
    code, out, err = run(*common, "--weight", 0, "--weight", 4, "--json")
    assert code == 0, err
    assert json.loads(out)["weights"] == [0.0, 4.0]
    again = (tmp_path / "out" / "runs.jsonl").read_text().splitlines()
    assert (again[:8], len(again)) == (lines[:8], len(lines))
    code, out, err = run(*common, "--force", "--weight", 4, "--weight", 8, "--json")
    assert code == 0, err
    assert json.loads(out)["weights"] == [4.0, 8.0]
    assert len((tmp_path / "out" / "runs.jsonl").read_text().splitlines()) == 1 + 3 * 2 * 2


def test_compare_command_rejects_wrong_options(run, tmp_path):
    save_map(rooms(), tmp_path / "rooms.yaml")
    command = "compare", tmp_path / "rooms.yaml", "-o", tmp_path / "out"
    code, out, err = run(*command, "--planner", "nobody")
    assert (code, out, err.count("\n")) == (2, "", 1)
    queries = "--queries", "none.csv"
    code, _, err = run(*command, *queries, "--random", 3)
    assert (code, "exclude each other" in err) == (2, True)
    for option in ("--seed", "--min-distance"):
        code, _, err = run(*command, *queries, option, 3)
        assert (code, f"{option} has no effect with --queries" in err) == (2, True)
    assert not (tmp_path / "out").exists()


LIDAR = Lidar(range=4.0, range_sigma=0.01, beams=60, model="mine")
CORRIDOR = Query("corridor", (2.0, 3.0), (38.0, 3.0))


@pytest.fixture(scope="module")
def corridors():
    grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    field = locplan.covariance_field(grid, FieldConfig(Fisher(LIDAR), stride=0.4))
    return Costmap.from_field(field)


@pytest.fixture
def nav2(tmp_path):
    file = tmp_path / "nav2.yaml"
    file.write_text("amcl:\n  ros__parameters:\n    alpha1: 0.05\n    max_particles: 500\n")
    return file


@pytest.mark.long
def test_compare_runs_simulated_choice(corridors, nav2):
    text = f"simulated choice: drives=2, minimise=lost, robot={nav2}"
    found = locplan.compare(
        corridors, ["any-angle", text], [CORRIDOR], seeds=[2], weights=8.0, execution=ONE
    )
    label = f"simulated choice:drives=2,minimise=lost,robot={nav2}"
    runs = [run for run in found.runs if run.task.planner == label]
    assert [(run.task.seed, run.status) for run in runs] == [(2, "solved")]
    for run in runs:
        choice = locplan.recommend_path(
            corridors.grid,
            CORRIDOR.start,
            CORRIDOR.goal,
            robot=Robot(LIDAR, filter=Amcl(alpha1=0.05, max_particles=500)),
            costs=corridors,
            settings=RecommendationSettings(drives=2, minimise="lost", rival=None),
            seed=run.task.seed,
        )
        np.testing.assert_array_equal(run.xy, choice.path.xy)
    name, options = found.description["planners"][label]
    assert (name, options["robot"]["filter"]["alpha1"]) == ("simulated choice", 0.05)


def test_simulated_choice_passes_costmap_and_options(corridors, nav2, monkeypatch):
    """A worker process uses a single thread."""
    asked = []

    def recommend_path(grid, start, goal, robot, **options):
        assert robot == Robot(LIDAR, filter=Amcl(alpha1=0.05, max_particles=500))
        asked.append(options)
        return types.SimpleNamespace(path=None, status="unreachable")

    monkeypatch.setattr("locplan.simulation.recommender.recommend_path", recommend_path)
    spec = PlannerSpec.parse(f"simulated choice:price=3,longest=1.2,robot={nav2}")
    assert spec.select_seeds([4, 5]) == (4, 5)
    plan = spec.plan(corridors, CORRIDOR.start, CORRIDOR.goal, 5)
    assert plan.status == "unreachable"
    assert [options["threads"] for options in asked] == [1]
    assert asked[0]["costs"] is corridors
    assert [options["seed"] for options in asked] == [5]
    assert (asked[0]["settings"].price, asked[0]["settings"].longest) == (3, 1.2)
    assert PlannerSpec.parse("simulated choice:seed=7").select_seeds([4, 5]) == (7,)
    here = spec.plan(corridors, CORRIDOR.start, CORRIDOR.start, 1)
    assert here.path.length == 0


def test_simulated_choice_warns_once(nav2):
    nav2.write_text(nav2.read_text() + "    robot_model_type: my::Legs\n")
    with pytest.warns(ParameterWarning, match="not simulated: robot_model_type"):
        spec = PlannerSpec.parse(f"simulated choice:robot={nav2}")
    with_options(spec.planner, seed=3)  # a second warning would be an error


def test_simulated_choice_reads_robot_once(nav2):
    """Workers receive the robot, not its file."""
    spec = PlannerSpec.parse(f"simulated choice:robot={nav2}")
    nav2.unlink()
    again = with_options(pickle.loads(pickle.dumps(spec.planner)), seed=3)
    assert (again.robot.filter.alpha1, again.seed) == (0.05, 3)
    again.check()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("drives=1", "drives"),
        ("minimise=all", "minimise"),
        ("longest=0.5", "longest"),
        ("price=-1", "price"),
        ("seed=-1", "seed"),
        ("lidar=tim571", "lidar"),
        ("robot=missing.yaml", "missing.yaml"),
        ("threads=2", "no option 'threads'; it has: drives, minimise"),
        ("budget=2", "a budget is for planner 'grid'"),
    ],
)
def test_simulated_choice_rejects_wrong_options(options, message):
    with pytest.raises(ConfigError, match="planner 'simulated choice:") as error:
        PlannerSpec.parse(f"simulated choice:{options}")
    assert message in str(error.value)


def test_unknown_planner_error_lists_planners():
    with pytest.raises(ConfigError, match=r"must be one of grid, .*, simulated choice, not 'no'"):
        PlannerSpec.parse("no")


@pytest.mark.usefixtures("inline_workers")
def test_journal_of_another_lidar_is_refused(corridors, tmp_path):
    other = dataclasses.replace(LIDAR, range_sigma=0.05)
    config = dataclasses.replace(corridors.settings.config, estimator=Fisher(other))
    settings = dataclasses.replace(corridors.settings, config=config)
    renamed = dataclasses.replace(corridors, settings=settings)
    journal = tmp_path / "runs.jsonl"
    execution = Execution(journal=journal)
    for costs in (corridors, corridors.copy()):
        locplan.compare({"it": costs}, "grid", [CORRIDOR], execution=execution)
        assert len(journal.read_text().splitlines()) == 2
    with pytest.raises(LocplanError, match=r"other settings \(maps\)"):
        locplan.compare({"it": renamed}, "grid", [CORRIDOR], execution=execution)


@pytest.mark.usefixtures("inline_workers")
def test_compare_uses_robot_for_fields(monkeypatch, tmp_path):
    """If fields have several lidars, planners get a robot with the lidar of their field."""
    asked = []

    def recommend_path(grid, start, goal, robot, **_):
        asked.append(robot)
        return types.SimpleNamespace(path=None, status="unreachable")

    monkeypatch.setattr("locplan.simulation.recommender.recommend_path", recommend_path)
    robot = Robot(LIDAR, footprint=0.1, margin=0.0, filter=Amcl(alpha1=0.05))
    grid, ends = rooms(), [((2.5, -0.5), (4.0, -0.5))]
    found = locplan.compare(grid, "simulated choice", ends, robot)
    assert {run.task.config for run in found.runs} == {"fused, 4 m"}
    assert {case.robot_radius for case in found.cases.values()} == {0.1}
    assert asked[-1] == robot
    assert found.summary()["robot"]["filter"]["alpha1"] == 0.05
    own = tmp_path / "other.yaml"
    Robot(footprint=0.3).save(own)
    locplan.compare(grid, f"simulated choice:robot={own}", ends, robot)
    assert asked[-1].footprint == 0.3
    asked.clear()
    shorter = dataclasses.replace(LIDAR, range=2.0)
    configs = {str(each.range): FieldConfig(Fisher(each), stride=1.0) for each in (LIDAR, shorter)}
    locplan.compare(grid, "simulated choice", ends, robot, configs=configs)
    assert {each.lidar for each in asked} >= {LIDAR, shorter}


@pytest.mark.usefixtures("inline_workers")
def test_report_names_undrivable_paths():
    cells = np.full((60, 60), FREE)
    cells[:, 28:32] = OCCUPIED
    cells[26:34, 28:32] = FREE  # a gap that the car's width fits, and its length does not
    grid = OccupancyGrid(cells, 0.1, name="gap")
    long = Footprint([(0.5, 0.2), (0.5, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
    car = Kinematics(drive="car-like", turning_radius=0.4)
    robot = Robot(footprint=long, margin=0.0, kinematics=car)
    curves = "RRTstar:space=ReedsShepp,turning_radius=0.4,iterations=300"
    ends = [((1.0, 1.5, np.pi / 2), (5.0, 4.5, -np.pi / 2))]
    found = locplan.compare(
        Costmap.blank(grid, robot=robot), ["lattice", curves, "grid"], ends, robot
    )
    by_planner = {run.task.planner: run for run in found.runs}
    assert {run.status for run in found.runs} == {"solved"}
    assert by_planner["lattice"].note == ""
    assert by_planner["grid"].note.startswith("the robot cannot drive it: tight turn near")
    said = found.report()
    assert "the robot cannot drive 1 of its 1 paths" in " ".join(said.split())
    assert "lattice: the baseline\n" in said
