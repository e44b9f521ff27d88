"""Grids of the MovingAI benchmark, with the optimal lengths of their scenarios."""

from __future__ import annotations

import numpy as np
import pytest

from support.machine import SHARED_DATA

FOLDER = SHARED_DATA / "movingai"


SCENARIOS_A_MAP = 12


def read_map(path) -> np.ndarray:
    """Density 1 on passable cells, inf elsewhere; row 0 is the file's first line."""
    lines = path.read_text().splitlines()
    rows = lines[lines.index("map") + 1 :]
    passable = np.array([[character in ".GS" for character in row] for row in rows if row])
    return np.where(passable, 1.0, np.inf)


def read_all_scenarios(path) -> list[tuple[tuple[int, int], tuple[int, int], float]]:
    """(row, col) of start and goal, and the optimal length."""
    lines = [line.split() for line in path.read_text().splitlines()[1:] if line.strip()]
    return [((int(f[5]), int(f[4])), (int(f[7]), int(f[6])), float(f[8])) for f in lines]


def read_scenarios(path):
    """Some of them, of all lengths."""
    every = read_all_scenarios(path)
    return every[:: max(1, len(every) // SCENARIOS_A_MAP)] + every[-1:]


def find_scenario_files():
    if not FOLDER.is_dir():
        pytest.skip("the MovingAI grids (../shared/data/movingai) are not here")
    return sorted(FOLDER.glob("*.scen"))


def find_map_file(path):
    name = path.name.removesuffix(".scen").removesuffix(".map").removesuffix("-even-1")
    return path.with_name(f"{name}.map")
