"""Compare planners, weights and lidar ranges in one call and one report.

Run: python examples/compare.py [FOLDER [SECONDS [MAP.yaml ...]]]
"""

from __future__ import annotations

import sys

import locplan
from locplan.comparison import Execution, RandomQueries
from locplan.maps import environments


def main(folder: str = "comparison", seconds: float = 1.0, *maps: str) -> None:
    result = locplan.compare(
        maps or [environments.make("two_corridors", resolution=0.1)],
        ["grid", "any-angle", "InformedRRTstar", "BITstar", "RRTConnect"],
        RandomQueries(6, min_distance=15.0),
        weights=[0.0, 4.0],
        seeds=[1, 2],
        execution=Execution(time_limit=seconds),
        configs={  # how much does a longer range help?
            "6 m": locplan.Sad(range=6.0),
            "8 m": locplan.Sad(range=8.0),
        },
    )
    print(result.report())
    for name, answer in result.answers().items():
        print(f"{name}: {answer}")
    result.save(folder)
    print(f"wrote {folder}")


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(float, sys.argv[2:3]), *sys.argv[3:])
