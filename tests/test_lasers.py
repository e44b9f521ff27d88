"""The estimators against the uncertainty that was measured with real lasers.

The reference of ../shared/data/carmen is the posterior of a matcher: every odd scan of six logs,
matched on the map of the even ones. The settings of the estimators are tuned to these logs and
seven others.
"""

from __future__ import annotations

import csv
from typing import NamedTuple

import numpy as np
import pytest
from conftest import SHARED_DATA
from scipy.stats import spearmanr

from locplan.field import Estimator, Fused, Lidar, MapPart, Scan, position_axes, scalar
from locplan.maps import OccupancyGrid, load_map

pytestmark = pytest.mark.long

LOGS = {
    "aces": (180, 40.0),
    "csail": (361, 40.0),
    "fhw": (180, 40.0),
    "intel": (180, 30.0),
    "orebro": (181, 30.0),
    "seattle": (361, 40.0),
}
"""Beams of each log's laser, and the greatest distance that counts as a return [m]."""


class Log(NamedTuple):
    """A log's map, its laser, and what was measured at its poses by column."""

    grid: OccupancyGrid
    lidar: Lidar
    measured: dict[str, np.ndarray]


def read_log(name: str) -> Log:
    """Read a log, without the tenth of its poses whose scans fit the map worst."""
    with (SHARED_DATA / "carmen" / f"localizability_{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    table = {column: np.array([float(row[column]) for row in rows]) for column in rows[0]}
    fits = table["score_per_beam"] >= np.quantile(table["score_per_beam"], 0.1)
    beams, farthest = LOGS[name]
    lidar = Lidar(range=farthest, least_range=0.05, field_of_view_deg=180.0, beams=beams)
    grid = load_map(SHARED_DATA / "rosmaps_carmen" / f"{name}_even")
    assert grid.origin[2] == 0.0  # the grid's own axes are the world's
    return Log(grid, lidar, {column: values[fits] for column, values in table.items()})


def covariances(log: Log, estimator: Estimator) -> np.ndarray:
    """Covariance at each pose of a log, from its cell at its exact heading, (n, 3, 3)."""
    grid, found = log.grid, []
    prepared = estimator.prepare(grid.cells, grid.resolution)
    for x, y, heading in zip(*(log.measured[name] for name in ("x", "y", "theta")), strict=True):
        row, col = (np.array([index]) for index in grid.world_to_cell(x, y))
        part = MapPart(
            grid.cells, row, col, grid.resolution, grid.shape,
            headings=np.array([heading]), prepared=prepared,
        )  # fmt: skip
        found.append(estimator.covariances(part)["covariance"][0])
    return np.array(found)


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    if not all((SHARED_DATA / name).is_dir() for name in ("carmen", "rosmaps_carmen")):
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    return [read_log(name) for name in LOGS]


@pytest.fixture(scope="module")
def scan(logs) -> list[np.ndarray]:
    return [covariances(log, Scan(log.lidar)) for log in logs]


@pytest.fixture(scope="module")
def fused(logs) -> list[np.ndarray]:
    return [covariances(log, Fused.of(log.lidar)) for log in logs]


def ranks(logs: list[Log], column: str, predicted: list[np.ndarray]) -> tuple[float, float]:
    """Rank correlation with what was measured, over all logs, and the mean within one."""
    measured = [log.measured[column] for log in logs]
    within = [spearmanr(*each).statistic for each in zip(predicted, measured, strict=True)]
    pooled = spearmanr(np.concatenate(predicted), np.concatenate(measured)).statistic
    return pooled, float(np.mean(within))


def test_fused_ranks_the_measured_deviation_of_positions(logs, fused):
    deviations = [scalar(each, "position_std") for each in fused]
    pooled, within = ranks(logs, "sd_major", deviations)
    assert pooled >= 0.89
    assert within >= 0.86
    measured = np.concatenate([log.measured["sd_major"] for log in logs])
    ratio = np.exp(np.mean(np.log(np.concatenate(deviations) / measured)))
    assert 0.8 < ratio < 1.2  # in metres, too


def test_scan_alone_ranks_it_within_a_site(logs, scan):
    pooled, within = ranks(logs, "sd_major", [scalar(each, "position_std") for each in scan])
    assert pooled >= 0.86
    assert within >= 0.85


def test_scan_ranks_the_measured_deviation_of_headings(logs, scan):
    deviations = [scalar(each, "heading_std") for each in scan]
    pooled, within = ranks(logs, "sd_theta_deg", deviations)
    assert pooled >= 0.90
    assert within >= 0.84


def test_the_ellipse_lies_as_it_was_measured(logs, fused):
    apart = []
    for log, found in zip(logs, fused, strict=True):
        elongated = log.measured["sd_major"] > 3 * log.measured["sd_minor"]
        turned = position_axes(found[elongated])[2] - log.measured["major_dir"][elongated]
        apart.append(np.degrees(np.abs((turned + np.pi / 2) % np.pi - np.pi / 2)))
    assert np.mean(np.concatenate(apart) < 15) >= 0.97
