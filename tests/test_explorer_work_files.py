"""What a view is handed on as: exports, a command, code, a page; and recorded drives."""

import base64
import contextlib
import dataclasses
import io
import json
import re
import shlex
import zlib
from pathlib import Path

import numpy as np
import pytest
from conftest import SHARED_DATA, changed
from explorer_views import (
    GOAL,
    LIDAR,
    MIDDLE,
    START,
    WAY,
    answered,
    corridors,
    session_of,
)

import locplan
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.explorer import Opening, RecordedDrive, Session
from locplan.export import nav2_keepout
from locplan.field import (
    Exponential,
    FieldConfig,
    Fisher,
    Fused,
    InverseSquare,
    Sad,
    Scan,
    SearchWindow,
    config_spelled,
    equipped,
)
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, load_map, save_map
from locplan.planners import AWARE, plan_beside_shortest
from locplan.recordings import Recording, match_scans
from locplan.robots import Inflation, Lidar, Robot, robot_spelled

# Recorded drives


def drive_in(grid: OccupancyGrid, scans: int, *, times=True, moved=0.0) -> Recording:
    """A drive through an empty hall, of scans that the map has exactly, or off by some metres."""
    lidar = Lidar(range=30.0, beams=36)
    free = np.flatnonzero(grid.cells[grid.shape[0] // 2] == 254)
    x = (np.linspace(free[3], free[-4], scans)) * grid.resolution
    poses = np.column_stack([x, np.full(scans, grid.shape[0] / 2 * grid.resolution), 0 * x])
    width, height = (size * grid.resolution for size in grid.shape[::-1])
    ranges = np.empty((scans, 36))
    for n, (px, py, _) in enumerate(poses):
        cos, sin = np.cos(lidar.angles), np.sin(lidar.angles)
        with np.errstate(divide="ignore"):
            along = np.where(cos > 0, (width - 1 - px) / cos, (1 - px) / cos)
            across = np.where(sin > 0, (height - 1 - py) / sin, (1 - py) / sin)
        ranges[n] = np.minimum(along, across) + moved
    stamps = np.linspace(5.0, 5.0 + scans / 10, scans) if times else None
    return Recording(ranges, lidar, poses, times=stamps)


def shown(drive: Recording, grid: OccupancyGrid, **options):
    """What the page gets of a drive."""
    return RecordedDrive.of(drive).shown(grid, **options)


def hall() -> OccupancyGrid:
    """A hall of 18 x 8 m with walls of 0.5 m, which begin 0.5 m from the map's edge."""
    cells = np.full((90, 190), UNKNOWN, np.uint8)
    cells[5:-5, 5:-5], cells[10:-10, 10:-10] = OCCUPIED, FREE
    return OccupancyGrid(cells, 0.1)


def test_a_drive_is_shown_pose_by_pose():
    grid = hall()
    drive = drive_in(grid, 30)
    told = json.loads(json.dumps(shown(drive, grid), allow_nan=False))
    assert told["t"][0] == 0
    assert told["t"][-1] == pytest.approx(3.0)
    assert told["timed"] is True
    assert told["x"] == pytest.approx(drive.poses[:, 0].tolist(), abs=1e-4)
    assert told["sd"] == [None] * 30
    assert told["unlike"] == [0] * 30


def test_scans_that_end_far_from_walls_are_unlike_the_map():
    grid = hall()
    good, bad = drive_in(grid, 6), drive_in(grid, 6, moved=-2.4)
    mixed = dataclasses.replace(good, ranges=np.concatenate([good.ranges[:3], bad.ranges[3:]]))
    assert shown(mixed, grid)["unlike"] == [0] * 3 + [1] * 3


def test_a_scan_with_few_returns_is_not_judged():
    grid = hall()
    ranges = drive_in(grid, 3, moved=-2.4).ranges.copy()
    ranges[1, 9:] = np.inf
    ranges[2] = np.inf
    some = dataclasses.replace(drive_in(grid, 3), ranges=ranges)
    assert shown(some, grid)["unlike"] == [1, 0, 0]


def test_of_a_long_drive_some_poses_are_shown():
    grid = hall()
    drive = drive_in(grid, 5000 + 700, times=False)
    told = shown(drive, grid)
    assert len(told["x"]) == len(told["t"]) == 5000
    assert (told["x"][0], told["x"][-1]) == pytest.approx((drive.poses[0, 0], drive.poses[-1, 0]))
    assert told["timed"] is False
    assert told["scans"] == 5000 + 700


def test_matched_scans_have_the_deviations_of_the_library():
    grid = hall()
    drive = drive_in(grid, 4)
    calls = []
    found = shown(drive, grid, matched=True, progress=lambda *n: calls.append(n))
    assert calls[-1] == (4, 4)
    own = match_scans(drive, grid).position_std
    assert found["sd"] == pytest.approx(own.round(4).tolist())


def test_a_drive_off_the_map_is_shown_without_deviations():
    grid = hall()
    away = drive_in(grid, 4).moved(500.0, 0.0, 0.0)
    assert shown(away, grid, matched=True)["sd"] == [None] * 4


def test_real_scans_are_unlike_the_maps_of_other_sites():
    logs, maps = SHARED_DATA / "carmen", SHARED_DATA / "rosmaps_carmen"
    if not logs.is_dir() or not maps.is_dir():
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    drive = RecordedDrive.of(logs / "seattle-corrected.log.gz").recording
    share = {
        site: np.mean(shown(drive, load_map(maps / site))["unlike"]) for site in ("seattle", "aces")
    }
    assert share["seattle"] < 0.05 < 0.9 < share["aces"]


def test_a_drive_is_read_from_its_file(tmp_path):
    drive_in(hall(), 12).save(tmp_path / "tour.npz")
    drive = RecordedDrive.of(tmp_path / "tour.npz")
    about = {"name": "tour.npz", "duration": pytest.approx(1.2), "poses": 12, "scans": 12}
    assert drive.about() == about
    assert RecordedDrive.of(tmp_path / "tour.npz").name == "tour.npz"
    assert RecordedDrive.of(drive) is drive
    assert RecordedDrive.of(drive_in(hall(), 12)).name == "recorded drive"
    assert drive.on(hall()).recording is drive.recording  # it is no bag
    with pytest.raises(ConfigError, match="recording or its file"):
        RecordedDrive.of(3)
    with pytest.raises(LocplanError, match="is not there"):
        RecordedDrive.of(tmp_path / "none.npz")


# Exports


PAGE_FORMATS = ("nav2-keepout", "nav2-speed", "path")


def exported(folder, *, force=False, grid=None, progress=lambda *_: None, **asked):
    """What the page gets of an export into a folder."""
    with contextlib.ExitStack() as ends:
        session = session_of(with_field=grid is None, folder=folder, force=force)
        ends.callback(session.close)
        if grid is not None:
            session.original = session.grid = grid
            own = dataclasses.replace(corridors()[1], grid=grid)
            session.begin(own).result(60)
        return answered(session, "export", progress=progress, **(WAY | asked))


def test_an_export_is_that_of_the_library(tmp_path):
    made = exported(tmp_path / "out", to="nav2-keepout", distro="kilted")
    assert "kilted" in " ".join(made["warnings"])  # what Nav2 does wrong there
    costs = Costmap.from_field(*corridors(), weight=3.0, robot=Robot().radius)
    with pytest.warns(UserWarning, match="kilted"):
        nav2_keepout(tmp_path / "own", costs, distro="kilted")
    own = {each.name for each in (tmp_path / "own").iterdir()}
    folder = "two_corridors-nav2-keepout"
    assert set(made["files"]) == {f"{folder}/{name}" for name in own}
    for name in own:
        mine = (tmp_path / "out" / folder / name).read_bytes()
        assert mine == (tmp_path / "own" / name).read_bytes(), name


@pytest.mark.parametrize("to", PAGE_FORMATS)
def test_each_format_is_written(tmp_path, to):
    files = exported(tmp_path, to=to)["files"]
    assert files
    assert all((tmp_path / name).is_file() for name in files)


def test_a_path_is_exported_through_its_waypoints(tmp_path):
    (file,) = exported(tmp_path, to="path", via=[list(MIDDLE)])["files"]
    xy = locplan.Path.load(tmp_path / file).xy
    assert np.isclose(xy, MIDDLE, atol=1e-6).all(axis=1).any()


def test_an_export_beside_another_gets_a_number(tmp_path):
    first, second = (exported(tmp_path, to="path")["files"] for _ in range(2))
    before = (tmp_path / first[0]).read_bytes()
    assert (first, second) == (["two_corridors-path.csv"], ["two_corridors-path-2.csv"])
    (tmp_path / second[0]).write_text("mine")
    forced = exported(tmp_path, to="path", via=[list(MIDDLE)], force=True)
    assert forced["files"] == first
    assert (tmp_path / first[0]).read_bytes() != before
    assert (tmp_path / second[0]).read_text() == "mine"


def test_a_link_to_nowhere_is_in_the_way(tmp_path):
    (tmp_path / "two_corridors-path.csv").symlink_to(tmp_path / "gone")
    assert exported(tmp_path, to="path")["files"] == ["two_corridors-path-2.csv"]


def test_force_replaces_no_folder_that_was_changed(tmp_path):
    made = exported(tmp_path, to="nav2-speed")
    (tmp_path / made["files"][0]).write_text("mine")
    with pytest.raises(LocplanError):
        exported(tmp_path, to="nav2-speed", force=True)


@pytest.mark.parametrize("name", ["../../etc", "a/b", "..", "", "naïve map", "x" * 500, "\ufffd"])
def test_no_name_of_a_map_leaves_the_folder(tmp_path, name):
    grid, _ = corridors()
    named = dataclasses.replace(grid, name=name)
    (file,) = exported(tmp_path / "o", grid=named, to="path")["files"]
    assert [each.name for each in tmp_path.iterdir()] == ["o"]
    assert Path(file).name == file
    assert (tmp_path / "o" / file).is_file()


@pytest.mark.parametrize(
    ("folder", "asked", "named"),
    [
        (None, {}, "folder"),
        ("out", {"to": "no-such"}, "to must be one of"),
        ("out", {"to": ["path"]}, "to must be one of"),
        ("out", {"distro": "no-such"}, "distro"),
    ],
)
def test_exports_refuse_what_is_unknown(tmp_path, folder, asked, named):
    with pytest.raises(ConfigError, match=named):
        exported(folder and tmp_path / folder, **asked)
    assert not list(tmp_path.iterdir())


# The command and the code


def reproduced(config: FieldConfig, grid=None, way=WAY, drives=None, **opening):
    """The command and the code of a way, of a session with some settings."""
    given, field = corridors()
    known = field if grid is None and config == field.config else None
    session = Session(given if grid is None else grid, Opening(config, **opening))
    session.begin(known).result(120)
    made = answered(session, "reproduce", **way, drives=drives)
    session.close()
    return made


def done_again(made, run):
    """The result of the code, and what the command prints."""
    names = {}
    with contextlib.redirect_stdout(io.StringIO()) as output:
        exec(made["python"], names)
    assert "length" in output.getvalue()
    lines = [line for line in made["shell"].splitlines() if not line.startswith("#")]
    (words,) = map(shlex.split, lines)
    assert words[0] == "locplan"
    code, out, err = run(*words[1:], "--json")
    assert code == 0, err
    return names["result"], json.loads(out)


CONFIGS = {
    "no lidar": (FieldConfig(stride=0.4), True),
    "a range": (FieldConfig(Sad(range=4.0), stride=0.8), True),
    "the paper's": (FieldConfig(Sad.paper(range=5.0)), True),
    "what is seen": (FieldConfig(Sad(template="visible"), stride=0.4), True),
    "a disc as wide as a lidar": (FieldConfig(Sad().with_lidar(Lidar.preset("lds-01"))), True),
    "a preset": (FieldConfig(Scan(Lidar.preset("turtlebot4")), stride=0.4), True),
    "half of a preset": (
        FieldConfig(
            Fisher(
                dataclasses.replace(Lidar.preset("rplidar-a1"), range=5.5, field_of_view_deg=180.0)
            ),
            headings=4,
        ),
        True,
    ),
    "the lidar by default": (FieldConfig(Fused(Lidar()), stride=0.4), True),
    "a lidar of one's own": (FieldConfig(Fisher(Lidar(range=7.5, beams=91)), stride=0.4), True),
    "a mounted one": (FieldConfig(Scan(Lidar(range=9.0, mount_x=0.1, model="mine"))), True),
    "other weights": (FieldConfig(Sad(weights=Exponential(tau=0.4)), stride=0.4), False),
    "another window": (
        FieldConfig(Sad(window=SearchWindow(half_width=1.0)), stride=0.4),
        False,
    ),
    "a fused one": (FieldConfig(Fused(LIDAR, scan=Scan(LIDAR, z_rand=0.1))), False),
    "one's own noise": (FieldConfig(Scan(Lidar(range=9.0, mount_x=0.1), z_rand=0.1)), False),
}
OUTLINE = locplan.Footprint([(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)])
ROBOTS = {
    "the usual one": Robot(),
    "a small one": Robot("lds-01", footprint=0.1, margin=0.02),
    "a long one": Robot(Lidar(range_sigma=0.01), footprint=OUTLINE, inflation=Inflation()),
    "a shaky one": Robot(LIDAR).changed(
        {"laser_model_type": "likelihood_field_prob", "half_cell": False, "heading_drift_deg": 0.1}
    ),
}


def of_options(words: list[str]) -> tuple[Robot, FieldConfig]:
    """The robot and the settings of a field that the commands make of options."""
    from locplan.cli._robot_options import FieldOptions

    pairs = list(zip(words[::2], words[1::2], strict=True))
    kinds = {"disc": float, "stride": float, "headings": int}
    given = {key[2:]: kinds.get(key[2:], str)(value) for key, value in pairs if key != "--set"}
    settings = tuple(value for key, value in pairs if key == "--set")
    return FieldOptions(set=settings, **given).robot_and_field()


@pytest.mark.parametrize("name", ROBOTS)
def test_options_and_code_make_the_same_robot(name):
    robot = ROBOTS[name]
    made, _ = of_options(robot_spelled(robot).words)
    assert made.summary() == robot.summary()
    code = reproduced(FieldConfig(stride=0.8), robot=robot)["python"]
    (line,) = [line for line in code.splitlines() if line.startswith("robot = ")]
    assert eval(line.partition(" = ")[2], {"locplan": locplan}).summary() == robot.summary()


@pytest.mark.parametrize("name", CONFIGS)
def test_options_and_code_make_the_same_settings(name, tmp_path):
    config, sayable = CONFIGS[name]
    lidar = getattr(config.estimator, "lidar", None)
    robot = Robot(lidar)
    names = {"locplan": locplan, "robot": robot}
    for own in (lidar, None):
        assert eval(config_spelled(config, own).code, names) == config
    spelled = config_spelled(config, lidar)
    assert (not spelled.after) == sayable
    if sayable:
        words = [*robot_spelled(robot).words, *spelled.words]
        assert of_options(words) == (robot, config)
        assert "model=mine" not in words


def test_an_estimator_of_ones_own_is_made_from_its_settings(monkeypatch):
    @dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
    class Mine(Sad):
        name = "mine"

    Mine.__module__ = "elsewhere"
    config = FieldConfig(Mine(range=5.0))
    spelled = config_spelled(config, None)
    assert spelled.words == ["--config", "settings.json"]
    assert "from_json" in spelled.code
    config = changed(FieldConfig(), weights=InverseSquare())
    assert config_spelled(config, None).words == ["--config", "settings.json"]


@pytest.mark.parametrize(
    ("config", "name"),
    [
        (FieldConfig(stride=0.8), 'two corridors\' "map" $HOME.yaml'),
        (FieldConfig(Fisher(Lidar(range=7.5, beams=91)), stride=0.4), "-dash;x.yaml"),
        (FieldConfig(Fisher(Lidar.preset("lds-01")), stride=0.4), "ünï.yaml"),
    ],
)
def test_the_command_and_the_code_plan_the_path_shown(config, name, run, tmp_path, monkeypatch):
    grid, _ = corridors()
    moved = dataclasses.replace(grid, origin=(-20.0, -1.5, 0.3))
    save_map(moved, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    moved = load_map(tmp_path / name)

    def world(xy):
        x, y = moved.grid_to_world(xy[1] / 0.1, xy[0] / 0.1)
        return float(x), float(y)

    start, *via, goal = (world(xy) for xy in (START, MIDDLE, (21.0, 3.0), GOAL))
    robot, criterion = Robot(footprint=0.2, margin=0.0), "heading_std"
    way = {"start": start, "goal": goal, "via": via, "weight": 2.5}
    made = reproduced(config, moved, way, robot=robot, criterion=criterion, map_file=name)
    field = locplan.load_or_compute(moved, config)
    costs = Costmap.from_field(moved, field, weight=2.5, robot=0.2, criterion=criterion)
    own = plan_beside_shortest(costs, start, goal, via=via)[AWARE].path.xy
    code, command = done_again(made, run)
    assert np.allclose(code.candidates[1].path.xy, own, rtol=0, atol=1e-8)
    assert np.allclose(command["candidates"][1]["path"]["xy"], own, rtol=0, atol=1e-8)
    assert min(own[:, 0]) < 0


@pytest.mark.parametrize(
    "config", [FieldConfig(Sad(range=4.0), stride=0.8), FieldConfig(Fisher(LIDAR))]
)
def test_the_command_and_the_code_choose_as_the_simulation_does(config, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid, _ = corridors()
    save_map(grid, "lab.yaml")
    grid = load_map("lab.yaml")
    robot = Robot().changed({"max_particles": 600, "half_cell": False, "outliers": 0.1})
    given = {"robot": robot, "criterion": "heading_std", "map_file": "lab.yaml"}
    made = reproduced(config, grid, WAY | {"weight": 2.5}, 2, **given)
    own = locplan.choose(
        *(grid, START, GOAL, equipped(robot, config)),
        costs=config,
        weight=2.5,
        criterion="heading_std",
        drives=2,
    )
    code, command = done_again(made, run)
    assert code == own
    expected = json.loads(json.dumps(own.summary()))
    for each in (command, expected):  # the command keeps the lidar beside sad's disc
        del each["about"]["config"]
    assert command == expected
    assert len(list((tmp_path / "chosen").glob("*.csv"))) > 2


def test_a_choice_with_another_lidar_than_the_fields_is_told_in_python():
    made = reproduced(corridors()[1].config, robot=Robot(Lidar(range=9.0)), drives=8)
    assert "cannot say the lidar" in made["shell"]
    assert "robot = locplan.Robot().changed({'range': 9.0})" in made["python"]
    assert "locplan.Fisher(lidar=locplan.Lidar(range=6.0))" in made["python"]


# The page to share


def tiny(folder: Path) -> Path:
    """A page of two modules."""
    folder.mkdir()
    (folder / "index.html").write_text(
        '<!doctype html><html><head>\n<title>x</title>\n<link rel="icon" href="static/i.svg">\n'
        '<link rel="stylesheet" href="static/s.css">\n</head><body><p id="p"></p>\n'
        '<script type="module" src="static/main.js"></script>\n</body></html>\n'
    )
    (folder / "i.svg").write_text("<svg/>")
    (folder / "s.css").write_text("p { color: red }")
    (folder / "main.js").write_text('import { a } from "./a.js";\n\na("</script><!--");\n')
    (folder / "a.js").write_text("export function a(x) {\n  return x;\n}\nexport const b = 1;\n")
    return folder


def page_of(monkeypatch=None, static=None, **named) -> str:
    """A page of the corridors that is handed on, of the files in another folder perhaps."""
    if static is not None:
        monkeypatch.setattr("locplan.explorer._sharing.STATIC", static)
    session = session_of()
    session.original = dataclasses.replace(session.original, **named)
    told = answered(session, "share", view={**WAY, "layer": "sigma"})
    content = session.download(told["download"]).content
    assert told["bytes"] == len(content)
    session.close()
    return content.decode()


def page_data(page: str) -> dict:
    """What a page carries."""
    return json.loads(re.search(r"window\.LOCPLAN = (.*?);</script>", page).group(1))


def modules_of(page: str) -> str:
    """The modules of a page as one script."""
    return re.search(r'<script type="module">(.*?)</script>', page, re.S).group(1)


def test_modules_are_joined_in_the_order_of_their_imports(tmp_path, monkeypatch):
    page = page_of(monkeypatch, tiny(tmp_path / "static"))
    expected = 'function a(x) {\n  return x;\n}\nconst b = 1;\n\n\na("\\x3c/script>\\x3c!--");\n'
    assert modules_of(page) == expected


@pytest.mark.parametrize(
    ("file", "text", "named"),
    [
        ("a.js", "export default 3;\n", "export default"),
        ("index.html", '<html><head></head><img src="static/a.png"></html>', "no page"),
    ],
)
def test_a_page_that_cannot_be_joined_is_refused(tmp_path, monkeypatch, file, text, named):
    folder = tiny(tmp_path / "static")
    (folder / file).write_text(text)
    with pytest.raises(LocplanError, match=named):
        page_of(monkeypatch, folder)


def test_no_text_within_ends_the_script(tmp_path, monkeypatch):
    hostile = '</script><script>alert("&")</script>\u2028<!-- <b>"&'
    page = page_of(monkeypatch, tiny(tmp_path / "static"), name=hostile)
    named = page_data(page)["about"]["map"]["name"]
    assert named.startswith('</script><script>alert("&")</script>')
    assert page.count("<script") == page.count("</script>") == 2
    assert "alert(" in page
    assert "<title>&lt;/script&gt;&lt;script&gt;alert(&quot;&amp;&quot;)" in page
    data = re.search(r"window\.LOCPLAN = (.*?);</script>", page).group(1)
    assert not set("<>&\u2028") & set(data)


def test_the_policy_allows_just_what_is_inside():
    import hashlib

    page = page_of()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    rules = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert rules["default-src"] == "'none'"
    for kind, pattern in (("script", r"<script[^>]*>(.*?)</script>"), ("style", "<style>(.*?)</s")):
        inside = re.findall(pattern, page, re.S)
        digests = [base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() for t in inside]
        assert rules[f"{kind}-src"].split() == [f"'sha256-{each}'" for each in digests]
    assert page.index("Content-Security-Policy") < page.index("<script")


def test_a_shared_page_carries_map_layers_and_answer():
    page, (grid, field) = page_of(), corridors()
    data = page_data(page)
    cells = np.frombuffer(zlib.decompress(base64.b64decode(data["cells"])), np.uint8)
    levels = np.array([UNKNOWN, FREE, OCCUPIED])[cells].reshape(grid.shape)
    np.testing.assert_array_equal(levels[::-1], grid.cells)
    sigma = zlib.decompress(base64.b64decode(data["layers"]["sigma"]))
    assert len(sigma) == field.evaluated.size
    assert data["answer"]["aware"]["length"] > data["answer"]["shortest"]["length"]
    assert data["view"]["layer"] == "sigma"
    assert (data["about"]["can"], data["about"]["drives"]) == ({}, [])
    assert data["state"]["busy"] is None
    assert "<title>two_corridors · fisher · locplan</title>" in page
    assert page_of() == page


def test_a_shared_page_asks_nobody_for_anything():
    text = page_of()
    outside = set(re.findall(r"(?:https?:)?//[\w.-]+\.\w+[^\s\"'`]*", text))
    assert not {each for each in outside if not each.startswith("http://www.w3.org/")}
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    assert "@import" not in text
    assert not re.search(r"url\((?!['\"]?(?:data:|#))", text)


def test_modules_of_the_page_name_no_two_things_alike():
    script = modules_of(page_of())
    names = re.findall(r"^(?:async )?(?:function\*?|const|let|class) ([\w$]+)", script, re.M)
    pairs = re.findall(r"^(?:const|let) [\[{]([^\]}]*)[\]}] =", script, re.M)
    names += [
        each.split(":")[-1].split("=")[0].strip() for pair in pairs for each in pair.split(",")
    ]
    assert names
    assert not {name for name in names if names.count(name) > 1}


# The notebook


@pytest.mark.parametrize("kernel", [None, object()])
def test_in_a_notebook_alone_the_page_is_a_frame(monkeypatch, kernel):
    import sys
    import types

    shell = types.SimpleNamespace(kernel=kernel)
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    with locplan.explore(*corridors(), open_browser=False) as page:
        html = page._repr_html_()
    assert (html is None) == (kernel is None)
    if html:
        assert html.count(page.address) == 2
