"""Fields by executors: on a cluster of dask.distributed, and in processes."""

import os
import signal
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

import numpy as np
import pytest
from support.maps import random_rooms

from locplan.errors import FieldError
from locplan.field import FieldConfig, Sad, SearchWindow, covariance_field, load_or_compute
from locplan.maps import OccupancyGrid

pytestmark = pytest.mark.filterwarnings("default")  # of dask's own shutting down
CONFIG = FieldConfig(Sad(range=1.0, window=SearchWindow(half_width=0.6)))


@pytest.fixture
def start_client():
    distributed = pytest.importorskip(
        "distributed", reason="the extra locplan[dask] is not installed"
    )

    @contextmanager
    def start(workers):
        with (
            distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0"
            ) as cluster,
            distributed.Client(cluster, set_as_default=False) as client,
        ):
            yield client

    return start


@pytest.fixture
def grid() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((300, 320), seed=6, blocks=30), 0.05, name="rooms")


def test_cluster_computes_same_field(start_client, grid, monkeypatch):
    monkeypatch.setattr("locplan.field.tiles.TILE", 16)
    expected = covariance_field(grid, CONFIG)
    monkeypatch.setattr("locplan.field.compute.ThreadPoolExecutor", None)  # not here
    with start_client(1) as client:
        field = covariance_field(grid, CONFIG, executor=client.get_executor())
    np.testing.assert_array_equal(field.covariance, expected.covariance)


@pytest.mark.long
def test_field_is_complete_after_killed_worker(start_client, grid, tmp_path, monkeypatch):
    monkeypatch.setattr("locplan.field.tiles.TILE", 8)
    expected = covariance_field(grid, CONFIG)
    killed = []

    def kill_one(done, total):
        if not killed and done > total / 10:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    with start_client(2) as client:
        computed = {"executor": client.get_executor(), "cache_dir": tmp_path}
        field = load_or_compute(grid, CONFIG, **computed, progress=kill_one)
    assert killed
    np.testing.assert_array_equal(field.covariance, expected.covariance)


@pytest.fixture(scope="module")
def process():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        yield executor


def test_process_computes_same_field(process, grid):
    field = covariance_field(grid, CONFIG, executor=process)
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, CONFIG).covariance)


def test_workers_with_another_engine_are_refused(process, grid, monkeypatch):
    monkeypatch.setattr("locplan.field.tiles.ENGINE", 99)
    with pytest.raises(FieldError, match="another version of locplan"):
        covariance_field(grid, CONFIG, executor=process)
