"""Exports of a choice: what is recommended is what Nav2 is given."""

import dataclasses
import json
import warnings

import numpy as np
import pytest
import yaml
from support.command_line import check_refusal
from support.recommendations import recommend

from locplan import (
    FieldConfig,
    Fisher,
    Path,
    Recommendation,
    covariance_field,
    save_map,
)
from locplan.errors import ConfigError
from locplan.export import nav2_keepout
from locplan.export.masks import compute_keepout_mask
from locplan.maps import environments
from locplan.planning import Costmap, path_metrics, plan
from locplan.robots import Amcl, Lidar, Robot
from locplan.simulation.problem import RecommendationSettings

pytestmark = pytest.mark.usefixtures("undrawn")

START, GOAL = (2.0, 3.0), (38.0, 3.0)
ROBOT = Robot(Lidar(range=6.0), filter=Amcl(min_particles=100, max_particles=100))

AWARE = "aware, weight 4"  # weights 3 and 8 lead to the same path


@pytest.fixture(scope="module")
def field():
    grid = environments.make("two_corridors", resolution=0.1)
    return covariance_field(grid, FieldConfig(Fisher(ROBOT.lidar), stride=0.5))


@pytest.fixture(scope="module")
def recommendation(field):
    costs = Costmap.from_field(field, robot=ROBOT)
    candidates = {"around": plan(Costmap.blank(field.grid), START, GOAL, via=[(20.0, 12.0)]).path}
    ends = field.grid, START, GOAL, ROBOT
    settings = {"rival": None, "weight": 3.0}
    return recommend(*ends, costs=costs, candidates=candidates, drives=4, **settings)


def recommend_candidate(choice, name):
    """The choice that takes the candidate of this name."""
    leader = [each.name for each in choice.candidates].index(name)
    judgement = dataclasses.replace(choice.judgement, leader=leader, verdict="better")
    candidates = [dataclasses.replace(each, arrivals=None) for each in choice.candidates]
    return dataclasses.replace(choice, judgement=judgement, candidates=tuple(candidates))


def add_better_rival(choice):
    """The choice whose rival, another filter, has a tenth of the error."""
    drives = choice.shortest.driven
    log_error = drives.log_error - np.log(10.0)
    rival = dataclasses.replace(drives, log_error=log_error, lost=np.zeros_like(drives.lost))
    settings = dataclasses.replace(choice.settings, rival=RecommendationSettings().rival)
    candidates = [dataclasses.replace(each, driven=drives) for each in choice.candidates]
    changes = {"rival": rival, "settings": settings, "candidates": tuple(candidates)}
    return dataclasses.replace(choice, **changes)


def test_candidate_path_is_cheapest_on_costmap(recommendation):
    names = [each.name for each in recommendation.candidates]
    assert {"shortest", "detour 1", "around"} <= {*names}
    assert AWARE in names
    for each in recommendation.candidates:
        costs = (
            recommend_candidate(recommendation, each.name).costmap()
            if each.name != "shortest"
            else None
        )
        costs = costs or dataclasses.replace(recommendation, judgement=None).costmap()
        cheapest = plan(costs, START, GOAL).metrics.cost
        assert path_metrics(costs, each.path).cost <= 1.03 * cheapest, each.name


def test_recommendation_costmap_respects_max_e(recommendation):
    limit = float(np.nanquantile(recommendation.costs.e, 0.9))
    settings = dataclasses.replace(recommendation.settings, max_e=limit)
    costs = dataclasses.replace(
        recommend_candidate(recommendation, "detour 1"), settings=settings
    ).costmap()
    passable = np.isfinite(costs.density)
    assert costs.e[passable].max() <= limit < np.nanmax(recommendation.costs.e)


def test_recommendation_without_drives_returns_field_costmap(field):
    costs = Costmap.from_field(field, robot=0.2)
    planned = recommend(field.grid, START, GOAL, ROBOT, costs=costs, drives=0)
    assert planned.costmap() is planned.costs


def export_keepout(folder, *args, **settings):
    with warnings.catch_warnings(record=True, action="always") as caught:
        conversion = nav2_keepout(folder, *args, **settings)
    return conversion, [str(each.message) for each in caught]


def test_keepout_mask_matches_recommended_path(tmp_path, recommendation):
    choice = recommend_candidate(recommendation, "around")
    conversion, warning_texts = export_keepout(tmp_path / "m", choice)
    values, _ = compute_keepout_mask(choice.costmap())
    image = (tmp_path / "m" / "mask.pgm").read_bytes()[-values.size :]
    assert (np.frombuffer(image, np.int8).reshape(values.shape)[::-1] == values).all()
    assert [(each.name, each.is_equivalent) for each in conversion.paths] == [("around", True)]
    (line,) = warning_texts
    assert line.startswith("smac2d's path for around passes 0.35 m from walls at (16.15, 11.85)")
    assert "Source: the recommended path, around, for" in (tmp_path / "m/README.md").read_text()
    about = json.loads((tmp_path / "m/export.json").read_text())
    assert about["choice"]["recommended_name"] == "around"
    assert not (tmp_path / "m-routes").exists()


def test_export_warns_about_useless_mask(run, tmp_path, recommendation):
    """The mask of the shortest path makes no detour cheaper."""
    save_map(recommendation.costs.grid, tmp_path / "lab.yaml")
    message = "the recommended path is the shortest, so the mask only charges cells near walls"
    for name, is_useless in (("shortest", True), ("around", False)):
        recommend_candidate(recommendation, name).save(tmp_path / name)
        line = "--to", "nav2-keepout", "--choice", tmp_path / name, "-o", tmp_path / f"{name}-mask"
        code, _, err = run("export", tmp_path / "lab.yaml", *line)
        assert code == 0
        assert (message in err) == is_useless


def test_export_adds_graph_if_planner_deviates(tmp_path, recommendation):
    choice = recommend_candidate(recommendation, "around")
    conversion, warning_texts = export_keepout(tmp_path / "m", choice, planner_param=0.01)
    assert not conversion.paths[0].is_equivalent
    assert warning_texts == [
        f"smac2d does not take around ({conversion.paths[0].verdict_text});"
        f" {tmp_path / 'm-routes'} has it as a route graph"
    ]
    assert "around,1," in (tmp_path / "m-routes/routes.csv").read_text()
    assert (tmp_path / "m-routes/graph.geojson").is_file()
    assert "smac2d does not take around" in (tmp_path / "m/README.md").read_text()


def test_export_warns_about_missing_route_graph(tmp_path, recommendation):
    """A path nearer to walls than the robot may be has no route graph."""
    costs = recommendation.costs
    near = plan(Costmap.blank(costs.grid, robot=0.05), START, GOAL, via=[(20.0, 12.0)]).path
    settings = {"planner_param": 0.01, "paths": {"near": near}}
    _, (line,) = export_keepout(tmp_path / "m", costs, **settings)
    assert "it has no route graph: path near leaves the map's free space" in line
    assert (tmp_path / "m" / "mask.pgm").is_file()
    assert not (tmp_path / "m-routes").exists()


def test_readme_puts_tuning_advice_first(tmp_path, recommendation):
    choice = add_better_rival(recommend_candidate(recommendation, "around"))
    (advice,) = choice.advice
    assert advice.startswith("Tune the filter first")
    export_keepout(tmp_path / "m", choice)
    lines = (tmp_path / "m/README.md").read_text().splitlines()
    assert lines[2] == f"- {advice}"


def test_advice_rejects_tuning_without_effect(tmp_path, recommendation):
    """If the lidar sees too few walls, the robot gets lost with every filter."""
    choice = add_better_rival(recommend_candidate(recommendation, "around"))
    rival = dataclasses.replace(choice.rival, lost=np.ones_like(choice.rival.lost))
    shortest = choice.candidates[0]
    metrics = dataclasses.replace(shortest.metrics, degenerate_share=0.8)
    halls = [dataclasses.replace(each, driven=rival, metrics=metrics) for each in choice.candidates]
    choice = dataclasses.replace(choice, rival=rival, candidates=tuple(halls))
    count = len(choice.rival.lost)
    assert choice.advice[:2] == [
        "The robot still gets lost in at least half of the drives. Run `locplan check`.",
        "Tuning alone does not help: with safe settings (update_min_d 0.1, update_min_a 0.1),"
        f" the robot gets lost in {count} of {count} drives on the shortest path."
        " The lidar sees too few walls on 80 % of the shortest path.",
    ]
    export_keepout(tmp_path / "m", choice)
    assert "first" not in (tmp_path / "m/README.md").read_text().lower()


def test_loaded_recommendation_needs_its_field(tmp_path, recommendation, field):
    choice = recommend_candidate(recommendation, AWARE)
    choice.save(tmp_path / "planned")
    loaded = Recommendation.load(tmp_path / "planned")
    with pytest.raises(ConfigError, match="call with_field"):
        loaded.costmap()
    assert loaded.config == field.config
    np.testing.assert_array_equal(
        loaded.with_field(field).costmap().density, choice.costmap().density
    )
    other = environments.make("hall", resolution=0.1)
    with pytest.raises(ConfigError, match="the recommendation is for another map"):
        loaded.with_field(covariance_field(other, field.config))


def test_costmap_rejects_recommendation_without_path(recommendation):
    nothing = dataclasses.replace(
        recommendation, candidates=(), judgement=None, status="unreachable"
    )
    with pytest.raises(ConfigError, match="the recommendation has no path: The goal is"):
        nothing.costmap()


def test_command_exports_recommendation(run, tmp_path, recommendation):
    grid = recommendation.costs.grid
    save_map(grid, tmp_path / "lab.yaml")
    add_better_rival(recommend_candidate(recommendation, AWARE)).save(tmp_path / "planned")
    line = "export", tmp_path / "lab.yaml"
    line += "--choice", tmp_path / "planned", "--to"
    (tmp_path / "nav2.yaml").write_text(
        "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.3}}}\n"
    )
    robot_options = "--robot", tmp_path / "nav2.yaml"
    code, shown, _ = run(*line, "nav2-keepout", *robot_options, "-o", tmp_path / "m")
    assert code == 0
    assert shown.index("Tune the filter first") < shown.index("planner ")
    own = yaml.safe_load((tmp_path / "m/nav2.yaml").read_text())
    assert own["global_costmap"]["global_costmap"]["ros__parameters"]["robot_radius"] == 0.3
    assert (
        json.loads((tmp_path / "m/export.json").read_text())["choice"]["recommended_name"] == AWARE
    )
    run(*line, "path", "-o", tmp_path / "path.csv")
    np.testing.assert_allclose(
        Path.load(tmp_path / "path.csv").xy, recommend_candidate(recommendation, AWARE).path.xy
    )
    words = "--lidar has no effect with --choice"
    assert words in check_refusal(run(*line, "path", "--lidar", "turtlebot4"))
    assert "--choice has no effect with --to" in check_refusal(run(*line, "nav2-speed"))


@pytest.mark.long
def test_command_exports_recommendations_as_routes(run, tmp_path, recommendation):
    grid = recommendation.costs.grid
    save_map(grid, tmp_path / "lab.yaml")
    near = dataclasses.replace(recommendation, candidates=(), judgement=None, status="unreachable")
    for name, choice in (
        ("there", recommend_candidate(recommendation, "around")),
        ("short", recommend_candidate(recommendation, "shortest")),
        ("nowhere", near),
    ):
        choice.save(tmp_path / "planned" / name)
    Path([(2.0, 3.0), (6.0, 3.0)]).save(tmp_path / "mine.csv")
    line = "export", tmp_path / "lab.yaml", "--to"
    routes = *line, "nav2-routes", "--path", tmp_path / "mine.csv", "--choice"
    code, out, _ = run(*routes, tmp_path / "planned", "-o", tmp_path / "r", "--json")
    assert code == 0
    assert {*json.loads(out)["followed"]} <= {"there", "short", "mine"}
    table = (tmp_path / "r" / "routes.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in table[1:]] == ["short", "there", "mine"]
    there, short = tmp_path / "planned" / "there", tmp_path / "planned" / "short" / "choice.json"
    code, out, _ = run(*routes, there, "--choice", short, "-o", tmp_path / "s", "--json")
    assert code == 0
    two = "--choice", tmp_path / "planned"
    assert "--to path takes one --choice, not 3" in check_refusal(run(*line, "path", *two))
    again = "--choice", there, "--choice", there
    assert "two folders of recommendations are called there" in check_refusal(
        run(*line, "path", *again)
    )
    assert "has no recommendation" in check_refusal(run(*line, "path", "--choice", tmp_path))
    other = dataclasses.replace(recommendation, robot=dataclasses.replace(ROBOT, footprint=0.3))
    other.save(tmp_path / "other")
    refusal = check_refusal(
        run(*routes, there, "--choice", tmp_path / "other", "-o", tmp_path / "t")
    )
    assert (
        "the recommendations there and other differ in the map, the field or the robot's size"
        in refusal
    )
