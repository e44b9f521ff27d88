"""Files as nobody means them, made of valid ones, and what each reader may do with them.

A case is the name of a reader and a seed: from them alone follow the file and the damage.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import random
import re
import shutil
import signal
import struct
import sys
import tempfile
import warnings
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from drive_bags import KINDS, write_drive
from PIL import Image

from locplan._util.runs import Run
from locplan.comparison import Journal, PlannerSpec, read_movingai_map, read_scenarios
from locplan.costs import Costmap, Path as Route, path_metrics
from locplan.errors import LocplanError
from locplan.export import distribution
from locplan.export._parameters import Robot, with_costmap
from locplan.export._registry import _is_untouched_export
from locplan.field import (
    CovarianceField,
    FieldCache,
    FieldConfig,
    Sad,
    SearchWindow,
    _cache as cache,
    _tiles as tiles,
    field_path,
    load_config,
)
from locplan.field._store import _Found
from locplan.field._zarr import attributes, write
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, load_map, save_map, source_files
from locplan.planners import Plan, plan, read_queries
from locplan.recordings import Recording, read_drive
from locplan.robots import Lidar, read_amcl, read_parameters

MAX_LINE = 1050
"""Length of a message [characters] that no error and no warning reaches."""
SECONDS, BYTES = 20, 2 * 10**9
"""Time of the processor [s] and memory that no case may take."""
ASTRAL = "\U0001f9ed"
TOKENS = (
    "",
    "0",
    "1",
    "-1",
    "2",
    "0.5",
    "3.14159",
    "1000",
    "1e-3",
    "9.99e9",
    "nan",
    "inf",
    "-inf",
    ".nan",
    "-0",
    "1e308",
    "-1e308",
    "1e-320",
    "1e12",
    "9" * 400,
    "-" + "9" * 400,
    "9" * 5000,
    "0x" + "f" * 5000,
    "2147483648",
    "18446744073709551616",
    "4000000000",
    "[" * 5000,
    "{" * 5000,
    '{"a":' * 3000,
    "- " * 3000,
    "[" * 90 + "]" * 90,
    "\0",
    '"\\0"',
    '"\\ud800"',
    ASTRAL,
    "\ufeff",
    "\u2028",
    "\x85",
    "\x0b",
    "\r",
    "\n",
    "\t",
    " " * 5000,
    "a" * 5000,
    "~",
    "null",
    "true",
    "2020-13-45",
    "2001-12-14t21:59:43.10-05:00",
    "1:90:90",
    "0b",
    "[]",
    "{}",
    "[[1, 2], {a: b}]",
    "? [a, b]\n: c",
    "? ~\n: c",
    "{1: 2, ~: 3, 2020-01-01: 4}",
    "!!python/object/apply:os.system [x]",
    "!!binary eA==",
    "!!int x",
    "!!timestamp x",
    "!!set {a, b}",
    "&a [*a]",
    "*a",
    "<<: *a",
    "&a [1]"
    + "".join(f"\n{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in pairwise("abcdefgh")),
    *('"\\UFFFFFFFF"', '"\\U00110000"', '"\\U0001F9ED"', '"\\U12"', '"\\ud83d\\ude00"', '"\\u12"'),
    *('"\\u0000"', '"\\x00"', '"\\xff"', '"\\x"', '"\\xg1"', '"\\N\\L\\P\\_"', '"\\q"', '"\\'),
    *("&a", "&a &b x", "&a *a", "&\u00e9 x", "&a {<<: *a}", "&a {b: *a}", "*", "&", "&a [1]\n*a"),
    *("{<<: 1}", "{<<: [1, {x: 1}]}", "{<<: {<<: {a: 1}}}", "{<<: &b {<<: *b}}", "<<: {image: x}"),
    *("!", "!!", "!<", "!e!x", "!%", "!!float [1]", "!!str {a: 1}", "!!null x", "!!bool 5"),
    *("!!omap [1]", "!!pairs [a]", "!!seq {}", "!!merge <<", "!!value =", "!<tag:yaml.org:> x"),
    *("%YAML 9.9\n---\n", "%TAG ! tag:x,2000:\n---\n", "\n---\n", "\n...\n", "|\n  a", ">9\n"),
    *("@", "`", "a: b: c", "{? }", "[a, b: c]", "0o17", "0b102", "1_0", "12:30:45.5", "=\n"),
    "../" * 50,
    "/dev/zero",
    "/",
    ".",
    "'",
    '"',
    ":",
    ",",
    "#",
    "%",
    "=",
    "$\\frac{",
)
"""Texts that have broken readers, and such that could."""
VALUES: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    1,
    2,
    0.5,
    7.3,
    100,
    1e-3,
    10**400,
    -(10**400),
    2**31,
    2**63,
    2**64,
    1e308,
    -1e308,
    1e-320,
    1e12,
    -0.0,
    float("nan"),
    float("inf"),
    "",
    "x" * 3000,
    "\0",
    "\ud800",
    ASTRAL,
    [],
    {},
    [[]],
    [1, 2, 3],
    {"a": 1},
    {"": {"": []}},
    [None] * 500,
    {"name": "sad"},
    {"name": "scan"},
    {"name": []},
    ["a"],
    [10**6, 10**6],
)
"""Values of JSON in places that were not made for them."""


def numbers_of(random: random.Random, text: str) -> str:
    """The text with one of its numbers or words replaced."""
    places = list(re.finditer(r"-?\d[\d.e+-]*|\w+", text))
    if not places:
        return text + random.choice(TOKENS)
    place = random.choice(places)
    return text[: place.start()] + random.choice(TOKENS) + text[place.end() :]


def flip(random: random.Random, data: bytes) -> bytes:
    if not data:
        return b"\0"
    at = random.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << random.randrange(8)]) + data[at + 1 :]


def cut(random: random.Random, data: bytes) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def leave_out(random: random.Random, data: bytes) -> bytes:
    begin, end = piece(random, data)
    return data[:begin] + data[end:]


def repeat(random: random.Random, data: bytes) -> bytes:
    begin, end = piece(random, data)
    return data[:end] + data[begin:end] * random.choice((1, 1, 2, 50)) + data[end:]


def insert(random: random.Random, data: bytes) -> bytes:
    at = random.randrange(len(data) + 1)
    return data[:at] + encoded(random.choice(TOKENS)) + data[at:]


def noise(random: random.Random, data: bytes) -> bytes:
    begin, end = piece(random, data)
    return data[:begin] + random.randbytes(end - begin) + data[end:]


def replace(random: random.Random, data: bytes) -> bytes:
    return encoded(numbers_of(random, data.decode("utf-8", "surrogateescape")))


def swap_lines(random: random.Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    random.shuffle(lines)
    return b"\n".join(lines)


def change_yaml(random: random.Random, data: bytes) -> bytes:
    """Another value of a key, or an anchor at one key and its alias at another."""
    text = data.decode("utf-8", "surrogateescape")
    values = list(re.finditer(r"(?<=:)( [^\n]*)?$", text, re.MULTILINE))
    if not values:
        return replace(random, data)
    anchored, changed = random.choice(values), random.choice(values)
    put = {changed: f" {random.choice(TOKENS)}"}
    if random.random() < 0.4:
        put = {anchored: f" &a{anchored[0]}", changed: random.choice((" *a", "\n  <<: *a"))}
    for value in sorted(put, key=re.Match.start, reverse=True):
        text = text[: value.start()] + put[value] + text[value.end() :]
    return encoded(text)


def change_json(random: random.Random, data: bytes) -> bytes:
    """Another value somewhere in a text of JSON, in which a checksum fits again."""
    try:
        root = [json.loads(data)]
    except (ValueError, RecursionError):
        return replace(random, data)
    node, key = random.choice(list(places_in(root)))
    way = random.randrange(5)
    if way == 0 and node is not root:
        del node[key]
    elif way == 1 and isinstance(node, dict):
        node[random.choice((*TOKENS, "name"))] = node[key]
    elif way == 2:
        for _ in range(random.choice((1, 3, 400))):
            node[key] = [node[key]] if random.random() < 0.5 else {"a": node[key]}
    else:
        node[key] = random.choice(VALUES)
    whole = root[0]
    about = whole.get("attributes") if isinstance(whole, dict) else None
    if isinstance(about, dict) and "checksum" in about and random.random() < 0.9:
        described = {name: value for name, value in about.items() if name != "checksum"}
        text = json.dumps(described, sort_keys=True)
        about["checksum"] = hashlib.sha256(text.encode()).hexdigest()
    return json.dumps(whole).encode()


def change_journal(random: random.Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    at = random.randrange(len(lines))
    lines[at] = change_json(random, lines[at])
    return b"\n".join(lines)


def change_png(random: random.Random, data: bytes) -> bytes:
    """Another value in a chunk of a PNG, whose checksum fits again."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    if not chunks:
        return flip(random, data)
    n = random.choice((0, random.randrange(len(chunks))))
    kind, body = chunks[n]
    if kind == b"IHDR" and random.random() < 0.6 and len(body) == 13:
        field = random.choice(((0, ">I"), (4, ">I"), (8, ">B"), (9, ">B"), (12, ">B")))
        sizes = (0, 1, 2, 3, 4, 6, 8, 16, 255, 5000, 2**16, 2**20, 2**31 - 1, 2**32 - 1)
        value = random.choice([size for size in sizes if size < 256 or field[1] == ">I"])
        changed = bytearray(body)
        struct.pack_into(field[1], changed, field[0], value)
        body = bytes(changed)
    elif kind == b"IDAT" and random.random() < 0.5:
        body = zlib.compress(bytes(random.choice((0, 10, 10**6))))
    else:
        body = random.choice((flip, cut, repeat, insert))(random, body)
    chunks[n] = kind, body
    if random.random() < 0.3:
        extra = random.choice((b"iCCP", b"tRNS", b"PLTE", b"zTXt", b"acTL", b"fcTL", b"eXIf"))
        chunks.insert(random.randrange(len(chunks) + 1), (extra, random.randbytes(26)))
    made = data[:8]
    for kind, body in chunks:
        checksum = zlib.crc32(kind + body)
        made += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", checksum)
    return made


def piece(random: random.Random, data: bytes) -> tuple[int, int]:
    begin = random.randrange(len(data) + 1)
    return begin, min(len(data), begin + random.choice((1, 2, 4, 10, 30, 100)))


def encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass" if "\ud800" in text else "surrogateescape")


def places_in(node: Any) -> Iterator[tuple[Any, Any]]:
    stack = [node]
    while stack:
        owner = stack.pop()
        for key in owner.keys() if isinstance(owner, dict) else range(len(owner)):
            yield owner, key
            if isinstance(owner[key], (dict, list)):
                stack.append(owner[key])


Change = Callable[[random.Random, bytes], bytes]
ANY: tuple[Change, ...] = (flip, cut, leave_out, repeat, insert, noise, replace)
LINES: tuple[Change, ...] = (*ANY, replace, replace, replace, insert, swap_lines)
YAML: tuple[Change, ...] = (*LINES, change_yaml, change_yaml, change_yaml, change_yaml)
JSON: tuple[Change, ...] = (*ANY, change_json, change_json, change_json, change_json, change_json)
PNG: tuple[Change, ...] = (*ANY, change_png, change_png, change_png, change_png)


@dataclass(frozen=True)
class Reader:
    """A reader, the valid files it starts from, and how they are damaged."""

    files: Callable[[Path], None]
    """Function that writes valid files into a folder."""
    damaged: str
    """Pattern of the files that are damaged, of which one is drawn."""
    read: Callable[[Path], object]
    """Function that reads the folder's files."""
    changes: tuple[Change, ...] = LINES
    """The kinds of damage."""
    share: int = 10
    """Share of the cases in a run of all readers."""
    may_refuse: bool = True
    """False if not even a LocplanError may be raised."""


ROOM = np.full((12, 16), FREE, np.uint8)
ROOM[[0, -1]] = ROOM[:, [0, -1]] = ROOM[5:8, 4:7] = OCCUPIED
GRID = OccupancyGrid(ROOM, 0.1, (1.0, -2.0, 0.1), "room")
COSTS = Costmap.from_density(GRID, np.where(GRID.free, 1.0, np.inf))
SMALL = FieldConfig(
    Sad(range=0.5, window=SearchWindow(half_width=0.2, step=0.1, half_rotation_deg=0.0)), stride=0.4
)
MAP_YAML = """image: map.pgm
resolution: 0.05
origin: [-1.0, -2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
mode: trinary
"""
NAV2 = """amcl:
  ros__parameters:
    alpha1: 0.2
    max_particles: 2000
    laser_model_type: "likelihood_field"
    sigma_hit: 0.2
    z_hit: 0.5
    robot_model_type: "nav2_amcl::DifferentialMotionModel"
global_costmap:
  global_costmap:
    ros__parameters:
      plugins: ["static_layer", "inflation_layer"]
      filters: []
      static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}
planner_server:
  ros__parameters:
    planner_plugins: ["GridBased"]
    GridBased: {plugin: "nav2_smac_planner::SmacPlanner2D", tolerance: 0.5}
"""
RUN = {
    "digest": "0f",
    "task": {"map": "m", "config": "c", "query": "q", "weight": 4.0, "planner": "p", "seed": 0},
    "status": "solved",
    "seconds": 0.5,
    "wall_seconds": 0.6,
    "measures": {"length": 3.0, "max_e": None},
    "history": [[0.1, 3.5], [0.2, 3.0]],
    "xy": [[0.0, 0.0], [3.0, 0.0]],
    "note": "",
}
SETTINGS = FieldConfig(Sad(range=4.0)).to_json()


def pictures(folder: Path) -> None:
    """The room as images of all kinds that are read."""
    grey = Image.fromarray(np.where(ROOM == FREE, 254, 0).astype(np.uint8))
    kinds = ("L", "RGB", "RGBA", "LA", "P", "1")
    every = {f"{kind}.png": grey.convert(kind) for kind in kinds}
    every |= {"I.png": Image.fromarray(np.asarray(grey).astype(np.uint16) * 257)}
    every |= {"L.pgm": grey, "1.pbm": grey.convert("1"), "L.bmp": grey}
    every |= {"I.pgm": every["I.png"]}
    for name, picture in every.items():
        picture.save(folder / name, "PPM" if name[-3:] in ("pgm", "pbm") else None)
        text = MAP_YAML.replace("map.pgm", name)
        (folder / f"{name}.yaml").write_text(text)
    rows = "\n".join(" ".join(map(str, row)) for row in np.asarray(grey))
    (folder / "plain.pgm").write_text(f"P2\n# made up\n16 12\n255\n{rows}\n")
    (folder / "plain.pgm.yaml").write_text(MAP_YAML.replace("map.pgm", "plain.pgm"))


def read_pictures(folder: Path) -> None:
    load_map(folder / f"{CHANGED[0]}.yaml")


CHANGED = [""]
"""Name of the file that is damaged in the case under way."""


def lines(name: str, text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_text(text, "utf-8") and None


def map_files(folder: Path) -> None:
    save_map(GRID, folder / "map.yaml")
    (folder / "map.yaml").write_text(MAP_YAML)


def read_map(folder: Path) -> None:
    for file in source_files(folder / "map.yaml"):
        os.path.realpath(file)
    grid = load_map(folder / "map.yaml")
    repr(grid)
    grid.world_to_cell(0.0, 0.0)


def read_path(folder: Path) -> None:
    path = Route.load(folder / "path.csv")
    repr(path)
    path.resampled(0.5)
    list(path.by_heading(8)) if path.heading is not None else None
    path_metrics(COSTS, path)


def saved_files(folder: Path) -> None:
    """A costmap, a plan and a run, as they are saved."""
    COSTS.save(folder / "costs.npz")
    ends = [GRID.cell_to_world(*np.argwhere(GRID.free)[0].tolist())] * 2
    made = plan(COSTS, *ends, planner=lambda *query: Route(query[1:]))
    made.write(folder / "plan.json")
    run = Run("plan", {"map": "a.yaml", "start": "1,2"}, frozenset({"map"}))
    (folder / "run.yaml").write_text(run.text(folder), encoding="utf-8")


def read_costs(folder: Path) -> None:
    costs = Costmap.load(folder / "costs.npz")
    repr(costs)
    path_metrics(costs, Route([[1.0, -1.5], [2.0, -1.5]]))


def read_plan(folder: Path) -> None:
    made = Plan.load(folder / "plan.json")
    repr(made)
    json.dumps(made.summary(), allow_nan=False)
    made.report()


def read_run(folder: Path) -> None:
    run = Run.read(folder / "run.yaml")
    assert all(isinstance(word, str) for word in run.words())
    run.changes(run)


def read_settings(folder: Path) -> None:
    config = load_config(folder / "config.json")
    repr(config)
    json.dumps(config.to_json(), allow_nan=False)
    tiles.nothing_known(GRID, config)


def settings_files(folder: Path) -> None:
    from locplan.field import Fisher, Scan
    from locplan.robots import Lidar

    for n, estimator in enumerate((Sad(), Sad.paper(), Fisher(Lidar()), Scan(Lidar(mount_x=0.1)))):
        text = json.dumps({"config": FieldConfig(estimator).to_json()}, indent=1)
        (folder / f"{n}.json").write_text(text)


def read_any_settings(folder: Path) -> None:
    shutil.copy(folder / CHANGED[0], folder / "config.json")
    read_settings(folder)


def field_files(folder: Path) -> None:
    field = made_field()
    write(folder / "f.zarr", field.values, GRID, SMALL)


def made_field() -> CovarianceField:
    """A field of values that are made up, which no kernel has to be compiled for."""
    values = tiles.nothing_known(GRID, SMALL)
    values["covariance"][tiles.needed_points(GRID, SMALL)] = 0.01 * np.eye(2)
    return CovarianceField.of(values, GRID, SMALL)


def read_field(folder: Path) -> None:
    field = CovarianceField.load(folder / "f.zarr")
    repr(field)


def cache_files(folder: Path) -> None:
    field = made_field()
    write(field_path(GRID, SMALL, folder), field.values, GRID, SMALL)
    write(folder / ("0" * 32 + ".zarr"), field.values, GRID, SMALL)


def read_cache(folder: Path) -> None:
    found = cache.entries(folder)
    assert len(found) == 2
    assert any(entry.about.get("map_name") == "room" for entry in found)
    json.dumps(FieldCache(folder, found, 10**9).summary())
    assert FieldCache(folder, found, 10**9).table().count("\n") >= 3
    wanted = tiles.needed_points(GRID, SMALL)
    about = attributes(GRID, SMALL)
    known = _Found.at(field_path(GRID, SMALL, folder), about, GRID, SMALL, wanted)
    assert len(known.complaint) < MAX_LINE
    assert known.complaint.isprintable()


def read_nav2(folder: Path) -> None:
    robot = Robot(distribution("jazzy"), None, read_parameters(folder / "nav2.yaml"))
    merged = with_costmap(robot, "static")
    yaml.safe_dump(merged.content, sort_keys=False, allow_unicode=True)
    read_amcl(folder / "nav2.yaml")


def export_files(folder: Path) -> None:
    (folder / "a.csv").write_text("x\n")
    digest = hashlib.sha256(b"x\n").hexdigest()
    (folder / "export.json").write_text(json.dumps({"map": "m", "files": {"a.csv": digest}}))


def read_journal(folder: Path) -> None:
    with Journal(folder / "runs.jsonl", resume=True) as journal:
        sorted(run.task for run in journal.runs.values())


def read_spec(folder: Path) -> None:
    PlannerSpec.of((folder / "spec.txt").read_bytes().decode("utf-8", "surrogateescape"))


MOVINGAI = "type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\n....\n"
SCENARIOS = "version 1\n0\ta.map\t4\t3\t0\t0\t3\t2\t4.2\n1\ta.map\t4\t3\t0\t1\t3\t1\t5.0\n"
QUERIES = """name,start_x,start_y,goal_x,goal_y,start_heading_deg
one,1.5,2.0,3.0,4.0,90
"two, too",0.0,-1.0,2,5,
"""
OPEN = OccupancyGrid(np.full((3, 4), FREE, np.uint8), 1.0)


def recorded() -> Recording:
    """A drive of a few scans."""
    poses = np.column_stack([0.3 * np.arange(5), np.ones(5), np.linspace(0, 1, 5)])
    ranges = np.round(np.random.default_rng(1).uniform(0.5, 7.5, (5, 6)), 3)
    lidar = Lidar(range=8.0, field_of_view_deg=180.0, beams=6, mount_x=0.1)
    return Recording(ranges, lidar, poses, 100.0 + np.arange(5) / 4, poses + 0.1)


def carmen_log(folder: Path) -> None:
    drive, lines = recorded(), ["# made up", "PARAM robot_length 1 0 host 0"]
    for n, (x, y, heading) in enumerate(drive.poses):
        readings = " ".join(map(str, drive.ranges[n]))
        lines.append(f"ODOM {x + 0.1} {y} {heading} 0 0 0 {n} host {n}")
        lines.append(f"FLASER 6 {readings} {x} {y} {heading} {x} {y} {heading} {n} host {n}")
    (folder / "drive.log").write_text("\n".join(lines) + "\n")
    (folder / "drive.log.gz").write_bytes(gzip.compress((folder / "drive.log").read_bytes()))


def drive_tables(folder: Path) -> None:
    for suffix in (".csv", ".npz"):
        recorded().save(folder / f"drive{suffix}")


def drive_bags(folder: Path) -> None:
    for kind in KINDS:
        path = write_drive(folder, recorded(), kind)
        if path.is_dir():
            (path / "metadata.yaml").rename(folder / f"{kind}.yaml")
            for file in path.iterdir():
                file.rename(folder / file.name)
            path.rmdir()


def drive_folder(folder: Path) -> None:
    write_drive(folder, recorded(), "mcap")


def read_changed_drive(folder: Path) -> None:
    use_drive(read_drive(folder / CHANGED[0]))


def use_drive(drive: Recording) -> None:
    repr(drive)
    drive.report()
    json.dumps(drive.summary(), allow_nan=False)
    drive.ends()


READERS = {
    "CARMEN log": Reader(carmen_log, "drive.log*", read_changed_drive, share=8),
    "drive CSV": Reader(drive_tables, "drive.csv", read_changed_drive, share=8),
    "drive NPZ": Reader(drive_tables, "drive.npz", read_changed_drive, ANY, 8),
    "bag": Reader(drive_bags, "drive*.*", read_changed_drive, ANY, 15),
    "folder of a bag": Reader(
        drive_folder,
        "drive_mcap/metadata.yaml",
        lambda folder: use_drive(read_drive(folder / "drive_mcap")),
        YAML,
        6,
    ),
    "map YAML": Reader(map_files, "map.yaml", read_map, YAML, 25),
    "image": Reader(pictures, "*.p*m", read_pictures, ANY, 15),
    "PNG": Reader(pictures, "*.png", read_pictures, PNG, 15),
    "BMP": Reader(pictures, "*.bmp", read_pictures, ANY, 5),
    "path": Reader(
        lines("path.csv", "x,y,heading\n1.2,-1.5,0.1\n1.7,-1.5,0.2\n2.0,-1.4,3.1\n"),
        "path.csv",
        read_path,
        share=15,
    ),
    "settings": Reader(settings_files, "?.json", read_any_settings, JSON, 20),
    "costmap": Reader(saved_files, "costs.npz", read_costs, ANY, 5),
    "plan": Reader(saved_files, "plan.json", read_plan, JSON, 10),
    "run": Reader(saved_files, "run.yaml", read_run, YAML, 10),
    "field": Reader(field_files, "f.zarr/**/*", read_field, JSON, 2),
    "cache": Reader(cache_files, "0*.zarr/**/*", read_cache, JSON, 1, may_refuse=False),
    "cached field": Reader(
        cache_files, "[1-9a-f]*.zarr/**/*", read_cache, JSON, 2, may_refuse=False
    ),
    "Nav2 parameters": Reader(lines("nav2.yaml", NAV2), "nav2.yaml", read_nav2, YAML, 15),
    "MovingAI map": Reader(
        lines("a.map", MOVINGAI), "a.map", lambda folder: read_movingai_map(folder / "a.map")
    ),
    "MovingAI scenarios": Reader(
        lines("a.scen", SCENARIOS), "a.scen", lambda folder: read_scenarios(folder / "a.scen", OPEN)
    ),
    "queries": Reader(
        lines("q.csv", QUERIES), "q.csv", lambda folder: read_queries(folder / "q.csv")
    ),
    "journal": Reader(
        lines("runs.jsonl", f'{{"format": "locplan comparison 1"}}\n{json.dumps(RUN)}\n'),
        "runs.jsonl",
        read_journal,
        (*LINES, change_journal, change_journal, change_journal, change_journal, change_journal),
    ),
    "planner": Reader(
        lines("spec.txt", "BITstar:time_limit=2,seed=3,settings.rewire_factor=1.2"),
        "spec.txt",
        read_spec,
        share=5,
    ),
    "export folder": Reader(
        export_files, "export.json", _is_untouched_export, JSON, 5, may_refuse=False
    ),
}
"""All readers of files by name."""


class Fault(AssertionError):
    """What a reader did with a hostile file and must not."""


class Bench:
    """A folder of valid files for each reader, in which one file at a time is damaged."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.valid: dict[str, dict[Path, bytes]] = {}

    def run(self, name: str, seed: int) -> str:
        """Run a case; return "read" or "refused", or raise a Fault."""
        reader, home = READERS[name], self.folder / name
        if name not in self.valid:
            home.mkdir()
            reader.files(home)
            found = [file for file in sorted(home.glob(reader.damaged)) if file.is_file()]
            self.valid[name] = {file: file.read_bytes() for file in found}
        file, content = damaged(name, seed, self.valid[name])
        CHANGED[0] = file.name
        file.write_bytes(content)
        try:
            return self._outcome(reader, home)
        except Fault as fault:
            raise Fault(f"{name} {seed}: {fault}") from fault.__cause__
        finally:
            file.write_bytes(self.valid[name][file])

    def _outcome(self, reader: Reader, home: Path) -> str:
        outcome = "read"
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                reader.read(home)
            except LocplanError as error:
                outcome = "refused"
                self._check(str(error))
                if not reader.may_refuse:
                    raise Fault("refused") from error
            except BaseException as error:
                raise Fault(f"{type(error).__name__}: {str(error)[:300]}") from error
        for warning in caught:
            if warning.category.__module__.split(".")[0] not in ("locplan", "builtins"):
                raise Fault(f"{warning.category.__name__}: {warning.message}")
            if not issubclass(warning.category, UserWarning):
                raise Fault(f"{warning.category.__name__}: {warning.message}")
            self._check(str(warning.message))
        return outcome

    def _check(self, line: str) -> None:
        if not (line.isprintable() and 0 < len(line) < MAX_LINE):
            raise Fault(f"a message of {len(line)} characters: {line[:100]!r}")


def damaged(name: str, seed: int, valid: dict[Path, bytes]) -> tuple[Path, bytes]:
    """The file of a case, and its content."""
    drawn = random.Random(f"{name} {seed}")
    file = drawn.choice(list(valid))
    content = valid[file]
    for _ in range(drawn.choice((1, 1, 1, 2, 3))):
        content = drawn.choice(READERS[name].changes)(drawn, content)
    return file, content


@contextmanager
def limits() -> Iterator[None]:
    """Let what takes too much time or memory fail, where the system can."""
    if sys.platform != "linux":
        yield
        return
    import resource

    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (taken + BYTES, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@contextmanager
def alarm() -> Iterator[None]:
    """Raise a TimeoutError in a case that does not end."""

    def end(*_: object) -> None:
        raise TimeoutError(f"over {SECONDS} s")

    clocks = (
        (signal.ITIMER_PROF, signal.SIGPROF, SECONDS),  # of this process alone
        (signal.ITIMER_REAL, signal.SIGALRM, 30 * SECONDS),  # where it waits for something
    )
    before = [signal.signal(number, end) for _, number, _ in clocks]
    for clock, _, seconds in clocks:
        signal.setitimer(clock, seconds)
    try:
        yield
    finally:
        for (clock, number, _), handler in zip(clocks, before, strict=True):
            signal.setitimer(clock, 0)
            signal.signal(number, handler)


def cases(count: int, first: int = 0) -> Iterator[tuple[str, int]]:
    """Readers and seeds, each reader with its share of all cases."""
    total = sum(reader.share for reader in READERS.values())
    for name, reader in READERS.items():
        for seed in range(first, first + max(1, round(count * reader.share / total))):
            yield name, seed


def run_all(count: int, first: int = 0) -> tuple[dict[str, dict[str, int]], list[Fault]]:
    """Run about `count` cases; return the outcomes by reader, and all faults."""
    outcomes: dict[str, dict[str, int]] = {name: {} for name in READERS}
    faults = []
    with tempfile.TemporaryDirectory() as folder, limits():
        bench = Bench(Path(folder))
        for name, seed in cases(count, first):
            try:
                with alarm():
                    outcome = bench.run(name, seed)
            except Fault as fault:
                outcome = "fault"
                faults.append(fault)
            outcomes[name][outcome] = outcomes[name].get(outcome, 0) + 1
    return outcomes, faults


if __name__ == "__main__":  # READER SEED shows a case, COUNT [FIRST] runs many
    if sys.argv[1] in READERS:
        with tempfile.TemporaryDirectory() as folder:
            bench, case = Bench(Path(folder)), (sys.argv[1], int(sys.argv[2]))
            print(bench.run(*case) if len(sys.argv) < 4 else "")
            print(damaged(*case, bench.valid[case[0]]))
    else:
        import time

        began = time.perf_counter()
        results, faults = run_all(*map(int, sys.argv[1:]))
        for name, counts in results.items():
            print(f"{name}: {counts}")
        for fault in faults:
            print(fault)
        total = sum(sum(counts.values()) for counts in results.values())
        print(f"{total} cases, {len(faults)} faults, {time.perf_counter() - began:.0f} s")
