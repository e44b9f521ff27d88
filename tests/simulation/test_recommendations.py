"""Recommended paths for many queries, computed here and on executors."""

import math
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from support.cases import sample_cases
from support.maps import ascii_map
from support.recommendations import recommend, recommend_many

import locplan
from locplan import Costmap, Lidar
from locplan.errors import ConfigError, LocplanError, PoseError
from locplan.field import FieldConfig, Fisher
from locplan.maps import environments
from locplan.planning import Query
from locplan.robots import Amcl, Robot
from locplan.simulation import RecommendationSettings, recommendations as module
from locplan.simulation.recommendations import Recommendations, read_recommendations

pytestmark = pytest.mark.usefixtures("undrawn")

LIDAR = Lidar(range=4.0, range_sigma=0.01, beams=60)
AMCL = Amcl(min_particles=100, max_particles=100)
QUERIES = (
    Query("far", (2.0, 3.0), (14.0, 3.0)),
    Query("near", (2.0, 3.0), (5.0, 10.0)),
    Query("back", (14.0, 3.0), (3.0, 10.0)),
)
ROBOT = Robot(filter=AMCL)
SETTINGS = RecommendationSettings(drives=2, rival=None)
QUICK = {"robot": ROBOT, "drives": 2, "rival": None}


@pytest.fixture(scope="module")
def costs():
    grid = environments.make("two_corridors", resolution=0.1)
    field = locplan.covariance_field(grid, FieldConfig(Fisher(LIDAR), stride=0.4))
    return Costmap.from_field(field)


@pytest.fixture(scope="module")
def recommendations(costs):
    return recommend_many(costs, QUERIES, **QUICK)


class Late(Executor):
    """An executor whose last task is done first."""

    def __init__(self):
        self.tasks = []

    def submit(self, call, *arguments):
        task = Future()
        self.tasks.append((task, call, arguments))
        if len(self.tasks) == len(QUERIES):
            for earlier, function, values in reversed(self.tasks):
                earlier.set_result(function(*values))
        return task


def test_recommend_paths_equals_recommend_path(costs, recommendations):
    for seed, (query, each) in enumerate(zip(QUERIES, recommendations, strict=True), 1):
        asked = {"costs": costs, "seed": seed, "threads": 1, **QUICK}
        single = recommend(costs.grid, query.start, query.goal, **asked)
        assert (each.map, each.query) == ("two_corridors", query)
        assert each.recommendation.summary() == single.summary()
        assert each.recommendation.robot.lidar == LIDAR


def test_saved_recommendations_are_read_back(recommendations, tmp_path):
    recommendations.save(tmp_path / "planned")
    read = read_recommendations(tmp_path / "planned")
    assert read == {each.query.name: each.recommendation for each in recommendations}
    header, *rows = (tmp_path / "planned" / "choices.csv").read_text().splitlines()
    assert header.startswith("map,query,")
    assert len(rows) == len(QUERIES)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "choices.csv").write_text("mine")
    with pytest.raises(LocplanError, match=r"choices\.csv: was not written by"):
        recommendations.save(tmp_path / "mine")
    same = Recommendations((recommendations[0], recommendations[0]))
    with pytest.raises(ConfigError, match="'far' and 'far' would be saved as one file"):
        same.save(tmp_path / "same")


@pytest.mark.parametrize("kind", sample_cases(["processes", "late", "threads"]))
def test_recommendations_are_equal_for_all_executors(costs, recommendations, kind):
    pools = {
        "late": Late,
        "threads": lambda: ThreadPoolExecutor(2),
        "processes": lambda: ProcessPoolExecutor(1, mp_context=get_context("spawn")),
    }
    done = []
    with pools[kind]() as executor:
        other = recommend_many(
            costs, QUERIES, executor=executor, **QUICK, progress=lambda *each: done.append(each)
        )
    assert [each.recommendation for each in other] == [
        each.recommendation for each in recommendations
    ]
    assert done == [(1, 3), (2, 3), (3, 3)]
    assert all(each.recommendation.costs is costs for each in other)


@pytest.mark.long
@pytest.mark.filterwarnings("default")  # of dask's own shutting down
def test_dask_cluster_returns_equal_recommendations(costs, recommendations):
    distributed = pytest.importorskip("distributed", reason="locplan[dask] is not installed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        other = recommend_many(costs, QUERIES, executor=client.get_executor(), **QUICK)
    assert [each.recommendation for each in other] == [
        each.recommendation for each in recommendations
    ]


def test_task_uses_single_thread(costs, monkeypatch):
    """It returns no costmap, so that little data is sent back."""
    threads = []

    def note(*arguments, **options):
        threads.append(options["threads"])
        return recommend(*arguments, **options)

    monkeypatch.setattr(module, "recommend_path", note)
    case = module._QueryCase("map", costs, QUERIES[1], 2)
    recommendation = module.recommend_for_case(locplan.__version__, case, ROBOT, SETTINGS)
    assert (recommendation.costs, threads) == (None, [1])
    recommend_many(costs, QUERIES[1:2], **QUICK, threads=2)
    assert threads == [1, 2]


def test_executor_holds_limited_number_of_tasks(costs, monkeypatch):
    monkeypatch.setattr(module, "IN_FLIGHT", 1)
    held, most = [], []

    class Held(Future):
        def result(self, timeout=None):
            held.remove(self)
            return super().result(timeout)

    class Counting(Executor):
        def submit(self, call, *arguments):
            task = Held()
            task.set_result(call(*arguments))
            held.append(task)
            most.append(len(held))
            return task

    recommend_many(costs, QUERIES[:2], executor=Counting(), **QUICK)
    assert most == [1, 1]


def test_workers_with_another_locplan_are_refused(costs):
    class Newer(ThreadPoolExecutor):
        def submit(self, call, version, *arguments):
            return super().submit(call, "99.0", *arguments)

    refusal = pytest.raises(ConfigError, match=r"'far': a worker has locplan .*, not 99\.0")
    with Newer(1) as executor, refusal:
        recommend_many(costs, QUERIES[:1], executor=executor, **QUICK)


def test_failing_executor_raises_locplan_error(costs):
    class Broken(Executor):
        def submit(self, *_):
            raise OSError("no\nworkers")

    with pytest.raises(LocplanError, match=r"'far': the executor failed \(OSError: no workers\)$"):
        recommend_many(costs, QUERIES, executor=Broken(), **QUICK)


def test_report_summarizes_all_queries(recommendations):
    ratios = [
        each.recommendation.recommended_candidate.driven.error.value
        / each.recommendation.shortest.driven.error.value
        for each in recommendations
    ]
    assert recommendations.error_ratio.value == pytest.approx(math.exp(np.log(ratios).mean()))
    assert recommendations.n_detours == sum(
        each.recommendation.best > 0 for each in recommendations
    )
    lost = [
        [
            e.driven.lost.mean()
            for e in (c.recommendation.shortest, c.recommendation.recommended_candidate)
        ]
        for c in recommendations
    ]
    assert recommendations.lost == pytest.approx(np.mean(lost, axis=0))
    off = [
        [
            e.driven.off_at_end.mean()
            for e in (c.recommendation.shortest, c.recommendation.recommended_candidate)
        ]
        for c in recommendations
    ]
    assert recommendations.off_at_end == pytest.approx(np.mean(off, axis=0))
    rows = recommendations.table().records()
    assert [row["query"] for row in rows] == ["far", "near", "back"]
    far = rows[0]
    assert (far["start_x"], far["goal_y"]) == (QUERIES[0].start[0], QUERIES[0].goal[1])
    assert far["length_chosen"] == recommendations[0].recommendation.path.length
    shortest = recommendations[0].recommendation.shortest
    assert far["error_shortest"] == pytest.approx(shortest.driven.error.value)
    text = " ".join(recommendations.report().split())
    assert f"two_corridors 3 of 3 {recommendations.n_detours} " in text
    assert f"{recommendations.error_ratio.value:.2f}" in text
    assert f"{recommendations.lost[0]:.0%} -> {recommendations.lost[1]:.0%}" in text


def test_recommend_paths_takes_queries_per_map(costs):
    hall = environments.make("hall", resolution=0.1)
    maps = {"corridors": costs, "hall": Costmap.blank(hall)}
    recommendations = recommend_many(
        maps, {"hall": 1, "corridors": QUERIES[1:2]}, **QUICK, query_seed=4
    )
    assert [(each.map, each.query.name) for each in recommendations] == [
        ("corridors", "near"),
        ("hall", "random 1"),
    ]
    assert math.dist(recommendations[1].query.start, recommendations[1].query.goal) >= 10.0
    assert recommendations[1].recommendation.robot.lidar.range == 6.0  # the default
    assert "all maps" in recommendations.report()
    assert len([each for each in recommendations if each.map == "hall"]) == 1
    with pytest.raises(ConfigError, match="no queries for map 'hall'"):
        recommend_many(maps, {"corridors": QUERIES[:1]}, **QUICK)


def test_report_counts_queries_without_path():
    parted = ascii_map(*["....#...."] * 4, resolution=0.5)
    ends = [((0.75, 0.75), (3.75, 0.75)), ((0.75, 0.75), (1.25, 1.25))]
    recommendations = recommend_many(Costmap.blank(parted), ends, **QUICK)
    assert [each.recommendation.status for each in recommendations] == ["unreachable", "solved"]
    assert (len(recommendations.solved_recommendations), recommendations.n_detours) == (1, 0)
    assert "1 of 2" in recommendations.report()
    assert recommendations.table().records()[0]["chosen"] == ""
    assert recommendations.error_ratio.value == 1.0
    only = recommend_many(Costmap.blank(parted), ends[:1], **QUICK)
    assert "0 of 1" in only.report()


@pytest.mark.long
def test_default_field_is_fused_for_lidar(monkeypatch):
    asked = []

    def field_of(grid, config, **options):
        asked.append((grid.name, config, options["threads"]))
        return locplan.covariance_field(grid, FieldConfig(config, stride=1.0))

    monkeypatch.setattr(module, "load_or_compute", field_of)
    grid = environments.make("hall", resolution=0.1)
    recommendations = recommend_many(
        grid, 2, robot=Robot(LIDAR, footprint=0.4, margin=0.0), drives=2, threads=1
    )
    assert asked == [("hall", locplan.Fused(LIDAR), 1)]
    assert {each.recommendation.costs.robot_radius for each in recommendations} == {0.4}


@pytest.mark.parametrize(
    ("maps", "queries", "options", "message"),
    [
        (None, QUERIES, {}, "a map must be a file"),
        ([], QUERIES, {}, "at least one map"),
        ({}, QUERIES, {}, "at least one map"),
        ("costs", [], {}, "no query; give at least one"),
        ("costs", "missing.csv", {}, r"missing\.csv"),
        ("costs", [3], {}, "queries must be"),
        ("costs", QUERIES, {"drives": 1}, "drives"),
        ("costs", QUERIES, {"minimise": "all"}, "minimise"),
        ("costs", QUERIES, {"price": -1}, "price"),
        ("costs", QUERIES, {"longest": 0.5}, "longest"),
        ("costs", [((2.0, 3.0), (2.0, 3.0))], {}, "query 'query 1': start and goal are one place"),
        ("costs", [((2.0, 3.0), (-9.0, 0.0))], {}, r"query 'query 1': goal .* outside the map"),
    ],
)
def test_recommend_paths_rejects_bad_input(costs, maps, queries, options, message, monkeypatch):
    if maps == "costs":
        maps = costs
    elif maps is None:
        maps = [None]
    monkeypatch.setattr(module, "recommend_path", None)  # bad input is rejected earlier
    kind = PoseError if "outside" in message else LocplanError
    with pytest.raises(kind, match=message):
        recommend_many(maps, queries, **(QUICK | options))
