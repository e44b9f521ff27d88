"""What do paths change for a robot that gets lost? On any maps; examples/places.py has the fields.

Routes: on each map some random queries, of 10 m or more and with a shortest path of at most 40 m,
are chosen for as `locplan plan` does, seed 1. The shortest, the inflated, the leading and the
chosen path are then driven 64 times by `simulate` with seed 1001: in other worlds, which no
choice has seen. A pursuit follower steers 40 more drives of each by the filter's pose.

Whether `plan` and `simulate` agree: for the shortest path and for the one that led the race, the
error of a typical drive and the share of lost drives; and the ratio of both paths' errors. Each
is a value with a 95 % interval on both sides. Two agree if they differ by no more than the
interval of their difference, whose half is the root of the sum of the squares of the halves that
face each other. So 95 % of the comparisons of two right procedures agree; comparisons are
counted, not queries, of which each has two or five.

Run: python examples/evidence.py [FOLDER [MAP.yaml ...]]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

import locplan
from locplan._util.intervals import Interval, of_mean, wilson
from locplan.field import SHORT_LIDAR
from locplan.planners import random_queries
from locplan.robots import Amcl, Robot
from locplan.simulation import Arrivals, Closed, simulate

OWN = Path(__file__).resolve().parent.parent / "maps"
PRODUCT = {"laser_model_type": "likelihood_field_prob"}
CALM = dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4", "alpha5"), 0.05)
ROUTE_FILTERS = {
    "Nav2's defaults": Amcl(),
    "alphas 0.05": Amcl(**CALM),
    "alphas 0.05, beams multiplied": Amcl(**CALM, **PRODUCT),
}
"""The filters that drive with a lidar of 6 m; tuned ones beside Nav2's."""
MIN_DISTANCE, LONGEST_DISTANCE = 10.0, 40.0
"""Least distance from start to goal, and greatest length of the shortest path [m]."""
CLOSED = 40
"""Number of closed-loop drives of each path."""
SHORTEST, INFLATED, LEADER, CHOSEN = "shortest", "inflated", "winner of the race", "chosen"


def main(
    folder: str = "evidence",
    maps: Sequence[str] = (),
    drives: int = 64,
    queries: int = 2,
) -> None:
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    grids = [locplan.load_map(file) for file in maps or sorted(OWN.glob("*.yaml"))]
    driven = [
        each
        for name, amcl in ROUTE_FILTERS.items()
        for grid in grids
        for each in routes_of(grid, name, Robot(SHORT_LIDAR, filter=amcl), drives, queries)
    ]
    text = [routes_table(driven), maps_table(driven), ranks_table(driven)]
    print("\n\n".join(text), flush=True)
    (target / "evidence.md").write_text("\n\n".join(text) + "\n", encoding="utf-8")
    print(f"wrote {target / 'evidence.md'}")


# Routes: what the recommended path changes.


@dataclass(frozen=True)
class Judged:
    """A choice, and fresh drives of its paths, in other worlds than those that decided."""

    map: str
    filter: str
    choice: locplan.Choice
    seconds: float
    """Time of the choice beside the field [s]."""
    log_error: Mapping[str, np.ndarray]
    """Logarithm of the RMSE of each fresh drive of the paths [ln m]."""
    lost: Mapping[str, np.ndarray]
    """True for each fresh drive that was off by more than 1 m at some time."""
    off_at_end: Mapping[str, np.ndarray]
    """True for each fresh drive that was off by more than 1 m where it ends."""
    arrivals: Mapping[str, Arrivals]
    """Fresh closed-loop drives of the paths."""

    def path_of(self, what: str) -> str:
        """Name of the path that is chosen, led the race, or has this name."""
        names = [each.name for each in self.choice.candidates]
        best = {CHOSEN: self.choice.best, LEADER: self.choice.judgement.leader}
        if what in best:
            return names[best[what]]
        return what if what in names else SHORTEST  # an inflated path may be the shortest

    def ratio(self, what: str, beside: str = SHORTEST) -> Interval:
        """Logarithm of the ratio of both paths' errors, with its interval over the drives."""
        apart = self.log_error[self.path_of(what)] - self.log_error[self.path_of(beside)]
        half = 2.0 * float(apart.std(ddof=1)) / len(apart) ** 0.5
        return Interval(float(apart.mean()), float(apart.mean()) - half, float(apart.mean()) + half)

    def agreements(self) -> Iterator[bool]:
        """Whether what the choice shows is what the fresh drives show, within their intervals."""
        for what in dict.fromkeys((SHORTEST, self.path_of(LEADER))):
            shown = next(each for each in self.choice.candidates if each.name == what).driven
            log_error, lost = self.log_error[what], self.lost[what]
            again = of_mean(log_error)
            yield within(Interval(*np.log(shown.error)), again)
            yield within(shown.lost_rate, wilson(float(lost.mean()), len(lost)))
        if self.choice.judgement.leader:
            yield within(Interval(*np.log(self.choice.judgement.ratio)), self.ratio(LEADER))


def within(one: Interval, other: Interval) -> bool:
    """Whether two independent values differ by no more than the interval of their difference."""
    first, second = (one, other) if one.value < other.value else (other, one)
    apart = np.hypot(first.high - first.value, second.value - second.low)
    return bool(second.value - first.value <= apart + 1e-12)


def routes_of(
    grid: locplan.OccupancyGrid, name: str, robot: Robot, drives: int, count: int
) -> Iterator[Judged]:
    """Choose a path for some random queries, and drive the paths that count afresh."""
    blank = locplan.Costmap.blank(grid, robot=robot)
    try:
        queries = random_queries(blank, 4 * count, 2, min_distance=MIN_DISTANCE)
    except locplan.LocplanError:  # the map is too small
        return
    for query in queries:
        ends = query.start[:2], query.goal[:2]
        shortest = locplan.plan(blank, *ends).path
        if shortest is None or shortest.length > LONGEST_DISTANCE or not count:
            continue
        count -= 1
        yield judged(grid, name, robot, ends, drives)


def judged(
    grid: locplan.OccupancyGrid, name: str, robot: Robot, ends: tuple, drives: int
) -> Judged:
    """Choose a path for a query, and drive it, the shortest and the inflated one afresh."""
    in_fields = 0.0

    def compute(of: locplan.OccupancyGrid, points: np.ndarray | None = None) -> object:
        nonlocal in_fields
        began = time.perf_counter()
        field = locplan.load_or_compute(of, locplan.Fused(robot.lidar), points=points)
        in_fields += time.perf_counter() - began
        return field

    began = time.perf_counter()
    choice = locplan.choose(grid, *ends, robot, compute=compute)
    seconds = time.perf_counter() - began - in_fields
    wanted = {SHORTEST, INFLATED, choice.candidates[choice.judgement.leader].name}
    paths = {each.name: each.path for each in choice.candidates if each.name in wanted}
    closed = Closed(drives=CLOSED)
    simulated = simulate(grid, paths, robot, drives=drives, closed=closed, seed=1001)
    found = simulated.drives
    return Judged(
        grid.name,
        name,
        choice,
        seconds,
        {path: np.log(each.mean_squares) / 2 for path, each in found.items()},
        {path: each.lost for path, each in found.items()},
        {path: each.off_at_end for path, each in found.items()},
        simulated.arrivals,
    )


def routes_table(driven: Sequence[Judged]) -> str:
    """What the chosen path changes against the shortest and the inflated one, for each filter."""
    rows = []
    for name in dict.fromkeys(each.filter for each in driven):
        own = [each for each in driven if each.filter == name]
        maps = [each.map for each in own]
        over = [[each.ratio(CHOSEN, other) for each in own] for other in (SHORTEST, INFLATED)]
        moved = sum(each.choice.best > 0 for each in own)
        better, worse = sum(r.high < 0 for r in over[0]), sum(r.low > 0 for r in over[0])
        worst = [float(np.exp(each.ratio(CHOSEN).value)) for each in own if each.choice.best]
        what = SHORTEST, INFLATED, CHOSEN
        lost = [np.mean([each.lost[each.path_of(w)].mean() for each in own]) for w in what]
        off = [np.mean([each.off_at_end[each.path_of(w)].mean() for each in own]) for w in what]
        arrive = [[each.arrivals[each.path_of(w)].arrived.value for each in own] for w in what]
        gain = over_queries([100 * (c - s) for s, _, c in zip(*arrive, strict=True)], maps)
        confirmed = [each.choice.judgement for each in own if each.choice.judgement.leader]
        undecided = sum(each.verdict == "undecided" for each in confirmed)
        agree = [each for route in own for each in route.agreements()]
        rows.append(
            [
                f"{name} ({len(own)} queries, {len(set(maps))} maps)",
                *(text_of(exp(over_queries([each.value for each in r], maps))) for r in over),
                f"{moved}: {better}/{worse}",
                " / ".join(f"{each:.0%}" for each in lost),
                " / ".join(f"{each:.0%}" for each in off),
                f"{' / '.join(f'{np.mean(each):.1%}' for each in arrive)}; {text_of(gain)} points",
                f"{sum(each > 0.95 for each in worst)}",
                f"{undecided / len(own):.0%}",
                f"{np.mean(agree):.0%} of {len(agree)}",
                f"{np.median([each.seconds for each in own]):.1f} s",
            ]
        )
    heads = (
        "filter",
        "error over the shortest's",
        "over the inflated one's",
        "moved: better/worse",
        "lost: shortest / inflated / chosen",
        "off at the end",
        "arrive; chosen over shortest",
        "above .95",
        "undecided",
        "`plan` and `simulate` agree",
        "time",
    )
    return markdown(heads, rows)


def maps_table(driven: Sequence[Judged]) -> str:
    """What the choice changes on each map, for each filter."""
    rows = []
    filters = list(dict.fromkeys(each.filter for each in driven))
    for name in dict.fromkeys(each.map for each in driven):
        cells = [name]
        for kind in filters:
            here = [each for each in driven if (each.map, each.filter) == (name, kind)]
            if not here:
                cells.append("")
                continue
            error = np.exp(np.mean([each.log_error[SHORTEST].mean() for each in here]))
            lost = [
                np.mean([e.lost[e.path_of(w)].mean() for e in here]) for w in (SHORTEST, CHOSEN)
            ]
            factor = np.exp(np.mean([each.ratio(CHOSEN).value for each in here]))
            cells.append(
                f"{len(here)}: {error:.2f} m, {lost[0]:.0%} → {lost[1]:.0%}, x{factor:.2f}"
            )
        rows.append(cells)
    return markdown(["map", *filters], rows)


def ranks_table(driven: Sequence[Judged]) -> str:
    """Rank correlation over paths of what open drives show with closed-loop failures."""
    rows = []
    for name in dict.fromkeys(each.filter for each in driven):
        own = [(each, path) for each in driven if each.filter == name for path in each.arrivals]
        fails = [1 - each.arrivals[path].arrived.value for each, path in own]
        cells = [f"{name} ({len(own)} paths, {sum(each > 0 for each in fails)} fail at times)"]
        for figures in ("log_error", "lost", "off_at_end"):
            shown = [getattr(each, figures)[path].mean() for each, path in own]
            cells.append(f"{spearman(shown, fails):.2f}")
        faults = [d.fault for each, path in own for d in each.arrivals[path].drives]
        cells.append(f"{faults.count('follower')} and {faults.count('world')} of {len(faults)}")
        rows.append(cells)
    heads = ("filter", "ln RMSE", "lost", "off at the end")
    return markdown((*heads, "fail with perfect localization: follower, world"), rows)


def spearman(one: Sequence[float], other: Sequence[float]) -> float:
    """Spearman's rank correlation; NaN where all values are one."""
    if len(set(one)) < 2 or len(set(other)) < 2:
        return float("nan")
    return float(spearmanr(one, other).statistic)


def exp(interval: Interval) -> Interval:
    """The ratio of which this is the logarithm."""
    return Interval(*np.exp(interval).tolist())


def over_queries(numbers: Sequence[float], maps: Sequence[str], resamples: int = 1000) -> Interval:
    """The mean, with its 95 % interval over maps and queries."""
    random = np.random.default_rng(0)
    values, names = np.array(numbers), np.array(maps)
    groups = [values[names == name] for name in dict.fromkeys(maps)]
    means = []
    for _ in range(resamples):
        drawn = [groups[n] for n in random.integers(0, len(groups), len(groups))]
        means.append(np.concatenate([random.choice(g, len(g)) for g in drawn]).mean())
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return Interval(float(values.mean()), low, high)


def text_of(interval: Interval) -> str:
    return f"{interval.value:.2f} [{interval.low:.2f}, {interval.high:.2f}]"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    main(*sys.argv[1:2], maps=sys.argv[2:])
