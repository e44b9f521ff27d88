"""The readers of files with a valid file for each, and strategies that damage it."""

from __future__ import annotations

import gzip
import json
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from PIL import Image

from locplan._support.output import ResultOutput
from locplan._support.runs import RunRecord, format_run, record_run
from locplan.comparison.benchmarks import read_movingai_map, read_scenarios
from locplan.comparison.journal import RunJournal
from locplan.comparison.planners import PlannerSpec
from locplan.export.user_graph import UserGraph
from locplan.field import (
    CovarianceField,
    FieldConfig,
    Fisher,
    Sad,
    Scan,
    SearchWindow,
    files,
    load_config,
    tiles,
)
from locplan.field.cache import format_cache_table, list_cache_entries
from locplan.field.store import field_path
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, Zone, Zones, load_map, save_map
from locplan.planning import Costmap, Path as Route, Plan, path_metrics, plan
from locplan.planning.queries import read_queries
from locplan.recordings import Recording, read_recording
from locplan.robots import Lidar, read_parameters
from locplan.robots.nav2 import read_amcl
from support.bag_files import KINDS, write_drive

Draw = Callable[[st.SearchStrategy[Any]], Any]
TOKENS = (
    *("", "0", "-1", "2", "0.5", "1000", "9.99e9", "nan", "-inf", ".nan", "-0", "1e308", "1e-320"),
    *("1e12", "9" * 5000, "0x" + "f" * 5000, "18446744073709551616", "[" * 5000, "{" * 5000),
    *('{"a":' * 3000, "- " * 3000, "[" * 90 + "]" * 90, "\0", '"\\0"', '"\\ud800"', "\U0001f9ed"),
    *("\ufeff", "\u2028", "\x85", "\r", "\n", " " * 5000, "a" * 5000, "~", "null", "true", "[]"),
    *("2020-13-45", "1:90:90", "0b", "{}", "[[1, 2], {a: b}]", "? [a, b]\n: c", "{1: 2, ~: 3}"),
    *("!!python/object/apply:os.system [x]", "!!binary eA==", "!!int x", "!!timestamp x", "&a x"),
    *("&a [*a]", "*a", "<<: *a", "&a {<<: *a}", "{<<: 1}", "&a [1]\n*a", '"\\U00110000"', '"\\'),
    *("!", "!!float [1]", "%YAML 9.9\n---\n", "\n---\n", "|\n  a", "a: b: c", "../" * 50, "="),
    *("/dev/zero", "/", ".", "'", '"', ":", ",", "#", "%", "$\\frac{"),
)
"""Texts that have broken readers, and such that could."""
VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 0.5, 10**400, -(10**400), 2**64, 1e308, 1e-320, -0.0, float("nan")),
    *(float("inf"), "", "x" * 3000, "\0", "\ud800", [], {}, [[]], [1, 2, 3], {"a": 1}, ["a"]),
    *([None] * 500, {"name": "sad"}, {"name": "scan"}, {"name": []}, [10**6, 10**6]),
)
"""Values of JSON in places that were not made for them."""


def encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass" if "\ud800" in text else "surrogateescape")


def edit(draw: Draw, data: bytes) -> bytes:
    """Put other bytes, or none, in the place of some."""
    begin = draw(st.integers(0, len(data)))
    length = draw(st.sampled_from((0, 1, 4, 30, len(data))))
    put = draw(st.binary(max_size=20) | st.sampled_from(TOKENS).map(encoded))
    return data[:begin] + put + data[begin + length :]


def replace_word(draw: Draw, data: bytes) -> bytes:
    """Put a token in the place of a number or a word."""
    text = data.decode("utf-8", "surrogateescape")
    words = list(re.finditer(r"-?\d[\d.e+-]*|\w+", text))
    if not words:
        return edit(draw, data)
    word = draw(st.sampled_from(words))
    return encoded(text[: word.start()] + draw(st.sampled_from(TOKENS)) + text[word.end() :])


def change_json(draw: Draw, data: bytes) -> bytes:
    """Change a value in one line of JSON, or in all of it."""
    lines = [data] if data[-1:] != b"\n" else data.splitlines()
    at = draw(st.integers(0, len(lines) - 1))
    try:
        root = [json.loads(lines[at])]
    except (ValueError, RecursionError):
        return replace_word(draw, data)
    node, key = draw(st.sampled_from(list(places_in(root))))
    if node is not root and draw(st.booleans()):
        del node[key]
    else:
        node[key] = draw(st.sampled_from(VALUES))
    lines[at] = json.dumps(root[0]).encode() if root else b""
    return b"\n".join(lines)


def places_in(node: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(node.keys() if isinstance(node, dict) else range(len(node))):
        yield node, key
        if isinstance(node[key], dict | list):
            yield from places_in(node[key])


def change_png(draw: Draw, data: bytes) -> bytes:
    """Change a chunk of a PNG, whose checksum fits again."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    n = draw(st.integers(0, max(0, len(chunks) - 1)))
    if not chunks or chunks[n][0] == b"IDAT":
        return edit(draw, data)
    kind, body = chunks[n]
    sizes = st.sampled_from((0, 1, 255, 5000, 2**20, 2**31 - 1, 2**32 - 1))
    if kind == b"IHDR" and draw(st.booleans()):
        body = struct.pack(">II", draw(sizes), draw(sizes)) + body[8:]
    else:
        body = edit(draw, body)
    chunks[n] = kind, body
    made = data[:8]
    for kind, body in chunks:
        made += struct.pack(">I", len(body)) + kind + body
        made += struct.pack(">I", zlib.crc32(kind + body))
    return made


Damage = Callable[[Draw, bytes], bytes]
TEXT: tuple[Damage, ...] = (edit, replace_word, replace_word)
JSON: tuple[Damage, ...] = (edit, change_json, change_json)


@st.composite
def damage(draw: Draw, damages: tuple[Damage, ...], valid: dict[str, bytes]) -> tuple[str, bytes]:
    """The name of one of some files, and its content after one to three kinds of damage."""
    name = draw(st.sampled_from(sorted(valid)))
    content = valid[name]
    for _ in range(draw(st.integers(1, 3))):
        content = draw(st.sampled_from(damages))(draw, content)
    return name, content


@dataclass(frozen=True)
class Reader:
    """A reader of files."""

    files: Callable[[Path], object]
    """Function that writes valid files into a folder."""
    pattern: str
    """Pattern of the files that are damaged, one at a time."""
    read: Callable[[Path], object]
    """Function that reads the damaged file, by its path."""
    damages: tuple[Damage, ...] = TEXT
    """The kinds of damage."""
    may_refuse: bool = True
    """False if not even a LocplanError may be raised."""


ROOM = np.full((12, 16), FREE, np.uint8)
ROOM[[0, -1]] = ROOM[:, [0, -1]] = ROOM[5:8, 4:7] = OCCUPIED
GRID = OccupancyGrid(ROOM, 0.1, (1.0, -2.0, 0.1), "room")
OPEN = OccupancyGrid(np.full((3, 4), FREE, np.uint8), 1.0)
COSTS = Costmap.from_density(GRID, np.where(GRID.free, 1.0, np.inf))
WINDOW = SearchWindow(half_width=0.2, step=0.1, half_rotation_deg=0.0)
SMALL = FieldConfig(Sad(range=0.5, window=WINDOW), stride=0.4)
NAV2 = """amcl:
  ros__parameters: {alpha1: 0.2, max_particles: 2000, laser_model_type: "likelihood_field"}
global_costmap:
  global_costmap:
    ros__parameters: {plugins: ["static_layer"], filters: []}
planner_server:
  ros__parameters:
    planner_plugins: ["GridBased"]
    GridBased: {plugin: "nav2_smac_planner::SmacPlanner2D", tolerance: 0.5}
"""
RUN = {
    "digest": "0f",
    "task": {"map": "m", "config": "c", "query": "q", "weight": 4.0, "planner": "p", "seed": 0},
    **{"status": "solved", "seconds": 0.5, "wall_seconds": 0.6, "note": ""},
    **{"measures": {"length": 3.0, "max_e": None}, "history": [[0.1, 3.5], [0.2, 3.0]]},
    "xy": [[0.0, 0.0], [3.0, 0.0]],
}
TEXTS = {
    "path.csv": "x,y,heading\n1.2,-1.5,0.1\n1.7,-1.5,0.2\n2.0,-1.4,3.1\n",
    "a.map": "type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\n....\n",
    "a.scen": "version 1\n0\ta.map\t4\t3\t0\t0\t3\t2\t4.2\n1\ta.map\t4\t3\t0\t1\t3\t1\t5.0\n",
    "q.csv": 'name,start_x,start_y,goal_x,goal_y\none,1.5,2.0,3.0,4.0\n"a, b",0.0,-1.0,2,5\n',
    "g.geojson": json.dumps(
        {
            "type": "FeatureCollection",
            "features": [
                {
                    "type": "Feature",
                    "properties": {"id": 1, "frame": "map"},
                    "geometry": {"type": "Point", "coordinates": [1.0, 2.0]},
                },
                {
                    "type": "Feature",
                    "properties": {"id": 2, "startid": 1, "endid": 1, "metadata": {"aisle": 4}},
                    "geometry": {"type": "LineString"},
                },
            ],
        }
    ),
    "runs.jsonl": f'{{"format": "locplan comparison", "version": 2}}\n{json.dumps(RUN)}\n',
    "spec.txt": "BITstar:time_limit=2,seed=3,rewire_factor=1.2",
    "nav2.yaml": NAV2,
}


def text_of(name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(TEXTS[name], "utf-8")


def pictures(folder: Path) -> None:
    """The room as images of several kinds, each with its YAML."""
    grey = Image.fromarray(np.where(ROOM == FREE, 254, 0).astype(np.uint8))
    every = {f"{kind}.png": grey.convert(kind) for kind in ("L", "RGBA", "P", "1")}
    every |= {"I.png": Image.fromarray(np.asarray(grey).astype(np.uint16) * 257)}
    for name, picture in (every | {"L.pgm": grey, "L.bmp": grey}).items():
        picture.save(folder / name)
        save_map(GRID, folder / "map.yaml")
        text = (folder / "map.yaml").read_text().replace("map.pgm", name)
        (folder / f"{name}.yaml").write_text(text)


def settings(folder: Path) -> None:
    for n, estimator in enumerate((Sad(), Fisher(Lidar()), Scan(Lidar(mount_x=0.1)))):
        text = json.dumps({"config": FieldConfig(estimator).to_json()})
        (folder / f"{n}.json").write_text(text)


def saved(folder: Path) -> None:
    """A costmap, a plan and a run, as they are saved."""
    COSTS.save(folder / "costs.npz")
    ends = [GRID.position(*np.argwhere(GRID.free)[0].tolist())] * 2
    plan(COSTS, *ends, planner=lambda *query: Route(query[1:])).write(folder / "plan.json")
    run = RunRecord("plan", {"map": "a.yaml", "start": "1,2"}, frozenset({"map"}))
    with record_run(run):
        text = format_run(folder, "choice", {"a.csv": "0" * 64})
    (folder / "run.yaml").write_text(text, encoding="utf-8")


ZONES = Zones([Zone(kind, [[1, -2], [2, -2], [2, -1]]) for kind in ("no-go", "prefer")])
ZONES = Zones([*ZONES, Zone("slow", [[1.25, -2], [2, -2], [2, -1], [1.5, 0]], 30.0)])


def make_field() -> CovarianceField:
    """A field of values that are made up, which no kernel has to be compiled for."""
    values = tiles.make_empty_values(GRID, SMALL)
    values["covariance"][tiles.find_required_points(GRID, SMALL)] = 0.01 * np.eye(2)
    return CovarianceField.from_values(values, GRID, SMALL)


def field_arrays(folder: Path) -> None:
    make_field().save(folder / "field.npz")


def cache_files(folder: Path) -> None:
    field, about = make_field(), files.make_metadata(GRID, SMALL)
    known = tiles.find_computed_points(field.values)
    for path in (field_path(GRID, SMALL, folder), folder / ("0" * 32 + ".npz")):
        files.write_points(path, field.values, known, about | {"finished_share": 1.0}, GRID.cells)


def change_about(draw: Draw, data: bytes) -> bytes:
    """Change a value in the description of a .npz file."""
    try:
        with np.load(BytesIO(data)) as arrays:
            content = dict(arrays)
        text = change_json(draw, str(content["about"]).encode()).decode("utf-8", "replace")
    except Exception:  # it was damaged before
        return edit(draw, data)
    written = BytesIO()
    np.savez(written, **content | {"about": np.array(text.replace("\0", ""))})
    return written.getvalue()


def list_cache(file: Path) -> None:
    found = list_cache_entries(file.parent)
    assert len(found) == 2
    json.dumps([entry.to_json() for entry in found])
    assert format_cache_table(found, file.parent).count("\n") >= 3


def make_recording() -> Recording:
    """A drive of a few scans."""
    poses = np.column_stack([0.3 * np.arange(5), np.ones(5), np.linspace(0, 1, 5)])
    ranges = np.round(np.random.default_rng(1).uniform(0.5, 7.5, (5, 6)), 3)
    lidar = Lidar(range=8.0, field_of_view_deg=180.0, beams=6, mount_x=0.1)
    return Recording(ranges, lidar, poses, 100.0 + np.arange(5) / 4, poses + 0.1)


def drives(folder: Path) -> None:
    """The drive in every format that is read."""
    drive, lines = make_recording(), ["# made up", "PARAM robot_length 1 0 host 0"]
    for n, (x, y, heading) in enumerate(drive.poses):
        readings = " ".join(map(str, drive.ranges[n]))
        lines.append(f"ODOM {x + 0.1} {y} {heading} 0 0 0 {n} host {n}")
        lines.append(f"FLASER 6 {readings} {x} {y} {heading} {x} {y} {heading} {n} host {n}")
    (folder / "drive.log").write_text("\n".join(lines) + "\n")
    (folder / "drive.log.gz").write_bytes(gzip.compress((folder / "drive.log").read_bytes()))
    drive.save(folder / "drive.npz")
    for kind in KINDS:
        write_drive(folder, drive, kind)


def read_drive(file: Path) -> None:
    in_bag = file.parent if file.suffix != ".bag" and "_" in file.parent.name else file
    drive = read_recording(in_bag)
    drive.report()
    json.dumps(drive.summary(), allow_nan=False)


def read_journal(file: Path) -> None:
    with RunJournal(file, {}):
        pass


ARRAYS: tuple[Damage, ...] = (edit, change_about, change_about)
READERS = {
    "log": Reader(drives, "drive.log*", read_drive),
    "drive": Reader(drives, "drive.npz", read_drive, (edit,)),
    "bag": Reader(drives, "drive*/**/*.*", read_drive, (edit, edit, replace_word)),
    "map": Reader(pictures, "map.yaml", load_map),
    "image": Reader(pictures, "*.p*m", lambda file: load_map(f"{file}.yaml")),
    "BMP": Reader(pictures, "*.bmp", lambda file: load_map(f"{file}.yaml"), (edit,)),
    "PNG": Reader(pictures, "*.png", lambda file: load_map(f"{file}.yaml"), (edit, change_png)),
    "path": Reader(
        text_of("path.csv"), "path.csv", lambda file: path_metrics(COSTS, Route.load(file))
    ),
    "settings": Reader(settings, "?.json", lambda file: load_config(file).to_json(), JSON),
    "costmap": Reader(saved, "costs.npz", Costmap.load, (edit,)),
    "plan": Reader(saved, "plan.json", lambda file: Plan.load(file).report(), JSON),
    "run": Reader(saved, "run.yaml", lambda file: RunRecord.read(file).list_command_words()),
    "outputs": Reader(
        saved,
        "run.yaml",
        lambda file: ResultOutput(file.parent, "choice", True).check(),
        may_refuse=False,
    ),
    "field": Reader(field_arrays, "field.npz", CovarianceField.load, ARRAYS),
    "cache": Reader(cache_files, "*.npz", list_cache, ARRAYS, may_refuse=False),
    "Nav2 parameters": Reader(text_of("nav2.yaml"), "nav2.yaml", read_parameters),
    "filter": Reader(text_of("nav2.yaml"), "nav2.yaml", read_amcl),
    "route graph": Reader(text_of("g.geojson"), "g.geojson", UserGraph.read, JSON),
    "zones": Reader(
        lambda folder: ZONES.save(folder / "zones.geojson"),
        "zones.geojson",
        lambda file: Zones.load(file).cells(GRID, "no-go"),
        JSON,
    ),
    "mask": Reader(pictures, "map.yaml", lambda file: Zones.load(file).cells(GRID, "no-go")),
    "MovingAI map": Reader(text_of("a.map"), "a.map", read_movingai_map),
    "scenarios": Reader(text_of("a.scen"), "a.scen", lambda file: read_scenarios(file, OPEN)),
    "queries": Reader(text_of("q.csv"), "q.csv", read_queries),
    "journal": Reader(text_of("runs.jsonl"), "runs.jsonl", read_journal, JSON),
    "planner": Reader(
        text_of("spec.txt"),
        "spec.txt",
        lambda file: PlannerSpec.parse(file.read_bytes().decode("utf-8", "surrogateescape")),
    ),
}
"""All readers of files by name."""
