"""Time the rating of 2,000 places for landmarks, and the choice of ten."""

from __future__ import annotations

import time

import numpy as np

import locplan
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.robots import Amcl, Robot

SIZE = 800
FEW = 20
"""Number of places whose worth is also found by placing each."""


def cluttered() -> tuple[OccupancyGrid, dict[str, locplan.Path]]:
    """A map of 40 m x 40 m with 60 blocks, and three routes through it."""
    cells = np.full((SIZE, SIZE), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    random = np.random.default_rng(3)
    for _ in range(60):
        top, left = random.integers(10, SIZE - 60, 2)
        height, width = random.integers(8, 50, 2)
        cells[top : top + height, left : left + width] = OCCUPIED
    grid = OccupancyGrid(cells, 0.05)
    costs = locplan.Costmap.blank(grid, robot=0.5)
    ends = {"up": ((2, 2), (38, 38)), "down": ((2, 38), (38, 2)), "across": ((2, 20), (38, 20))}
    routes = {name: locplan.plan(costs, *both).path for name, both in ends.items()}
    assert all(routes.values())
    return grid, routes


def test_ten_of_two_thousand_places(benchmark):
    """Ten poles on a map of 800 x 800 cells; the peer places each object, and looks around anew."""
    grid, routes = cluttered()
    settings = {
        "paths": routes,
        "robot": Robot(filter=Amcl(laser_model_type="likelihood_field_prob")),
        "threads": 2,
    }
    made = benchmark.pedantic(
        lambda: locplan.place_landmarks(grid, locplan.advice.Pole(0.2), 10, **settings),
        rounds=3,
        warmup_rounds=1,
    )
    objective, places = made.search.sight, made.search.places
    every = np.arange(len(places))
    objective.start(every[:0])
    times, values = [], np.empty(len(places))
    for _ in range(3):
        began = time.perf_counter()
        values = objective.values(every)
        times.append((time.perf_counter() - began) / len(places))
    some = np.linspace(0, len(places) - 1, FEW).astype(int)
    began = time.perf_counter()
    anew = []
    for n in some:
        objective.start(every[n : n + 1])
        anew.append(objective.value())
    apart = (time.perf_counter() - began) / FEW
    np.testing.assert_allclose(values[some], anew, rtol=1e-5)
    benchmark.extra_info["places"] = len(places)
    benchmark.extra_info["ratio_to_placing_each"] = apart / min(times)
    print(f"\n{len(places)} places, {apart / min(times):.0f} times as fast as placing each")
