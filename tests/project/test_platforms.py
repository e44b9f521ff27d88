"""What is said where a system or an extra lacks something."""

import os
import subprocess
import sys
from importlib import import_module

import pytest
from support.cases import sample_cases
from support.costmaps import EMPTY_ROOM, ROOM_ENDS, blank_room

import locplan
from locplan._support.output import clear_abandoned_folders, strip_staging_folder, temporary_folder
from locplan._support.user_cache import find_kernel_root
from locplan.comparison import Execution, compare
from locplan.errors import LocplanError


@pytest.mark.parametrize(
    ("platform", "message"),
    [
        ("win32", "not available on Windows: .*; take grid"),
        ("linux", r"need ompl: pip install 'locplan\[ompl\]'"),
        ("darwin", "not available on macOS 14 .*macOS 15"),
    ],
)
def test_missing_ompl_error_names_remedy(monkeypatch, platform, message):
    bindings = "locplan.planning.ompl.settings"
    monkeypatch.delitem(sys.modules, bindings, raising=False)
    monkeypatch.setitem(sys.modules, "ompl", None)
    monkeypatch.setattr("sys.platform", platform)
    monkeypatch.setattr("sys.version_info", (3, 13, 0, "final", 0))
    monkeypatch.setattr("platform.mac_ver", lambda: ("14.7", ("", "", ""), "arm64"))
    with pytest.raises(LocplanError, match=message) as caught:
        import_module(bindings)
    assert "\n" not in str(caught.value)


def test_ompl_error_names_supported_python(monkeypatch):
    bindings = "locplan.planning.ompl.settings"
    monkeypatch.delitem(sys.modules, bindings, raising=False)
    monkeypatch.setitem(sys.modules, "ompl", None)
    monkeypatch.setattr("sys.version_info", (3, 14, 0, "final", 0))
    with pytest.raises(LocplanError, match=r"3\.14 .*Python 3\.13"):
        import_module(bindings)


def test_planning_works_without_ompl_and_posix():
    code = """
import sys
for name in ("ompl", "fcntl", "resource", "cloudpickle"):
    sys.modules[name] = None
import locplan.comparison
import locplan
from support.costmaps import ROOM_ENDS, blank_room
print(locplan.plan(blank_room(), *ROOM_ENDS, planner="any-angle").status)
for planner in ("RRTstar", "PRM"):
    try:
        locplan.plan(blank_room(), *ROOM_ENDS, planner=planner)
    except locplan.LocplanError as error:
        print(error)
"""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr
    status, *errors = done.stdout.splitlines()
    assert status == "solved"
    assert len(errors) == 2
    assert all("OMPL's planners" in error and "grid or any-angle" in error for error in errors)


def test_comparison_runs_without_posix_modules(tmp_path):
    """Windows has neither locks of `fcntl` nor limits of `resource`."""
    for name in ("fcntl", "resource"):  # workers find these first, and cannot import them
        (tmp_path / f"{name}.py").write_text(f"raise ModuleNotFoundError('{name}')")
    code = """
import locplan.comparison
from locplan.comparison import Execution, compare
from support.costmaps import ROOM_ENDS, blank_room
execution = Execution(workers=1, journal="runs.jsonl")
(run,) = compare({"room": blank_room()}, "grid", [ROOM_ENDS], execution=execution).runs
print(run.status, run.note)
"""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=env, cwd=tmp_path
    )
    assert (done.returncode, done.stdout) == (0, "solved \n"), done.stderr
    assert (tmp_path / "runs.jsonl").exists()


def test_unlocked_temporary_folder_is_not_abandoned(tmp_path, monkeypatch):
    """A process on Windows and one on Linux may write into one folder."""
    monkeypatch.setitem(sys.modules, "fcntl", None)
    with temporary_folder(tmp_path) as folder:
        monkeypatch.undo()
        clear_abandoned_folders(tmp_path)
        assert folder.exists()
        assert strip_staging_folder(f"{folder}/new/plan.csv") == f"{tmp_path}/plan.csv"
    assert not folder.exists()


def test_compare_runs_builtin_planners_without_cloudpickle(monkeypatch):
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    execution = Execution(workers=1)
    (run,) = compare({"room": blank_room()}, "grid", [ROOM_ENDS], execution=execution).runs
    assert run.status == "solved"


def command(folder, *arguments, env=(), before=None, **streams):
    """Exit code, and what a command said on standard output and standard error."""
    done = subprocess.run(
        [sys.executable, "-m", "locplan", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **dict(env)},
        preexec_fn=before,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **streams},
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    "backend", sample_cases(["module://matplotlib_inline.not_there", "nonsense"])
)
def test_pictures_ignore_matplotlib_backend_variable(tmp_path, backend):
    locplan.save_map(EMPTY_ROOM, tmp_path / "room.yaml")
    env = {"MPLBACKEND": backend, "MPLCONFIGDIR": "/proc/nowhere"}
    said = command(tmp_path, "info", "room.yaml", "-o", "a.png", env=env)
    assert (said[0], said[2].replace("locplan: drawing\n", "")) == (0, "")  # after a second
    assert (tmp_path / "a.png").exists()


def test_missing_home_is_one_notice(tmp_path):
    """Containers often run as a user without a home."""
    locplan.save_map(EMPTY_ROOM, tmp_path / "room.yaml")
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    env = dict.fromkeys(("HOME", "LOCALAPPDATA"), str(tmp_path / "file" / "home"))
    env |= dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(tmp_path / "temporary"))
    env |= dict.fromkeys(("LOCPLAN_CACHE", "MPLCONFIGDIR", "XDG_CACHE_HOME"), "")
    env["NUMBA_CACHE_DIR"] = str(find_kernel_root())  # compiling takes long
    words = "field", "room.yaml", "--field", "sad", "--stride", "1", "-o", "a.png"
    code, _, err = command(tmp_path, *words, env=env)
    assert code == 0, err
    lines = err.splitlines()
    assert ["cannot be written, so the cache is in" in line for line in lines].count(True) == 1
    assert all(line.startswith("locplan: ") for line in lines)  # further ones are slow steps
    (cache,) = (tmp_path / "temporary").iterdir()
    assert {"fields", "matplotlib"} <= {folder.name for folder in cache.iterdir()}


@pytest.mark.skipif(os.name != "posix", reason="Windows has no limits of a process")
@pytest.mark.parametrize("columns", sample_cases(["1", "0"]))
def test_help_ends_on_narrow_terminal(tmp_path, columns):
    def before():
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (30, 30))  # it went on for ever

    code, out, err = command(tmp_path, "plan", "--help", env={"COLUMNS": columns}, before=before)
    assert (code, err) == (0, "")
    assert "--goal" in out


@pytest.mark.skipif(os.name != "posix", reason="a shell of Unix closes streams")
@pytest.mark.parametrize("closed", sample_cases([(0, 1, 2), (1,)]))
def test_closed_streams_lead_nowhere(tmp_path, closed):
    locplan.save_map(EMPTY_ROOM, tmp_path / "room.yaml")

    def before():
        for number in closed:
            os.close(number)

    assert command(tmp_path, "info", "room.yaml", before=before) == (0, "", "")
