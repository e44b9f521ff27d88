"""Folders of results: whole or not at all, and nothing of the user's lost."""

import json
import os
import signal
from contextlib import contextmanager

import pytest
from conftest import drawn

from locplan import plotting
from locplan._util import results
from locplan._util.tables import rounded_up
from locplan.errors import LocplanError
from locplan.maps import find_maps, load_map, save_map

ENDS = ("--start", "1,3", "--goal", "4,3")
PLAN = ("plan", *ENDS, "--stride", "0.5")


def write(folder, files, kind="plan", **options):
    with results.ResultFolder(folder, kind, **options).writing() as new:
        for name, text in files.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_text(text)


def content(folder):
    files = (each for each in folder.rglob("*") if each.is_file() and each.name != results.MANIFEST)
    return {each.relative_to(folder).as_posix(): each.read_text() for each in files}


def test_files_of_an_earlier_run_are_replaced_and_removed_and_no_others(tmp_path):
    folder = tmp_path / "new" / "out"
    write(folder, {"a": "1", "b": "1", "logs/c": "1"})
    write(folder, {"x": "1"}, kind="pareto")
    (folder / "mine").write_text("mine")
    write(folder, {"a": "2", "logs/c": "2"})
    assert content(folder) == {"a": "2", "logs/c": "2", "x": "1", "mine": "mine"}
    assert list(tmp_path.rglob(".locplan-*")) == []


@pytest.mark.parametrize("earlier", [{}, {"a": "1"}], ids=["never written", "changed since"])
def test_a_file_that_is_not_as_locplan_wrote_it_is_in_the_way(tmp_path, earlier):
    write(tmp_path, earlier | {"z": "1"})
    (tmp_path / "a").write_text("mine")
    with pytest.raises(LocplanError, match=r"a: is in the way.*--force"):
        results.Results("plan", ("a",)).into(tmp_path)
    with pytest.raises(LocplanError, match="a: is in the way"):
        write(tmp_path, {"a": "2", "z": "2"})
    assert content(tmp_path) == {"a": "mine", "z": "1"}
    write(tmp_path, {"a": "2", "z": "2"}, force=True)
    assert content(tmp_path) == {"a": "2", "z": "2"}


def test_a_file_that_is_no_longer_written_stays_if_it_was_changed(tmp_path):
    write(tmp_path, {"history.png": "1", "a": "1"})
    (tmp_path / "history.png").write_text("mine")
    write(tmp_path, {"a": "2"})
    assert content(tmp_path) == {"history.png": "mine", "a": "2"}


def test_a_file_with_the_same_content_is_not_in_the_way(tmp_path):
    (tmp_path / "a").write_text("1")
    write(tmp_path, {"a": "1"})
    assert content(tmp_path) == {"a": "1"}


def test_others_stay_where_wanted(tmp_path):
    for name in "ab":
        with results.ResultFolder(tmp_path, "maps").writing(others_stay=True) as new:
            (new / name).write_text("1")
    assert set(content(tmp_path)) == {"a", "b"}
    write(tmp_path, {"a": "2"}, kind="maps")  # the manifest knows b still
    assert set(content(tmp_path)) == {"a"}


def test_a_folder_in_the_way_is_never_replaced(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(LocplanError, match="is a folder"):
        write(tmp_path, {"a": "1"}, force=True)


@pytest.mark.parametrize(
    "manifest",
    [
        "",
        "notes of mine",
        "[" * 5000,
        "[1]",
        '{"plan": 3}',
        '{"plan": {"a": []}}',
        '{"plan": {"a\\u0000b": "1"}}',
        '{"plan": {"\\ud800": "1"}}',
        "\xff",
    ],
)
def test_a_manifest_that_is_none_of_ours_is_in_the_way(tmp_path, manifest):
    (tmp_path / results.MANIFEST).write_text(manifest, encoding="latin-1")
    with pytest.raises(LocplanError, match=f"{results.MANIFEST}: is in the way, and no list"):
        results.Results("plan", ("a",)).into(tmp_path)
    with pytest.raises(LocplanError, match=f"{results.MANIFEST}: is in the way, and no list"):
        write(tmp_path, {"a": "1"})
    assert (tmp_path / results.MANIFEST).read_text(encoding="latin-1") == manifest
    write(tmp_path, {"a": "1"}, force=True)
    write(tmp_path, {"a": "2"})
    assert content(tmp_path) == {"a": "2"}


def test_a_folder_of_the_manifests_name_is_never_replaced(tmp_path):
    (tmp_path / results.MANIFEST).mkdir()
    with pytest.raises(LocplanError, match="is in the way"):
        write(tmp_path, {"a": "1"}, force=True)
    assert (tmp_path / results.MANIFEST).is_dir()


def test_a_manifest_removes_nothing_outside_of_its_folder(tmp_path):
    (tmp_path / "mine").write_text("1")
    write(tmp_path / "out", {"a": "1"})
    known = json.loads((tmp_path / "out" / results.MANIFEST).read_text())
    known["plan"]["../mine"] = known["plan"]["a"]
    (tmp_path / "out" / results.MANIFEST).write_text(json.dumps(known))
    write(tmp_path / "out", {"b": "1"})
    assert (tmp_path / "mine").exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt, LocplanError("x: no")])
@pytest.mark.parametrize("there", [False, True])
def test_an_interrupted_block_leaves_the_folder_as_it_was(tmp_path, error, there):
    folder = tmp_path / "above" / "out"
    if there:
        write(folder, {"a": "1"})
    before = sorted(tmp_path.rglob("*")), content(tmp_path)

    def interrupted():
        with results.ResultFolder(folder, "plan").writing() as new:
            (new / "a").write_text("2")
            raise error

    with pytest.raises((KeyboardInterrupt, LocplanError)):
        interrupted()
    assert (sorted(tmp_path.rglob("*")), content(tmp_path)) == before


@pytest.mark.parametrize("fails_at", range(1, 6))
def test_a_failure_while_files_move_undoes_all_moves(tmp_path, monkeypatch, fails_at):
    write(tmp_path, {"a": "1", "b": "1", "c": "1"})
    before = content(tmp_path)
    replace, done = results._replace, []

    def failing(*arguments):
        done.append(arguments)
        if len(done) == fails_at:
            raise OSError(28, "No space left on device")
        replace(*arguments)

    monkeypatch.setattr(results, "_replace", failing)
    with pytest.raises(LocplanError, match="No space left"):
        write(tmp_path, {"a": "2", "b": "2", "d": "2"})
    assert content(tmp_path) == before
    assert list(tmp_path.rglob(".locplan-*")) == []


@pytest.mark.parametrize("links", [True, False])
def test_a_failure_puts_a_link_of_the_users_back_as_a_link(tmp_path, monkeypatch, links):
    (tmp_path / "elsewhere").write_text("1")
    folder = tmp_path / "out"
    write(folder, {"a": "1", "b": "1"})
    (folder / "a").unlink()
    (folder / "a").symlink_to(tmp_path / "elsewhere")
    if not links:  # as on file systems without hard links
        monkeypatch.setattr(os, "link", _no_links)
    (folder / "b").unlink()
    with pytest.raises(LocplanError, match="no, not now"), _moving_fails(monkeypatch, "b"):
        write(folder, {"a": "2", "b": "2"})
    assert (folder / "a").is_symlink()
    assert (tmp_path / "elsewhere").read_text() == "1"


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


def test_errors_name_the_last_place_of_a_file(tmp_path):
    with (
        pytest.raises(LocplanError, match=f"^{tmp_path}/out/a.png: no$"),
        results.ResultFolder(tmp_path / "out", "plan").writing() as new,
    ):
        raise LocplanError(f"{new / 'a.png'}: no")


@pytest.mark.parametrize("links", [True, False])
def test_a_process_that_is_killed_while_files_move_leaves_only_files_that_are_ours(
    tmp_path, monkeypatch, links
):
    earlier = {"a": "1", "b": "1", "c": "1"}
    replace = results._replace
    if not links:  # as on file systems without hard links
        monkeypatch.setattr(os, "link", _no_links)
    for count in range(1, 6):
        folder = tmp_path / str(count)
        write(folder, earlier)
        calls = []

        def killed(*arguments, calls=calls, count=count):
            calls.append(arguments)
            if len(calls) == count:
                raise SystemExit  # nothing is undone, as if the process were gone
            replace(*arguments)

        with monkeypatch.context() as patched:
            patched.setattr(results, "_replace", killed)
            patched.setattr(results.ExitStack, "__exit__", lambda *_: None)
            with pytest.raises(SystemExit):
                write(folder, {"a": "2", "b": "2", "d": "2"})
        assert content(folder).keys() >= {"a", "b"}
        write(folder, {"a": "3"})
        assert content(folder) == {"a": "3"}


def _no_links(*_, **__):
    raise OSError(95, "Operation not supported")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupts_are_put_off_until_the_block_ends(number):
    done, before = [], signal.getsignal(number)
    signal.signal(number, lambda *_: done.append("signal"))
    try:
        with results.interrupts_put_off():
            os.kill(os.getpid(), number)
            done.append("block")
        assert done == ["block", "signal"]
    finally:
        signal.signal(number, before)


def test_ctrl_c_while_files_move_waits_until_all_have_moved(tmp_path, monkeypatch):
    write(tmp_path, {"a": "1", "b": "1"})
    replace = results._replace

    def interrupting(*arguments):
        os.kill(os.getpid(), signal.SIGINT)
        replace(*arguments)

    monkeypatch.setattr(results, "_replace", interrupting)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # the shell may ignore it
    try:
        with pytest.raises(KeyboardInterrupt):
            write(tmp_path, {"a": "2", "b": "2"})
    finally:
        signal.signal(signal.SIGINT, before)
    assert content(tmp_path) == {"a": "2", "b": "2"}


@pytest.fixture
def room(tmp_path):
    grid = drawn("##########", *["#........#"] * 6, "#...#    #", "##########", resolution=0.5)
    for name in ("room", "other"):
        save_map(grid, tmp_path / f"{name}.yaml")
    return tmp_path / "room.yaml"


def test_a_plan_that_is_interrupted_while_it_draws_leaves_its_folder_as_it_was(
    run, room, tmp_path, monkeypatch
):
    plan, out = [*PLAN, room, "-o", tmp_path / "out"], tmp_path / "out"
    assert run(*plan)[0] == 0
    before = {each: each.read_bytes() for each in out.iterdir()}
    assert {each.name for each in before} > {"choice.png", "chosen.csv", results.MANIFEST}

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(plotting.Picture, "savefig", interrupted)
    assert run(*plan, "--weight", "9")[0] == 130
    assert {each: each.read_bytes() for each in out.iterdir()} == before


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ((*PLAN, "ROOM", "-o", "OUT", "--planner", "BITstar"), "history.png"),
        ((*PLAN, "ROOM", "-o", "OUT"), "chosen.csv"),
        (("plan", "ROOM", *ENDS, "--front", "-o", "OUT"), "front.csv"),
        (("simulate", *ENDS, "--drives", "2", "ROOM", "-o", "OUT"), "errors.csv"),
        (("simulate", "--random", "2", "--drives", "2", "ROOM", "-o", "OUT"), "01-room.png"),
        (("compare", "ROOM", "-o", "OUT"), "runs.csv"),
        (("info", "hall", "-o", "OUT"), "hall.pgm"),
        (("field", "ROOM", "OTHER", "--picture", "e", "-o", "OUT"), "room.png"),
    ],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_a_file_of_the_users_is_in_the_way(run, room, tmp_path, command, name):
    (tmp_path / "OUT").mkdir()
    (tmp_path / "OUT" / name).write_text("mine")
    places = {"ROOM": room, "OTHER": tmp_path / "other.yaml", "OUT": tmp_path / "OUT"}
    code, out, err = run(*(places.get(each, each) for each in command))
    assert code == 2
    assert f"{name}: is in the way" in out + err
    assert (tmp_path / "OUT" / name).read_text() == "mine"


def test_landmarks_are_not_placed_where_a_file_is_in_the_way(run, room, tmp_path, monkeypatch):
    placed = []
    monkeypatch.setattr("locplan.place_landmarks", lambda *_, **__: placed.append(1))
    (tmp_path / "landmarks.csv").write_text("mine")
    command = "landmarks", room, *ENDS, "--object", "pole", "--lidar", "turtlebot4", "-o", tmp_path
    code, _, err = run(*command)
    assert (code, placed) == (2, [])
    assert "landmarks.csv: is in the way" in err


def test_other_files_in_a_field_are_in_the_way(run, room, tmp_path):
    field = tmp_path / "f.zarr"
    assert [run("field", room, "-o", field)[0] for _ in range(2)] == [0, 0]
    (field / "notes.txt").write_text("mine")
    code, _, err = run("field", room, "-o", field)
    assert code == 2
    assert "notes.txt: is in the way, and not locplan's" in err
    assert run("field", room, "-o", field, "--force")[0] == 0
    assert not (field / "notes.txt").exists()
    (field / "mine").symlink_to(tmp_path)
    assert "f.zarr/mine: is in the way" in run("field", room, "-o", field)[2]


def test_a_folder_that_is_no_field_is_never_replaced_by_one(run, room, tmp_path):
    (tmp_path / "mine.zarr").mkdir()
    (tmp_path / "mine.zarr" / "data").write_text("mine")
    code, _, err = run("field", room, "-o", tmp_path / "mine.zarr", "--force")
    assert code == 2
    assert "mine.zarr: is there, and not as locplan wrote it" in err
    assert (tmp_path / "mine.zarr" / "data").read_text() == "mine"


def test_no_picture_takes_the_place_of_another_maps_image(run, room, tmp_path):
    save_map(load_map(room), tmp_path / "lab.yaml", image_format="png")
    before = (tmp_path / "lab.png").read_bytes()
    code, _, err = run("field", room, "-o", tmp_path / "lab.png")
    assert code == 2
    assert "replaces lab.png, a map" in err
    assert (tmp_path / "lab.png").read_bytes() == before


def test_no_export_takes_the_place_of_the_map_that_it_is_made_of(run, room, tmp_path):
    mask = tmp_path / "keepout"
    assert run("export", room, "--to", "nav2-keepout", "-o", mask)[0] == 0
    before = sorted(mask.iterdir())
    code, _, err = run("export", mask / "mask.yaml", "--to", "nav2-speed", "-o", mask)
    assert code == 2
    assert "keepout: replaces mask." in err
    assert sorted(mask.iterdir()) == before


def test_masks_that_were_exported_are_no_maps_of_a_folder(run, room, tmp_path):
    folder = tmp_path / "maps"
    save_map(load_map(room), folder_of(folder) / "room.yaml")
    for _ in range(2):
        assert run("export", folder, "--to", "nav2-keepout", "-o", folder / "keepout")[0] == 0
    assert find_maps(folder) == [folder / "room.yaml"]
    assert len(find_maps(folder / "keepout")) == 1


@pytest.mark.usefixtures("inline_workers")
def test_a_comparison_begins_anew_by_force(run, room, tmp_path):
    least = "--min-distance", "1"
    few = "--random", "2", "--planner", "any-angle", "--workers", "1"
    compare = ("compare", room, *few, *least, "-o", tmp_path / "out")
    journal = tmp_path / "out" / "runs.jsonl"
    assert run(*compare)[0] == 0
    before = journal.read_text()
    assert run(*compare)[0] == 0
    assert journal.read_text() == before
    code, _, err = run(*compare, "--weight", "2")
    assert (code, "other settings (weights)" in err) == (2, True)
    assert run(*compare, "--force", "--weight", "2")[0] == 0
    assert len(journal.read_text().splitlines()) == 3


def test_a_front_in_a_table_has_integrals_that_serve_as_budgets():
    for value in (4.17538, 7.3791, 0.00012344, 9999.6, 3.0, 0.0):
        assert value <= float(rounded_up(value)) <= value * 1.002


def folder_of(path):
    path.mkdir()
    return path
