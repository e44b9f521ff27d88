"""The estimators against the uncertainty that was measured with real lasers.

The reference of ../shared/data/carmen is the posterior of a matcher: every odd scan of six logs,
matched on the map of the even ones. The settings of the estimators are tuned to these logs and
seven others.
"""

from __future__ import annotations

import importlib
import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr
from support.machine import SHARED_DATA

from locplan.field import Estimator, Fused, Scan, position_axes, scalar
from locplan.field.estimator import MapPart

pytestmark = pytest.mark.long

EXAMPLES = str(Path(__file__).resolve().parents[2] / "examples")
sys.path.insert(0, EXAMPLES)
lasers = importlib.import_module("lasers")
sys.path.remove(EXAMPLES)
"""The program that reads the logs and their reference."""
Log = lasers.Log


def covariances(log: Log, estimator: Estimator) -> np.ndarray:
    """Covariance at each pose of a log, from its cell at its exact heading, (n, 3, 3)."""
    grid, found = log.grid, []
    prepared = estimator.prepare(grid.cells, grid.resolution)
    assert grid.origin[2] == 0.0  # the grid's own axes are the world's
    for x, y, heading in log.poses:
        row, col = (np.array([index]) for index in grid.cell((x, y)))
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
    return list(lasers.read_logs(SHARED_DATA).values())


@pytest.fixture(scope="module")
def scan(logs) -> list[np.ndarray]:
    return [covariances(log, Scan(log.lidar)) for log in logs]


@pytest.fixture(scope="module")
def fused(logs) -> list[np.ndarray]:
    return [covariances(log, Fused(log.lidar)) for log in logs]


def ranks(logs: list[Log], column: str, predicted: list[np.ndarray]) -> tuple[float, float]:
    """Rank correlation with what was measured, over all logs, and the mean within one."""
    measured = [log.measured[column] for log in logs]
    within = [spearmanr(*each).statistic for each in zip(predicted, measured, strict=True)]
    pooled = spearmanr(np.concatenate(predicted), np.concatenate(measured)).statistic
    return pooled, float(np.mean(within))


def test_fused_ranks_measured_position_deviation(logs, fused):
    deviations = [scalar(each, "position_std") for each in fused]
    pooled, within = ranks(logs, "sd_major", deviations)
    assert pooled >= 0.89
    assert within >= 0.87
    measured = np.concatenate([log.measured["sd_major"] for log in logs])
    ratio = np.exp(np.mean(np.log(np.concatenate(deviations) / measured)))
    assert 0.8 < ratio < 1.2  # in metres, too


def test_fused_predicts_large_deviations_in_metres(logs, fused):
    measured = np.concatenate([log.measured["sd_major"] for log in logs])
    ratios = np.concatenate([scalar(each, "position_std") for each in fused]) / measured
    large = np.abs(np.log(ratios[measured > lasers.LARGE]))
    assert np.mean(large < math.log(1.5)) >= 0.75
    for low, high in itertools.pairwise(lasers.CLASSES):
        in_class = ratios[(low <= measured) & (measured < high)]
        assert 0.67 < np.exp(np.mean(np.log(in_class))) < 1.5


def test_scan_ranks_measured_position_deviation(logs, scan):
    pooled, within = ranks(logs, "sd_major", [scalar(each, "position_std") for each in scan])
    assert pooled >= 0.86
    assert within >= 0.85


def test_scan_ranks_measured_heading_deviation(logs, scan):
    deviations = [scalar(each, "heading_std") for each in scan]
    pooled, within = ranks(logs, "sd_theta_deg", deviations)
    assert pooled >= 0.90
    assert within >= 0.84


def test_fused_ellipse_has_measured_direction(logs, fused):
    apart = []
    for log, found in zip(logs, fused, strict=True):
        direction = position_axes(found[log.is_elongated])[2]
        apart.append(lasers.angle_between(direction, log.measured["major_dir"][log.is_elongated]))
    assert np.mean(np.concatenate(apart) < math.radians(15)) >= 0.97
