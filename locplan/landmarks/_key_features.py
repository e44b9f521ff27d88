"""Which features of a map localization depends on: `key_features`, and its report."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import number, positive, whole
from locplan._util.progress import ProgressCallback, parts
from locplan._util.tables import wrapped
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.field import equipped
from locplan.landmarks._feature_sights import Sights
from locplan.landmarks._features import Feature, KeyFeatures, in_cm
from locplan.landmarks._objects import Shape
from locplan.landmarks._outcomes import FeatureDrives
from locplan.landmarks._routes import routes_of
from locplan.landmarks._sight import lines_along, surroundings
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot


def key_features(
    grid: OccupancyGrid,
    *,
    paths: Mapping[str, Path | ArrayLike] | Sequence[Path | ArrayLike] | Path | None = None,
    places: Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | None = None,
    robot: Robot | None = None,
    count: int = 3,
    piece: float = 1.0,
    largest: float = 4.0,
    gap: float = 0.1,
    shift: float = 0.3,
    progress: ProgressCallback | None = None,
) -> KeyFeatures:
    """Find the features of a map that localization along some routes depends on.

    The loss by a feature is how far the expected deviation of the position rises without it: the
    root of the mean of P_xx + P_yy that `place_landmarks` makes small. Rays that met an object
    reach what lies behind it, exactly as on the map without it. A piece of a wall is no window:
    rays that met it count for nothing. `KeyFeatures.verify` drives without the worst ones.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    paths : Path, or mapping of str to Path or to (n, 2) array, optional
        Routes of the robot in the world [m], within the free cells.
    places : sequence of (x, y), or mapping of str to (x, y), optional
        Instead of paths: the robot drives the shortest paths between all of these, 2 to 8 [m].
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    count : int, default 3
        Number of features that are taken away together, 1 to 50: the worst one, then the worst
        beside it, and so on, since features that stand in for each other hide their loss.
    piece : float, default 1.0
        Length of the pieces that walls are divided into, about their corners and ends, above 0, up
        to 20 [m].
    largest : float, default 4.0
        Maximum extent of what counts as one object [m], above 0; what is joined farther is a
        wall. Raise it for large machines or shelves.
    gap : float, default 0.1
        Maximum gap between the parts of one object [m], 0 to 2; outlines on maps are often broken.
    shift : float, default 0.3
        Distance for `Feature.error` by which a feature has been moved in the world [m], above 0, up
        to 2.
    progress : callable, optional
        Called with (done, total) features that were taken away.

    Returns
    -------
    KeyFeatures
        The features in order of loss, and a verdict.

    Raises
    ------
    LocplanError
        If an argument is out of its range, or a path leaves the free cells.

    Notes
    -----
    On simulated drives of the log-product filter in a hall with few objects the losses rank the
    errors without each (rank correlation about .7), and errors by features 0.3 m off are within
    about 3 cm of those driven. Losses of a few per cent rank nothing, and Nav2's default model,
    `likelihood_field`, can lose its way with a feature and hold it without: only drives show it.
    What comes into sight only as another feature goes is no feature here.

    Examples
    --------
    >>> import locplan
    >>> from locplan.landmarks import Pole, with_objects
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> grid = with_objects(grid, Pole(0.3), [(20.0, 3.8)])
    >>> route = Path(np.array([[14.0, 3.0], [26.0, 3.0]]))
    >>> found = key_features(grid, paths=route)
    >>> found.features[0].title, round(found.features[0].x)
    ('object of 0.2 x 0.2 m', 20)
    """
    check_grid(grid)
    # Longer pieces and wider gaps would make their searches take long.
    number("gap", gap, 0.0, 2.0)
    number("piece", piece, 0.0, 20.0)
    whole("count", count, 1, 50)
    # Greatest distance that a feature may be off; no filter pairs it with its place beyond [m].
    number("shift", shift, 0.0, 2.0)
    for name, value in (("piece", piece), ("largest", largest), ("shift", shift)):
        positive(name, value, "m")
    robot = equipped(robot)
    if (paths is None) == (places is None):
        raise ConfigError("give paths, or places that routes lead between, and not both")
    routes = routes_of(grid, paths, places, robot.radius)
    half = grid.resolution  # half the width of the narrowest thing that no ray may miss
    lines = lines_along(grid, routes, robot)
    seen = surroundings(grid, lines, Shape(half, half, is_round=True), robot)
    sights = Sights(grid, seen, piece, largest, gap)
    total = len(sights.kinds)
    each, *later = parts(progress, [total] * min(count, total) or [0])
    base = sights.profile()
    profiles = np.empty((total, len(base)))
    for n in range(total):
        profiles[n] = sights.without(n)
        each(n + 1, total)
    losses = np.sqrt(profiles.mean(axis=1)) - np.sqrt(base.mean())
    order = np.argsort(-losses, kind="stable").tolist()
    features = tuple(
        _feature(sights, n, number, base, profiles[n], shift) for number, n in enumerate(order, 1)
    )
    chosen, few = _together(sights, order, later)
    return KeyFeatures(
        grid,
        routes,
        robot,
        features,
        tuple(order.index(n) + 1 for n in chosen),
        np.array([float(profile.mean()) for profile in (base, *few)]),
        sights.positions,
        tuple(seen.routes.tolist()),
        np.stack([base, *few[:1], *few[-1:]] if few else [base] * 3),
        shift,
    )


def _together(
    sights: Sights, order: list[int], callbacks: Sequence[ProgressCallback]
) -> tuple[list[int], list[Floats]]:
    """Take features away one after the other, each the worst beside those before it.

    The first one is that of `order`, which are all of them. Returns their numbers, and
    P_xx + P_yy along the routes as each has gone.
    """
    chosen, profiles = order[:1], []
    for n in chosen:  # grows
        sights.take(n)
        profiles.append(sights.profile())
        if len(chosen) <= len(callbacks):
            values = np.full(len(order), -np.inf)
            for other in range(len(order)):
                if other not in chosen:
                    values[other] = sights.without(other).mean()
                callbacks[len(chosen) - 1](other + 1, len(order))
            chosen.append(int(np.argmax(values)))
    return chosen, profiles


def _feature(
    sights: Sights, n: int, number: int, base: Floats, without: Floats, shift: float
) -> Feature:
    """A feature with what is lost without it."""
    cells = sights.whole[n]
    before = float(np.sqrt(base.mean()))
    loss = float(np.sqrt(without.mean())) - before
    rises = np.sqrt(without) - np.sqrt(base)
    worst = int(np.argmax(rises))
    errors = sights.biases(n)[:, :2]
    strongest = np.linalg.eigvalsh(np.einsum("nij,nik->jk", errors, errors) / len(errors))[-1]
    x_worst, y_worst = sights.positions[worst].tolist()
    return Feature(
        number,
        sights.kinds[n],
        *_rectangle(sights.grid, cells),
        seen=len(np.unique(sights.rays_of(n) // sights.seen.rays.beams)) / len(base),
        loss=loss,
        share=loss / before,
        worst=float(rises[worst]),
        worst_share=float(rises[worst] / np.sqrt(base[worst])),
        worst_at=(x_worst, y_worst),
        error=shift * float(np.sqrt(max(strongest, 0.0))),
        cells=cells,
    )


def _rectangle(grid: OccupancyGrid, cells: Ints) -> tuple[float, float, float, float, float]:
    """World x, y, length, width and heading of the least rectangle around cells [m, rad]."""
    import cv2

    corners = np.concatenate([cells + shift for shift in ((0, 0), (0, 1), (1, 0), (1, 1))])
    (col, row), (one, other), angle = cv2.minAreaRect(corners[:, ::-1].astype(np.float32))
    x, y = grid.grid_to_world(row, col)
    heading = np.radians(angle) + (np.pi / 2 if other > one else 0.0) + grid.origin[2]
    length, width = max(one, other) * grid.resolution, min(one, other) * grid.resolution
    # Half a turn changes nothing.
    return float(x), float(y), length, width, float((heading + 1e-6) % np.pi - 1e-6)


def features_report(found: KeyFeatures, drives: FeatureDrives | None = None) -> str:
    """The verdicts, then the features with the greatest loss."""
    said = drives.verdict if drives else "not verified: nothing was driven"
    lines = wrapped([found.verdict, said, f"with {found.robot.title}"])
    parts = [str(drives.table()), *lines] if drives else lines
    if not found.features:
        return "\n".join(parts)
    table = found.table()
    # Number of features in the table.
    listed = {*range(1, 11), *found.together}
    rows = (row for n, row in enumerate(table.rows, 1) if n in listed)
    shown = dataclasses.replace(table, rows=tuple(rows))
    after = [
        f"rise: of the expected deviation of the position, {in_cm(float(found.deviations[0]))}"
        " with all, as the feature goes; worst: at the place where it rises most",
        f"moved: error of the position if the feature is {100 * found.shift:.0f} cm off and the"
        " map does not show it, to first order",
    ]
    if len(found) > len(shown):
        after.append(f"{len(found)} features are seen; features.csv lists all of them")
    if len(found.together) > 1:
        steps = ", ".join(
            f"{number}: {in_cm(each)}"
            for number, each in zip(found.together, found.deviations[1:].tolist(), strict=True)
        )
        after.append(f"expected deviation as they go one after the other: without {steps}")
    return "\n".join([*parts, str(shown), *wrapped(after)])
