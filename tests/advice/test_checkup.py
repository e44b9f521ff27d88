"""The check: weak spots, routes, simulated fixes, and the next action."""

import dataclasses
import json
import logging
import math
import re
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from support.check_cases import CORNERS, FEW_PARTICLES, LIDAR, ROBOT, TUNED_FILTER
from support.maps import blocks, furnished_room
from support.small_drive import FILE

import locplan
from locplan import check, save_map
from locplan.advice.failures import attribute_failures
from locplan.advice.figures import caption_text
from locplan.advice.limits import CheckLimit
from locplan.advice.next_step import choose_next_action
from locplan.advice.rates import rank_fixes
from locplan.advice.text import spot_text
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, environments
from locplan.robots.presets import UPDATES
from locplan.simulation.arrivals import Arrivals, ClosedLoopDrive
from locplan.simulation.drives import LOST_DISTANCE

pytestmark = pytest.mark.usefixtures("undrawn")

UNTUNED = locplan.Robot(LIDAR).with_settings(FEW_PARTICLES)
AISLES = [((14.05, 15.05), (16.35, 2.95)), ((1.1, 18.9), (13.3, 18.9))]


@contextmanager
def listen():
    """Yield a list that gets the findings of checks as they are logged."""
    findings = []
    handler = logging.Handler()
    handler.emit = lambda record: findings.append(record.getMessage())
    logger = logging.getLogger("locplan.advice")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    yield findings
    logger.setLevel(logging.NOTSET)
    logger.removeHandler(handler)


class Watched:
    """A check with its findings and its progress, in order."""

    def __init__(self):
        self.steps = []
        with listen() as self.findings:
            self.report = check(
                *(furnished_room(), ROBOT.with_settings(UPDATES), CORNERS),
                effort="quick",
                progress=lambda *step: self.steps.append((len(self.findings), *step)),
            )


@pytest.fixture(scope="module")
def watched():
    return Watched()


@pytest.fixture(scope="module")
def fine(watched):
    return watched.report


@pytest.fixture(scope="module")
def solid():
    return check(blocks(), UNTUNED, AISLES, effort="quick")


def test_check_recommends_nothing_for_tuned_robot(fine):
    assert fine.is_fine
    assert fine.recommended == ()
    assert fine.fixed_scenario.paths == fine.scenario.paths
    high = 100 * fine.baseline.lost.high
    text = " ".join(fine.report().split())
    assert f"Nothing to do. A quick check cannot exclude a loss rate of up to {high:.0f} %." in text


@pytest.mark.parametrize("columns", [58, 64, 71, 80])
def test_report_keeps_intervals_on_one_line(solid, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    for line in solid.report().splitlines():
        assert not re.match(r"%|\[\d|\d+\]", line)


def test_routes_join_all_station_pairs(fine):
    assert [each.name for each in fine.routes] == ["door to desk", "door to shelf", "desk to shelf"]
    for each in fine.routes:
        start, goal = each.name.split(" to ")
        assert np.allclose(each.path.xy[[0, -1]], [CORNERS[start], CORNERS[goal]])


def test_repaired_map_helps_against_solid_walls(solid):
    assert "map" in solid.recommended
    assert solid.after.lost.high < solid.before.lost.low
    assert np.array_equal(
        solid.fixed_scenario.filter_map.cells, locplan.maps.hollow_walls(blocks()).cells
    )
    assert solid.fixed_scenario.world is solid.scenario.world


def test_weak_spots_name_map_fault(solid):
    alone = [each for each in solid.spots if not each.rings and not each.stopped]
    assert alone
    assert {each.missing for each in alone} == {"the map is wrong (solid walls)"}


@pytest.mark.long
def test_check_accepts_repaired_filter_map(solid, tmp_path):
    """The repair is not recommended again, nor advised."""
    filter_map = solid.fixed_scenario.filter_map
    report = check(blocks(), UNTUNED, AISLES, effort="quick", filter_map=filter_map)
    assert "locplan repair" in " ".join(fault.sentence for fault in solid.faults)
    assert "locplan repair" not in " ".join(fault.sentence for fault in report.faults)
    assert report.baseline.lost.high < solid.baseline.lost.low
    assert "map" not in [each.kind for each in report.fixes]
    solid.save(tmp_path / "own")
    assert (
        f"{tmp_path}/own/"
        in json.loads((tmp_path / "own" / "check.json").read_text())["next"]["command"]
    )


def test_equal_losses_put_cheaper_fix_first(solid):
    """Loss rates with overlapping intervals count as equal, even if the error is larger."""
    repair, settings = solid.fixes
    assert (repair.kind, settings.kind) == ("map", "settings")
    assert repair.rates.lost.high > settings.rates.lost.value > repair.rates.lost.value
    worse_repair = dataclasses.replace(repair, rates=settings.rates, ratio=settings.ratio)
    better_settings = dataclasses.replace(settings, rates=repair.rates, ratio=repair.ratio)
    assert rank_fixes([better_settings, worse_repair]) == [worse_repair, better_settings]


@pytest.mark.long
def test_small_error_makes_fix_optional():
    """A robot with an error below 0.1 m needs no other settings."""
    changes = {name: 0.2 for name in TUNED_FILTER if name.startswith("alpha")}
    report = check(furnished_room(), ROBOT.with_settings(changes), CORNERS, effort="quick")
    assert report.recommended == ()
    (settings,) = (fix for fix in report.fixes if fix.kind == "settings")
    assert settings.verdict == "better"
    assert "would lower the error" in " ".join(report.report().split())


def test_settings_help_against_scattered_particles(two_corridors_at_its_worst):
    report = two_corridors_at_its_worst
    assert report.recommended == ("settings",)
    assert report.preset_choice.name == "safe"
    assert report.fixed_scenario.robot.amcl.update_min_d == 0.1
    assert report.confirmation.word == "better"


@pytest.fixture(scope="module")
def two_corridors_at_its_worst():
    grid = environments.make("two_corridors", resolution=0.1)
    noisy = {name: 1.0 for name in TUNED_FILTER if name.startswith("alpha")}
    robot = ROBOT.with_settings({**noisy, "min_particles": 100, "max_particles": 200})
    return check(grid, robot, [((2.0, 3.0), (16.0, 3.0))], effort="quick")


def test_losing_route_names_its_weak_spots(solid):
    losing = [each for each in solid.routes if each.rates.lost.value]
    assert losing
    for each in losing:
        assert re.fullmatch(r"([A-F](, [A-F])*)?", each.lost_near)
        assert len(each.lost_at) == round(each.rates.lost.value * each.rates.n_drives)
    assert sum(each.lost for each in solid.spots) == sum(len(each.lost_at) for each in losing)


def test_weak_spots_are_sorted_by_failures(solid, two_corridors_at_its_worst):
    for report in (solid, two_corridors_at_its_worst):
        failed = [each.lost + each.stopped for each in report.spots]
        assert failed == sorted(failed, reverse=True)
        letters = [each.letter for each in report.spots]
        assert letters == [*"ABCDEF", *[""] * len(letters)][: len(letters)]
        idle = [each for each in report.spots if not each.lost + each.stopped]
        weight = [each.position_std * each.length * len(each.routes) for each in idle]
        assert weight == sorted(weight, reverse=True)


@pytest.mark.long
def test_wide_hall_has_single_weak_spot():
    cells = np.full((300, 300), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    hall = OccupancyGrid(cells, 0.1, name="hall")
    report = check(hall, ROBOT, [((3.0, 15.0), (27.0, 15.0))], effort="quick")
    (wide,) = [each for each in report.spots if each.missing == "few walls within 6 m"]
    assert min(wide.length, wide.width) > 15
    assert abs(wide.y - 15) < 1
    assert wide.routes


def test_weak_spot_is_featureless_corridor(two_corridors_at_its_worst):
    first = two_corridors_at_its_worst.spots[0]
    assert first.letter == "A"
    assert first.length > 10 > first.width
    turned = math.degrees(first.direction)
    assert min(turned, 180 - turned) < 5
    assert first.missing == "no features along x"
    assert first.routes


@pytest.mark.long
def test_weak_spots_are_reachable():
    """A strip between a drawn frame and the edge of the image is wide and featureless."""
    cells = np.full((100, 240), FREE, np.uint8)
    cells[20:80:59, 20:220] = cells[20:80, 20:220:199] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, name="framed")
    larger = OccupancyGrid(np.pad(cells, 5, constant_values=FREE), 0.1, (-0.5, -0.5, 0.0))
    report = check(grid, ROBOT, [((3.0, 5.0), (20.0, 5.0))], effort="quick", filter_map=larger)
    assert report.spots
    assert all(2 <= each.x <= 22 and 2 <= each.y <= 8 for each in report.spots)
    sizes = "The map measures 24.00 x 10.00 m, the filter's map 25.00 x 11.00 m"
    assert sizes in " ".join(report.report().split())


def test_long_routes_are_driven_less_often():
    """A quick check simulates a third of its 32 drives on a route of 100 m."""
    cells = np.full((30, 1020), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    lidar = locplan.Lidar(range=6.0, beams=30)
    robot = locplan.Robot(lidar).with_settings({"min_particles": 10, "max_particles": 10})
    stations = {"west": (1.0, 1.5), "east": (101.0, 1.5)}
    report = check(OccupancyGrid(cells, 0.1), robot, stations, effort="quick")
    assert (report.baseline.n_drives, report.baseline.n_closed) == (11, 6)


@pytest.mark.long
def test_fix_without_gain_is_driven_less():
    robot = ROBOT.with_settings({**UPDATES, "laser_max_range": 5.9})
    report = check(furnished_room(), robot, CORNERS, effort="quick")
    (longer_range,) = report.fixes
    assert longer_range.kind == "range"
    assert longer_range.rates.n_drives < report.baseline.n_drives
    assert longer_range.verdict in ("worse", "no difference", "undecided")
    assert math.isnan(longer_range.rates.reached.value)


@pytest.mark.long
def test_full_range_helps_against_limited_one():
    grid = environments.make("two_corridors", resolution=0.1)
    robot = locplan.Robot(locplan.Lidar(range=12.0, beams=120)).with_settings(TUNED_FILTER)
    report = check(grid, robot.with_settings({"laser_max_range": 1.5}), effort="quick")
    assert "range" in report.recommended
    assert report.fixed_scenario.robot.amcl.laser_max_range >= 12.0


def test_threshold_repair_finds_dark_grey_walls(tmp_path):
    save_map(furnished_room(), tmp_path / "room.yaml")
    image = tmp_path / "room.pgm"
    image.write_bytes(image.read_bytes().replace(b"\x00", b"\x70"))
    report = check(tmp_path / "room.yaml", ROBOT, CORNERS, effort="quick")
    assert (report.scenario.world.cells == OCCUPIED).sum() == (
        furnished_room().cells == OCCUPIED
    ).sum()
    assert report.recommended[0] == "walls"
    report.save(tmp_path / "report")
    written = locplan.load_map(tmp_path / "report" / "map.yaml")
    assert np.array_equal(written.cells, furnished_room().cells)


@pytest.mark.long
def test_check_ignores_thread_count(fine, tmp_path, monkeypatch):
    monkeypatch.setenv("LOCPLAN_CACHE", str(tmp_path))  # an empty cache
    again = check(
        furnished_room(), ROBOT.with_settings(UPDATES), CORNERS, effort="quick", threads=1
    )
    assert again.summary() == fine.summary()


@pytest.mark.parametrize("columns", ["80", "120"])
def test_report_is_short_and_names_fixes(
    solid, two_corridors_at_its_worst, fine, monkeypatch, columns
):
    monkeypatch.setenv("COLUMNS", columns)
    for each in (solid, two_corridors_at_its_worst, fine):
        text = each.report(Path("report"))
        lines = text.splitlines()
        assert len(lines) <= 25
        assert "..." not in text
        assert max(len(line) for line in lines if "report/" not in line) <= int(columns)
        assert ("Weak spot A" in text) == bool(each.spots)
        for fix in each.fixes:
            assert set(fix.title.split()) <= set(text.split())  # its cell may fold
        assert text.startswith(f"Your robot gets lost (error > {LOST_DISTANCE:g} m) in")
    assert "repaired map" in solid.report()


def test_report_names_letters_of_picture(fine, solid):
    spots = [dataclasses.replace(solid.spots[0], letter=letter) for letter in "ABCDEF"]
    text = dataclasses.replace(fine, spots=tuple(spots)).report()
    explained = re.findall(r"Weak spot ([A-F]) at \(", text)
    drawn = re.search(r"Also drawn: ([A-F, ]+)", text)[1].split(", ")
    assert explained + drawn == [*"ABCDEF"]


def test_check_reports_closed_loop_failures(solid):
    failing = [route for route in solid.routes if route.rates.reached.value < 1]
    assert failing
    for route in failing:
        assert set(route.rates.endings) <= {
            "elsewhere",
            "aborted",
            "timed out",
            "follower",
            "world",
        }
        assert sum(route.rates.endings.values()) == len(route.stopped_at)
    reached = 100 * solid.baseline.reached.value
    text = " ".join(solid.report().split())
    assert f"(the estimate steers) it reaches the goal in {reached:.0f} %" in text
    assert "If it fails, it" in text


def walls_with_gap(width):
    """Return two rooms with a wall of 0.2 m between them, and a gap in it [cells]."""
    cells = np.full((80, 120), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[:, 58:62] = OCCUPIED
    cells[10:16, 20:30] = cells[60:70, 90:95] = OCCUPIED
    cells[40 : 40 + width, 58:62] = FREE
    return OccupancyGrid(cells, 0.05, name="gap")


def test_narrow_passage_gets_footprint_advice(tmp_path):
    """No fix helps there."""
    robot = ROBOT.with_settings({**UPDATES, "footprint": 0.2, "margin": 0.0})
    report = check(walls_with_gap(9), robot, [((1.0, 2.1), (5.0, 2.1))], effort="quick")
    assert report.baseline.reached.high < 1
    assert (report.passage.x, report.passage.y) == pytest.approx((3.0, 2.2), abs=0.15)
    assert report.passage.width == pytest.approx(0.45, abs=0.05)
    assert report.passage.robot_width == pytest.approx(0.4)
    assert (report.recommended, report.fixes) == ((), ())
    text = " ".join(report.report(tmp_path).split())
    assert "m wide, the robot 0.40 m" in text
    assert "widen the passage, or correct the robot's radius (now 0.2 m)" in text
    assert text.endswith(f"--set=footprint=0.2 -o {tmp_path}")
    wider = check(walls_with_gap(20), robot, [((1.0, 2.1), (5.0, 2.1))], effort="quick")
    assert (wider.passage, wider.baseline.reached.value) == (None, 1.0)


def test_failing_routes_come_first(solid, two_corridors_at_its_worst, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    for report in (solid, two_corridors_at_its_worst):
        fails = [route.rates.has_failure for route in report.routes]
        assert fails[0]
        assert fails == sorted(fails, reverse=True)
        for route in report.routes:
            assert route.rates.n_closed >= 16 or not route.rates.has_failure
        lines = {tuple(line.get_xydata().ravel()): line for line in report.figure().axes[0].lines}
        for route, is_failing in zip(report.routes, fails, strict=True):
            line = lines[tuple(route.path.xy.ravel())]
            assert (line.get_color() == "#d55e00") == is_failing
        text = report.report().splitlines()
        heading = next(n for n, line in enumerate(text) if line.endswith("reaches the goal"))
        assert report.routes[0].name in text[heading + 1]


def test_places_where_robots_stop_have_letters(solid):
    stops = np.concatenate([route.stopped_at for route in solid.routes])
    places = [spot for spot in solid.spots if spot.stopped]
    assert places
    for spot in places:
        apart = np.linalg.norm(stops - [spot.x, spot.y], axis=1)
        assert spot.stopped >= 2
        assert (apart <= 2.0).sum() >= spot.stopped
    assert places[0].letter
    assert sum(bool(spot.letter) for spot in solid.spots) <= 6


def test_figure_labels_do_not_overlap(solid):
    axes = solid.figure().axes[0]
    at = np.array([each.get_position() for each in axes.texts])
    assert len(at) > len(solid.spots[:6])
    size = 0.05 * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    for n, one in enumerate(at):
        assert (np.abs(at[n + 1 :] - one).max(axis=1) >= size).all()


def test_figure_labels_stay_within_axes(solid):
    """A label above the Axes would cover the title."""
    rows, cols = np.nonzero(solid.scenario.world.free)
    x, y = solid.scenario.world.position(int(rows.max()), int(cols[rows.argmax()]))
    spots = [dataclasses.replace(spot, x=x, y=y, stopped=2) for spot in solid.spots[:1]]
    axes = dataclasses.replace(solid, spots=tuple(spots)).figure().axes[0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for text in axes.texts:
        at_x, at_y = text.get_position()
        assert left < at_x < right
        assert low < at_y < high


def test_figure_caption_explains_drawn_marks(solid):
    areas = [spot for spot in solid.spots if spot.rings]
    places = [spot for spot in solid.spots if not spot.rings]
    assert areas
    assert places
    for spots, words in ((areas, {"letters", "shaded"}), (places, {"letters"}), ([], set())):
        spots = tuple(dataclasses.replace(spot, letter="A") for spot in spots)
        caption = caption_text(dataclasses.replace(solid, spots=spots))
        assert {word for word in ("letters", "shaded") if f"{word}: " in caption} == words


def attribute_stops(outcomes, place):
    """Return the text of the place where drives with these outcomes end."""
    grid = furnished_room()
    cells = grid.cells.copy()
    cells[:10] = UNKNOWN
    grid = dataclasses.replace(grid, cells=cells)
    drives = tuple(ClosedLoopDrive(outcome, 1.0, place, place) for outcome in outcomes)
    paths = {"a to b": locplan.Path([(2.0, 2.0), (6.0, 2.0)])}
    arrivals = {"a to b": Arrivals(drives)}
    (spot,), _ = attribute_failures([], paths, [np.array([])], arrivals, grid)
    return spot_text(spot).partition(": ")[2]


@pytest.mark.parametrize(
    ("outcomes", "text"),
    [
        (["aborted"] * 2, "2 drives are aborted"),
        (["elsewhere"] + ["aborted"] * 2, "3 drives miss the goal, most are aborted"),
        (["elsewhere", "aborted"], "2 drives miss the goal"),
    ],
)
def test_stop_text_names_main_ending(outcomes, text):
    assert attribute_stops(outcomes, (3.0, 3.0, 0.0)) == text


@pytest.mark.parametrize("place", [(3.0, 0.2, 0.0), (-3.0, 3.0, 0.0)])
def test_stop_text_names_unknown_space(place):
    """Unknown cells stop no drive."""
    text = attribute_stops(["aborted"] * 2, place)
    assert text == "2 drives are aborted, outside the mapped area"


def test_next_action_is_always_possible(solid):
    """If no fix helps, it is a recording or a longer check."""
    usual = dataclasses.replace(solid, recommended=(), confirmation=None, effort="usual")
    assert usual.report().splitlines()[-1].startswith("  ros2 bag record ")
    quick = dataclasses.replace(usual, effort="quick")
    assert quick.report().splitlines()[-1].startswith("  locplan check ")
    assert quick.report().splitlines()[-1].endswith(" -o report")
    driven = dataclasses.replace(usual, recording_sentences=("drive 1: The map fits",))
    assert driven.report().splitlines()[-1].startswith("  locplan recording ")
    for report in (usual, quick, driven):  # the page of the explorer shows the sentence alone
        assert "--" not in choose_next_action(report).sentence


def test_check_reports_findings_before_drives_end(watched):
    kinds = [finding.split(":")[0] for finding in watched.findings[:3]]
    assert kinds == ["map", "weak spots", "baseline"]
    done = [step for _, step, _ in watched.steps]
    assert done == sorted(done)
    assert any(count == 2 for count, _, _ in watched.steps)


def test_check_saves_files_of_fixes(solid, tmp_path):
    solid.save(tmp_path)
    assert solid.describe_fix_files()
    pages = "report.html", "check.json", "check.png", "check.csv"
    for name in (*solid.describe_fix_files(), *pages):
        assert (tmp_path / name).exists(), name
    about = json.loads((tmp_path / "check.json").read_text())
    assert about["recommended"] == list(solid.recommended)
    assert about["next"]["command"]
    assert str(tmp_path) in solid.report(tmp_path)


def test_next_commands_apply_recommended_fixes(two_corridors_at_its_worst, tmp_path):
    params = tmp_path / "mine.yaml"
    params.write_text("amcl: {ros__parameters: {alpha1: 2.0, laser_max_range: 6.0}}\n")
    save_map(furnished_room(), tmp_path / "lab.yaml")
    source = locplan.maps.read_map(tmp_path / "lab.yaml")[1]
    report = dataclasses.replace(two_corridors_at_its_worst, source=source)
    whole = report.summary(tmp_path / "out", params)["next"]
    assert whole["command"] == (
        f"ros2 launch nav2_bringup bringup_launch.py map:={tmp_path}/lab.yaml"
        f" params_file:={tmp_path}/out/nav2_params.yaml"
    )
    section = report.summary(tmp_path / "out")["next"]  # of amcl alone: Nav2 cannot start with it
    assert section["command"] == (
        f"locplan check {tmp_path}/lab.yaml --robot {tmp_path}/out/nav2_params.yaml"
    )
    assert "copy its lines into the amcl section" in section["files"]["nav2_params.yaml"]


@pytest.mark.parametrize("order", [1, -1])
def test_check_writes_one_file_of_several(two_corridors_at_its_worst, tmp_path, order):
    """nav2_bringup takes one parameter file, which must have the planner."""
    amcl, planner = tmp_path / "loc.yaml", tmp_path / "nav.yaml"
    amcl.write_text("amcl: {ros__parameters: {alpha1: 2.0, laser_max_range: 6.0}}\n")
    planner.write_text('planner_server: {ros__parameters: {planner_plugins: ["A"]}}\n')
    params = (amcl, planner)[::order]
    report = two_corridors_at_its_worst
    line = report.summary(tmp_path / "out", params)["next"]
    report.save(tmp_path / "out", tmp_path / "out", params)
    merged = tmp_path / "out" / "nav2_params.yaml"
    assert line["command"].endswith(f" params_file:={merged}")
    assert "merged, with the changes" in line["files"]["nav2_params.yaml"]
    read = locplan.robots.read_parameters(merged)
    assert read.read_node_parameters("planner_server") == {"planner_plugins": ["A"]}
    assert locplan.robots.nav2.read_amcl(merged).update_min_d == 0.1


def test_check_rejects_station_in_wall():
    with pytest.raises(
        locplan.LocplanError, match=r"route 'a to b': goal 2\.2,2\.7 lies in a wall"
    ):
        check(furnished_room(), ROBOT, {"a": (1.0, 1.0), "b": (2.2, 2.7)}, effort="quick")


def test_check_rejects_name_as_robot():
    with pytest.raises(locplan.LocplanError, match="robot must be a Robot, not 'turtlebot4'"):
        check(furnished_room(), "turtlebot4")


def test_check_rejects_unknown_effort():
    with pytest.raises(locplan.LocplanError, match="quick, usual, thorough"):
        check(furnished_room(), ROBOT, effort="slow")


def test_check_rejects_costmap_filter_mask(tmp_path):
    save_map(furnished_room(), tmp_path / "keepout_mask.yaml")
    with pytest.raises(locplan.LocplanError, match="mask for a costmap filter"):
        check(tmp_path / "keepout_mask.yaml", ROBOT)


@pytest.mark.parametrize(
    "text", ["lost", "lost > five", "speed > 3", "lost > 5", "error > 5%", "faults > 2m", ""]
)
def test_limit_rejects_nonsense(text):
    with pytest.raises(locplan.LocplanError, match=r"limit must be|not in|is a share"):
        CheckLimit.parse(text)


def test_limit_fails_beyond_whole_interval(fine):
    low, high = fine.baseline.lost.low, fine.baseline.lost.high
    assert (low, CheckLimit.parse("lost > 0%").fails(fine)) == (0, False)
    assert CheckLimit.parse(f"lost < {100 * high + 1:.0f}%").fails(fine)
    assert not CheckLimit.parse(f"lost < {100 * high - 1:.0f}%").fails(fine)
    assert CheckLimit.parse("reached >= 1%").fails(fine)
    assert CheckLimit.parse("faults <= 0").fails(fine)
    assert not CheckLimit.parse("error > 1 m").fails(fine)


def test_check_exits_with_4_beyond_limit(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_map(furnished_room(), tmp_path / "room.yaml")
    (tmp_path / "stations.csv").write_text("name,x,y\ndoor,1,1\ndesk,7,1\n")
    words = ["--effort=quick", "--stations", "stations.csv", "--set", "range=6", "-o", "report"]
    words += ["--lidar", "turtlebot3", "--fail-if", "faults <= 0"]
    few = [word for name, count in FEW_PARTICLES.items() for word in ("--set", f"{name}={count}")]
    code, out, err = run("check", "room.yaml", *words, *few)
    assert code == 4, err
    assert "door to desk" in out
    assert "failed: faults is 0 [0, 0]; fails if faults <= 0" in err
    for name in ("report/report.html", "report/run.yaml"):
        assert (tmp_path / name).exists()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder refuses root")
def test_check_rejects_unwritable_folder_early(run, tmp_path):
    save_map(furnished_room(), tmp_path / "room.yaml")
    error = "locplan: error: /proc: cannot be written; choose another folder\n"
    assert run("check", tmp_path / "room.yaml", "-o", "/proc/report") == (2, "", error)


@pytest.mark.long
def test_recording_shows_false_walls_of_map(monkeypatch):
    drive = locplan.recordings.read_recording(FILE)
    office = locplan.load_map(Path(__file__).parents[2] / "maps" / "office.yaml")
    cells = office.cells.copy()
    cells[140:148, 540:640] = OCCUPIED  # in the corridor
    grid, robot = dataclasses.replace(office, cells=cells), drive.robot(ROBOT)
    stations = [((7.0, 7.0), (20.5, 15.0))]
    with listen() as findings:
        report = check(grid, robot, stations, [drive], effort="quick")
    assert report.recording_sentences[0].startswith("drive 1: The map fits")
    assert "too few scans" in report.recording_sentences[2]  # of a log of one scan in half a metre
    assert report.recording_sentences[0] in report.report()
    (false,) = [each for each in report.faults if each.kind == "false walls"]
    assert false.boxes[0] == pytest.approx((26.4, 31.4, 6.4, 6.8), abs=0.15)
    assert "check these places, and map them again" in false.sentence
    assert f"map: {false.sentence}" in findings
    monkeypatch.setenv("COLUMNS", "80")
    text = report.report()
    assert len(text.splitlines()) <= 25
    assert f"at {false.place_text}" in " ".join(text.split())
    assert report.recording_sentences[0] in " ".join(text.split())
    assert np.array_equal(report.scenario.world.cells, cells)  # the check does not change the map


@pytest.mark.long
def test_check_skips_filter_if_map_misfits():
    """The recorded drive is from another building."""
    drive = locplan.recordings.read_recording(FILE)
    report = check(
        furnished_room(), drive.robot(ROBOT), [((1.0, 1.0), (7.0, 1.0))], [drive], effort="quick"
    )
    fit, visibility = report.recording_sentences
    assert "cannot show motion along corridors" in visibility
    assert "does not fit" in fit
