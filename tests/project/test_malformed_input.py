"""Files and settings that once broke a reader, took all memory, or made an error of 226 MB."""

import gzip
import itertools
import json
import math
import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.command_line import check_refusal
from support.hostile_files import GRID, OPEN, RUN, SMALL, cache_files, make_field
from support.maps import ascii_map

from locplan._support import reading
from locplan.comparison.benchmarks import read_movingai_map, read_scenarios
from locplan.comparison.journal import RunJournal
from locplan.errors import ConfigError, FieldError, LocplanError, MapError
from locplan.export.registry import list_formats
from locplan.field import (
    CovarianceField,
    FieldConfig,
    Fisher,
    Sad,
    Scan,
    SearchWindow,
    covariance_field,
    load_or_compute,
)
from locplan.field.cache import cache_folder, format_cache_table, list_cache_entries
from locplan.field.compute import find_lidar_cells
from locplan.field.store import field_path
from locplan.maps import OccupancyGrid, load_map, save_map
from locplan.maps.files import map_name_from_file
from locplan.recordings import read_recording
from locplan.robots import Amcl, Lidar, read_parameters
from locplan.robots.nav2 import read_amcl

DEEP = "[" * 5000


# --- parameters of Nav2 -----------------------------------------------------------------------


def nav2(folder: Path, text: str) -> Path:
    file = folder / "nav2.yaml"
    file.write_text(text, "utf-8")
    return file


def bomb(head: str) -> str:
    """YAML whose aliases stand for 9^7 values."""
    lines = [f"{head}a0: &a0 [x]"]
    for n in range(7):
        lines.append(f"a{n + 1}: &a{n + 1} [{', '.join([f'*a{n}'] * 9)}]")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        bomb("") + "amcl: *a7\n",
        bomb("") + "global_costmap: {global_costmap: {ros__parameters: {plugins: *a7}}}\n",
        "amcl: &a [*a]\n",
        "a: &a {<<: [{b: 1}]}\nb: &b {<<: [*a, *a]}\namcl: {<<: *b}\nc: &c [*c]\n",
    ],
)
def test_parameter_file_refuses_alias_bomb(tmp_path, text):
    with pytest.raises(MapError, match="aliases stand for over 100000 values; write out"):
        read_parameters(nav2(tmp_path, text))


def test_parameter_error_cuts_long_value(tmp_path):
    names = ", ".join(f"[{n}]" for n in range(5000))
    text = f"planner_server: {{ros__parameters: {{planner_plugins: [{names}]}}}}\n"
    with pytest.raises(LocplanError, match="must be a list of names, not") as caught:
        read_parameters(nav2(tmp_path, text))
    assert len(str(caught.value)) < 300


def test_parameters_resolve_aliases_and_merged_keys(tmp_path):
    text = (
        "base: &base {z_hit: 0.7, z_rand: 0.3}\namcl: {ros__parameters: {<<: *base, z_rand: 1}}\n"
    )
    file = nav2(tmp_path, text)
    own = read_parameters(file).read_node_parameters("amcl")
    assert own == {"z_hit": 0.7, "z_rand": 1}
    assert read_amcl(file) == Amcl(z_hit=0.7, z_rand=1)


def test_keys_and_unknown_types_become_text(tmp_path):
    text = "amcl:\n  ros__parameters:\n    a: 2001-12-14\n    b: 2020-13-45\n    c: !!int x\n"
    text += (
        "    ~: 1\n    2020-01-01: 2\n    [1, 2]: 3\n    5: 4\n    d: ~\n    e: [1, 2.5, true]\n"
    )
    file = nav2(tmp_path, text)
    own = read_parameters(file).read_node_parameters("amcl")
    odd = {"~": 1, "2020-01-01": 2, "?": 3, "5": 4, "d": None, "e": [1, 2.5, True]}
    assert own == {"a": "2001-12-14", "b": "2020-13-45", "c": "x", **odd}
    with pytest.warns(UserWarning, match="not simulated: .*2020-01-01"):
        read_amcl(file)


@pytest.mark.parametrize(
    "text", [DEEP, "- " * 3000, "a: " + DEEP, "\x00", "a: b: c", "", "[]", "a"]
)
def test_file_without_parameters_is_refused(tmp_path, text):
    with pytest.raises(LocplanError):
        read_parameters(nav2(tmp_path, text))


@pytest.mark.parametrize("text", [DEEP, "{" * 60000, "a: " + DEEP, "{[" * 51])
def test_deep_brackets_are_refused_before_parsing(tmp_path, monkeypatch, text):
    monkeypatch.setattr("yaml.compose", lambda *_, **__: pytest.fail("it is parsed"))
    for read in (read_parameters, load_map):
        with pytest.raises(MapError, match="has brackets over 100 deep"):
            read(nav2(tmp_path, text))


def test_numbers_over_64_bits_become_text(tmp_path):
    for value in ("0x" + "f" * 4000, str(2**63)):
        read = read_parameters(nav2(tmp_path, f"amcl: {{ros__parameters: {{a: {value}}}}}\n"))
        assert read.read_node_parameters("amcl") == {"a": value}
        yaml.safe_dump(read.content)
    file = nav2(tmp_path, f"amcl: {{ros__parameters: {{a: {-(2**63)}}}}}\n")
    assert read_parameters(file).read_node_parameters("amcl") == {"a": -(2**63)}


def test_amcl_rejects_number_beyond_float_range(tmp_path):
    for value in ("9" * 400, "9" * 5000, "0x" + "f" * 4000, "1e400"):
        file = nav2(tmp_path, f"amcl: {{ros__parameters: {{alpha1: {value}}}}}\n")
        with pytest.raises(LocplanError, match="alpha1 must be"):
            read_amcl(file)


# --- maps -------------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [0.0009, 1e-8, 10.1, 50, 10**400])
def test_grid_rejects_implausible_resolution(resolution):
    with pytest.raises(MapError, match=r"resolution must be 0\.001 to 10 m per cell"):
        OccupancyGrid(np.zeros((2, 2), np.uint8), resolution)
    with pytest.raises(MapError, match=r"not 0.0001; is it metres\?"):
        OccupancyGrid(np.zeros((2, 2), np.uint8), 1e-4)


@pytest.mark.parametrize("origin", [(10**400, 0, 0), (1e12, 0, 0), (0, 0, 1e300), "abc"])
def test_origins_beyond_all_maps_are_refused(origin):
    with pytest.raises(MapError, match="origin must be three"):
        OccupancyGrid(np.zeros((2, 2), np.uint8), 0.1, origin)


def test_map_name_replaces_invalid_characters(tmp_path):
    folder = tmp_path / os.fsdecode(b"h\xffall")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system has names in UTF-8 only")
    save_map(ascii_map("..."), folder / "map.yaml")
    assert load_map(folder).name == map_name_from_file(folder / "map.yaml") == "h\ufffdall"
    assert OccupancyGrid(np.zeros((1, 1), np.uint8), 1, name="a\nb\udcff").name == "a\ufffdb\ufffd"


@pytest.mark.parametrize("command", ["field", "export"])
def test_commands_accept_undecodable_file_name(run, tmp_path, monkeypatch, command):
    file = tmp_path / os.fsdecode(b"h\xffall.yaml")
    save_map(ascii_map(*["....."] * 5, resolution=0.5), tmp_path / "a.yaml")
    try:
        (tmp_path / "a.yaml").rename(file)
    except OSError:
        pytest.skip("this file system has names in UTF-8 only")
    monkeypatch.chdir(tmp_path)
    more = {
        "field": ["-o", "a.png", "--json"],
        "export": ["--to", "ros-map"],
    }
    code, out, err = run(command, file, *more[command])
    assert (code, "Traceback" in err) == (0, False)
    text = out.replace("\\ufffd", "\ufffd")  # JSON escapes it
    assert "h\ufffdall" in text
    assert text.replace("\n", "").isprintable()


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("a.map", "type octile\nheight 1\nwidth 1\nmap\n" + "\U0001f9ed." + "\n..\n", None),
        ("a.map", "type octile\nheight 1\nwidth 1\nmap\n...\n..\n", "the same length"),
        ("a.map", "map", "is not a MovingAI map"),
        ("a.map", "\0", "is not a MovingAI map"),
    ],
)
def test_movingai_maps_are_read_or_refused(tmp_path, name, text, fault):
    (tmp_path / name).write_text(text, "utf-8")
    if fault is None:
        assert read_movingai_map(tmp_path / name).free.tolist() == [[True, True], [False, True]]
        return
    with pytest.raises(LocplanError, match=fault):
        read_movingai_map(tmp_path / name)


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("0 a.map 4 3 0 0 4 2 1.0", "outside its map"),
        ("0 a.map 4 3 -1 0 3 2 1.0", "outside its map"),
        (f"0 a.map 4 3 0 0 {'9' * 400} 2 1.0", "outside its map"),
        (f"0 a.map {'9' * 400} 3 0 0 0 2 1.0", "is for a map of a number of 1329 bits"),
        ("0 a.map 4", "is not a scenario"),
    ],
)
def test_scenarios_must_fit_map(tmp_path, line, fault):
    (tmp_path / "a.scen").write_text(f"version 1\n{line}\n")
    with pytest.raises(LocplanError, match=fault):
        read_scenarios(tmp_path / "a.scen", OPEN)


# --- fields, and their cache ------------------------------------------------------------------


GARBAGE = [DEEP, "", "[]", "null", '{"kind": []}', '{"kind": ' + DEEP]


def described(file: Path, text: str) -> None:
    """Replace the description in a file of a field."""
    with np.load(file) as arrays:
        content = dict(arrays)
    np.savez(file, **content | {"about": np.array(text)})


def with_changes(file: Path, **changes: object) -> None:
    """Change entries of the description in a file of a field."""
    with np.load(file) as arrays:
        about = json.loads(str(arrays["about"]))
    described(file, json.dumps(about | changes))


@pytest.mark.parametrize("garbage", GARBAGE)
def test_garbage_description_is_computed_again(tmp_path, garbage, caplog):
    cache_files(tmp_path)
    described(field_path(GRID, SMALL, tmp_path), garbage)
    found = list_cache_entries(tmp_path)
    assert sorted(entry.to_json()["map"] for entry in found) == ["", "room"]
    assert format_cache_table(found, tmp_path).count("room") == 1
    field = load_or_compute(GRID, SMALL, cache_dir=tmp_path)
    assert "computed again" in caplog.text
    caplog.clear()
    again = load_or_compute(GRID, SMALL, cache_dir=tmp_path)
    assert not caplog.records
    np.testing.assert_array_equal(field.covariance, again.covariance)


@pytest.mark.parametrize(
    "changes",
    [
        {"map": ["a", "list"]},
        {"config": "sad"},
        {"config": []},
        {"origin": 0.0},
        {"resolution": "fine"},
        {"resolution": None},
        {"kind": ["a"] * 1000},
    ],
)
def test_cache_survives_entry_of_wrong_type(tmp_path, changes):
    cache_files(tmp_path)
    file = field_path(GRID, SMALL, tmp_path)
    with_changes(file, **changes)
    found = list_cache_entries(tmp_path)
    assert [entry.finished_share for entry in found] == [1.0, 1.0]
    json.dumps([entry.to_json() for entry in found])
    assert format_cache_table(found, tmp_path)
    with pytest.raises(LocplanError) as error:
        CovarianceField.load(file)
    assert str(file) in str(error.value)


def test_cache_list_cuts_long_texts(tmp_path):
    cache_files(tmp_path)
    with_changes(field_path(GRID, SMALL, tmp_path), map="a" * 9999, title="b" * 9999)
    found = list_cache_entries(tmp_path)
    assert len(format_cache_table(found, tmp_path)) < 5000
    assert len(json.dumps([entry.to_json() for entry in found])) < 5000


def test_field_file_refuses_oversized_arrays(tmp_path):
    file = tmp_path / "f.npz"
    make_field().save(file)
    with np.load(file) as arrays:
        content = dict(arrays)
    for name in ("covariance", "about"):
        np.savez_compressed(file, **content | {name: np.zeros(10**7)})
        tracemalloc.start()
        with pytest.raises(FieldError, match=r"its arrays take 80 MB, of at most"):
            CovarianceField.load(file)
        assert tracemalloc.get_traced_memory()[1] < 10**7
        tracemalloc.stop()


@pytest.mark.parametrize("text", [DEEP, "[]", '{"outputs": []}', "kind: run\nversion: 1", "\0"])
def test_export_refuses_damaged_run_file(tmp_path, text):
    (tmp_path / "run.yaml").write_text(text)
    with pytest.raises(LocplanError, match=r"run\.yaml: was not written by"):
        list_formats()["ros-map"].check_target(tmp_path)


# --- memory of estimators ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "estimator",
    [
        Sad(),
        Sad(range=1e4, window=SearchWindow(half_width=1000.0, step=100.0)),
        Scan(Lidar(), window=SearchWindow(half_width=1000.0, step=100.0)),
        Scan(Lidar(), sigma_hit=1e6),
    ],
)
def test_field_refuses_too_fine_cells(estimator, monkeypatch):
    """The check comes before any array is allocated."""
    grid = OccupancyGrid(np.full((60, 60), 254, np.uint8), 0.001)
    monkeypatch.setattr(type(estimator), "covariances", lambda *_: pytest.fail("it is computed"))
    with pytest.raises(ConfigError, match=r"are too fine for a range of .* scale the map down"):
        covariance_field(grid, estimator)


def test_oversized_search_window_is_refused():
    window = SearchWindow(half_width=100.0, step=0.1, half_rotation_deg=0.0)
    assert window.to_lattice(0.05).size < 10**7
    with pytest.raises(ConfigError, match="a search window of 52052013 offsets"):
        SearchWindow(half_width=100.0, step=0.1).to_lattice(0.05)


def test_range_beyond_map_changes_nothing():
    for make in (
        lambda r: Sad(range=r),
        lambda r: Scan(Lidar(range=r)),
        lambda r: Fisher(Lidar(range=r)),
    ):
        near, far = (covariance_field(GRID, make(r)) for r in (1e3, 1e4))
        np.testing.assert_array_equal(near.covariance, far.covariance)


def test_stride_beyond_map_evaluates_one_point():
    field = covariance_field(GRID, FieldConfig(Sad(range=1e4), stride=1e4))
    assert field.is_evaluated.shape == (1, 1)
    edited = OccupancyGrid(np.roll(GRID.cells, 1), GRID.resolution, GRID.origin)
    np.testing.assert_array_equal(
        field.update(edited).covariance, covariance_field(edited, field.config).covariance
    )


# --- the journal of a comparison, and the command line ----------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {"task": []},
        {"task": {**RUN["task"], "map": ["m"]}},
        {"task": {**RUN["task"], "seed": "0"}},
        {"task": {**RUN["task"], "weight": 10**400}},
        {"task": {**RUN["task"], "weight": None}},
        {"status": "happy"},
        {"status": []},
        {"seconds": [1]},
        {"seconds": 10**400},
        {"measures": []},
        {"history": [[1, "a"]]},
        {"xy": [[[], {}]]},
        {"note": 5},
        None,
    ],
)
def test_journal_error_names_damaged_line(tmp_path, changes):
    line = DEEP if changes is None else json.dumps({**RUN, **changes})
    (tmp_path / "runs.jsonl").write_text(
        f'{{"format": "locplan comparison", "version": 2}}\n{line}\n'
    )
    with pytest.raises(LocplanError, match=r"runs.jsonl: line 2 is damaged; delete it"):
        RunJournal(tmp_path / "runs.jsonl", {})


@pytest.mark.parametrize("image", ["~", "null", '""', '"a\\0b"', '"\\ud800"'])
def test_map_without_image_is_refused(run, tmp_path, image):
    """The image ~ must not mean the home folder."""
    save_map(ascii_map("..."), tmp_path / "a.yaml")
    text = (tmp_path / "a.yaml").read_text().replace("a.pgm", image)
    (tmp_path / "a.yaml").write_text(text)
    assert "image must be the name of a file" in check_refusal(run("field", tmp_path / "a.yaml"))


def test_empty_cache_folder_name_is_refused():
    with pytest.raises(LocplanError, match="the cache folder must be a path, not ''"):
        cache_folder("")


@pytest.mark.parametrize("reach", [0, 1, 2, 5, 17])
def test_nearest_cell_tie_takes_lowest_row(reach):
    """In the same row, the lowest column counts."""
    span = range(-reach, reach + 1)
    every = sorted(itertools.product(span, span), key=lambda move: math.hypot(*move))
    free, at = np.zeros((40, 40), bool), (np.array([20]), np.array([20]))
    for row, col in reversed(every):
        free[20 + row, 20 + col] = True
        rows, cols = find_lidar_cells(free, *at, reach)
        assert (rows.tolist(), cols.tolist()) == ([20 + row], [20 + col])


def test_lidar_search_stops_at_free_cell():
    free = np.ones((3, 1000), bool)
    free[:, 5] = False
    at = np.array([1]), np.array([5])
    rows, cols = find_lidar_cells(free, *at, 10**15)
    assert (rows.tolist(), cols.tolist()) == ([1], [4])


# --- pipes and sizes --------------------------------------------------------------------------


READ = {
    "lidar.sdf": Lidar.from_file,
    "drive.npz": read_recording,
    "drive.log": read_recording,
    "drive.log.gz": read_recording,
    "drive.mcap": read_recording,
    "map.yaml": load_map,
    "nav2.yaml": read_parameters,
    "journal": lambda file: RunJournal(file, {}),
}


@pytest.mark.parametrize("name", READ)
def test_readers_refuse_pipes(tmp_path, name):
    """Reading a pipe would wait forever."""
    os.mkfifo(tmp_path / name)
    with pytest.raises(LocplanError, match="no plain file, but a pipe"):
        READ[name](tmp_path / name)


@pytest.mark.parametrize("name", ["lidar.sdf", "map.yaml", "nav2.yaml", "journal"])
def test_sizes_are_checked_before_reading(tmp_path, name):
    with open(tmp_path / name, "wb") as file:
        file.truncate(3 * 10**9)
    tracemalloc.start()
    with pytest.raises(LocplanError, match="MB, too much for such a file"):
        READ[name](tmp_path / name)
    assert tracemalloc.get_traced_memory()[1] < 10**7
    tracemalloc.stop()


FLASER = "FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 {0} a {0}\n"
SCANS = {
    "drive.log": ("# a log\n", FLASER),
    "drive.log.gz": ("# a log\n", FLASER),
}


@pytest.mark.parametrize("name", SCANS)
def test_recording_reader_limits_lines_and_memory(tmp_path, monkeypatch, name):
    head, line = SCANS[name]
    text = head + "".join(line.format(n) for n in range(9))
    write = gzip.open if name.endswith("gz") else open
    with write(tmp_path / name, "wt") as file:
        file.write(text)
    assert len(read_recording(tmp_path / name)) == 9
    monkeypatch.setattr("locplan.recordings.logs.MAX_ROOM", 1024)
    assert len(read_recording(tmp_path / name, every=3)) == 3
    with pytest.raises(LocplanError, match=r"over 4 scans of . beams take too much.*every="):
        read_recording(tmp_path / name)
    monkeypatch.setattr(reading, "MAX_LINES", 8)
    with pytest.raises(LocplanError, match=r"goes on beyond 8 lines, or .* MB; split it"):
        read_recording(tmp_path / name, every=9)


def test_recording_refuses_oversized_arrays(tmp_path):
    file = tmp_path / "drive.npz"
    np.savez_compressed(file, ranges=np.zeros((2**14, 2**14 + 1), np.uint8))
    tracemalloc.start()
    with pytest.raises(LocplanError, match="its arrays take 268 MB"):
        read_recording(file)
    assert tracemalloc.get_traced_memory()[1] < 10**7
    tracemalloc.stop()


@pytest.mark.parametrize("value", [r"\UFFFFFFFF", r"\U7FFFFFFF", r"\U00110000"])
def test_invalid_yaml_escape_is_refused(tmp_path, value):
    for read in (read_parameters, load_map):
        with pytest.raises(MapError, match="is not YAML in UTF-8"):
            read(nav2(tmp_path, f'amcl: {{ros__parameters: {{a: "{value}"}}}}\n'))
