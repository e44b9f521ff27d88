"""Compute a field on a dask cluster, save it and draw it.

Run: pip install 'locplan[dask]' && python examples/cluster.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import locplan
from locplan.maps import environments

try:
    from distributed import Client, LocalCluster
except ImportError:
    sys.exit("this example needs dask; run pip install 'locplan[dask]'")


def main(folder: str = "cluster") -> None:
    grid = environments.make("places", resolution=0.1)
    # On your own machines: Client("tcp://HOST:8786"), with locplan installed on the workers.
    with LocalCluster(n_workers=2, dashboard_address=":0") as cluster, Client(cluster) as client:
        field = locplan.load_or_compute(grid, executor=client.get_executor())
    print(f"{field.is_evaluated.sum():,} cells, {field.saturated_share:.0%} of them saturated")
    Path(folder).mkdir(parents=True, exist_ok=True)
    field.save(Path(folder) / "places.npz")
    field.figure().savefig(Path(folder) / "places.png")


if __name__ == "__main__":
    main(*sys.argv[1:2])
