"""What a call or a command can ask for is bounded by the machine, before any work."""

import re

import numpy as np
import pytest
from support.command_line import check_refusal
from support.maps import ascii_map

import locplan
from locplan import FieldConfig, LocplanError, Path, Sad, Scan, compare, covariance_field, save_map
from locplan._support import checks
from locplan._support.kernels import drives
from locplan.advice.tuning import tune
from locplan.comparison import Execution, RandomQueries
from locplan.comparison.journal import RunJournal
from locplan.comparison.statistics import PlannerRun, RunTask
from locplan.errors import ConfigError
from locplan.field import SearchWindow
from locplan.field.compute import find_lidar_cells
from locplan.planning import random_queries
from locplan.planning.ompl.planner import Ompl
from locplan.robots import Amcl, Disturbances, Lidar
from locplan.simulation import Simulator, drive_open, simulate

GRID = ascii_map("##########", *["#........#"] * 6, "#...#    #", "##########", resolution=1.0)
ENDS = ((1.5, 2.5), (8.5, 6.5))


@pytest.fixture
def no_work(monkeypatch):
    """Nothing is computed in the test."""

    def work(*_, **__):
        raise AssertionError("the work has begun")

    monkeypatch.setattr("locplan.field.Sad.covariances", work)
    monkeypatch.setattr(drives, "simulate_drive", work)


@pytest.fixture
def room(tmp_path):
    save_map(GRID, tmp_path / "room.yaml")
    return tmp_path / "room.yaml"


@pytest.fixture
def small_machine(monkeypatch):
    monkeypatch.setattr(checks, "count_usable_cores", lambda: 2)
    monkeypatch.setattr(checks, "get_usable_memory", lambda: 10**9)


CALLS = [
    (lambda: covariance_field(GRID, threads=65), r"threads must be at most 64 \(32 for each"),
    (lambda: simulate(GRID, {"a": np.array(ENDS)}, threads=65), "threads must be at most 64"),
    (lambda: tune([GRID], threads=10**30), "threads must be a whole number"),
    (lambda: simulate(GRID, {"a": np.array(ENDS)}, drives=100_001), "in 2..100000"),
    (lambda: simulate(GRID, {"a": np.array(ENDS)}, seed=-1), "seed must be a whole number"),
    (lambda: tune([GRID], seed=10**20), "seed must be a whole number"),
    (lambda: Execution(workers=4), r"workers must be at most 3 \(1 GB of this machine's"),
    (lambda: compare(GRID, queries=10_001), "random queries must be a whole number in 1..10000"),
    (lambda: RandomQueries(seed=-1), "the seed of random queries"),
    (lambda: compare(GRID, seeds=range(1, 1002)), "at most 1,000 seeds"),
    (lambda: compare(GRID, seeds=[10**20]), "each seed must be a whole number in 1..4294967295"),
    (lambda: Execution(memory=1e10), "take 10 GB of memory, and this machine has 1 GB"),
    (lambda: Ompl("RRT", seed=2**32).check(), "seed must be a whole number in 1..4294967295"),
    (lambda: Amcl(max_particles=10**9), "max_particles must be a whole number in 1..1000000"),
    (lambda: Disturbances(worlds=10**9), "worlds must be a whole number in 1..1000"),
    (lambda: Lidar(range=1e308), "range must be a positive number of m"),
    (lambda: Lidar(range=20_000.0), "range must be 0 to 10000"),
    (lambda: Sad(range=20_000.0), "range must be 0 to 10000"),
]


@pytest.mark.parametrize(("call", "message"), CALLS, ids=[message for _, message in CALLS])
def test_calls_refuse_work_beyond_machine_limits(call, message, no_work, small_machine):
    with pytest.raises(LocplanError, match=message) as fault:
        call()
    assert "\n" not in str(fault.value)


def test_field_refuses_window_beyond_memory(no_work, small_machine):
    wide = SearchWindow(half_width=200.0, step=0.2, half_rotation_deg=180, rotation_step_deg=0.2)
    for estimator in (Sad(window=wide), Scan(Lidar(), window=wide)):
        fine = ascii_map("....", "....", resolution=0.1)
        with pytest.raises(ConfigError, match=r"window of \d+ offsets takes too much"):
            covariance_field(fine, estimator)


def test_field_refuses_grid_beyond_memory(no_work, small_machine):
    large = locplan.OccupancyGrid(np.full((4000, 4000), 254, np.uint8), 0.1)
    with pytest.raises(ConfigError, match=r"the values of the field take .* set a larger stride"):
        covariance_field(large, FieldConfig(Sad(), stride=0.1))


def test_simulation_refuses_drives_beyond_memory(no_work, monkeypatch):
    simulator, path = Simulator(GRID), Path(np.array([[1.5, 2.5], [8.5, 2.5]]))
    monkeypatch.setattr(checks, "get_usable_memory", lambda: 10**6)
    with pytest.raises(ConfigError, match=r"1000000 drives of 1 paths take .* drive fewer"):
        drive_open(simulator, {"path": path}, range(10**6))


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("field MAP --threads 9999999", "threads must be at most"),
        ("field MAP --set range=1e308", "range must be a positive number of m"),
        ("field MAP --set range=1e12", "range must be 0 to 10000"),
        ("field MAP --stride -0", "stride must be a positive number"),
        ("field MAP --stride inf", "stride"),
        ("field MAP --headings 99999999999999999999", "headings"),
        ("simulate MAP --random 12345678901234567890", "--random"),
        ("simulate MAP --random 20000", "random queries must be a whole number in 1..10000"),
        ("simulate MAP --random 2 --seed 12345678901234567890", "--seed"),
        ("simulate MAP --random 2 --seed -1", "--seed"),
        ("simulate MAP --random 2 --drives 1000000000", "--drives"),
        ("simulate MAP --random 2 --set max_particles=1000000000", "max_particles"),
        ("simulate MAP --random 2 --set resample_interval=1000000000000000000000", "resample"),
        ("plan MAP --start 1.5,2.5 --goal 1e12,1e12", "goal"),
        ("plan MAP --start 1.5,2.5 --goal 1e308,-1e308", "goal"),
        ("plan MAP --start 1.5,2.5 --goal 8.5,6.5 --planner RRT --seed 99999999999", "seed"),
        ("plan MAP --start 1.5,2.5 --goal 8.5,6.5 --set footprint=" + "[" * 5000, "footprint"),
        ("compare MAP -o out --workers 100000", "workers must be at most"),
        ("compare MAP -o out --seeds 99999", "at most 1,000 seeds"),
        ("compare MAP -o out --seed -1", "--seed"),
    ],
)
def test_commands_refuse_values_out_of_bounds(
    run, room, command, message, no_work, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert message in check_refusal(run(*command.replace("MAP", str(room)).split()))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("field", ""), "an argument is empty"),
        (("field", "MAP", "-o", ""), "-o is empty"),
        (("field", "MAP", "--picture="), "--picture is empty"),
        (("field", "MAP", "--field", " "), "--field is empty"),
        (("plan", "MAP", "--start", "", "--goal", "1,1"), "--start is empty"),
    ],
)
def test_empty_argument_is_refused(run, room, arguments, named, monkeypatch):
    """An empty path would mean the current folder."""
    monkeypatch.chdir(room.parent)
    assert named in check_refusal(
        run(*[str(room) if each == "MAP" else each for each in arguments])
    )


def test_errors_shorten_long_arguments(run, room):
    for word in ("[" * 5000, "x" * 5000, "{" * 5000, "a\nb"):
        for arguments in (("plan", word), ("field", room, "--field", word), (word,)):
            assert len(check_refusal(run(*arguments))) < 600


def test_library_warnings_are_only_logged(run, room, monkeypatch):
    def noisy(*_, **__):
        np.float64(1e308) * 10

    monkeypatch.setattr("locplan.app.cli.groups.OutputOptions.show", noisy)
    code, _, err = run("field", room)
    assert (code, err) == (0, "")
    code, _, err = run("-v", "field", room)
    assert re.search("locplan.app.cli: RuntimeWarning: overflow", err)


def test_lidar_in_wall_moves_within_reach():
    free = np.zeros((40, 50), bool)
    free[5, 7] = free[8, 4] = free[30, 45] = True
    rows, cols = np.array([5, 6, 39, 0]), np.array([7, 4, 49, 49])
    near = find_lidar_cells(free, rows, cols, 3)
    assert [each.tolist() for each in near] == [[5, 8, 39, 0], [7, 4, 49, 49]]
    far = find_lidar_cells(free, rows, cols, 10**9)
    assert [each.tolist() for each in far] == [[5, 8, 30, 30], [7, 4, 45, 45]]


def test_full_disk_error_names_journal(tmp_path):
    resource = pytest.importorskip("resource", reason="Windows has no limits of a process")
    run = PlannerRun(
        RunTask("room", "own", "query", 1.0, "grid", 0), "crashed", 1.0, 1.0, note="x" * 9999
    )
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
    try:
        with (
            pytest.raises(LocplanError, match=r"runs\.jsonl: cannot be written \(File too large"),
            RunJournal(tmp_path / "runs.jsonl", {}) as journal,
        ):
            journal.add(run)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with RunJournal(tmp_path / "others.jsonl", {}) as journal:
        journal.add(run)


def test_random_queries_reject_negative_seed():
    costs = locplan.Costmap.blank(GRID)
    with pytest.raises(ConfigError, match="seed"):
        random_queries(costs, 2, -1, min_distance=1.0)
