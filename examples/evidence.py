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

What do settings change for a robot with a fault? The baseline (Nav2's defaults), the safe and the
precise preset drive at each level of disturbance: 16 simulated drives on two routes of each of
three maps, and 12 replays of each recording. Three seeds put the faults into the odometry of the
recordings. The kinked map is a recording's own. RECORDINGS is a folder with the logs and maps of
`SOUND` and `KINKED`. Without it, the figure shows simulated drives alone. Takes minutes. Finished
cases stay in levels.json, so that an interrupted run resumes; delete it to measure again.

Run: python examples/evidence.py levels [FOLDER [RECORDINGS]]
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

import locplan
from locplan._support import drawing as style
from locplan._support.drawing import NotebookFigure, save_figure
from locplan._support.intervals import Interval, compute_wilson_interval, estimate_mean
from locplan.field.config import SHORT_LIDAR
from locplan.planning import describe_map, random_queries
from locplan.recordings import Recording, read_recording, replay
from locplan.robots import PRECISE, SAFE, Amcl, Robot, with_preset
from locplan.simulation import (
    LEVELS,
    NO_FAULT,
    Arrivals,
    ClosedLoopSettings,
    Drives,
    Level,
    Simulator,
    drive_open,
    simulate,
)
from locplan.simulation.levels import KINKED_MAP, REVERSAL, SLIP, STANDSTILL, TURNS

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
SETTINGS = {"baseline": Amcl()} | {name: with_preset(Amcl(), name) for name in (SAFE, PRECISE)}
"""The settings that drive at the levels of disturbance."""
SHOWN_LEVELS = (NO_FAULT, TURNS, SLIP, KINKED_MAP, STANDSTILL, REVERSAL)
"""The levels from left to right in the figure: those that lose few robots come first."""
LEVEL_MAPS = ("two_corridors", "office", "warehouse")
SOUND = ("intel", "aces", "csail", "wean2", "mines2")
"""Recordings whose odometry and map are sound."""
KINKED = "killian_3"
"""Recording whose map has kinks."""
SOUND_LEVELS = (NO_FAULT, SLIP, STANDSTILL, REVERSAL)
"""Levels of recordings whose odometry and map are sound."""
FAULT_SEEDS = (1, 2, 3)
"""Seeds of the places where odometry of a recording misses motion; each has a third of the runs."""
REVERSE = 2.0
"""Distance that a route leads back at the level of reversals, and the least that a recording must
lead back to count there [m]."""


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
    choice: locplan.Recommendation
    seconds: float
    """Time of the choice beside the field [s]."""
    log_error: Mapping[str, np.ndarray]
    """Logarithm of the RMSE of each fresh drive of the paths [ln m]."""
    lost: Mapping[str, np.ndarray]
    """True for each fresh drive that was lost."""
    off_at_end: Mapping[str, np.ndarray]
    """True for each fresh drive that was off at the end."""
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
            again = estimate_mean(log_error)
            yield within(Interval(*np.log(shown.error)), again)
            yield within(shown.lost_rate, compute_wilson_interval(float(lost.mean()), len(lost)))
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
    choice = locplan.recommend_path(grid, *ends, robot, compute=compute)
    seconds = time.perf_counter() - began - in_fields
    wanted = {SHORTEST, INFLATED, choice.candidates[choice.judgement.leader].name}
    paths = {each.name: each.path for each in choice.candidates if each.name in wanted}
    closed = ClosedLoopSettings(drives=CLOSED)
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
        arrive = [[each.arrivals[each.path_of(w)].arrival_rate.value for each in own] for w in what]
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
        fails = [1 - each.arrivals[path].arrival_rate.value for each, path in own]
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


# Levels: what settings change at each level of disturbance.


@dataclass(frozen=True)
class Case:
    """Drives with some settings at one level, on one map or recording."""

    source: str
    """"simulation" or "recordings"."""
    place: str
    """Name of the map or the recording."""
    level: str
    settings: str
    log_error: list[float]
    """Logarithm of the RMSE of each drive [ln m]."""
    lost: list[bool]
    """True for each drive that was lost."""
    off_at_end: list[bool]
    """True for each drive that was off at the end."""

    @classmethod
    def from_drives(
        cls, source: str, place: str, level: Level, settings: str, drives: Sequence[Drives]
    ) -> Case:
        return cls(
            source,
            place,
            level.name,
            settings,
            np.concatenate([np.log(each.mean_squares) / 2 for each in drives]).round(4).tolist(),
            np.concatenate([each.lost for each in drives]).tolist(),
            np.concatenate([each.off_at_end for each in drives]).tolist(),
        )


def show_levels(
    folder: str = "evidence",
    recordings: str = "",
    maps: Sequence[str] = LEVEL_MAPS,
    drives: int = 16,
    runs: int = 12,
) -> None:
    """Drive with each setting at each level, and draw errors and lost drives."""
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    file = target / "levels.json"
    cases = [Case(**each) for each in json.loads(file.read_text())] if file.exists() else []
    known = {(case.source, case.place, case.level, case.settings) for case in cases}
    for source, place, level, drive in list_cases(recordings, maps, drives, runs):
        for settings, amcl in SETTINGS.items():
            if (source, place, level.name, settings) in known:
                continue
            case = Case.from_drives(source, place, level, settings, drive(amcl))
            print(f"{place}, {level.name}, {settings}: {np.exp(np.mean(case.log_error)):.2f} m")
            cases.append(case)
            file.write_text(json.dumps([asdict(each) for each in cases]), encoding="utf-8")
    text = levels_table(cases)
    print(text)
    (target / "levels.md").write_text(text + "\n", encoding="utf-8")
    save_figure(levels_figure(cases), target / "levels.png")
    print(f"wrote {target / 'levels.png'}, {target / 'levels.md'}")


def list_cases(
    recordings: str, maps: Sequence[str], drives: int, runs: int
) -> Iterator[tuple[str, str, Level, Callable[[Amcl], list[Drives]]]]:
    """List source, place and level of each case, and a function that drives with settings."""
    for name in maps:
        grid = locplan.load_map(OWN / f"{name}.yaml")
        paths = find_routes(grid)
        for level in LEVELS:
            routes = paths
            if level is REVERSAL:
                routes = {name: back_up(path) for name, path in paths.items()}
            if all(not level.can_affect(path, grid) for path in routes.values()):
                print(f"{name}: no route can have the fault of the level {level.name}")
                continue

            def simulate_level(
                amcl: Amcl,
                grid: locplan.OccupancyGrid = grid,
                routes: Mapping[str, locplan.Path] = routes,
                level: Level = level,
            ) -> list[Drives]:
                simulator = Simulator(grid, Robot("turtlebot4", filter=amcl), threads=1)
                return [*drive_open(simulator, routes, range(drives), level=level).values()]

            yield "simulation", name, level, simulate_level
    for name in (*SOUND, KINKED) if recordings else ():
        file = Path(recordings) / f"{name}.log.gz"
        if not file.exists():
            print(f"{file}: skipped, there is no such recording")
            continue
        recording, grid = read_recording(file), locplan.load_map(file.with_name(f"{name}.yaml"))
        for level in (KINKED_MAP,) if name == KINKED else SOUND_LEVELS:
            seeds = FAULT_SEEDS if level.missing else FAULT_SEEDS[:1]
            disturbed = {seed: disturb(recording, level, seed) for seed in seeds}
            if not all(disturbed.values()):
                continue

            def replay_level(
                amcl: Amcl,
                grid: locplan.OccupancyGrid = grid,
                disturbed: Mapping[int, Recording] = disturbed,
            ) -> list[Drives]:
                count = runs // len(disturbed)
                return [
                    replay(
                        drive,
                        grid,
                        Robot(drive.lidar, filter=amcl),
                        runs=count,
                        seed=seed,
                        threads=1,
                    ).drives
                    for seed, drive in disturbed.items()
                ]

            yield "recordings", name, level, replay_level


def find_routes(grid: locplan.OccupancyGrid, count: int = 2) -> dict[str, locplan.Path]:
    """Return shortest paths between places far apart, the first routes of `locplan check`."""
    robot = Robot("turtlebot4")
    costs = locplan.Costmap.blank(grid, robot=robot)
    paths = {}
    for pair in describe_map(grid, robot=robot).pairs[:count]:
        path = locplan.plan(costs, (pair.start.x, pair.start.y), (pair.goal.x, pair.goal.y)).path
        if path is not None:
            paths[f"{pair.start.name} to {pair.goal.name}"] = path
    return paths


def back_up(path: locplan.Path) -> locplan.Path:
    """Return a path that leads back over `REVERSE` after a third, and on again."""
    fine = path.resample(0.05, even=True)
    end, begin = np.searchsorted(fine.distance, [path.length / 3, path.length / 3 - REVERSE])
    order = [*range(end), *range(end, begin, -1), *range(begin, len(fine.xy))]
    return locplan.Path(fine.xy[order], np.unwrap(fine.facing)[order])


def disturb(recording: Recording, level: Level, seed: int = 1) -> Recording | None:
    """Return a recording with a level's fault in its odometry; None if it cannot have the fault."""
    before = recording.odometry
    after = level.disturb_odometry(before, recording.poses, np.random.default_rng(seed))
    changed = np.hypot(*(np.diff(after, axis=0) - np.diff(before, axis=0))[:, :2].T).sum()
    # Lost signs change the motion by twice the distance in reverse.
    if level is REVERSAL and changed < 2 * REVERSE:
        return None
    return replace(recording, odometry=after)


@dataclass(frozen=True)
class LevelResult:
    """Means over the maps or recordings of settings at one level, with the value of each."""

    error: Interval
    errors: Sequence[float]
    lost: Interval
    off_at_end: Interval
    off_rates: Sequence[float]


def summarize(cases: Sequence[Case]) -> LevelResult:
    """Return the means over places, with 95 % intervals over the drives of all places."""
    errors = [estimate_mean(np.array(case.log_error)) for case in cases]
    middle = float(np.mean([each.value for each in errors]))
    half = float(np.sqrt(sum((each.high - each.value) ** 2 for each in errors))) / len(cases)
    count = sum(len(case.lost) for case in cases)
    off_rates = [float(np.mean(case.off_at_end)) for case in cases]
    return LevelResult(
        exp(Interval(middle, middle - half, middle + half)),
        np.exp([each.value for each in errors]).tolist(),
        compute_wilson_interval(float(np.mean([np.mean(case.lost) for case in cases])), count),
        compute_wilson_interval(float(np.mean(off_rates)), count),
        off_rates,
    )


def summarize_levels(
    cases: Sequence[Case], source: str
) -> dict[str, tuple[int, dict[str, LevelResult]]]:
    """Return the number of places of each level, and the results of the settings there."""
    results = {}
    for level in SHOWN_LEVELS:
        here = [case for case in cases if (case.source, case.level) == (source, level.name)]
        places = {case.place for case in here}
        if places:
            results[level.name] = (
                len(places),
                {
                    name: summarize([case for case in here if case.settings == name])
                    for name in SETTINGS
                },
            )
    return results


def levels_table(cases: Sequence[Case]) -> str:
    """Return error, lost and off at the end of each setting at each level."""
    rows = []
    for source in dict.fromkeys(case.source for case in cases):
        for level, (count, results) in summarize_levels(cases, source).items():
            cells = [
                f"{each.error.value:.3f} m, {each.lost.value:.0%}, {each.off_at_end.value:.0%}"
                for each in results.values()
            ]
            rows.append([f"{source}, {level} ({count})", *cells])
    return markdown(["error, lost, off at the end", *SETTINGS], rows)


def levels_figure(cases: Sequence[Case]) -> NotebookFigure:
    """Draw errors above shares of lost drives, simulation next to recordings."""
    sources = list(dict.fromkeys(case.source for case in cases))
    summaries = [summarize_levels(cases, source) for source in sources]
    figure = NotebookFigure(figsize=(1.5 + 5.2 * len(sources), 5.8), layout="constrained")
    panels = figure.subplots(
        2,
        len(sources),
        sharex="col",
        sharey="row",
        squeeze=False,
        gridspec_kw={"width_ratios": [max(3, len(each)) for each in summaries]},
    )
    colours = dict(zip(SETTINGS, ("0.35", style.BLUE, style.VERMILION), strict=True))
    for (above, below), source, levels in zip(panels.T, sources, summaries, strict=True):
        for at, (_, results) in enumerate(levels.values()):
            for shift, (name, result) in zip((-0.27, 0.0, 0.27), results.items(), strict=True):
                x, colour = at + shift, colours[name]
                above.plot(
                    [x] * len(result.errors), result.errors, "o", color=colour, ms=3, alpha=0.4
                )
                above.plot([x - 0.11, x + 0.11], [result.error.value] * 2, color=colour, lw=3)
                below.bar(x, result.lost.value, 0.23, color=colour, alpha=0.25)
                below.bar(x, result.off_at_end.value, 0.23, color=colour)
                if source == "simulation":
                    above.vlines(x, *result.error[1:], color=colour, lw=1.2)
                    below.vlines(x, *result.off_at_end[1:], color="black", lw=1)
                if not at:
                    below.text(
                        x,
                        max(result.lost.value, result.off_at_end.high) + 0.03,
                        name,
                        rotation=90,
                        ha="center",
                        va="bottom",
                        color=colour,
                        fontweight="bold",
                    )
        places = "maps" if source == "simulation" else "drives"
        ticks = [f"{name.replace(' ', chr(10))}\n({count})" for name, (count, _) in levels.items()]
        above.set_title(f"{source} (number of {places})")
        below.set_xticks(range(len(ticks)), ticks)
        above.set_yscale("log")
        above.yaxis.set_major_formatter("{x:g}")
        below.set_ylim(0, 1)
        below.yaxis.set_major_formatter("{x:.0%}")
        for axes in (above, below):
            axes.grid(axis="y", alpha=0.3)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(axis="x", length=0)
    panels[0, 0].set_ylabel("error of a typical drive [m]")
    panels[1, 0].set_ylabel("drives lost at some time (light)\nand off at the end (dark)")
    return figure


if __name__ == "__main__":
    if sys.argv[1:2] == ["levels"]:
        show_levels(*sys.argv[2:4])
    else:
        main(*sys.argv[1:2], maps=sys.argv[2:])
