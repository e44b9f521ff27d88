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
    Ended,
    answered,
    corridors,
    session_of,
    view,
)

import locplan
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.explorer import RecordedDrive
from locplan.explorer._drives import MAX_POSES, shown_drive
from locplan.explorer._explore import frame_html, in_notebook
from locplan.explorer._reproduce import reproduced
from locplan.explorer._sharing import json_in_html, one_page, one_script, shared_page
from locplan.explorer._simulating import simulated
from locplan.explorer._view import View
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


def hall() -> OccupancyGrid:
    """A hall of 18 x 8 m with walls of 0.5 m, which begin 0.5 m from the map's edge."""
    cells = np.full((90, 190), UNKNOWN, np.uint8)
    cells[5:-5, 5:-5], cells[10:-10, 10:-10] = OCCUPIED, FREE
    return OccupancyGrid(cells, 0.1)


def test_a_drive_is_shown_pose_by_pose():
    grid = hall()
    drive = drive_in(grid, 30)
    told = json.loads(json.dumps(shown_drive(drive, grid), allow_nan=False))
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
    assert shown_drive(mixed, grid)["unlike"] == [0] * 3 + [1] * 3


def test_a_scan_with_few_returns_is_not_judged():
    grid = hall()
    ranges = drive_in(grid, 3, moved=-2.4).ranges.copy()
    ranges[1, 9:] = np.inf
    ranges[2] = np.inf
    some = dataclasses.replace(drive_in(grid, 3), ranges=ranges)
    assert shown_drive(some, grid)["unlike"] == [1, 0, 0]


def test_of_a_long_drive_some_poses_are_shown():
    grid = hall()
    drive = drive_in(grid, MAX_POSES + 700, times=False)
    told = shown_drive(drive, grid)
    assert len(told["x"]) == len(told["t"]) == MAX_POSES
    assert (told["x"][0], told["x"][-1]) == pytest.approx((drive.poses[0, 0], drive.poses[-1, 0]))
    assert told["timed"] is False
    assert told["scans"] == MAX_POSES + 700


def test_matched_scans_have_the_deviations_of_the_library():
    grid = hall()
    drive = drive_in(grid, 4)
    calls = []
    shown = shown_drive(drive, grid, matched=True, progress=lambda *n: calls.append(n))
    assert calls[-1] == (4, 4)
    own = match_scans(drive, grid).position_std
    assert shown["sd"] == pytest.approx(own.round(4).tolist())


def test_a_drive_off_the_map_is_shown_without_deviations():
    grid = hall()
    away = drive_in(grid, 4).moved(500.0, 0.0, 0.0)
    assert shown_drive(away, grid, matched=True)["sd"] == [None] * 4


def test_real_scans_are_unlike_the_maps_of_other_sites():
    logs, maps = SHARED_DATA / "carmen", SHARED_DATA / "rosmaps_carmen"
    if not logs.is_dir() or not maps.is_dir():
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    drive = RecordedDrive.read(logs / "seattle-corrected.log.gz").recording
    share = {
        site: np.mean(shown_drive(drive, load_map(maps / site))["unlike"])
        for site in ("seattle", "aces")
    }
    assert share["seattle"] < 0.05 < 0.9 < share["aces"]


def test_a_drive_is_read_from_its_file(tmp_path):
    drive_in(hall(), 12).save(tmp_path / "tour.npz")
    drive = RecordedDrive.read(tmp_path / "tour.npz")
    about = {"name": "tour.npz", "duration": pytest.approx(1.2), "poses": 12, "scans": 12}
    assert drive.about() == about
    assert RecordedDrive.of(tmp_path / "tour.npz").name == "tour.npz"
    assert RecordedDrive.of(drive) is drive
    assert RecordedDrive.of(drive_in(hall(), 12)).name == "recorded drive"
    with pytest.raises(ConfigError, match="recording or its file"):
        RecordedDrive.of(3)
    with pytest.raises(LocplanError, match="is not there"):
        RecordedDrive.read(tmp_path / "none.npz")


# Exports


PAGE_FORMATS = ("nav2-keepout", "nav2-static", "nav2-speed", "route-graph", "path")


def exported(folder, *, force=False, grid=None, progress=lambda *_: None, **asked):
    """What the page gets of an export into a folder."""
    with contextlib.ExitStack() as ends:
        session = session_of(with_field=grid is None, folder=folder, force=force)
        ends.callback(session.upkeep.close)
        if grid is not None:
            session.original = session.grid = grid
            own = dataclasses.replace(corridors()[1], grid=grid)
            session.upkeep.begin(own).result(60)
        return answered(session, "export", progress=progress, **(WAY | asked))


def test_an_export_is_that_of_the_library(tmp_path):
    made = exported(tmp_path / "out", to="nav2-keepout", distro="kilted")
    assert "kilted" in " ".join(made["warnings"])  # what Nav2 does wrong there
    costs = Costmap.from_field(*corridors(), weight=3.0, robot_radius=Robot().radius)
    with pytest.warns(UserWarning, match="kilted"):
        nav2_keepout(tmp_path / "own", costs, distro="kilted")
    own = {each.name for each in (tmp_path / "own").iterdir()}
    folder = "two_corridors-nav2-keepout"
    assert set(made["files"]) == {f"{folder}/{name}" for name in own}
    for name in own:
        mine = (tmp_path / "out" / folder / name).read_bytes()
        assert mine == (tmp_path / "own" / name).read_bytes(), name


@pytest.mark.parametrize("to", [name for name in PAGE_FORMATS if name != "route-graph"])
def test_each_format_is_written(tmp_path, to):
    files = exported(tmp_path, to=to)["files"]
    assert files
    assert all((tmp_path / name).is_file() for name in files)


def test_a_path_is_exported_through_its_waypoints(tmp_path):
    (file,) = exported(tmp_path, to="path", via=[list(MIDDLE)])["files"]
    xy = locplan.Path.load(tmp_path / file).xy
    assert np.isclose(xy, MIDDLE, atol=1e-6).all(axis=1).any()


def test_a_route_graph_shows_how_far_it_is_and_leaves_nothing_when_it_is_ended(tmp_path):
    steps = []
    exported(tmp_path, to="route-graph", progress=lambda *step: steps.append(step[:2]))
    steps = steps[1:]  # the first one is of the plan
    assert steps == sorted(steps)
    assert len({done for done, _ in steps}) > 10
    (folder,) = tmp_path.iterdir()

    def stop(done, total, doing=""):
        if done > 90:  # the files are being written
            raise Ended

    with pytest.raises(Ended):
        exported(tmp_path, to="route-graph", progress=stop)
    assert [*tmp_path.iterdir()] == [folder]


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


def both_paths(shown: View, file, run, tmp_path, monkeypatch):
    """The aware path of a view's code, of its command, and its own."""
    monkeypatch.chdir(tmp_path)
    made = reproduced(shown, file)
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(made["python"], {})
    command = [line for line in made["shell"].splitlines() if not line.startswith("#")]
    (words,) = map(shlex.split, command)
    assert words[0] == "locplan"
    code, out, err = run(*words[1:], "--json")
    assert code == 0, err
    own = shown.plans()["localizability-aware"].path.xy
    return json.loads(output.getvalue()), json.loads(out)["candidates"][1]["xy"], own


CONFIGS = {
    "no lidar": (FieldConfig(stride=0.4), True),
    "a range": (FieldConfig(Sad(range=4.0), stride=0.8), True),
    "the paper's": (FieldConfig(Sad.paper(range=5.0)), True),
    "what is seen": (FieldConfig(Sad(template="visible"), stride=0.4), True),
    "a disc as wide as a lidar": (FieldConfig(Sad.of(Lidar.preset("lds-01"))), True),
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
    "the lidar by default": (FieldConfig(Fused.of(Lidar()), stride=0.4), True),
    "a lidar of one's own": (FieldConfig(Fisher(Lidar(range=7.5, beams=91)), stride=0.4), True),
    "a mounted one": (FieldConfig(Scan(Lidar(range=9.0, mount_x=0.1, model="mine"))), True),
    "other weights": (FieldConfig(Sad(weights=Exponential(tau=0.4)), stride=0.4), False),
    "another window": (
        FieldConfig(Sad(window=SearchWindow(half_width=1.0)), stride=0.4),
        False,
    ),
    "a fused one": (FieldConfig(Fused(Fisher(LIDAR), Scan(LIDAR, z_rand=0.1))), False),
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
    from locplan.cli._field_options import FieldOptions
    from locplan.cli._robot_options import RobotOptions

    pairs = list(zip(words[::2], words[1::2], strict=True))
    kinds = {"disc": float, "stride": float, "headings": int}
    given = {key[2:]: kinds.get(key[2:], str)(value) for key, value in pairs if key != "--set"}
    named = given.pop("lidar", None)
    robot = RobotOptions(lidar=named, set=tuple(value for key, value in pairs if key == "--set"))
    return FieldOptions(**given).with_robot(robot)


@pytest.mark.parametrize("name", ROBOTS)
def test_options_and_code_make_the_same_robot(name):
    robot = ROBOTS[name]
    made, _ = of_options(robot_spelled(robot).words)
    assert made.summary() == robot.summary()
    costs = dataclasses.replace(view().costs, robot_radius=robot.radius)
    code = reproduced(dataclasses.replace(view(robot=robot), costs=costs), "lab.yaml")["python"]
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
    field = locplan.load_or_compute(moved, config)
    costs = Costmap.from_field(moved, field, weight=2.5, robot_radius=0.2, criterion="heading_std")

    def world(xy):
        x, y = moved.grid_to_world(xy[1] / 0.1, xy[0] / 0.1)
        return float(x), float(y)

    stops = world(START), world(MIDDLE), world((21.0, 3.0)), world(GOAL)
    robot = equipped(Robot(footprint=0.2, margin=0.0), config)
    shown = View(moved, field, costs, robot, stops[0], stops[-1], stops[1:-1])
    code, command, own = both_paths(shown, name, run, tmp_path, monkeypatch)
    assert np.allclose(code, own, rtol=0, atol=1e-8)
    assert np.allclose(command, own, rtol=0, atol=1e-8)
    assert min(own[:, 0]) < 0


@pytest.mark.parametrize(
    "config", [FieldConfig(Sad(range=4.0), stride=0.8), FieldConfig(Fisher(LIDAR))]
)
def test_the_command_and_the_code_choose_as_the_simulation_does(config, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid, _ = corridors()
    save_map(grid, "lab.yaml")
    grid = load_map("lab.yaml")
    field = locplan.load_or_compute(grid, config)
    costs = Costmap.from_field(grid, field, weight=2.5, criterion="heading_std")
    robot = Robot().changed({"max_particles": 600, "half_cell": False, "outliers": 0.1})
    robot = equipped(robot, field.config)
    shown = View(grid, field, costs, robot, START, GOAL)
    told = simulated(shown, drives=2)
    made = reproduced(shown, "lab.yaml", drives=2)
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(made["python"], {})
    assert np.allclose(json.loads(output.getvalue()), told.path.xy, rtol=0, atol=1e-8)
    code, out, err = run(*shlex.split(made["shell"])[1:], "--json")
    assert code == 0, err
    about, expected = json.loads(out), json.loads(json.dumps(told.summary()))
    about.pop("config"), expected.pop("config")  # the command keeps the lidar beside sad's disc
    assert about == expected
    assert len(list((tmp_path / "chosen").glob("*.csv"))) > 2


def test_a_choice_with_another_lidar_than_the_fields_is_told_in_python():
    shown = view(robot=Robot(Lidar(range=9.0)))
    made = reproduced(shown, "lab.yaml", drives=8)
    assert "cannot say the lidar" in made["shell"]
    assert "robot = locplan.Robot().changed({'range': 9.0})" in made["python"]
    assert "locplan.Fisher(lidar=locplan.Lidar(range=6.0))" in made["python"]


def test_edits_that_are_not_saved_are_said_first():
    made = reproduced(view(), "lab.yaml", edited=True)
    for text in (made["shell"], made["python"]):
        assert text.startswith("# lab.yaml is not the map on the page, which was edited since")
    assert not reproduced(view(), "lab.yaml")["python"].startswith("#")
    assert "locplan.save_map" in reproduced(view(), None)["shell"].splitlines()[0]


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


def test_modules_are_joined_in_the_order_of_their_imports(tmp_path):
    script = one_script(tiny(tmp_path / "static"))
    assert (
        script == 'function a(x) {\n  return x;\n}\nconst b = 1;\n\n\na("\\x3c/script>\\x3c!--");\n'
    )


def test_a_module_that_cannot_be_joined_is_refused(tmp_path):
    folder = tiny(tmp_path / "static")
    (folder / "a.js").write_text("export default 3;\n")
    with pytest.raises(LocplanError, match="export default"):
        one_script(folder)


def test_no_text_within_ends_the_script(tmp_path):
    hostile = {"name": '</script><script>alert("&")</script>', "other": "\u2028<!--"}
    page = one_page('<b>"&', hostile, tiny(tmp_path / "static"))
    assert page.count("<script") == page.count("</script>") == 2
    assert "alert(" in page
    assert "<title>&lt;b&gt;&quot;&amp;</title>" in page
    data = re.search(r"window\.LOCPLAN = (.*?);</script>", page).group(1)
    assert json.loads(data) == hostile
    assert json.loads(json_in_html(hostile)) == hostile
    assert not set("<>&\u2028") & set(json_in_html(hostile))


def test_the_policy_allows_just_what_is_inside(tmp_path):
    import hashlib

    page = one_page("x", {}, tiny(tmp_path / "static"))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    rules = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert rules["default-src"] == "'none'"
    for kind, pattern in (("script", r"<script[^>]*>(.*?)</script>"), ("style", "<style>(.*?)</s")):
        inside = re.findall(pattern, page, re.S)
        digests = [base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() for t in inside]
        assert rules[f"{kind}-src"].split() == [f"'sha256-{each}'" for each in digests]
    assert page.index("Content-Security-Policy") < page.index("<script")


def made_page(name: str = "lab", view_of_page=None):
    """A page of a small map."""
    about = {"version": "0", "map": {"name": name}, "can": {"save": True}, "drives": [{"n": 1}]}
    state = {"field": {"estimator": "scan"}, "layers": [], "busy": {"do": "field"}}
    cells = np.arange(200 * 300, dtype=np.uint8).reshape(200, 300) % 3
    layers = {"sigma": np.full((20, 30), 7, np.uint8)}
    return shared_page(about, state, cells, layers, {"aware": None}, view_of_page), cells


def page_data(page) -> dict:
    """What a page carries."""
    text = page.content.decode()
    return json.loads(re.search(r"window\.LOCPLAN = (.*?);</script>", text).group(1))


def test_a_shared_page_carries_map_layers_and_answer():
    page, cells = made_page()
    data = page_data(page)
    assert zlib.decompress(base64.b64decode(data["cells"])) == cells.tobytes()
    assert zlib.decompress(base64.b64decode(data["layers"]["sigma"])) == bytes([7] * 600)
    assert data["answer"] == {"aware": None}
    assert data["about"]["can"] == {}
    assert data["about"]["drives"] == []
    assert data["state"]["busy"] is None
    assert page.title == "lab · scan · locplan"
    assert page.size == len(page.content)
    assert made_page()[0].content == page.content


def test_a_shared_page_asks_nobody_for_anything():
    text = made_page("</script>")[0].content.decode()
    outside = set(re.findall(r"(?:https?:)?//[\w.-]+\.\w+[^\s\"'`]*", text))
    assert not {each for each in outside if not each.startswith("http://www.w3.org/")}
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    assert "@import" not in text
    assert not re.search(r"url\((?!['\"]?(?:data:|#))", text)
    assert page_data(made_page("</script>")[0])["about"]["map"]["name"] == "</script>"


def test_modules_of_the_page_name_no_two_things_alike():
    names = re.findall(r"^(?:async )?(?:function\*?|const|let|class) ([\w$]+)", one_script(), re.M)
    pairs = re.findall(r"^(?:const|let) [\[{]([^\]}]*)[\]}] =", one_script(), re.M)
    names += [
        each.split(":")[-1].split("=")[0].strip() for pair in pairs for each in pair.split(",")
    ]
    assert names
    assert not {name for name in names if names.count(name) > 1}


# The notebook


def test_a_frame_is_html_with_its_address_escaped():
    html = frame_html('http://127.0.0.1:1/a"b<c>/', 300)
    assert 'height="300"' in html
    assert '"b<c>' not in html
    assert "&quot;b&lt;c&gt;" in html


def test_a_script_is_no_notebook(monkeypatch):
    import sys
    import types

    assert not in_notebook()
    shell = types.SimpleNamespace(kernel=None)
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    assert not in_notebook()
    shell.kernel = object()
    assert in_notebook()
