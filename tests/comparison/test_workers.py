"""The engine of comparisons: no planner can stop it, and no run is made twice."""

import dataclasses
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from support.bad_planners import (
    boast,
    counting,
    crash,
    depart,
    fail,
    first_waits,
    hog,
    leave,
    print_something,
    refuse,
    sleep,
    spawn_and_crash,
    spawning,
    spin,
    stray,
    trespass,
)
from support.cases import sample_cases
from support.comparison_runs import QUERIES, room_with_door, run_comparison
from support.machine import TIMEOUT

import locplan
from locplan.comparison.planners import PlannerSpec
from locplan.errors import ConfigError, LocplanError
from locplan.planning import Costmap, Query, plan
from locplan.planning.grid import GridPlanner
from locplan.planning.requests import FunctionPlanner

HERE = Path(__file__).parents[1]
ERRORS = ("fail", "refuse", "depart", "boast", "trespass", "stray", "print_something")


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def comes_true(condition) -> bool:
    ends = time.monotonic() + TIMEOUT
    while time.monotonic() < ends:
        if condition():
            return True
        time.sleep(0.02)
    return bool(condition())


def by_planner(runs):
    return {
        label: [run for run in runs if run.task.planner == label]
        for label in {run.task.planner for run in runs}
    }


def untimed(run):
    """What does not depend on the clock."""
    return run.task, run.status, run.xy, dict(run.measures)


def test_failure_loses_single_run(capfd):
    bad = [crash, leave, hog, fail, refuse, depart, boast, trespass, stray, print_something]
    ticks = []
    runs = run_comparison(
        ["grid", *bad, "any-angle"],
        QUERIES[:1],
        workers=1,
        memory=2e8,
        progress=lambda *tick: ticks.append(tick),
    )
    found = by_planner(runs)
    statuses = {label: {run.status for run in some} for label, some in found.items()}
    assert statuses == {
        "grid": {"solved"},
        "any-angle": {"solved"},
        "crash": {"crashed"},
        "leave": {"crashed"},
        "hog": {"out of memory"},
        **{label: {"error"} for label in ERRORS},
    }
    notes = {label: some[0].note for label, some in found.items()}
    assert notes["crash"] == "its process was ended by SIGSEGV"
    assert notes["leave"] == "its process ended with exit code 3"
    assert notes["fail"] == "ValueError: no idea"
    assert notes["refuse"] == "not on this map"
    assert 'status "solved" without a path' in notes["boast"]
    assert "cannot be" in notes["trespass"]
    assert "does not lead" in notes["stray"]
    assert "must return a locplan.Path" in notes["print_something"]
    assert [done for done, _ in ticks] == list(range(len(runs) + 1))
    assert all(run.xy == () and run.measures == {} for run in runs if run.status != "solved")
    assert capfd.readouterr().out == ""


def test_run_after_hung_ones_is_solved():
    """The last planner has a limit of its own, so that a busy machine cannot end it too."""

    def unhurried(costs, start, goal, *, time_limit=100.0):
        return plan(costs, start, goal)

    planners = [spin, sleep, unhurried]
    runs = run_comparison(planners, QUERIES[:1], workers=1, patience=0.5, time_limit=100.0)
    assert [run.status for run in runs] == ["hung", "hung", "solved"]
    assert {run.note for run in runs[:2]} == {"was ended without an answer after 0.5 s"}
    assert all(run.wall_seconds >= 0.5 for run in runs[:2])


@pytest.mark.usefixtures("inline_workers")
def test_runs_use_costmap_of_weight():
    runs = run_comparison(["grid", "any-angle"], weights=[0, 5], workers=1)
    order = [(run.task.weight, run.task.query, run.task.planner) for run in runs]
    assert order == [
        (weight, query.name, planner)
        for weight in (0.0, 5.0)
        for query in QUERIES
        for planner in ("grid", "any-angle")
    ]
    for run in runs:
        query = next(query for query in QUERIES if query.name == run.task.query)
        costs = room_with_door().with_weight(run.task.weight)
        here = plan(costs, query.start, query.goal, planner=run.task.planner)
        assert run.measures["cost"] == here.metrics.cost
        assert run.measures["integrated_e"] == here.metrics.integrated_e
        assert run.xy == tuple(map(tuple, here.path.xy.tolist()))
        assert run.measures["turning"] > 0
        assert 0 < run.seconds <= run.wall_seconds
        assert run.task.seed == 0


@pytest.mark.usefixtures("inline_workers")
def test_unreachable_goal_is_run_status():
    runs = run_comparison(["grid", "RRTstar:iterations=100"], costs=room_with_door(door=False))
    assert {run.status for run in runs} == {"unreachable"}
    assert all("no path joins" in run.note for run in runs)


@pytest.mark.usefixtures("inline_workers")
def test_seeds_apply_to_random_planners(tmp_path):
    planners = [
        "grid",
        "RRTstar:iterations=200",
        "RRTstar:iterations=200,seed=9",
        PlannerSpec("mine", FunctionPlanner(counting, {"folder": str(tmp_path)})),
    ]
    found = by_planner(run_comparison(planners, seeds=[3, 4]))
    seeds = {label: sorted({run.task.seed for run in some}) for label, some in found.items()}
    assert list(seeds.values()).count([3, 4]) == 2
    assert seeds["grid"] == [0]
    assert seeds["RRTstar:iterations=200,seed=9"] == [9]


@pytest.mark.long
def test_seeded_runs_equal_across_workers():
    planners = ["RRTstar:iterations=400", "BITstar:iterations=3000", "PRMstar:iterations=100"]
    one, two = (run_comparison(planners, seeds=[5, 7], workers=workers) for workers in (1, 2))
    assert list(map(untimed, one)) == list(map(untimed, two))
    for planner in (planners[0], planners[2]):  # which solve them
        xy = {(run.task.query, run.xy) for run in one if run.task.planner == planner}
        assert len(xy) == 4


def test_local_planner_is_sent_and_prepared():
    def learner(costs, start, goal, *, bend=bool):
        assert learner.ready
        return plan(costs, start, goal)

    def prepare():
        learner.ready = True

    learner.prepare = prepare
    assert {run.status for run in run_comparison(learner, workers=1)} == {"solved"}


def test_compare_rejects_unpicklable_planner():
    import threading

    lock = threading.Lock()

    def locked(costs, start, goal):
        with lock:
            return plan(costs, start, goal)

    with pytest.raises(LocplanError, match="cannot be sent to a worker process"):
        run_comparison(locked, workers=1)


def test_failed_preparation_raises_error():
    def broken(costs, start, goal):
        return plan(costs, start, goal)

    broken.prepare = lambda: 1 / 0
    with pytest.raises(LocplanError, match="ZeroDivisionError"):
        run_comparison(broken, workers=1)


def test_crashed_preparation_ends_comparison():
    def broken(costs, start, goal):
        return plan(costs, start, goal)

    broken.prepare = lambda: os._exit(1)
    with pytest.raises(LocplanError, match="before they are ready"):
        run_comparison(broken, workers=1)


@pytest.mark.long
def test_failed_starts_count_per_worker(tmp_path):
    def fragile(costs, start, goal):
        return plan(costs, start, goal)

    def prepare():  # the first three processes end, once all of them are there
        for n in itertools.count():
            with suppress(FileExistsError):
                (tmp_path / str(n)).touch(exist_ok=False)
                break
        while n < 3 and not (tmp_path / "2").exists():
            pass
        if n < 3:
            os._exit(1)

    fragile.prepare = prepare
    assert {run.status for run in run_comparison(fragile, workers=3)} == {"solved"}


def test_killed_worker_loses_single_run(tmp_path):
    killed = []

    def kill(done, total):
        if done and not killed:  # another has solved its query: the first is waiting
            killed.append(int((tmp_path / "victim").read_text()))
            os.kill(killed[0], signal.SIGKILL)

    queries = [dataclasses.replace(QUERIES[0], name=str(n)) for n in range(6)]
    lazy = PlannerSpec("lazy", FunctionPlanner(first_waits, {"folder": str(tmp_path)}))
    runs = run_comparison(lazy, queries, workers=2, progress=kill)
    statuses = [run.status for run in runs]
    assert statuses.count("crashed") == len(killed) == 1
    assert statuses.count("solved") == 5
    assert "SIGKILL" in next(run.note for run in runs if run.status == "crashed")


@pytest.mark.usefixtures("inline_workers")
def test_journal_skips_finished_runs(tmp_path, monkeypatch, caplog):
    caplog.set_level("INFO")
    for function in (counting, fail):
        monkeypatch.setattr(function, "version", 2, raising=False)
    calls, file = tmp_path / "calls", tmp_path / "runs.jsonl"
    calls.mkdir()
    mine = PlannerSpec("mine", FunctionPlanner(counting, {"folder": str(calls)}))

    def added(**changes):
        before = len(list(calls.iterdir()))
        arguments = {"weights": [1.0], "seeds": [1, 2], "journal": file} | changes
        runs = run_comparison([mine, fail], **arguments)
        return runs, len(list(calls.iterdir())) - before

    first, count = added()
    assert count == 4
    again, count = added()
    assert count == 0
    assert "planner mine: 4 runs cached, version 2" in caplog.messages
    assert again == first
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:3]) + '\n{"half": ')  # a comparison that was interrupted
    again, count = added()
    assert {run.task for run in again} == {run.task for run in first}
    assert len(file.read_text().splitlines()) == len(lines)
    assert count in (2, 3)  # the journal had one or two runs of `mine`
    assert added(force=True)[1] == 4


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"seeds": [1, 2]}, "seeds"),
        ({"weights": [2.0]}, "weights"),
        ({"queries": QUERIES[:1]}, "queries"),
        ({"queries": [QUERIES[0], dataclasses.replace(QUERIES[1], goal=(2.5, 1.5))]}, "queries"),
        ({"planners": ["grid"]}, "planners"),
        ({"costs": dataclasses.replace(room_with_door(), u=room_with_door().u / 2)}, "maps"),
        ({"planners": ["any-angle"], "weights": [2.0]}, "planners, weights"),
    ],
)
@pytest.mark.usefixtures("inline_workers")
def test_journal_refuses_other_settings(tmp_path, changes, names):
    arguments = {"planners": ["grid", "any-angle"], "weights": [1.0], "journal": tmp_path / "r"}
    run_comparison(**arguments)
    before = (tmp_path / "r").read_text()
    with pytest.raises(
        LocplanError, match=rf"other settings \({names}\); name another .*force=True"
    ):
        run_comparison(**arguments | changes)
    assert (tmp_path / "r").read_text() == before
    runs = run_comparison(**arguments | changes, force=True)
    assert len((tmp_path / "r").read_text().splitlines()) == 1 + len(runs)


@pytest.mark.usefixtures("inline_workers")
def test_journal_refuses_other_versions(tmp_path):
    run_comparison("grid", journal=tmp_path / "r")
    head, *runs = (tmp_path / "r").read_text().splitlines()
    settings = json.loads(head)
    settings["versions"]["locplan"] = "99"
    (tmp_path / "r").write_text("\n".join([json.dumps(settings), *runs, ""]))
    with pytest.raises(LocplanError, match=r"other settings \(versions\)"):
        run_comparison("grid", journal=tmp_path / "r")


@pytest.mark.usefixtures("inline_workers")
def test_first_line_has_settings_and_versions(tmp_path):
    run_comparison(
        ["grid", "RRTstar:iterations=100"], seeds=[7], weights=[2], journal=tmp_path / "r"
    )
    head = json.loads((tmp_path / "r").read_text().splitlines()[0])
    assert head["versions"]["locplan"] == locplan.__version__
    assert head["planners"]["RRTstar:iterations=100"] == ["RRTstar", {"iterations": 100}]
    assert (head["weights"], head["seeds"]) == ([2.0], [7])
    assert [query["name"] for query in head["queries"]] == ["there", "back"]


@pytest.mark.usefixtures("inline_workers")
def test_torn_journal_loses_last_line(tmp_path):
    file = tmp_path / "runs.jsonl"
    first = run_comparison(["grid", "any-angle"], journal=file)
    whole = file.read_bytes()
    ends = [n for n, byte in enumerate(whole, 1) if byte == ord("\n")]
    for kept in [0, 9, *(end + cut for end in ends[::3] for cut in (-40, -1, 0, 9))]:
        file.write_bytes(whole[:kept])
        again = run_comparison(["grid", "any-angle"], journal=file)
        assert [untimed(run) for run in again] == [untimed(run) for run in first]
        finished = max(0, sum(end <= kept for end in ends) - 1)
        assert [new.seconds == old.seconds for new, old in zip(again, first, strict=True)].count(
            True
        ) >= finished
        lines = file.read_text().splitlines()
        assert len(lines) == 1 + len(first)
        assert all(json.loads(line) for line in lines)


@pytest.mark.usefixtures("inline_workers")
def test_other_files_are_no_journals(tmp_path):
    file = tmp_path / "notes.txt"
    for text in ("dear diary\n", "dear diary\ntoday", "dear"):
        file.write_text(text)
        for force in (False, True):
            with pytest.raises(LocplanError, match="is not a journal"):
                run_comparison("grid", journal=file, force=force)
        assert file.read_text() == text
    with pytest.raises(LocplanError, match="is a file, not a folder"):
        run_comparison("grid", journal=file / "such.jsonl")
    run_comparison("grid", journal=tmp_path / "runs.jsonl")
    with (tmp_path / "runs.jsonl").open("a") as journal:
        journal.write("{}\n")
    with pytest.raises(LocplanError, match="line 4 is damaged; delete it"):
        run_comparison("grid", journal=tmp_path / "runs.jsonl")


@pytest.mark.usefixtures("inline_workers")
def test_journal_of_older_format_is_refused(tmp_path):
    file = tmp_path / "runs.jsonl"
    file.write_text('{"format": "locplan comparison 1"}\n')
    with pytest.raises(LocplanError, match="other settings"):
        run_comparison("grid", journal=file)
    assert len(run_comparison("grid", journal=file, force=True)) == 2


@pytest.mark.usefixtures("inline_workers")
def test_journal_rejects_second_writer(tmp_path):
    file, faults = tmp_path / "runs.jsonl", []

    def compare_too(done, total):
        with pytest.raises(LocplanError, match="another comparison writes") as fault:
            run_comparison("grid", journal=file)
        faults.append(fault)

    run_comparison("grid", journal=file, progress=compare_too)
    assert len(faults) == 1 + len(QUERIES)


SCRIPT = """
import sys
sys.path[:0] = {path!r}
import signal
from support.bad_planners import slow, spawning, spin
from support.comparison_runs import run_comparison
from locplan.comparison.planners import PlannerSpec
from locplan.planning.requests import FunctionPlanner
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background it is ignored
naps = PlannerSpec("nap", FunctionPlanner({planner}, {{"folder": {folder!r}}}))
run_comparison([naps, spin], workers=2, journal={folder!r} + ".jsonl")
"""


def started(folder: Path, planner: str) -> subprocess.Popen:
    """A comparison in its own process and terminal session, once a planner is at work."""
    folder.mkdir()
    path = [entry for entry in sys.path if entry]
    script = SCRIPT.format(path=[str(HERE), *path], folder=str(folder), planner=planner)
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(folder.parent)},  # what a killed process leaves
    )
    assert comes_true(lambda: list(folder.iterdir()))
    return process


def descendants(pid: int) -> list[int]:
    listed = subprocess.run(["ps", "-eo", "pid,ppid"], capture_output=True, text=True, check=True)
    pairs = [tuple(map(int, line.split())) for line in listed.stdout.splitlines()[1:]]
    children = [child for child, parent in pairs if parent == pid]
    return [*children, *(one for child in children for one in descendants(child))]


@pytest.mark.parametrize(
    ("ending", "planner"),
    sample_cases(
        [
            (signal.SIGINT, "spawning"),
            (signal.SIGINT, "slow"),
            (signal.SIGTERM, "slow"),
            (signal.SIGKILL, "slow"),
        ],
        are_rows=True,
    ),
)
def test_signal_leaves_no_processes(tmp_path, ending, planner):
    process = started(tmp_path / "naps", planner)
    workers = descendants(process.pid)
    assert len(workers) >= 2
    os.killpg(process.pid, ending)  # as a terminal does; by themselves they would go on and on
    _, complaints = process.communicate(timeout=TIMEOUT)
    if ending == signal.SIGINT:
        assert complaints.count("Traceback") == 1
        assert complaints.rstrip().endswith("KeyboardInterrupt")
    assert comes_true(lambda: not any(map(alive, workers)))


@pytest.mark.parametrize("planner", [spawning, spawn_and_crash])
def test_planner_processes_end_with_run(tmp_path, planner):
    spec = PlannerSpec("spawns", FunctionPlanner(planner, {"folder": str(tmp_path)}))
    expected = {spawning: "hung", spawn_and_crash: "crashed"}[planner]
    for patience in (0.5, 10.0, 100.0):  # a busy machine starts the child late
        (run,) = run_comparison(spec, QUERIES[:1], workers=1, patience=patience)
        children = [int(file.name) for file in tmp_path.iterdir()]
        if children and run.status == expected:
            break
    assert run.status == expected
    assert children
    assert comes_true(lambda: not any(map(alive, children)))


@pytest.mark.long
def test_script_without_main_guard_compares(tmp_path):
    """Workers do not import it again."""
    script = tmp_path / "script.py"
    script.write_text(
        f"""
import sys
sys.path[:0] = {[str(HERE), *filter(None, sys.path)]!r}
from locplan.planning import plan
from support.comparison_runs import run_comparison
def mine(costs, start, goal):
    return plan(costs, start, goal)

print([run.status for run in run_comparison(mine, workers=2)])
"""
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "['solved', 'solved']\n"), done.stderr


def test_run_comparison_rejects_wrong_input(tmp_path):
    def get_error(**changes):
        with pytest.raises(LocplanError) as caught:
            run_comparison(**{"planners": ["grid"]} | changes)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    in_wall = Query("wall", (8.5, 1.5), (1.5, 1.5))
    assert get_error(queries=[in_wall]).startswith(
        "map 'room', query 'wall': start 8.5,1.5 lies in a wall"
    )
    assert "heading" in get_error(planners=["RRTstar:space=SE2"])
    assert "one seed" in get_error(seeds=[])
    assert "one weight" in get_error(weights=[1, 1.0])
    assert "distinct names" in get_error(queries=QUERIES + QUERIES)
    assert "weight" in get_error(weights=[-1.0])
    blank = Costmap.blank(room_with_door().grid, robot=0.0)
    assert "no field" in get_error(costs=blank, weights=[4.0])
    assert "at least one planner" in get_error(planners=[])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("gird", "^planner must be one of"),
        ("grid:time_limit=2", "has no option 'time_limit'"),
        ("BITstar:time_limit", "must be NAME=VALUE"),
        ("BITstar:time_limit=soon", "must be a positive number of seconds"),
        ("BITstar:seed=0", "seed must be a whole number"),
        ("BITstar:progress=yes", "progress must be a function"),
        ("BITstar:name=grid", "has no option 'name'"),
        ("grid:via=1", "has no option 'via'"),
        ("grid:max_e=-1", "max_e must be a positive number"),
        ("any-angle:budget=2", "a budget is for planner 'grid'"),
        ("RRTstar:rage=2", "has no option 'rage'"),
        ("RRTstar:settings.range=2", "such as range=2"),
    ],
)
def test_planners_are_checked(text, complaint):
    with pytest.raises(ConfigError, match=complaint) as caught:
        PlannerSpec.parse(text)
    assert text in str(caught.value)


def test_time_limits_and_spaces_are_known():
    def limit(text):
        return PlannerSpec.parse(text).time_limit

    assert limit("BITstar:time_limit=2") == 2
    assert limit("BITstar") == 5
    assert limit("BITstar:iterations=10") is None
    assert limit("RRT:max_e=0.1") == 5
    assert limit("grid:budget=3,time_limit=2") == 2
    assert limit("grid") is None
    assert PlannerSpec.parse("PRM:space=SE2").planner.space == "SE2"
    assert PlannerSpec.parse("grid:allow_corner_cutting=true").planner == GridPlanner(True)


@pytest.mark.usefixtures("inline_workers")
def test_planner_without_headings_accepts_poses():
    posed = [Query("posed", (1.5, 1.5, 0.0), (14.5, 10.5, math.pi / 2))]
    runs = run_comparison(["grid", "RRTConnect:space=SE2,iterations=20000"], posed)
    assert {run.status for run in runs} == {"solved"}


@pytest.mark.usefixtures("inline_workers")
def test_blank_costmap_allows_zero_weight():
    blank = Costmap.blank(room_with_door().grid, robot=0.0)
    (run,) = run_comparison("grid", QUERIES[:1], costs=blank, weights=[0])
    assert run.measures["cost"] == pytest.approx(run.measures["length"])
    assert math.isnan(run.measures["integrated_u"])


@pytest.mark.usefixtures("inline_workers")
def test_planner_without_version_runs_again(tmp_path):
    calls, file = tmp_path / "calls", tmp_path / "runs.jsonl"
    calls.mkdir()
    mine = PlannerSpec("mine", FunctionPlanner(counting, {"folder": str(calls)}))
    for _ in range(2):
        run_comparison(mine, weights=[1.0], seeds=[1], journal=file)
    assert len(list(calls.iterdir())) == 2 * len(QUERIES)
