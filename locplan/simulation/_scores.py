"""The scores by which paths are chosen: errors of their simulated drives as single numbers."""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Minimise = Literal["rmse", "lost", "goal-error", "heading"]
"""Quantity that the chosen path has least of."""
MINIMISED: tuple[Minimise, ...] = get_args(Minimise)
CLEARLY = math.log(0.9)
"""Difference of the mean log errors from which on a path counts as clearly better."""
CLEARLY_FEWER = 0.25
"""Difference of the shares of lost drives from which on it does: two of 8."""
ROUNDING = 1e-9
"""Amount by which a difference of shares may fall short of `CLEARLY_FEWER`."""
FLOOR = 1e-6
"""Mean square error that is added, so that no drive without error decides alone [m^2, rad^2]."""
LITTLE = 0.02
"""Difference of errors that hardly any robot feels [m]."""
SLIGHT = f"; that is under {100 * LITTLE:g} cm, and no drive is lost on the shortest either"
"""What is said of a path that is clearly better, but hardly worth a detour."""
LAST = 1.0
"""Length of the last stretch, of which "goal-error" is made [m]."""


def log_errors(
    distance: NDArray[np.float64],
    errors: NDArray[np.float64],
    minimise: Minimise,
    worst: float,
) -> NDArray[np.float64]:
    """Logarithm of the root mean square error of each drive, (drives,).

    Parameters
    ----------
    distance : (n,) array
        Distance driven up to each pose [m].
    errors : (drives, n, 3) array
        The filter's pose minus the true one [m, m, rad].
    minimise : str
        "heading" takes the error of the heading [rad], "goal-error" that of the position over the
        last metre, "rmse" and "lost" that of the position [m].
    worst : float
        Error as which larger ones count [m, or rad].
    """
    if minimise == "heading":
        squares = errors[..., 2] ** 2
    else:
        squares = errors[..., 0] ** 2 + errors[..., 1] ** 2
    if minimise == "goal-error":
        squares = squares[:, distance >= distance[-1] - LAST]
    return np.asarray(0.5 * np.log(np.minimum(squares.mean(axis=1), worst**2) + FLOOR))


def is_slight(before: float, after: float, lost: int) -> bool:
    """Whether an error falls by less than `LITTLE`, where no drive was lost before.

    Parameters
    ----------
    before, after : float
        Errors of a typical drive on the shortest and on the other path [m].
    lost : int
        Number of drives that were lost on the shortest path.
    """
    return lost == 0 and before - after < LITTLE


def worst_error(shape: tuple[int, int], resolution: float) -> float:
    """Error of a position as which larger ones count: the length of the map's diagonal [m]."""
    return math.hypot(*shape) * resolution


def log_error_range(worst: float) -> tuple[float, float]:
    """Least and greatest value that `log_errors` can have."""
    return 0.5 * math.log(FLOOR), 0.5 * math.log(worst**2 + FLOOR)


def selected(
    scores: NDArray[np.float64], lost: NDArray[np.float64], minimise: Minimise
) -> tuple[int, bool]:
    """Index of the path to recommend, and whether it is clearly better than the shortest.

    Parameters
    ----------
    scores : (paths,) array
        Mean log error of each path's drives with the price of its length, the shortest's first.
    lost : (paths,) array
        Share of each path's drives that were lost.
    minimise : str
        "lost" takes the fewest lost drives, of equals the least score; the others the least score.
    """
    if minimise == "lost":
        best = int(np.lexsort((scores, lost))[0])
        clear = bool(_clearly_fewer(lost[best], lost[0]))
    else:
        best = int(np.argmin(scores))
        clear = bool(scores[best] <= scores[0] + CLEARLY)
    return (best, True) if clear and best else (0, False)


def is_settled(
    sums: NDArray[np.float64],
    lost: NDArray[np.float64],
    prices: NDArray[np.float64],
    done: int,
    drives: int,
    minimise: Minimise,
    worst: float,
) -> bool:
    """Return whether the drives that are left cannot change the choice any more.

    Parameters
    ----------
    sums, lost : (paths,) arrays
        Sum of the log errors, and number of lost drives, of the `done` drives of each path.
    prices : (paths,) array
        Price of each path's length, which is added to its mean log error.
    done, drives : int
        Number of drives of each path until now, and in all.
    minimise, worst
        As for `log_errors`.
    """
    left = drives - done
    least, greatest = log_error_range(worst)
    low = (sums + left * least) / drives + prices
    high = (sums + left * greatest) / drives + prices
    fewest, most = lost / drives, (lost + left) / drives
    chosen, _ = selected(sums / done + prices, lost / done, minimise)
    others = np.arange(len(sums)) != chosen
    if minimise == "lost":
        if chosen == 0:
            return not bool(_clearly_fewer(fewest[others], most[0]).any())
        ahead = (most[chosen] < fewest) | ((most[chosen] <= fewest) & (high[chosen] < low))
        return bool(ahead[others].all() and _clearly_fewer(most[chosen], fewest[0]))
    if chosen == 0:
        return bool((low[others] > high[0] + CLEARLY).all())
    return bool((high[chosen] < low[others]).all() and high[chosen] <= low[0] + CLEARLY)


def _clearly_fewer(lost: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether shares of lost drives are clearly below others, whatever the rounding of both."""
    return np.asarray(others - lost >= CLEARLY_FEWER - ROUNDING)


def price_of(extra: NDArray[np.float64], price: float | None) -> NDArray[np.float64]:
    """Price of metres of detour, in log error; `price` is the detour for a halved error [m]."""
    return np.zeros_like(extra) if price is None else math.log(2) * extra / price


def front_of(lengths: NDArray[np.float64], scores: NDArray[np.float64]) -> list[int]:
    """Indices of the paths on the Pareto front of length against score, by length."""
    front: list[int] = []
    for index in np.lexsort((scores, lengths)).tolist():
        if not front or scores[index] < scores[front[-1]]:
            front.append(index)
    return front
