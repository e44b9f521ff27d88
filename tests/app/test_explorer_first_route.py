"""The first route of the page: both paths differ on it."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest
from support.maps import ascii_map

import locplan
from locplan.app.explorer.first_route import RouteStops, choose_first_route
from locplan.app.explorer.plans import has_drafts, measure_path
from locplan.app.explorer.repairs import compute_scene, make_blank_scene
from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.searches import PathSearches, ResultStore
from locplan.app.explorer.sites import ExploredSite
from locplan.app.explorer.weak_spots import name_weak_spots
from locplan.field import FieldConfig
from locplan.planning import Costmap

MAPS = ("two_corridors", "hall", "office", "places", "warehouse")
REAL_MAPS = Path(__file__).parents[2].parent / "shared" / "data" / "rosmaps"
REAL = (
    "tb4_warehouse",
    "mrpt_demo_world2_png",
    "robotnik_demo",
    "willow_garage_0.10",
    "nav2_depot",
)


def saved_share(grid) -> float | None:
    """Share of the degenerate metres that the first route avoids; None without a weak spot."""
    robot = locplan.Robot("turtlebot4")
    opening = StartSettings(FieldConfig(locplan.Fused(robot.lidar), stride=0.8), robot)
    site = ExploredSite(grid, opening.config, robot)
    scene = compute_scene(site, opening, lambda *_: None)
    if not name_weak_spots(scene):
        return None
    searches = PathSearches(ResultStore(520e6), scene)
    route = choose_first_route(searches, opening, is_draft=has_drafts(opening, grid))
    paths = [searches.path([route.start, route.goal], weight) for weight in (None, 8.0)]
    shortest, recommended = (measure_path(scene, p, 8.0, False)["degenerate"] for p in paths)
    return 1 - recommended / shortest


def test_first_route_avoids_degenerate_metres():
    assert saved_share(locplan.load_map("two_corridors")) > 0.5


@pytest.mark.long
def test_first_route_helps_on_most_maps():
    """On nine of ten maps, at least 5 % fewer metres are degenerate."""
    if not REAL_MAPS.is_dir():
        pytest.skip("the real maps are not here")
    files = [*MAPS, *(next((REAL_MAPS / name).glob("*.yaml")) for name in REAL)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        shares = {str(file): saved_share(locplan.load_map(file)) for file in files}
    known = {name: share for name, share in shares.items() if share is not None}
    assert sum(share >= 0.05 for share in known.values()) >= 0.9 * len(known), shares


def test_uniform_map_has_first_route():
    grid = ascii_map(*["." * 30] * 6, resolution=0.5)
    robot = locplan.Robot(footprint=0.0, margin=0.0)
    site = ExploredSite(grid, FieldConfig(locplan.Sad(range=1.0), stride=1.0), robot)
    scene = make_blank_scene(site)
    field = locplan.covariance_field(grid, site.config)
    costs = Costmap.from_field(field, robot=robot)
    scene = type(scene)(site, costs, field)
    route = choose_first_route(
        PathSearches(ResultStore(1e9), scene),
        StartSettings(site.config, robot, goal=(1.0, 1.0)),
        is_draft=False,
    )
    assert isinstance(route, RouteStops)
    assert route.goal == (1.0, 1.0)
    assert route.start != route.goal
