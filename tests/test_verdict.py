"""Verdicts: both paths of a plan are driven, and the aware one must be better to be recommended."""

import dataclasses
import json
import math

import numpy as np
import pytest
from conftest import drawn, refused

import locplan
from locplan import Costmap, Lidar, Path, save_map
from locplan.errors import ConfigError
from locplan.field import FieldConfig, Fisher, save_config
from locplan.maps import environments
from locplan.planners import plan_beside_shortest
from locplan.planners._plan import AWARE, SHORTEST
from locplan.robots import Amcl, Robot
from locplan.simulation import Drives, verdict
from locplan.simulation._scores import log_errors
from locplan.simulation.choice import _verdict

LIDAR = Lidar(range=6.0, range_sigma=0.01, beams=60, model="mine")
ENDS = (2.0, 3.0), (38.0, 3.0)
ASKED = "--start", "2,3", "--goal", "38,3"


@pytest.fixture(scope="module")
def corridors():
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def costs(corridors):
    config = FieldConfig(Fisher(LIDAR), stride=0.4)
    return Costmap.from_field(corridors, locplan.covariance_field(corridors, config))


@pytest.fixture(scope="module")
def plans(costs):
    return plan_beside_shortest(costs, *ENDS)


@pytest.fixture(scope="module")
def found(costs, plans):
    return verdict(costs, plans, seed=3)


@pytest.fixture
def files(corridors, tmp_path):
    """A map, and settings with a lidar."""
    save_map(corridors, tmp_path / "map.yaml")
    save_config(tmp_path / "mine.json", FieldConfig(Fisher(LIDAR), stride=0.4))
    return tmp_path


def along(*xy):
    return Path(np.array(xy, float))


def with_paths(plans, shortest, aware):
    """The plans with other paths; None for none."""
    return {
        label: dataclasses.replace(plan, path=path, status="solved" if path else "unreachable")
        for (label, plan), path in zip(plans.items(), (shortest, aware), strict=True)
    }


def errors_of(monkeypatch, shortest, aware):
    """Let the drives of both paths have these errors in x, one for each drive [m]."""

    def drive(self, lines, drives, **_):
        made = []
        for line, each in zip(lines, (shortest, aware), strict=True):
            errors = np.zeros((drives, len(line), 3))
            errors[..., 0] = np.resize(each, drives)[:, None]
            made.append(errors)
        return made

    monkeypatch.setattr("locplan.simulation._simulator.Simulator.drive_together", drive)


def test_the_aware_path_is_recommended_where_its_drives_are_better(found):
    assert found.recommended == AWARE
    assert found.text.startswith("driven in simulation with Nav2's defaults: error of a typical")
    assert found.text.endswith(" % of 8 drives: the aware path is recommended")
    assert {len(each.errors) for each in found.drives.values()} == {8}
    before, after = (found.typical_errors[label] for label in (SHORTEST, AWARE))
    assert f"{before:.2f} -> {after:.2f} m" in found.text
    lost = [100 * each.lost.mean() for each in found.drives.values()]
    assert f"lost {lost[0]:.0f} -> {lost[1]:.0f} %" in found.text


def test_the_errors_are_those_that_decide(found):
    for label, drives in found.drives.items():
        own = log_errors(drives.distance, drives.errors, "rmse", 1e3).mean()
        assert found.log_errors[label] == pytest.approx(own)
        assert found.typical_errors[label] == pytest.approx(math.exp(own))


def test_a_verdict_is_reproducible_and_takes_the_lidar_of_the_field(costs, plans, found):
    again = verdict(costs, plans, robot=Robot(LIDAR), seed=3, threads=1)
    assert again.summary() == found.summary()
    other = verdict(costs, plans, robot=Robot(dataclasses.replace(LIDAR, range=3.0)), seed=3)
    assert other.log_errors != found.log_errors


@pytest.mark.parametrize(
    ("aware", "recommended", "said"),
    [
        (0.35, AWARE, "lost 0 -> 0 % of 8 drives: the aware path is recommended"),
        (
            0.37,
            SHORTEST,
            "the aware path is not clearly better here: error of a typical drive 0.40 -> 0.37",
        ),
        (
            0.44,
            SHORTEST,
            "the aware path is not clearly better here: error of a typical drive 0.40 -> 0.44",
        ),
        (0.45, SHORTEST, "the aware path is worse here: error of a typical drive 0.40 -> 0.45 m"),
        (
            (0.1, 1.2),
            SHORTEST,
            "the aware path is worse here: error of a typical drive 0.40 -> 0.35",
        ),
        (0.04, AWARE, "0.40 -> 0.040 m"),
    ],
)
def test_a_tenth_less_error_decides(costs, plans, monkeypatch, aware, recommended, said):
    errors_of(monkeypatch, 0.4, aware)
    found = verdict(costs, plans)
    assert found.recommended == recommended
    assert said in found.text
    assert found.text.endswith(f"the {recommended.split('-')[-1]} path is recommended") or (
        found.text.endswith("; the shortest is recommended")
    )


def test_a_gain_that_no_robot_feels_is_called_so(costs, plans, monkeypatch):
    errors_of(monkeypatch, 0.1, 0.085)
    found = verdict(costs, plans)
    assert found.recommended == AWARE
    assert found.text.endswith("; that is under 2 cm, and no drive is lost on the shortest either")


def test_where_both_paths_lose_the_robot_tuning_comes_first(costs, plans, monkeypatch):
    errors_of(monkeypatch, 2.0, 1.2)
    found = verdict(costs, plans)
    assert found.recommended == AWARE
    assert "tune the filter first with `locplan tune`; `locplan evaluate` tells" in found.text


def test_the_filter_is_named(costs, plans, monkeypatch):
    errors_of(monkeypatch, 0.4, 0.3)
    robot = Robot(filter=Amcl(alpha1=0.05))
    found = verdict(costs, plans, robot)
    assert "driven in simulation with AMCL's alpha1 0.05: " in found.text
    assert found.robot.filter == robot.filter


def test_one_path_is_not_driven(costs, plans, monkeypatch):
    errors_of(monkeypatch, None, None)
    monkeypatch.setattr("locplan.simulation._simulator.Simulator.drive_together", None)
    path = plans[SHORTEST].path
    found = verdict(costs, with_paths(plans, path, path))
    assert (found.recommended, dict(found.drives)) == (SHORTEST, {})
    degenerate = plans[SHORTEST].metrics.integrated_u
    assert degenerate > 5
    assert found.text == (
        f"same path as the shortest: its weak spot of {degenerate:.1f} degenerate metres has no way"
        " around that costs less"
    )
    same = "same path as the shortest"
    for metres, text in ((0.4, f"{same}: no weak spot on the way"), (math.nan, same)):
        metrics = dataclasses.replace(plans[SHORTEST].metrics, integrated_u=metres)
        alike = {label: dataclasses.replace(plans[SHORTEST], metrics=metrics) for label in plans}
        assert verdict(costs, alike).text == text


def test_paths_are_one_unless_a_point_or_a_heading_lies_aside():
    line = along((0, 0), (10, 0))
    assert _verdict.is_one_way(line, along((0, 0), (5, 0.2), (10, 0)))
    loop = along((0, 0), (5, 0), (5, 0.4), (5, 0), (10, 0))
    assert not _verdict.is_one_way(line, loop)
    assert not _verdict.is_one_way(loop, line)
    ahead, back = (Path(line.xy, np.full(2, angle)) for angle in (0.0, np.pi))
    assert _verdict.is_one_way(ahead, Path(line.xy, np.full(2, 0.1)))
    assert not _verdict.is_one_way(ahead, back)


def test_paths_with_headings_and_waypoints_are_driven(costs):
    ends = (2.0, 3.0, 0.0), (38.0, 3.0, 0.0)
    options = {"planner": "RRTConnect", "space": "SE2", "iterations": 3000}
    plans = {
        label: locplan.plan(costs, *ends, via=[(10.0, 12.0, 0.0)], **options, seed=seed)
        for label, seed in ((SHORTEST, 1), (AWARE, 2))
    }
    assert all(plan.path.heading is not None for plan in plans.values())
    found = verdict(costs, plans, drives=2)
    assert found.text.startswith("driven in simulation")
    for label, drives in found.drives.items():
        assert drives.distance[-1] == pytest.approx(plans[label].path.length, rel=0.01)


def test_without_two_paths_there_is_no_verdict(costs, plans):
    assert verdict(costs, with_paths(plans, plans[SHORTEST].path, None)) is None
    assert verdict(costs, with_paths(plans, None, None)) is None
    with pytest.raises(ConfigError, match="no plan 'localizability-aware'"):
        verdict(costs, {SHORTEST: plans[SHORTEST]})


def test_the_command_drives_where_the_lidar_is_named(run, files, found):
    config = "--config", files / "mine.json", "--seed", "3"
    code, out, err = run("plan", files / "map.yaml", *ASKED, *config, "-o", files / "out")
    assert code == 0, err
    assert found.text in " ".join(out.split("\n"))
    about = json.loads((files / "out" / "plan.json").read_text())
    assert set(about["plans"]) == {SHORTEST, AWARE}
    assert about["verdict"]["recommended"] == AWARE
    assert about["verdict"]["robot"]["lidar"]["model"] == "mine"
    assert about["verdict"]["paths"][AWARE]["typical_error_m"] == found.typical_errors[AWARE]
    code, out, _ = run("plan", files / "map.yaml", *ASKED, *config[:2], "--no-verdict", "--json")
    assert json.loads(out)["verdict"] is None


def test_the_command_drives_the_filter_of_the_file(run, files, monkeypatch):
    errors_of(monkeypatch, 0.4, 0.6)
    text = "amcl:\n  ros__parameters:\n    alpha1: 0.05\n    recovery_alpha_fast: 0.1\n"
    (files / "nav2.yaml").write_text(text)
    options = "--robot", files / "nav2.yaml", "--set", "alpha2=0.1"
    config = "--config", files / "mine.json"
    code, out, err = run("plan", files / "map.yaml", *ASKED, *config, *options, "--json")
    assert code == 0, err
    about = json.loads(out)["verdict"]
    driven = about["robot"]["filter"]
    assert (driven["alpha1"], driven["alpha2"]) == (0.05, 0.1)
    assert about["recommended"] == SHORTEST
    assert "nav2.yaml: not simulated: recovery_alpha_fast" in err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "nothing is recommended: name the lidar (--lidar) to drive them"),
        (("--no-verdict", "CONFIG"), "nothing is recommended: the paths are not driven"),
    ],
)
def test_nothing_is_recommended_without_drives(run, files, monkeypatch, options, said):
    monkeypatch.setattr("locplan.simulation._simulator.Simulator.drive_together", None)
    titles = []
    monkeypatch.setattr(
        "locplan.plotting.save_figure", lambda figure, _: titles.append(figure.axes[0].get_title())
    )
    config = "--config", files / "mine.json"
    options = [each for option in options for each in (config if option == "CONFIG" else (option,))]
    code, out, err = run("plan", files / "map.yaml", *ASKED, *options, "-o", files / "out")
    assert code == 0, err
    assert out.strip().endswith(said)
    assert titles[0].replace("\n", " ").endswith(said)


def test_an_unreachable_goal_has_no_verdict(run, tmp_path):
    save_map(drawn("...#...", resolution=1.0), tmp_path / "parted.yaml")
    ends = "--start", "0.5,0.5", "--goal", "6.5,0.5", "--lidar", "tim571", "--estimator", "sad"
    code, out, _ = run("plan", tmp_path / "parted.yaml", *ends)
    assert code == 0
    assert out.strip().endswith("nothing is recommended: not both paths were found")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--seed", "3"), "has no option 'seed'"),
        (("--lidar", "tim571", "--set", "nothing=1"), "a robot has no setting 'nothing'"),
    ],
)
def test_options_of_drives_that_are_not_made_are_refused(run, files, options, said):
    assert said in refused(run("plan", files / "map.yaml", *ASKED, *options))


def test_the_picture_marks_the_path_that_is_recommended(costs, plans, found):
    field = locplan.covariance_field(costs.grid, FieldConfig(Fisher(LIDAR), stride=0.8))
    figure = locplan.plotting.plan_figure(
        costs, field, plans, recommended=found.recommended, verdict=found.text
    )
    (legend,) = figure.legends
    (marked,) = [text.get_text() for text in legend.get_texts() if "(recom" in text.get_text()]
    assert marked.startswith(f"{AWARE} (recommended): ")
    assert found.text in figure.axes[0].get_title().replace("\n", " ")


def test_drives_are_shown_in_few_words(found):
    assert repr(found) == f"Verdict({found.text})"
    assert all(isinstance(each, Drives) for each in found.drives.values())
