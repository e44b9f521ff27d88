"""Fields on a cluster of dask.distributed, with real worker processes."""

import os
import signal

import numpy as np
import pytest
from conftest import random_rooms

from locplan import cluster, store
from locplan.config import FieldConfig
from locplan.errors import LocplanError
from locplan.field import covariance_field
from locplan.grid import OccupancyGrid

distributed = pytest.importorskip("distributed", reason="the extra locplan[dask] is not installed")
pytestmark = pytest.mark.filterwarnings("default")  # of dask's own shutting down
CONFIG = FieldConfig(sensor_range=1.0, window=0.6)


@pytest.fixture(scope="module")
def scheduler():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as running:
        yield running


@pytest.fixture
def grid() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((300, 320), seed=6, blocks=30), 0.05, name="rooms")


def test_a_cluster_gives_the_same_field(scheduler, grid, monkeypatch):
    monkeypatch.setattr("locplan.tiles.TILE", 16)
    expected = covariance_field(grid, CONFIG)
    with cluster.executor_of(scheduler.scheduler_address) as executor:
        field = covariance_field(grid, CONFIG, executor=executor)
    np.testing.assert_array_equal(field.covariance, expected.covariance)


def test_a_worker_killed_mid_run_costs_nothing_but_time(scheduler, grid, tmp_path, monkeypatch):
    monkeypatch.setattr("locplan.tiles.TILE", 8)
    expected = covariance_field(grid, CONFIG)
    killed = []

    def kill_one(done, total):
        if not killed and done > total / 10:
            with distributed.Client(scheduler.scheduler_address) as client:
                pids = client.run(os.getpid)
            killed.append(next(iter(pids.values())))
            os.kill(killed[0], signal.SIGKILL)

    with cluster.executor_of(scheduler.scheduler_address) as executor:
        field = store.load_or_compute(
            grid, CONFIG, executor=executor, cache_dir=tmp_path, progress=kill_one
        )
    assert killed
    np.testing.assert_array_equal(field.covariance, expected.covariance)


def test_a_scheduler_that_does_not_answer_is_one_line(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", "1 s")
    with (
        pytest.raises(LocplanError, match="does not answer"),
        cluster.executor_of("tcp://127.0.0.1:9"),
    ):
        pass
    with pytest.raises(LocplanError, match="does not answer"), cluster.executor_of("nonsense://"):
        pass
