"""Output: whole or not at all, one command's results in a folder, and no user's file lost."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest
import yaml
from support.cases import sample_cases
from support.maps import ascii_map

from locplan._support import output
from locplan._support.drawing import NotebookFigure
from locplan._support.output import ResultFiles, ResultOutput, temporary_folder
from locplan._support.runs import RunRecord, pop_written_lines, record_run
from locplan._support.tables import format_rounded_up
from locplan.errors import LocplanError
from locplan.maps import find_maps, load_map, save_map

pytestmark = pytest.mark.usefixtures("undrawn")

ENDS = ("--start", "1,3", "--goal", "4,3")
PLAN = ("plan", *ENDS, "--stride", "0.5")


def write(folder, files, kind="plan", adds=False, **options):
    with ResultOutput(folder, kind, **options).writing(adds=adds) as new:
        for name, text in files.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_text(text)


def write_file(file, text, kind="path", **options):
    with ResultOutput(file, kind, is_file=True, **options).writing() as new:
        new.write_text(text)


def content(folder):
    """Texts of all files by name but for run.yaml, hidden ones included."""
    files = (each for each in folder.rglob("*") if each.is_file())
    texts = {each.relative_to(folder).as_posix(): each.read_text() for each in files}
    return {name: text for name, text in texts.items() if not name.endswith("run.yaml")}


def test_results_replace_and_remove_earlier_ones(tmp_path):
    folder = tmp_path / "new" / "out"
    write(folder, {"a": "1", "b": "1", "logs/c": "1", "more/d": "1"})
    write(folder, {"a": "2", "logs/c": "2"})
    assert content(tmp_path) == {"new/out/a": "2", "new/out/logs/c": "2"}
    assert not (folder / "more").exists()
    assert {*yaml.safe_load((folder / "run.yaml").read_text())["outputs"]} == {"a", "logs/c"}


@pytest.mark.parametrize("earlier", [{}, {"a": "1"}], ids=["never written", "changed"])
def test_output_refuses_other_files_without_force(tmp_path, earlier):
    if earlier:
        write(tmp_path, earlier | {"z": "1"})
    (tmp_path / "a").write_text("mine")
    fault = "was changed after locplan wrote it" if earlier else "was not written by"
    with pytest.raises(LocplanError, match=f"a: {fault}.*--force"):
        ResultFiles("plan", ("b",)).make_output(tmp_path)
    with pytest.raises(LocplanError, match=f"a: {fault}"):
        write(tmp_path, {"b": "2"})
    assert content(tmp_path) == {"a": "mine"} | ({"z": "1"} if earlier else {})
    write(tmp_path, {"b": "2"}, force=True)
    assert content(tmp_path) == {"a": "mine", "b": "2"}
    write(tmp_path, {"a": "3"}, force=True)
    assert content(tmp_path) == {"a": "3"}


def test_output_notes_purposes_of_written_files(tmp_path):
    files = dict.fromkeys(["chosen.csv", *(f"0{n}-way.csv" for n in range(5)), "errors.csv"], "1")
    purposes = {"chosen.csv": "the recommended path", "[0-9]*.csv": "a candidate path"}
    with record_run(RunRecord("plan", {})):
        write(tmp_path / "out", files, purposes=purposes)
        lines = pop_written_lines()
        assert pop_written_lines() == []
    assert lines[0] == f"wrote {tmp_path / 'out' / 'chosen.csv'}: the recommended path"
    assert len(lines) == 6
    assert lines[-1] == f"wrote {tmp_path / 'out'}: 2 more files"


def test_output_refuses_results_of_another_command(tmp_path):
    write(tmp_path, {"nav2_params.yaml": "1", "check.json": "1"}, kind="check")
    with pytest.raises(LocplanError, match=r"holds the results of another command \(check\)"):
        write(tmp_path, {"nav2_params.yaml": "2"}, kind="tuning")
    assert content(tmp_path) == {"nav2_params.yaml": "1", "check.json": "1"}
    write(tmp_path, {"nav2_params.yaml": "2"}, kind="tuning", force=True)
    assert content(tmp_path) == {"nav2_params.yaml": "2"}


def test_output_ignores_hidden_and_unfinished_files(tmp_path):
    (tmp_path / ".DS_Store").write_text("1")
    (tmp_path / "runs.jsonl").write_text("1")
    with pytest.raises(LocplanError, match=r"runs\.jsonl: was not written by"):
        write(tmp_path, {"a": "1"})
    for _ in range(2):
        write(tmp_path, {"a": "1"}, unfinished=("runs.jsonl",))
    assert content(tmp_path) == {".DS_Store": "1", "runs.jsonl": "1", "a": "1"}


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_output_refuses_folder_with_link(tmp_path, kind):
    target = tmp_path / "elsewhere"
    target.write_text("1") if kind == "file" else target.mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "link").symlink_to(target)
    with pytest.raises(LocplanError, match="link: was not written by"):
        write(tmp_path / "out", {"a": "1"})


def test_output_replaces_only_unchanged_file(tmp_path):
    file = tmp_path / "path.csv"
    write_file(file, "1")
    write_file(file, "2")
    with pytest.raises(LocplanError, match=r"path\.csv: holds the results of another command"):
        write_file(file, "3", kind="field")
    file.write_text("mine")
    with pytest.raises(LocplanError, match=r"path\.csv: was changed.*another file.*--force"):
        write_file(file, "3")
    write_file(file, "3", force=True)
    write_file(file, "4")
    assert content(tmp_path) == {"path.csv": "4"}


def test_file_of_others_is_refused(tmp_path):
    (tmp_path / "path.csv").write_text("mine")
    with pytest.raises(LocplanError, match=r"path\.csv: was not written by this command"):
        write_file(tmp_path / "path.csv", "1")
    assert content(tmp_path) == {"path.csv": "mine"}


def test_results_stay_if_nothing_is_written(tmp_path):
    write(tmp_path / "out", {"a": "1"})
    write(tmp_path / "out", {})
    assert content(tmp_path) == {"out/a": "1"}


def test_adding_files_keeps_earlier_results(tmp_path):
    for name in "ab":
        write(tmp_path, {name: "1"}, kind="maps", adds=True)
    assert set(content(tmp_path)) == {"a", "b"}
    write(tmp_path, {"a": "2"}, kind="maps")
    assert set(content(tmp_path)) == {"a"}
    write(tmp_path, {"c": "2"}, kind="plan", adds=True, force=True)
    assert set(content(tmp_path)) == {"c"}


def test_output_never_replaces_folder_by_file(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(LocplanError, match="is a folder"):
        write(tmp_path, {"a": "1"}, force=True)


@pytest.mark.parametrize("run", ["", "notes of mine", "[" * 200, "[1]", "kind: run", "\xff"])
def test_run_file_of_others_is_refused(tmp_path, run):
    (tmp_path / "run.yaml").write_text(run, encoding="latin-1")
    with pytest.raises(LocplanError, match=r"run\.yaml: was not written by"):
        write(tmp_path, {"a": "1"})
    assert (tmp_path / "run.yaml").read_text(encoding="latin-1") == run
    write(tmp_path, {"a": "1"}, force=True)
    write(tmp_path, {"a": "2"})
    assert content(tmp_path) == {"a": "2"}


def test_run_file_removes_nothing_outside_folder(tmp_path):
    folder = tmp_path / "out"
    write(folder, {"a": "1"})
    (tmp_path / "mine").write_text("1")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "mine").write_text("1")
    (folder / "link").symlink_to(tmp_path / "elsewhere")
    run = yaml.safe_load((folder / "run.yaml").read_text())
    for name in ("../mine", "link/mine", str(tmp_path / "mine")):
        run["outputs"][name] = run["outputs"]["a"]
    (folder / "run.yaml").write_text(yaml.safe_dump(run))
    write(folder, {"b": "1"}, force=True)
    assert content(tmp_path) == {"mine": "1", "elsewhere/mine": "1", "out/b": "1"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, LocplanError("x: no")])
@pytest.mark.parametrize("there", [False, True])
def test_failed_write_leaves_folder_unchanged(tmp_path, error, there):
    folder = tmp_path / "above" / "out"
    if there:
        write(folder, {"a": "1"})
    before = sorted(tmp_path.rglob("*")), content(tmp_path)

    def fail():
        with ResultOutput(folder, "plan").writing() as new:
            (new / "a").write_text("2")
            raise error

    with pytest.raises((KeyboardInterrupt, LocplanError)):
        fail()
    assert (sorted(tmp_path.rglob("*")), content(tmp_path)) == before


def test_next_run_finishes_failed_moves(tmp_path, monkeypatch):
    write(tmp_path, {"a": "1", "b": "1", "c": "1"})
    with pytest.raises(LocplanError, match="no, not now"), _moving_fails(monkeypatch, "b"):
        write(tmp_path, {"a": "2", "b": "2", "d": "2"})
    write(tmp_path, {"e": "1"}, adds=True)
    assert content(tmp_path) == {"a": "2", "b": "2", "d": "2", "e": "1"}


@contextmanager
def _moving_fails(monkeypatch, name):
    """Files move in this block, but for the one of this name."""
    move = os.replace

    def failing(source, target):
        if os.path.basename(target) == name:
            raise OSError(28, "no, not now")
        move(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", failing)
        yield


def test_interrupted_moves_are_finished_at_once(tmp_path, monkeypatch):
    write(tmp_path, {"a": "1", "b": "1"})
    move, done = os.replace, []

    def interrupt_once(source, target):
        if os.path.basename(target) == "b" and not done:
            done.append(target)
            raise KeyboardInterrupt
        move(source, target)

    monkeypatch.setattr(os, "replace", interrupt_once)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path, {"a": "2", "b": "2"})
    assert content(tmp_path) == {"a": "2", "b": "2"}


def test_error_names_final_file_path(tmp_path):
    """The file itself is still in a temporary folder."""
    with (
        pytest.raises(LocplanError, match=f"^{tmp_path}/out/a.png: no$"),
        ResultOutput(tmp_path / "out", "plan").writing() as new,
    ):
        raise LocplanError(f"{new / 'a.png'}: no")


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path[:0] = {path!r}
from locplan._support.output import ResultOutput
left = [{moves}]
def killing(step):
    def stepped(*arguments, **options):
        if not left[0]:
            os.kill(os.getpid(), signal.SIGKILL)
        left[0] -= 1
        return step(*arguments, **options)
    return stepped
with ResultOutput(Path("out"), "plan").writing() as new:
    for name in ("a", "b", "d"):
        (new / name).write_text("2")
    os.replace, os.unlink, os.rmdir = map(killing, (os.replace, os.unlink, os.rmdir))
    Path.unlink = killing(Path.unlink)
"""


@pytest.mark.skipif(os.name != "posix", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("has_results", sample_cases([True, False]))
def test_next_run_completes_or_undoes_moves(tmp_path, has_results):
    """Each process is killed one step later than the process before it."""
    old = {"a": "1", "b": "1", "c": "1"} if has_results else {}
    new, seen = {"a": "2", "b": "2", "d": "2"}, []
    for moves in range(20):
        home = tmp_path / str(moves)
        home.mkdir()
        if has_results:
            write(home / "out", old)
        code = KILLED.format(path=[entry for entry in sys.path if entry], moves=moves)
        exit_code = subprocess.run([sys.executable, "-c", code], cwd=home).returncode
        if not exit_code:
            break
        assert exit_code == -signal.SIGKILL
        write(home / "out", {"mine": "1"}, adds=True)
        after = content(home / "out")
        assert after.pop("mine") == "1"
        assert after in (old, new)
        assert not list(home.rglob(".locplan-*"))
        seen.append(after)
    assert {len(seen) > 5, old in seen, new in seen} == {True}


@pytest.mark.skipif(os.name != "posix", reason="Windows has no SIGKILL")
def test_recovery_keeps_files_changed_after_kill(tmp_path):
    write(tmp_path / "out", {"a": "1", "b": "1", "c": "1"})
    code = KILLED.format(path=[entry for entry in sys.path if entry], moves=2)
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path).returncode < 0
    (tmp_path / "out" / "b").write_text("mine")
    (tmp_path / "out" / "d").write_text("mine")
    with pytest.raises(LocplanError, match="b: was changed"):
        ResultFiles("plan", ()).make_output(tmp_path / "out")
    assert content(tmp_path / "out") == {"a": "2", "b": "mine", "d": "mine"}


def test_abandoned_folder_moves_nothing_outside_output(tmp_path):
    """A journal may come with files that somebody sent."""
    (tmp_path / "out").mkdir()
    with temporary_folder(tmp_path / "out") as staging:
        (staging / "new" / "link").mkdir(parents=True)
        for file in (staging / "b", staging / "new" / "link" / "c"):
            file.write_text("1")
        (tmp_path / "out" / "link").symlink_to(tmp_path)
        output.write_move_journal(staging, dict.fromkeys(("../b", "link/c", str(tmp_path / "d"))))
    assert [each.name for each in tmp_path.iterdir()] == ["out"]


@pytest.fixture
def room(tmp_path):
    grid = ascii_map("##########", *["#........#"] * 6, "#...#    #", "##########", resolution=0.5)
    for name in ("room", "other"):
        save_map(grid, tmp_path / f"{name}.yaml")
    return tmp_path / "room.yaml"


def test_interrupted_plan_leaves_folder_unchanged(run, room, tmp_path, monkeypatch):
    plan, out = [*PLAN, room, "-o", tmp_path / "out"], tmp_path / "out"
    assert run(*plan)[0] == 0
    before = {each: each.read_bytes() for each in out.iterdir()}
    assert {each.name for each in before} > {"choice.png", "chosen.csv", "run.yaml"}

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(NotebookFigure, "savefig", interrupted)
    assert run(*plan, "--weight", "9")[0] == 130
    assert {each: each.read_bytes() for each in out.iterdir()} == before


@pytest.mark.parametrize(
    "command",
    [
        (*PLAN, "ROOM", "-o", "OUT"),
        ("plan", "ROOM", *ENDS, "--front", "-o", "OUT"),
        ("simulate", *ENDS, "--drives", "2", "ROOM", "-o", "OUT"),
        ("simulate", "--random", "2", "--drives", "2", "ROOM", "-o", "OUT"),
        ("compare", "ROOM", "-o", "OUT"),
        ("check", "ROOM", "-o", "OUT"),
        ("tune", "ROOM", "-o", "OUT"),
        ("repair", "ROOM", "-o", "OUT"),
        ("recording", "none.npz", "ROOM", "-o", "OUT"),
        ("export", "ROOM", "--to", "nav2-keepout", "-o", "OUT"),
        ("info", "hall", "-o", "OUT"),
        ("field", "ROOM", "OTHER", "--picture", "e", "-o", "OUT"),
        ("field", "ROOM", "OTHER", "-o", "OUT"),
    ],
    ids=lambda command: "-".join(part for part in command if part.strip("-").islower()),
)
def test_commands_refuse_folder_with_other_files(run, room, tmp_path, command):
    (tmp_path / "OUT").mkdir()
    (tmp_path / "OUT" / "notes.txt").write_text("mine")
    places = {"ROOM": room, "OTHER": tmp_path / "other.yaml", "OUT": tmp_path / "OUT"}
    code, out, err = run(*(places.get(each, each) for each in command))
    assert code == 2
    assert "OUT/notes.txt: was not written by this command; name another folder" in out + err
    assert [each.name for each in (tmp_path / "OUT").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (("info", "ROOM", "-o", "OUT"), "a.png"),
        (("field", "ROOM", "-o", "OUT"), "a.png"),
        (("field", "ROOM", "-o", "OUT"), "a.npz"),
        (("export", "ROOM", "--to", "path", *ENDS, "-o", "OUT"), "a.csv"),
    ],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_commands_refuse_file_of_user(run, room, tmp_path, command, name):
    file = tmp_path / name
    file.write_text("mine")
    command = [{"ROOM": room, "OUT": file}.get(each, each) for each in command]
    code, _, err = run(*command)
    assert code == 2
    assert f"{name}: was not written by this command; name another file" in err
    assert file.read_text() == "mine"
    assert [run(*command, "--force")[0], run(*command)[0]] == [0, 0]
    assert (tmp_path / f"{name}.run.yaml").exists()


def test_landmarks_command_checks_folder_first(run, room, tmp_path, monkeypatch):
    placed = []
    monkeypatch.setattr("locplan.place_landmarks", lambda *_, **__: placed.append(1))
    command = "landmarks", room, *ENDS, "--object", "pole", "--lidar", "turtlebot4", "-o", tmp_path
    code, _, err = run(*command)
    assert (code, placed) == (2, [])
    assert "other.pgm: was not written by" in err


def test_picture_never_replaces_map_image(run, room, tmp_path):
    save_map(load_map(room), tmp_path / "lab.yaml", image_format="png")
    before = (tmp_path / "lab.png").read_bytes()
    code, _, err = run("field", tmp_path / "lab.yaml", "-o", tmp_path / "lab.png", "--force")
    assert code == 2
    assert "replaces lab.png, a map" in err
    assert (tmp_path / "lab.png").read_bytes() == before


def test_input_is_protected_under_other_case(run, room, tmp_path):
    """On macOS and Windows LAB.png is lab.png; here, a second link to it stands for that."""
    save_map(load_map(room), tmp_path / "lab.yaml", image_format="png")
    (tmp_path / "LAB.png").hardlink_to(tmp_path / "lab.png")
    before = (tmp_path / "lab.png").read_bytes()
    code, _, err = run("field", tmp_path / "lab.yaml", "-o", tmp_path / "LAB.png", "--force")
    assert code == 2
    assert "replaces lab.png, a map" in err
    assert (tmp_path / "LAB.png").read_bytes() == before


def test_export_never_replaces_input_map(run, room, tmp_path):
    mask = tmp_path / "keepout"
    assert run("export", room, "--to", "nav2-keepout", "-o", mask)[0] == 0
    before = {each: each.read_bytes() for each in mask.iterdir()}
    code, _, err = run("export", mask / "mask.yaml", "--to", "nav2-speed", "-o", mask, "--force")
    assert code == 2
    assert "replaces mask." in err
    assert {each: each.read_bytes() for each in mask.iterdir()} == before


def test_map_search_skips_exported_masks(run, room, tmp_path):
    folder = tmp_path / "maps"
    save_map(load_map(room), folder_of(folder) / "room.yaml")
    for _ in range(2):
        assert run("export", folder, "--to", "nav2-keepout", "-o", folder / "keepout")[0] == 0
    assert find_maps(folder) == [folder / "room.yaml"]
    assert len(find_maps(folder / "keepout")) == 1


@pytest.mark.usefixtures("inline_workers")
def test_force_restarts_comparison(run, room, tmp_path):
    least = "--min-distance", "1"
    few = "--random", "2", "--planner", "any-angle", "--workers", "1"
    compare = ("compare", room, *few, *least, "-o", tmp_path / "out")
    journal = tmp_path / "out" / "runs.jsonl"
    assert run(*compare)[0] == 0
    before = journal.read_text()
    assert run(*compare)[0] == 0
    assert journal.read_text() == before
    code, _, err = run(*compare, "--weight", "2")
    assert code == 2
    assert err.endswith(
        "other settings (weights); name another file, or replace them with --force\n"
    )
    assert run(*compare, "--force", "--weight", "2")[0] == 0
    assert len(journal.read_text().splitlines()) == 3


def test_budget_in_table_is_rounded_up():
    """Rounded down, the budget would exclude its path."""
    for value in (4.17538, 7.3791, 0.00012344, 9999.6, 3.0, 0.0):
        assert value <= float(format_rounded_up(value)) <= value * 1.002


def folder_of(path):
    path.mkdir()
    return path
