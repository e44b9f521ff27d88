"""Small maps: drawn with characters, random rooms, corridors, blocks."""

from __future__ import annotations

import numpy as np

from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


def ascii_map(*lines: str, resolution: float = 1.0, origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    """A grid from a drawing, its first line at the top: '.' free, '#' occupied, ' ' unknown."""
    levels = {".": FREE, "#": OCCUPIED, " ": UNKNOWN}
    cells = [[levels[character] for character in line] for line in reversed(lines)]
    return OccupancyGrid(np.array(cells, np.uint8), resolution, origin)


def random_rooms(shape: tuple[int, int], seed: int, *, blocks: int = 14) -> np.ndarray:
    """Levels of a map with random boxes of all three levels, deterministic."""
    rng = np.random.default_rng(seed)
    cells = np.full(shape, FREE, np.uint8)
    for _ in range(blocks):
        top, left = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        height, width = rng.integers(2, max(3, min(shape) // 4), 2)
        cells[top : top + height, left : left + width] = rng.choice([OCCUPIED, UNKNOWN, FREE])
    return cells


def corridor(
    length: float, width: float, *, angle: float = 0.0, resolution: float = 0.05
) -> OccupancyGrid:
    """A straight corridor with walls, unknown beyond, its axis turned by `angle` [rad]."""
    half = int((length / 2 + 1) / resolution)
    y, x = np.mgrid[-half:half, -half:half] + 0.5
    along = (np.cos(angle) * x + np.sin(angle) * y) * resolution
    across = (np.cos(angle) * y - np.sin(angle) * x) * resolution
    cells = np.full(x.shape, UNKNOWN, np.uint8)
    cells[(abs(across) < width / 2 + 0.15) & (abs(along) < length / 2)] = OCCUPIED
    cells[(abs(across) < width / 2) & (abs(along) < length / 2)] = FREE
    return OccupancyGrid(cells, resolution, (-half * resolution, -half * resolution, 0.0))


def blocks(thick: bool = True) -> OccupancyGrid:
    """Aisles of 1.5 m between blocks of 3 m, which are black inside, or have walls of one cell."""
    cells = np.full((200, 200), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for row in range(15, 165, 45):
        for col in range(15, 150, 45):
            cells[row : row + 30, col : col + 30] = OCCUPIED
            if not thick:
                cells[row + 1 : row + 29, col + 1 : col + 29] = UNKNOWN
    return OccupancyGrid(cells, 0.1, name="blocks")


def furnished_room():
    """A room with a pillar and a niche, in which a tuned filter keeps its place."""
    cells = np.full((120, 160), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[50:60, 40:50] = cells[:20, 120:122] = cells[90:92, 100:160] = OCCUPIED
    return OccupancyGrid(cells, 0.05, name="room")
