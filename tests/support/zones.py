"""Random zones, and positions inside them by a plain rule."""

import numpy as np

from locplan import Zone, Zones


def random_outline(rng, centre, size, corners):
    """A star-shaped outline, which does not cross itself."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
    angles[:3] = angles[0], angles[0] + 2.1, angles[0] + 4.2
    angles, radius = np.sort(angles), rng.uniform(0.2, 1.0, corners) * size
    return centre + radius[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


def inside(polygon, points):
    """True for each point inside a polygon, by its even or odd number of crossings."""
    result = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        between = (y0 <= points[:, 1]) != (y1 <= points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x0 + (points[:, 1] - y0) / (y1 - y0) * (x1 - x0)
        result ^= between & (points[:, 0] > x)
    return result


def random_zones(rng, grid, positions, count=20):
    """Zones of all kinds about some of the positions, whose ends are in no no-go zone."""
    kinds = (
        ["no-go"] * (count // 2) + ["prefer"] * (count // 4) + ["slow"] * (count - 3 * count // 4)
    )
    extent = max(grid.shape) * grid.resolution
    ends = grid.cell(positions[[0, -1]])
    zones = []
    while len(zones) < count:
        kind = kinds[len(zones)]
        centre = positions[rng.integers(len(positions))] + rng.normal(0, 0.3, 2)
        outline = random_outline(rng, centre, rng.uniform(0.2, 0.3 + 0.03 * extent), 6)
        zone = Zone(kind, outline, 30 if kind == "slow" else None)
        if not Zones([zone]).cells(grid, "no-go")[ends].any():
            zones.append(zone)
    return Zones(zones)


def crosses(zones, grid, xy):
    """True if a path is inside a no-go zone by more than a thousandth of a cell."""
    steps = np.maximum(1, np.hypot(*np.diff(xy, axis=0).T) / grid.resolution * 10).astype(int)
    pieces = [np.linspace(a, b, n) for a, b, n in zip(xy, xy[1:], steps, strict=False)]
    points = np.concatenate([xy[:1], *pieces, xy[-1:]])
    for zone in zones.no_go_zones:
        ahead = np.roll(zone.polygon, -1, axis=0) - zone.polygon
        away = points[:, None] - zone.polygon
        along = np.clip((away * ahead).sum(-1) / (ahead**2).sum(-1), 0, 1)
        distance = np.hypot(*(away - along[..., None] * ahead).transpose(2, 0, 1)).min(axis=1)
        if (inside(zone.polygon, points) & (distance > 1e-3 * grid.resolution)).any():
            return True
    return False
