"""A lidar that sees less is never more certain: without a sector, or with a shorter range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from locplan.field import (
    Estimator,
    FieldConfig,
    Fisher,
    Fused,
    Sad,
    Scan,
    covariance_field,
    load_or_compute,
    scalar,
)
from locplan.field.estimator import MapPart
from locplan.maps import FREE, OccupancyGrid, environments, save_map
from locplan.planning import Costmap, path_cost, plan
from locplan.planning.metrics import compare_lidars
from locplan.robots import Lidar, Robot
from locplan.simulation import simulate

pytestmark = pytest.mark.usefixtures("undrawn")

MAPS = "hall", "office", "places", "two_corridors", "warehouse"
ROUND = Lidar(range=12.0, beams=360)
HALF = replace(ROUND, field_of_view_deg=180.0, beams=180)


def make_random_partial_lidar(lidar: Lidar, random: np.random.Generator) -> Lidar:
    """Return the lidar without a sector, or with a shorter range."""
    if random.random() < 0.4:
        return replace(lidar, range=lidar.range * random.uniform(0.3, 0.95))
    width = random.uniform(60.0, 355.0)
    middle = random.uniform(-180.0, 180.0)
    beams = round(lidar.beams * width / 360)
    return replace(lidar, field_of_view_deg=width, beams=beams, mount_yaw_deg=middle)


def compute_deviation_ratios(kind: type[Estimator], grid: OccupancyGrid, count: int) -> np.ndarray:
    """Return deviations of a partial view divided by those of the whole view, at random poses."""
    random, ratios = np.random.default_rng(7), []
    free = np.argwhere(grid.clearance > 0.2)
    prepared = kind(ROUND).prepare(grid.cells, grid.resolution)
    for row, col in free[random.integers(0, len(free), count)]:
        whole = replace(ROUND, range=float(random.choice([6.0, 12.0])))
        part = MapPart(
            grid.cells, np.array([row]), np.array([col]), grid.resolution, grid.shape,
            headings=random.uniform(-np.pi, np.pi, 1), prepared=prepared,
        )  # fmt: skip
        less, more = (
            kind(lidar).covariances(part)["covariance"][0]
            for lidar in (make_random_partial_lidar(whole, random), whole)
        )
        ratios.append(
            [scalar(less, name) / scalar(more, name) for name in ("position_std", "heading_std")]
        )
    return np.array(ratios)


@pytest.fixture(scope="module")
def grids() -> list[OccupancyGrid]:
    return [environments.make(name, resolution=0.1) for name in MAPS]


def test_partial_view_never_lowers_fisher_deviation(grids):
    ratios = np.concatenate([compute_deviation_ratios(Fisher, grid, 60) for grid in grids])
    assert ratios.min() > 1 - 1e-9
    assert np.median(ratios) > 1.01


@pytest.mark.parametrize("kind", [Scan, Fused])
def test_partial_view_rarely_lowers_scan_deviation(kind, grids):
    """At most 1 % of the deviations fall by more than 5 %."""
    ratios = np.concatenate([compute_deviation_ratios(kind, grid, 60) for grid in grids])
    assert np.mean(ratios < 0.95, axis=0).max() <= 0.01
    assert np.median(ratios) > 1.01


def test_wider_lidar_compares_more_beams():
    for estimator in (Fisher, Scan):
        whole, half = estimator(ROUND), estimator(HALF)
        assert (whole.beams_compared, half.beams_compared) == (360, 180)
        assert whole.temperature == half.temperature == pytest.approx(12.6 / 180)
        quarter = estimator(replace(HALF, field_of_view_deg=90.0, beams=90, mount_yaw_deg=45.0))
        bearings = [
            set(
                np.round(
                    np.degrees(each.make_kernel_lidar().angles + each.make_kernel_lidar().yaw), 9
                ).tolist()
            )
            for each in (quarter, half, whole)
        ]
        assert bearings[0] < bearings[1] < bearings[2]


def test_narrower_lidar_keeps_beam_noise():
    left, whole = (Scan(replace(HALF, field_of_view_deg=width)) for width in (90.0, 180.0))
    inside = np.isin(whole.make_kernel_lidar().angles, left.make_kernel_lidar().angles)
    assert inside.sum() == left.beams_compared == 90
    np.testing.assert_array_equal(whole.end_deviations[inside], left.end_deviations)


def test_half_lidar_increases_degenerate_share():
    office = environments.make("office", resolution=0.1)
    grid = OccupancyGrid(office.cells[:160, :160], office.resolution)
    half, whole = (each.degenerate_share for each in compare_lidars(grid, [HALF, ROUND]))
    assert half > whole
    shares = []
    for lidar in (HALF, ROUND):
        field = load_or_compute(grid, FieldConfig(Fused(lidar), stride=0.4))
        costs = Costmap.from_field(field)
        shares.append(np.mean(costs.u[np.isfinite(costs.density)]))
    assert shares[0] > shares[1]


def test_costmap_combines_u_of_headings():
    grid = environments.make("places", resolution=0.1)
    field = covariance_field(grid, FieldConfig(Fisher(HALF), stride=0.8))
    mean, worst = (Costmap.from_field(field, headings=how) for how in ("mean", "worst"))
    for costs, join in ((mean, np.mean), (worst, np.max)):
        np.testing.assert_allclose(costs.u, join(costs.u_of_heading, axis=0), atol=1e-6)
        np.testing.assert_allclose(costs.e, join(costs.e_of_heading, axis=0), rtol=1e-6)
    assert np.nanmean(worst.u) > np.nanmean(mean.u) + 0.05


@pytest.mark.parametrize("with_lidar", [False, True])
def test_sad_costmap_has_note_with_lidar(with_lidar):
    """The plan has the same note, unless it is the shortest path, which ignores u."""
    grid = OccupancyGrid(np.pad(np.full((20, 30), FREE, np.uint8), 1), 0.1)
    robot = Robot(Lidar(range=2.0)) if with_lidar else Robot()
    field = covariance_field(grid, FieldConfig(Sad(range=2.0), stride=0.8))
    costs = Costmap.from_field(field, robot=robot)
    aware, shortest = (
        plan(each, (0.6, 0.6), (2.4, 1.4)) for each in (costs, costs.with_weight(0.0))
    )
    assert ("locplan.Fused(robot.lidar)" in costs.estimator_note) == with_lidar
    assert aware.note == costs.estimator_note
    assert costs.estimator_note in aware.report()
    assert shortest.note == ""
    fused = covariance_field(grid, FieldConfig(Fused(Lidar(range=2.0)), stride=0.8))
    assert Costmap.from_field(fused, robot=robot).estimator_note == ""


def test_fused_ranks_paths_as_drives_do():
    """On the aware path of `Sad` half of the drives get lost, on the shortest none."""
    grid = environments.make("places", resolution=0.1)
    robot = Robot(Lidar(range=6.0))
    sad, fused = (
        Costmap.from_field(
            covariance_field(grid, FieldConfig(each, stride=0.8)), robot=robot, weight=16.0
        )
        for each in (Sad(), Fused(robot.lidar))
    )
    ends = (46.0, 11.8), (6.8, 17.8)
    paths = {
        "shortest": plan(sad.with_weight(0.0), *ends).path,
        "aware": plan(sad, *ends).path,
    }
    assert path_cost(sad, paths["aware"]) < path_cost(sad, paths["shortest"])
    assert path_cost(fused, paths["aware"]) > 1.1 * path_cost(fused, paths["shortest"])
    shortest, aware = simulate(grid, paths, robot, drives=6).drives.values()
    assert not shortest.lost.any()
    assert aware.lost.mean() > 0.2


def test_plan_command_prints_sad_note_once(run, tmp_path):
    grid = OccupancyGrid(np.pad(np.full((30, 40), FREE, np.uint8), 1), 0.1)
    save_map(grid, tmp_path / "room.yaml")
    options = "--start", "0.8,0.8", "--goal", "3.2,2.2", "--lidar", "lds-01", "--stride", "0.8"
    for drives in ((), ("--drives", 0)):
        _, out, _ = run("plan", tmp_path / "room.yaml", *options, "--field", "sad", *drives)
        assert " ".join(out.split()).count("the field with locplan.Fused(robot.lidar)") == 1
    _, out, _ = run("plan", tmp_path / "room.yaml", *options, "--drives", 0)
    assert "locplan.Fused(robot.lidar)" not in out
