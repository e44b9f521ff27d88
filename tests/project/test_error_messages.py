"""What an error may say: one line that can be printed, with values cut short."""

import math
import pickle

import numpy as np
import pytest
from support.bag_files import BEGIN, open_bag
from support.command_line import check_refusal

from locplan._support import checks
from locplan.app.cli.wording import translate_options
from locplan.errors import MAX_MESSAGE, ConfigError, LocplanError, PoseError
from locplan.field import Sad, Scan
from locplan.field.estimators import estimator_class
from locplan.maps import OccupancyGrid, save_map
from locplan.planning.requests import make_planner
from locplan.robots import Lidar, Robot


def bomb(depth: int) -> list:
    """Lists in lists, of which each holds the one before ten times."""
    value: list = ["x"]
    for _ in range(depth):
        value = [value] * 10
    return value


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("a", "'a'"),
        ("a\nb\0", "'a\\nb\\x00'"),
        ("\udcff", "'\\udcff'"),
        ([1, 2.5], "[1, 2.5]"),
        (None, "None"),
        (np.zeros(3), "a value of type ndarray"),
    ],
)
def test_errors_show_values_as_written(value, text):
    assert checks.short_repr(value) == text


def test_errors_show_size_of_long_numbers():
    assert checks.short_repr(10**5000) == "a number of 16610 bits"


@pytest.mark.parametrize("value", ["a" * 10**6, list(range(10**6)), bomb(100), {"a": bomb(9)}])
def test_errors_cut_long_and_deep_values(value):
    """Writing out the whole value would take too much memory."""
    assert len(checks.short_repr(value)) <= 60


def test_error_message_is_printable_line():
    error = LocplanError("a\nb\udcff" + "x" * 10**6 + "; do this")
    assert str(error).isprintable()
    assert str(error).startswith("a?b?xxx")
    assert str(error).endswith("xxx; do this")
    assert len(str(error)) <= MAX_MESSAGE
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


@pytest.mark.parametrize("value", [10**400, -(10**400), math.inf, math.nan, True, "1", None, [1]])
def test_number_checks_require_finite_number(value):
    with pytest.raises(ConfigError):
        checks.check_number("a", value)
    with pytest.raises(ConfigError):
        checks.check_positive("a", value)


@pytest.mark.parametrize("value", [1e13, 1e308, 10**13])
def test_numbers_whose_products_overflow_are_refused(value):
    for check in (checks.check_number, checks.check_positive):
        with pytest.raises(ConfigError, match=r"and at most 1e\+12"):
            check("a", value)


def test_tiny_number_is_not_positive():
    """The number's reciprocal would overflow."""
    with pytest.raises(ConfigError, match="at least 1e-12"):
        checks.check_positive("a", 1e-320)


def test_whole_numbers_fit_64_bits():
    assert checks.check_integer("a", 2**63 - 1) == 2**63 - 1
    with pytest.raises(ConfigError, match=r"below 2\^63"):
        checks.check_integer("a", 2**63)


@pytest.mark.parametrize("x", [10**400, 1e12, -1e9])
def test_position_beyond_all_maps_is_refused(x):
    with pytest.raises(PoseError):
        checks.check_position(x, 0.0)


@pytest.mark.parametrize(
    "settings",
    [
        lambda: Sad(range=10**400),
        lambda: Sad(noise_level=1e-320),
        lambda: Lidar(range=1e308),
        lambda: Lidar(mount_x=1e308),
        lambda: Scan(Lidar(), z_rand=10**400),
        lambda: Scan(Lidar(), max_beams=10**400),
    ],
)
def test_estimators_refuse_numbers_that_would_overflow(settings):
    with pytest.raises(ConfigError):
        settings()


@pytest.mark.parametrize(
    ("call", "guess"),
    [
        (lambda: Robot("turtlebot_4"), "turtlebot4"),
        (lambda: Robot("TurtleBot3"), "turtlebot3"),
        (lambda: make_planner("any-angel"), "any-angle"),
        (lambda: make_planner("RRTstr"), "RRTstar"),
        (lambda: make_planner("RRTstar", {"timelimit": 2}), "time_limit"),
        (lambda: Robot().with_settings({"inflaton_radius": 1.0}), "inflation_radius"),
        (lambda: Robot.from_summary({"filter": {"alpha_1": 1}}), "alpha1"),
        (lambda: estimator_class("fusd"), "fused"),
    ],
)
def test_unknown_name_suggests_similar_one(call, guess):
    with pytest.raises(ConfigError, match=rf"; did you mean '{guess}'\?$"):
        call()


def test_unlike_name_suggests_nothing():
    with pytest.raises(ConfigError, match=r"not 'sonar'$"):
        Robot("sonar")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--map-frame", "world"), "set --map-frame and --base-frame"),
        (
            ("--base-frame", "rob"),
            "has no frame 'rob'; set --base-frame to one of: base_link, laser",
        ),
        (("--scan-topic", "/s"), "has no scans on /s; set --scan-topic to one of: /scan"),
    ],
)
def test_command_line_names_options_as_typed(run, tmp_path, options, said):
    lidar = Lidar(range=5.0, beams=7, field_of_view_deg=180.0)
    with open_bag(tmp_path, "mcap") as (path, bag):
        bag.tf(BEGIN, bag.transform(BEGIN, "odom", "base_link", (0, 0, 0)))
        bag.tf(BEGIN, bag.transform(BEGIN, "base_link", "laser", (0, 0, 0)), topic="/tf_static")
        bag.scan(BEGIN, lidar, np.ones(7))
    room = OccupancyGrid(np.full((20, 20), 254), resolution=0.1)
    save_map(room, tmp_path / "room.yaml")
    assert said in check_refusal(run("recording", path, tmp_path / "room.yaml", *options))


def test_command_suggests_lidar_for_bare_urdf(run, tmp_path):
    (tmp_path / "bot.urdf").write_text("<robot><link name='base_link'/></robot>")
    save_map(OccupancyGrid([[254]], resolution=0.1), tmp_path / "room.yaml")
    error = check_refusal(run("info", tmp_path / "room.yaml", "--robot", tmp_path / "bot.urdf"))
    assert "has no planar lidar; name the robot's, such as --lidar turtlebot4" in error


def test_command_line_keeps_words_of_python():
    text = "name another folder with --force (in Python force=True), or drop force=True"
    expected = "name another folder with --force (in Python force=True), or drop --force"
    assert translate_options(text, "plan") == expected
    planner = "planner 'RRTstar:time_limit=-1': time_limit must be positive"
    assert translate_options(planner, "compare") == planner
