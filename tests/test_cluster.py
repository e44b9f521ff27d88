"""Fields on a cluster of dask.distributed, with real worker processes."""

import gc
import os
import signal
import socketserver
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from conftest import random_rooms

from locplan import load_map, save_map
from locplan.cli import main
from locplan.errors import FieldError, LocplanError
from locplan.field import (
    CovarianceField,
    FieldConfig,
    Sad,
    SearchWindow,
    _compute as cluster,
    _store as store,
    covariance_field,
)
from locplan.maps import OccupancyGrid

distributed = pytest.importorskip("distributed", reason="the extra locplan[dask] is not installed")
pytestmark = pytest.mark.filterwarnings("default")  # of dask's own shutting down
CONFIG = FieldConfig(Sad(range=1.0, window=SearchWindow(half_width=0.6)))


class Banner(socketserver.BaseRequestHandler):
    """Of a server that speaks first, and of something else."""

    def handle(self):
        self.request.sendall(b"SSH-2.0-OpenSSH_9.2p1\r\n" * 10)


@pytest.fixture(scope="module")
def scheduler():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as running:
        yield running


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """A cluster that is there answers some time, however busy the machine is."""
    monkeypatch.setattr(cluster, "PATIENCE", 600.0)
    monkeypatch.setattr(cluster, "WORKERLESS", 600.0)


@pytest.fixture
def grid() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((300, 320), seed=6, blocks=30), 0.05, name="rooms")


def test_a_cluster_gives_the_same_field(scheduler, grid, monkeypatch):
    monkeypatch.setattr("locplan.field._tiles.TILE", 16)
    expected = covariance_field(grid, CONFIG)
    with cluster.executor_of(scheduler.scheduler_address) as executor:
        field = covariance_field(grid, CONFIG, executor=executor)
    np.testing.assert_array_equal(field.covariance, expected.covariance)


def test_a_worker_killed_mid_run_costs_nothing_but_time(scheduler, grid, tmp_path, monkeypatch):
    monkeypatch.setattr("locplan.field._tiles.TILE", 8)
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


def test_a_cluster_without_workers_is_not_waited_for_forever(grid, monkeypatch):
    monkeypatch.setattr(cluster, "WORKERLESS", 0.5)
    with (
        distributed.LocalCluster(n_workers=1, dashboard_address=":0") as dying,
        cluster.executor_of(dying.scheduler_address) as executor,
    ):
        dying.scale(0)
        with pytest.raises(FieldError, match="the executor failed"):
            covariance_field(grid, CONFIG, executor=executor)


def test_commands_compute_on_a_cluster(scheduler, grid, tmp_path, monkeypatch, capsys):
    save_map(grid, tmp_path / "rooms.yaml")
    arguments = "field", tmp_path / "rooms.yaml", "--disc", "1", "-o", tmp_path / "f.zarr"
    address = "--scheduler", scheduler.scheduler_address
    monkeypatch.setattr("sys.argv", ["locplan", *map(str, arguments + address)])
    monkeypatch.setattr("locplan.field._compute.ThreadPoolExecutor", None)  # not here
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 0, capsys.readouterr().err
    monkeypatch.undo()
    here = covariance_field(load_map(tmp_path / "rooms.yaml"), FieldConfig(Sad(range=1.0)))
    there = CovarianceField.load(tmp_path / "f.zarr")
    np.testing.assert_array_equal(there.covariance, here.covariance)


def test_workers_with_another_engine_are_refused(grid, monkeypatch):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        monkeypatch.setattr("locplan.field._tiles.ENGINE", 99)
        with pytest.raises(FieldError, match="another locplan"):
            covariance_field(grid, CONFIG, executor=executor)


def test_what_is_no_scheduler_is_one_line(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    with socketserver.TCPServer(("127.0.0.1", 0), Banner) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.server_address[1]}"
        with pytest.raises(LocplanError, match="does not answer"), cluster.executor_of(address):
            pass
        server.shutdown()


def test_a_scheduler_that_does_not_answer_is_one_line(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    with (
        pytest.raises(LocplanError, match="does not answer"),
        cluster.executor_of("tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.parametrize(
    "address", ["xyz", "nonsense://", ":", "tcp://", "http://[", "tcp://host:0", "host:99999", ""]
)
def test_what_is_no_address_is_refused_before_a_client_is_made(address, monkeypatch):
    monkeypatch.setattr(distributed, "Client", None)
    with pytest.raises(LocplanError, match="must be an address"), cluster.executor_of(address):
        pass


def test_a_client_that_cannot_connect_is_not_closed_by_the_collector(monkeypatch):
    """Closing it would take long, and end in a traceback beside the error."""
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    closed = []
    gc.collect()  # those of other tests
    monkeypatch.setattr(distributed.Client, "close", lambda *_, **__: closed.append(1))
    with pytest.raises(LocplanError, match="TLS"), cluster.executor_of("tls://127.0.0.1:9"):
        pass
    gc.collect()
    assert not closed
