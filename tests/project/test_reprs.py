"""What people see of objects: short lines, pictures in notebooks, lists and arrays."""

from __future__ import annotations

import inspect
import io

import numpy as np
import pytest
from PIL import Image
from support.maps import ascii_map

import locplan
from locplan import Costmap, CovarianceField, Path
from locplan.advice.tuning import tune_on_drive
from locplan.errors import ConfigError, LocplanError, PoseError
from locplan.field.figures import field_figure
from locplan.maps import environments
from locplan.planning import Plan, PlannerResult
from locplan.recordings import Recording, fit_to_map, record_drive, replay
from locplan.recordings.ambiguous_places import find_ambiguous_places
from locplan.recordings.calibration import calibrate_drive
from locplan.recordings.evaluation import evaluate_drive, match_scans
from locplan.recordings.location import locate_drive
from locplan.recordings.matching import ScanDatabase
from locplan.robots import Amcl, Robot
from locplan.simulation import Simulator, simulate

ENDS = (2.0, 3.0), (38.0, 3.0)
WINDOW = locplan.field.SearchWindow(half_width=2.0, step=1.0)


@pytest.fixture(scope="module")
def grid() -> locplan.OccupancyGrid:
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def field(grid) -> CovarianceField:
    return locplan.covariance_field(grid, locplan.FieldConfig(locplan.Sad(), stride=0.4))


@pytest.fixture(scope="module")
def costs(grid, field) -> Costmap:
    return Costmap.from_field(field)


@pytest.fixture(scope="module")
def plan(costs) -> Plan:
    return locplan.plan(costs, *ENDS)


def test_repr_is_short_with_units(grid, field, costs, plan):
    front = locplan.pareto_front(costs, *ENDS, max_labels=200_000)
    drives = simulate(
        grid, {"a": Path([(2.0, 3.0), (4.0, 3.0)])}, robot=Robot(filter=Amcl()), drives=2
    )
    said = {
        grid: "OccupancyGrid(two_corridors, 158 x 412 cells of 0.1 m, origin",
        field: "CovarianceField(two_corridors: ",
        costs: "Costmap(two_corridors, 158 x 412 cells of 0.1 m, ",
        plan.path: "Path(2,3 to 38,3 m, ",
        plan: "Plan(solved, any-angle, 2,3 to 38,3: ",
        plan.metrics: "PathMetrics(",
        front: "ParetoFront(",
        locplan.planning.plan_field(costs, ENDS[1]): "CostToGo(two_corridors, to 38,3 m",
        drives: "Simulation(two_corridors, a: Drives(2 of 2.00 m, median error ",
        Simulator(grid): "Simulator(two_corridors, lidar, 6 m, 360°; radius 0.2 m, margin 0.05 m; ",
        locplan.export.recommended_routes.build_recommended_routes(
            costs, {"a": plan.path}
        ): "RecommendedRoutes(1 of 1 ",
        locplan.Footprint([(0.5, 0.2), (0.5, -0.2), (-0.3, 0.0)]): "Footprint(3 corners, radii ",
    }
    for each, beginning in said.items():
        assert repr(each).startswith(beginning), repr(each)
        assert len(repr(each)) < 160, repr(each)
        assert "array" not in repr(each)
    assert " m² rad" in repr(field)


def test_repr_of_settings_omits_defaults():
    assert repr(locplan.Sad()) == "Sad()"
    lidar = locplan.Lidar(range=8.0)
    assert repr(locplan.Scan(lidar, max_beams=90)) == "Scan(lidar=Lidar(range=8.0), max_beams=90)"
    assert repr(locplan.FieldConfig(stride=0.4)) == "FieldConfig(stride=0.4, headings=1)"
    assert repr(Amcl(alpha1=0.1)) == "Amcl(alpha1=0.1)"


def test_unreachable_plan_repr_gives_reason(grid):
    walled = ascii_map("..#..", resolution=1.0)
    found = locplan.plan(Costmap.blank(walled), (0.5, 0.5), (4.5, 0.5))
    assert repr(found).startswith("Plan(unreachable, any-angle, 0.5,0.5 to 4.5,0.5: no path joins")
    field = locplan.covariance_field(walled, locplan.Sad(range=2.0, window=WINDOW))
    costs = Costmap.from_field(field)
    assert locplan.pareto_front(costs, (0.5, 0.5), (4.5, 0.5))._repr_png_() is None
    assert Image.open(io.BytesIO(found._repr_png_())).size[0] > 100


def test_notebooks_show_pictures(grid, field, costs, plan):
    front = locplan.pareto_front(costs, *ENDS, max_labels=200_000)
    for each in (grid, field, costs, plan, front, field_figure(field)):
        image = Image.open(io.BytesIO(each._repr_png_()))
        assert image.format == "PNG"
        assert min(image.size) > 100
        assert len(np.unique(np.asarray(image.convert("L")))) > 2


def test_path_converts_to_list_and_array(plan):
    path = plan.path
    assert len(path) == len(path.xy) == len(list(path))
    assert next(iter(path)) == ENDS[0]
    np.testing.assert_array_equal(np.asarray(path), path.xy)
    assert np.asarray(path, dtype=np.float32).dtype == np.float32


def test_map_equality_ignores_names(grid):
    same = locplan.OccupancyGrid(grid.cells.copy(), grid.resolution, grid.origin, "other")
    assert same == grid
    assert len({same, grid}) == 1
    cells = grid.cells.copy()
    cells[0, 0] = 0 if cells[0, 0] else 254
    assert locplan.OccupancyGrid(cells, grid.resolution, grid.origin) != grid
    assert grid != "two_corridors"


def test_cell_rejects_other_than_positions(grid):
    for wrong in ((2.0,), "here", (1.0, 2.0, 3.0, 4.0), (np.nan, 1.0)):
        with pytest.raises(PoseError, match="pose"):
            grid.cell(wrong)


def test_field_converts_to_xarray_dataset(grid, field):
    data = field.to_xarray()
    np.testing.assert_array_equal(data["e"], field.e)
    i, j = np.argwhere(field.is_evaluated)[40]
    point = float(data["x"][j]), float(data["y"][i])
    np.testing.assert_allclose(field.at(point, "covariance"), data["covariance"][i, j], rtol=1e-9)
    assert data["e"].attrs["units"] == "m² rad"
    lidar = locplan.Lidar(range=3.0, field_of_view_deg=180.0, beams=20)
    several = locplan.FieldConfig(locplan.Scan(lidar), stride=2.0, headings=4)
    data = locplan.covariance_field(grid, several).to_xarray()
    assert data["ambiguity"].dims == ("y", "x", "heading")
    assert data["heading"].values.tolist() == several.heading_angles.tolist()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda g, f, c: locplan.plan(g, *ENDS), "costs must be a Costmap, not a value of type"),
        (
            lambda g, f, c: locplan.plan("lab.yaml", *ENDS),
            "costs must be a Costmap, not 'lab.yaml'",
        ),
        (lambda g, f, c: locplan.planning.plan_field(g, ENDS[0]), "costs must be a Costmap"),
        (lambda g, f, c: locplan.pareto_front(f, *ENDS), "costs must be a Costmap"),
        (lambda g, f, c: Costmap.from_field(g), "field must be a CovarianceField"),
        (lambda g, f, c: Costmap.from_field(c), "field must be a CovarianceField"),
        (lambda g, f, c: Costmap.from_density("lab.yaml", 1), "grid must be an OccupancyGrid"),
        (lambda g, f, c: Costmap.blank(f), "grid must be an OccupancyGrid"),
        (lambda g, f, c: locplan.covariance_field("lab.yaml"), "locplan.load_map"),
        (lambda g, f, c: locplan.load_or_compute(f), "grid must be an OccupancyGrid"),
        (lambda g, f, c: locplan.covariance_field(g, "sad"), "config must be a FieldConfig"),
        (lambda g, f, c: locplan.load_map(g), "a map file must be a path"),
        (lambda g, f, c: locplan.save_map("m.yaml", g), "grid must be an OccupancyGrid"),
        (lambda g, f, c: locplan.simulation.simulate("m", {"a": [(0, 0)]}), "grid must be"),
        (lambda g, f, c: locplan.plan(c, ENDS), "goal"),
        (lambda g, f, c: Path.load(3), "a path file must be a path, not 3"),
        (lambda g, f, c: CovarianceField.load(3), "a field must be a path"),
        (lambda g, f, c: locplan.load_config(3), "a file of settings must be a path"),
        (lambda g, f, c: locplan.save_config(g, "a.json"), "config must be a FieldConfig"),
        (lambda g, f, c: f.update("m.yaml"), "grid must be an OccupancyGrid"),
        (lambda g, f, c: f.scalar("foo"), "scalar must be one of e, "),
        (lambda g, f, c: locplan.pareto_front(c, *ENDS).plan(999), "paths, from 0 on; there is no"),
        (lambda g, f, c: simulate(g, Path([(2, 3), (4, 3)])), "paths must be a mapping of names"),
        (
            lambda g, f, c: Simulator(g, robot="utm-30lx"),
            "robot must be a Robot, not 'utm-30lx'; such as",
        ),
        (lambda g, f, c: Simulator(g, Robot(filter=3)), "filter must be an Amcl"),
        (
            lambda g, f, c: PlannerResult(Path([(0, 0)]), "timeout"),
            "the status of a result with a path must be solved",
        ),
    ],
)
def test_arguments_of_another_kind_are_named(grid, field, costs, call, message):
    with pytest.raises((ConfigError, LocplanError, TypeError), match=message):
        call(grid, field, costs)


RECIPES = (
    *(locplan.recommend_path, locplan.covariance_field, find_ambiguous_places),
    *(locplan.locate, locplan.place_landmarks, ScanDatabase, calibrate_drive),
    *(evaluate_drive, fit_to_map, match_scans),
    *(record_drive, replay, tune_on_drive, Simulator),
    *(simulate, locate_drive),
)
WRONG = {
    **dict.fromkeys(("grid", "recording", "robot", "lidar", "filter_map"), 7),
    **{"drives": 0.5, "runs": 0, "seed": -1, "threads": 0, "clearance": -1.0, "start": "here"},
}


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: recipe.__name__)
def test_recipes_name_invalid_arguments(grid, recipe):
    poses = [(2.0 + n / 4, 3.0, 0.0) for n in range(40)]
    lidar, path = locplan.Lidar(range=5.0, field_of_view_deg=180.0, beams=5), Path([(2, 3), (4, 3)])
    drive = Recording(np.full((40, 5), 1.0), lidar, poses, odometry=poses)
    sound = {"grid": grid, "recording": drive, "robot": Robot(lidar), "lidar": lidar, "path": path}
    sound |= {"paths": {"a": path}, "start": (2, 3), "goal": (4, 3), "scan": np.ones(5)}
    sound |= {"kind": locplan.advice.Pole(), "count": 1}
    takes = inspect.signature(recipe).parameters
    given = {name: value for name, value in sound.items() if name in takes}
    for name in WRONG.keys() & takes.keys():
        called = {"filter_map": "grid", "threads": "thread"}.get(name, name)
        with pytest.raises(LocplanError, match=rf"\b{called}"):
            recipe(**given | {name: WRONG[name]})
