"""Compute the claims of README and guides, with 95 % intervals, from measured rows.

Run: python examples/evidence.py [FOLDER]

Reads the rows in examples/evidence/, one CSV file for each kind of measurement. Writes claims.csv,
one row for each claim, and the tables of examples/guides/evidence.md. With FOLDER, both files are
written there instead. Takes seconds.

These programs measure the rows again: lasers.py, routes.py, levels.py, ground_truth.py and
places.py. Rows of other files come from the command in the claim. Each row names the version that
it was measured with.
"""

from __future__ import annotations

import csv
import functools
import itertools
import math
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import fisher_exact

import locplan
from locplan._support.intervals import Interval, compute_wilson_interval, format_metres

ROWS = Path(__file__).resolve().with_name("evidence")
"""Folder of the measured rows, and of the claims."""
PAGE = ROWS.parent / "guides" / "evidence.md"
DIGITS = 4
"""Significant digits of numbers in the files."""
TABLE = re.compile(r"(<!-- table: (.+?) -->\n).*?(<!-- end -->)", re.DOTALL)
Rows = Sequence[Mapping[str, Any]]
"""Rows of a file: texts by the names of the columns."""


def main(folder: str | None = None) -> None:
    """Compute the claims, and write them and the page's tables."""
    claims = [claim for section in SECTIONS for claim in section()]
    page = TABLE.sub(lambda found: fill_table(found, claims), PAGE.read_text(encoding="utf-8"))
    target, page_target = ROWS, PAGE
    if folder is not None:
        target = Path(folder)
        page_target = target / PAGE.name
    write_rows(target / "claims.csv", [asdict(claim) for claim in claims])
    page_target.write_text(page, encoding="utf-8")
    print(f"wrote {len(claims)} claims to {target / 'claims.csv'}, and {page_target}")


# Rows, and statistics of them.


def read_rows(name: str, folder: Path = ROWS, **conditions: object) -> list[dict[str, Any]]:
    """Read the rows of a file that have some values; numbers are numbers."""
    file = folder / f"{name}.csv"
    if not file.exists():
        return []
    with file.open(encoding="utf-8", newline="") as opened:
        rows = [
            {key: read_number(text) for key, text in row.items()} for row in csv.DictReader(opened)
        ]
    return select(rows, **conditions)


def read_number(text: str) -> float | str:
    """Return the number that a text is, or the text."""
    try:
        return float(text)
    except ValueError:
        return text


def select(rows: Iterable[dict[str, Any]], **conditions: object) -> list[dict[str, Any]]:
    """Return the rows that have some values."""
    return [row for row in rows if all(row[key] == value for key, value in conditions.items())]


def write_rows(file: Path, rows: Rows) -> Path:
    """Write rows with the columns of the first one, numbers with `DIGITS` digits."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", encoding="utf-8", newline="") as opened:
        writer = csv.DictWriter(opened, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: format_number(value) for key, value in row.items()} for row in rows)
    return file


def format_number(value: object) -> object:
    """Return a value as a file has it: NaN is an empty text."""
    if isinstance(value, bool | np.bool_):
        return int(value)
    if not isinstance(value, float):
        return value
    if math.isnan(value):
        return ""
    rounded = float(f"{value:.{DIGITS}g}") + 0.0  # no -0
    return int(rounded) if rounded == int(rounded) else rounded


@functools.cache
def find_version() -> str:
    """Return the version of locplan with the commit of this folder, if there is one."""
    command = ["git", "rev-parse", "--short=8", "HEAD"]
    done = subprocess.run(command, cwd=ROWS.parent, capture_output=True, text=True, check=False)
    return f"{locplan.__version__} {done.stdout.strip()}".strip()


def interval_of(row: Mapping[str, Any], value: str, low: str = "", high: str = "") -> Interval:
    """Return the interval in three columns of a row, by default NAME, NAME_low and NAME_high."""
    columns = value, low or f"{value}_low", high or f"{value}_high"
    return Interval(*(row[key] if row[key] != "" else math.nan for key in columns))


def estimate_over_groups(
    groups: Sequence[np.ndarray | Sequence[float]], resamples: int = 1000
) -> Interval:
    """Return the mean of all values with its 95 % interval: groups, then their values, redrawn."""
    random = np.random.default_rng(0)
    values = [np.asarray(group, float) for group in groups]
    means = []
    for _ in range(resamples):
        drawn = [values[n] for n in random.integers(0, len(values), len(values))]
        means.append(np.concatenate([random.choice(each, len(each)) for each in drawn]).mean())
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return Interval(float(np.concatenate(values).mean()), low, high)


def estimate_over_maps(rows: Rows, column: str | Callable[[Mapping[str, Any]], float]) -> Interval:
    """Return the mean of a column over queries, with its interval over maps and queries."""
    read = column if callable(column) else lambda row: row[column]
    maps = dict.fromkeys(row["map"] for row in rows)
    return estimate_over_groups([[read(r) for r in rows if r["map"] == name] for name in maps])


def estimate_middle(values: Sequence[float]) -> Interval:
    """Return the median with its 95 % bootstrap interval."""
    random = np.random.default_rng(0)
    drawn = np.median(random.choice(np.array(values), (4000, len(values))), axis=1)
    return Interval(float(np.median(values)), *np.quantile(drawn, (0.025, 0.975)).tolist())


def estimate_geometric(values: Sequence[float]) -> Interval:
    """Return the geometric mean with its 95 % bootstrap interval."""
    random, logs = np.random.default_rng(0), np.log(values)
    drawn = random.choice(logs, (4000, len(logs))).mean(axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975)).tolist()
    return exp(Interval(float(logs.mean()), low, high))


def exp(interval: Interval) -> Interval:
    """Return the ratio of which this is the logarithm."""
    return Interval(*np.exp(interval).tolist())


# Claims.


@dataclass(frozen=True)
class Claim:
    """A number that README or a guide may quote."""

    key: str
    claim: str
    value: float
    low: float
    high: float
    unit: str
    """Nothing, "%", "m", "s", or "of N" for a count."""
    n: int
    """Number of the cases in `data`."""
    data: str
    command: str
    version: str

    @property
    def figure(self) -> str:
        """The number with its unit and its interval, as in `0.80 [0.71, 0.89]`."""
        bounds = [] if math.isnan(self.low) else [self.low, self.high]
        if self.unit.startswith("of "):
            bounds = [100 * bound / float(self.unit[3:]) for bound in bounds]
            text = f"{self.value:g} {self.unit}"
            return text + (f" [{bounds[0]:.0f}, {bounds[1]:.0f} %]" if bounds else "")
        digits = choose_digits(self.value, self.unit)
        number = f"{self.value:.{digits}f}"
        text = f"{number} {self.unit}".strip()
        if not bounds:
            return text
        return f"{text} [{bounds[0]:.{digits}f}, {bounds[1]:.{digits}f}]"


def choose_digits(value: float, unit: str) -> int:
    """Return the number of decimals of a figure."""
    if unit == "%":
        return 1 if 0 < abs(value) < 2 else 0
    if value == int(value) and not unit:
        return 0
    if unit == "s":
        return 0 if value >= 10 else 1
    return 3 if unit == "m" and abs(value) < 0.1 else 2


@dataclass(frozen=True)
class Source:
    """Data, command and version that some claims share."""

    data: str
    command: str
    version: str

    def claim(self, key: str, text: str, interval: Interval, unit: str = "", n: float = 1) -> Claim:
        """Return a claim; shares are given in per cent."""
        value, low, high = (100 * each if unit == "%" else each for each in interval)
        return Claim(
            key, text, value, low, high, unit, int(n), self.data, self.command, self.version
        )

    def count(self, key: str, text: str, number: float, total: float) -> Claim:
        """Return a claim of a count, with Wilson's interval."""
        interval = compute_wilson_interval(number / total, int(total))
        scaled = Interval(number, interval.low * total, interval.high * total)
        return self.claim(key, text, scaled, f"of {total:.0f}", total)


def join_versions(rows: Rows) -> str:
    """Return the version of the rows, or all of their versions."""
    versions = sorted({row["version"] for row in rows}, reverse=True)
    return versions[0] if len(versions) == 1 else f"partly {'; partly '.join(versions)}"


def fixed(value: float) -> Interval:
    """Return a value without an interval."""
    return Interval(value, math.nan, math.nan)


# Real lasers.

LASERS = {
    "fused": "`fused`",
    "scan": "`scan`",
    "fisher": "`fisher`",
    "sad": "`sad` (the paper's e)",
    "perturbation loss": "perturbation loss, after LF-3PM",
    "degeneracy factor": "degeneracy factor",
    "X-ICP": "contributions, after X-ICP",
    "GFM": "geometric feature metric (GFM)",
    "clearance": "distance to the nearest wall",
}
"""Texts of the estimators and of the published measures."""
NEAR = "within a factor of 1.5 above 0.2 m"
CHOSEN = "six logs of lasers, on which constants were chosen"


def read_lasers() -> list[dict[str, Any]]:
    """Read all rows of lasers; those of lasers.py get the same columns as the others."""
    common = {"data": CHOSEN, "command": "python examples/lasers.py DATA examples/evidence"}
    return [{**common, **row} for row in read_rows("lasers")] + read_rows("lasers_other")


def claim_lasers() -> Iterator[Claim]:
    """Claims on ranks, directions and metres of real lasers."""
    quantities = {
        "rank": "Rank correlation of {} with the deviation measured by real lasers",
        "rank of heading": "Rank correlation of {} with the measured deviation of the heading",
        "ratio": "Predicted over measured deviation of {}",
        "direction": "Ellipses of {} whose direction is within 15 degrees",
        NEAR: "Deviations of {} that are right within a factor of 1.5, above 0.2 m",
    }
    names = {"rank of heading": "heading", NEAR: "metres"}
    for row in read_lasers():
        if row["quantity"] not in quantities or row["log"] not in ("pooled", "within"):
            continue
        group = row["estimator"].lower().replace(" ", "_").replace("-", "_")
        if "apart" in row["data"]:
            group = f"apart.{group}"
        quantity = names.get(row["quantity"], row["quantity"])
        parts = {"rank": [row["log"]], "heading": ["heading", row["log"]]}
        key = ".".join(["lasers", group, *parts.get(quantity, [quantity])])
        text = quantities[row["quantity"]].format(LASERS[row["estimator"]])
        if quantity in parts:
            text += ", mean within a log" if row["log"] == "within" else ", all logs together"
        source = Source(row["data"], row["command"], row["version"])
        unit = "%" if quantity in ("direction", "metres") else ""
        interval = interval_of(row, "value", "low", "high")
        yield source.claim(key, text, interval, unit, row["n"] or 0)


def tabulate_lasers() -> str:
    """Tabulate the ranks of all estimators and measures."""
    rows = read_lasers()
    lines = []
    for name, text in LASERS.items():
        cells = [text]
        for data, log in itertools.product(("six", "seven"), ("pooled", "within")):
            ranks = select(rows, estimator=name, quantity="rank", log=log)
            ranks = [row for row in ranks if row["data"].startswith(data)]
            rank = interval_of(ranks[0], "value", "low", "high") if ranks else None
            cells.append(format_interval(rank) if rank else "")
        lines.append(cells)
    heads = ("", "six logs, pooled", "within a log", "seven kept apart, pooled", "within a log")
    return markdown(heads, lines)


def tabulate_metres() -> str:
    """Tabulate the predicted over the measured deviation by the measured one."""
    rows = read_rows("lasers")
    quantities = [q for q in dict.fromkeys(r["quantity"] for r in rows) if q.startswith("ratio,")]
    lines = []
    for name in ("sad", "fisher", "scan", "fused"):
        own = {row["quantity"]: row for row in select(rows, estimator=name, log="pooled")}
        cells = [LASERS[name].split(" (")[0]]
        cells += [f"{own[quantity]['value']:.2f}" for quantity in quantities]
        for quantity in (NEAR, "direction"):
            share = interval_of(own[quantity], "value", "low", "high")
            cells.append(format_share(share))
        lines.append(cells)
    heads = [f"{q.removeprefix('ratio, ').replace(' to ', '-')}" for q in quantities]
    return markdown(["measured", *heads, "right above 0.2 m", "direction right"], lines)


# Paths.

FILTERS = {
    "defaults": "Nav2's defaults",
    "alphas 0.05": "alphas 0.05",
    "precise": "precise settings",
}
"""Names of the filters in routes.csv, and their texts."""
FILTER_KEYS = {"defaults": "default", "alphas 0.05": "calm", "precise": "precise"}
SIMULATED = "simulated drives on {} real maps"
PATHS = "shortest", "inflated", "recommended"
ROUTES_COMMAND = "python examples/routes.py examples/evidence MAP.yaml ..."


@dataclass(frozen=True)
class Query:
    """The rows of one query in routes.csv."""

    shortest: dict[str, Any]
    inflated: dict[str, Any]
    leader: dict[str, Any]
    recommended: dict[str, Any]

    @property
    def is_moved(self) -> bool:
        """True if another path than the shortest is recommended."""
        return self.recommended is not self.shortest

    @property
    def has_leader(self) -> bool:
        """True if another path than the shortest led the race."""
        return self.leader is not self.shortest

    def agreements(self) -> Iterator[bool]:
        """True for each figure that `plan` shows and fresh drives confirm, within intervals."""
        for row in [self.shortest, self.leader] if self.has_leader else [self.shortest]:
            yield agree(log(interval_of(row, "shown_error")), log(interval_of(row, "error")))
            lost = compute_wilson_interval(row["lost"] / row["drives"], int(row["drives"]))
            yield agree(interval_of(row, "shown_lost"), lost)
        if self.has_leader:
            shown = interval_of(self.leader, "shown_ratio")
            yield agree(log(shown), log(interval_of(self.leader, "ratio")))


def agree(one: Interval, other: Interval) -> bool:
    """True if two independent values differ by no more than the interval of their difference."""
    first, second = (one, other) if one.value < other.value else (other, one)
    half = np.hypot(first.high - first.value, second.value - second.low)
    return bool(second.value - first.value <= half + 1e-3)


def log(interval: Interval) -> Interval:
    """Return the logarithm of a ratio."""
    return Interval(*np.log(interval).tolist())


def group_queries(name: str) -> list[Query]:
    """Return the queries that were driven with a filter."""
    groups: dict[object, list[dict[str, Any]]] = {}
    for row in read_rows("routes", filter=name):
        groups.setdefault((row["map"], row["query"]), []).append(row)
    queries = []
    for rows in groups.values():
        flags = ("is_inflated", "is_leader", "is_recommended")
        inflated, leader, recommended = (next(r for r in rows if r[flag]) for flag in flags)
        shortest = next(r for r in rows if r["path"] == "shortest")
        queries.append(Query(shortest, inflated, leader, recommended))
    return queries


def estimate_over_queries(queries: Sequence[Query], read: Callable[[Query], float]) -> Interval:
    """Return the mean over queries with its interval over maps and queries."""
    maps = dict.fromkeys(query.shortest["map"] for query in queries)
    return estimate_over_groups(
        [[read(q) for q in queries if q.shortest["map"] == name] for name in maps]
    )


def estimate_ratio(queries: Sequence[Query], column: str) -> Interval:
    """Return the geometric mean of a ratio of the recommended paths."""
    return exp(estimate_over_queries(queries, lambda q: math.log(q.recommended[column])))


def estimate_rate(queries: Sequence[Query], path: str, count: str, drives: str) -> Interval:
    """Return the mean of a rate of the shortest, inflated or recommended paths."""
    return estimate_over_queries(
        queries, lambda q: getattr(q, path)[count] / getattr(q, path)[drives]
    )


def count_changes(queries: Sequence[Query]) -> tuple[int, int]:
    """Count queries whose recommended path is significantly better, and worse."""
    ratios = [interval_of(query.recommended, "ratio") for query in queries]
    return sum(ratio.high < 1 for ratio in ratios), sum(ratio.low > 1 for ratio in ratios)


def claim_routes() -> Iterator[Claim]:
    """Claims on recommended paths."""
    for name, text in FILTERS.items():
        queries, key = group_queries(name), f"routes.{FILTER_KEYS[name]}"
        n, maps = len(queries), len({query.shortest["map"] for query in queries})
        source = Source(
            f"{n} queries, {SIMULATED.format(maps)}", ROUTES_COMMAND, queries[0].shortest["version"]
        )
        error = estimate_ratio(queries, "ratio")
        yield source.claim(
            f"{key}.error", f"Error of the recommended over the shortest path, {text}", error, n=n
        )
        yield source.claim(
            f"{key}.inflated",
            f"Error of the recommended over the inflated path, {text}",
            estimate_ratio(queries, "inflated_ratio"),
            n=n,
        )
        moved = [query for query in queries if query.is_moved]
        better, worse = count_changes(moved)
        counts = {
            "moved": ("another path than the shortest is recommended", len(moved)),
            "better": ("the recommended path is significantly better", better),
            "worse": ("the recommended path is significantly worse", worse),
            "undecided": (
                "the recommendation is undecided",
                sum(query.leader["verdict"] == "undecided" for query in queries),
            ),
        }
        for what, (sentence, count) in counts.items():
            yield source.count(f"{key}.{what}", f"Queries on which {sentence}, {text}", count, n)
        for path in ("shortest", "recommended"):
            yield source.claim(
                f"{key}.lost.{path}",
                f"Drives lost on {path} paths, {text}",
                estimate_rate(queries, path, "lost", "drives"),
                "%",
                n,
            )
        longer = estimate_over_queries(
            queries, lambda q: q.recommended["length"] / q.shortest["length"] - 1
        )
        yield source.claim(
            f"{key}.longer", f"Additional length of recommended paths, {text}", longer, "%", n
        )
        figures = [agrees for query in queries for agrees in query.agreements()]
        yield source.count(
            f"{key}.agree",
            f"Figures of `plan` that `simulate` confirms within both intervals, {text}",
            sum(figures),
            len(figures),
        )


def claim_choices() -> Iterator[Claim]:
    """Claims on how often a recommendation is wrong, from drawn errors."""
    rows = {row["true_ratio"]: row for row in read_rows("choices")}
    for key, name, text in (
        ("false", "1, like all others", "all ten paths have the same error"),
        ("found", 0.8, "one of ten paths has 0.8 of the error, and the rest is worse"),
    ):
        row = rows[name]
        source = Source(
            "drawn errors", "python tests/benchmarks/power_of_choices.py 4000", row["version"]
        )
        share = compute_wilson_interval(row["recommended"], int(row["choices"]))
        yield source.claim(
            f"choices.{key}", f"Recommendations if {text}", share, "%", row["choices"]
        )


def tabulate_routes() -> str:
    """Tabulate the changes by recommended paths, for each filter."""
    columns = []
    for name, text in FILTERS.items():
        queries = group_queries(name)
        moved = [query for query in queries if query.is_moved]
        better, worse = count_changes(moved)
        figures = [agrees for query in queries for agrees in query.agreements()]
        lost = [
            percent(estimate_rate(queries, path, "lost", "drives").value)
            for path in ("shortest", "inflated", "recommended")
        ]
        longer = np.mean([q.recommended["length"] / q.shortest["length"] for q in queries]) - 1
        undecided = sum(query.leader["verdict"] == "undecided" for query in queries)
        columns.append(
            [
                f"{text} ({len(queries)} queries)",
                f"**{format_interval(estimate_ratio(queries, 'ratio'))}**",
                format_interval(estimate_ratio(queries, "inflated_ratio")),
                f"{len(moved)}: {better} / {worse}",
                ", ".join(lost),
                percent(longer),
                f"{undecided}",
                f"{sum(figures)} of {len(figures)}",
            ]
        )
    heads = (
        "",
        "error of the recommended over the shortest path",
        "over the inflated path",
        "another path recommended: better / worse",
        "lost: shortest, inflated, recommended",
        "longer",
        "undecided",
        "figures of `plan` confirmed",
    )
    return markdown(*transpose(heads, columns))


def tabulate_choices() -> str:
    """Tabulate the recommendations for drawn errors."""
    rows = [
        [
            f"{row['true_ratio']:g}" if isinstance(row["true_ratio"], float) else row["true_ratio"],
            f"{100 * row['recommended']:g} %",
            f"{100 * row['undecided']:g} %",
            f"{100 * row['within_interval']:g} %",
        ]
        for row in read_rows("choices")
    ]
    heads = (
        "error of the best path over the shortest path's",
        "recommended",
        "undecided",
        "interval holds the truth",
    )
    return markdown(heads, rows)


# Closed loop.


def claim_closed_loop() -> Iterator[Claim]:
    """Claims on robots that reach the goal in simulation."""
    rows = read_rows("closed_loop")
    keys = zip(
        dict.fromkeys(row["query"] for row in rows), ("hall", "hall2", "two_corridors"), strict=True
    )
    for query, key in keys:
        shortest, recommended = select(rows, query=query)
        command = f"{shortest['command']}; locplan simulate ... --closed-loop 200 --seed 1001"
        source = Source("simulated drives", command, shortest["version"])
        for row in (shortest, recommended):
            name, text = f"closed_loop.{key}.{row['path']}", f"the {row['path']} path, {query}"
            yield source.count(
                f"{name}.arrived",
                f"Robots that reach the goal on {text}",
                row["arrived"],
                row["closed_loop_drives"],
            )
            lost = compute_wilson_interval(row["lost"] / row["drives"], int(row["drives"]))
            yield source.claim(f"{name}.lost", f"Drives lost on {text}", lost, "%", row["drives"])
        yield source.claim(
            f"closed_loop.{key}.longer",
            f"Additional length of the recommended path, {query}",
            fixed(recommended["length"] - shortest["length"]),
            "m",
        )
    for name, text in FILTERS.items():
        queries, key = group_queries(name), f"routes.{FILTER_KEYS[name]}.arrived"
        source = Source(
            f"closed-loop drives of {len(queries)} queries",
            ROUTES_COMMAND,
            queries[0].shortest["version"],
        )
        for path in PATHS:
            yield source.claim(
                f"{key}.{path}",
                f"Robots that reach the goal on {path} paths, {text}",
                estimate_rate(queries, path, "arrived", "closed_loop_drives"),
                "%",
                len(queries),
            )
        yield source.claim(
            f"{key}.gain",
            f"Points by which more robots reach the goal on recommended paths, {text}",
            estimate_gain(queries),
            "%",
            len(queries),
        )


def estimate_gain(queries: Sequence[Query]) -> Interval:
    """Return how many more robots reach the goal on recommended paths, as a share."""
    return estimate_over_queries(
        queries,
        lambda q: (
            (q.recommended["arrived"] - q.shortest["arrived"]) / q.shortest["closed_loop_drives"]
        ),
    )


def tabulate_closed_loop() -> str:
    """Tabulate robots that reach the goal on single queries."""
    lines = []
    for row in read_rows("closed_loop"):
        drives = row["closed_loop_drives"]
        share = compute_wilson_interval(row["arrived"] / drives, int(drives))
        lines.append(
            [
                row["query"],
                row["path"],
                f"{row['length']:.1f} m",
                f"{row['error']:.2f} m",
                percent(row["lost"] / row["drives"]),
                f"{row['arrived']:.0f} of {drives:.0f} "
                f"[{100 * share.low:.0f}, {100 * share.high:.0f} %]",
            ]
        )
    return markdown(("query", "path", "length", "error", "lost", "reach the goal"), lines)


def tabulate_arrivals() -> str:
    """Tabulate robots that reach the goal on the queries of the paths."""
    columns = []
    for name, text in FILTERS.items():
        queries = group_queries(name)
        rates = [estimate_rate(queries, path, "arrived", "closed_loop_drives") for path in PATHS]
        gain = estimate_gain(queries)
        gains = [q.recommended["arrived"] - q.shortest["arrived"] for q in queries]
        tenth = 0.1 * queries[0].shortest["closed_loop_drives"]
        rows = {id(row): row for q in queries for row in (q.shortest, q.inflated, q.leader)}
        drives, faults = (
            sum(row[column] for row in rows.values())
            for column in ("closed_loop_drives", "follower_faults")
        )
        columns.append(
            [
                f"{text} ({len(queries)} queries)",
                *map(format_share, rates),
                f"{100 * gain.value:.1f} [{100 * gain.low:.1f}, {100 * gain.high:.1f}]",
                f"{sum(each > tenth for each in gains)}, {sum(each < -tenth for each in gains)}",
                f"{faults:.0f} of {drives:.0f}",
            ]
        )
    heads = (
        "",
        "reach the goal: shortest paths",
        "inflated paths",
        "recommended paths",
        "recommended minus shortest, points",
        "queries with over 10 points more, fewer",
        "fail with perfect localization",
    )
    return markdown(*transpose(heads, columns))


def transpose(
    heads: Sequence[str], columns: Sequence[Sequence[str]]
) -> tuple[list[str], list[list[str]]]:
    """Return head and rows of a table whose columns are given."""
    head, *rows = map(list, zip(heads, *columns, strict=True))
    return head, rows


# Nav2.


def claim_nav2() -> Iterator[Claim]:
    """Claims on a real Nav2."""
    rows = read_rows("nav2")
    version = rows[0]["version"]
    source = Source("simulated robot, whole Nav2 stack", "a real Nav2, by hand", version)
    hall = [row for row in rows if row["query"].startswith("hall")]
    masked = [row for row in hall if row["arm"].startswith("mask")]
    arms = {
        "nav2.hall.plain.arrived": ("in the hall as it is", select(hall, arm="as it is")),
        "nav2.hall.mask.arrived": ("in the hall with the exported mask", masked),
        "nav2.hall.precise.arrived": (
            "in the hall with precise settings",
            select(hall, arm="precise settings"),
        ),
        "nav2.skirk.plain.arrived": (
            "on a solid map as it is",
            [r for r in rows if "skirk" in r["query"] and r["arm"] == "as it is"],
        ),
        "nav2.skirk.repaired.arrived": (
            "on a solid map with the repaired map for AMCL",
            [r for r in rows if "skirk" in r["query"] and r["arm"] != "as it is"],
        ),
        "nav2.corridors.mask.arrived": (
            "in two_corridors with a mask",
            select(rows, query="two_corridors 2,3 to 38,3", arm="mask"),
        ),
    }
    for key, (text, arm) in arms.items():
        arrived, drives = (sum(row[column] for row in arm) for column in ("arrived", "drives"))
        yield source.count(key, f"Robots that reach the goal {text}", arrived, drives)
    total = sum(row["drives"] for row in rows)
    yield source.claim("nav2.drives", "Drives of the whole stack", fixed(total), n=total)
    chances = [compare_simulation(row) for row in rows if row["simulated"] != ""]
    yield source.count(
        "nav2.agree",
        "Pairs of query and settings on which simulation and Nav2 agree (Fisher, p > 0.05)",
        sum(chance > 0.05 for chance in chances),
        len(chances),
    )
    for planner in ("Smac 2D", "Theta*", "NavFn"):
        for has_mask in (0, 1):
            masks = read_rows("masks", planner=planner, has_mask=has_mask)
            if not masks:
                continue
            word = "with" if has_mask else "without"
            plans = Source("six maps, six pairs each", "a real Nav2, by hand", masks[0]["version"])
            key = f"nav2.cost.{planner.lower().replace(' ', '').rstrip('*')}.{word}"
            yield plans.claim(
                key,
                f"Cost J of {planner}'s paths {word} a mask, over the least",
                estimate_geometric([row["cost_ratio"] for row in masks]),
                n=sum(row["pairs"] for row in masks),
            )


def compare_simulation(row: Mapping[str, Any]) -> float:
    """Return the probability of arrivals in Nav2 and in simulation by chance (Fisher)."""
    table = [
        [int(row["arrived"]), int(row["drives"] - row["arrived"])],
        [int(row["simulated_arrived"]), int(row["simulated"] - row["simulated_arrived"])],
    ]
    return float(fisher_exact(table).pvalue)


def tabulate_nav2() -> str:
    """Tabulate the drives of a real Nav2, with those in simulation."""
    rows = []
    for row in read_rows("nav2"):
        error, simulated = row["greatest_error"], row["simulated"]
        rows.append(
            [
                row["query"],
                row["arm"],
                f"{row['arrived']:.0f} of {row['drives']:.0f}",
                "" if error == "" else f"{error:g} m",
                "" if simulated == "" else f"{row['simulated_arrived']:.0f} of {simulated:.0f}",
            ]
        )
    heads = ("query", "", "reach the goal", "greatest error of AMCL, median", "in simulation")
    return markdown(heads, rows)


# Recordings.


SETTINGS = {
    "defaults": "Nav2's defaults",
    "safe": "safe settings",
    "precise": "precise settings",
}


TRUTH_COMMAND = "python examples/ground_truth.py DATA examples/evidence"
LOCATED = ("count", "right", "certain", "certain_right")
"""Columns of located scans."""


def claim_recordings() -> Iterator[Claim]:
    """Claims on replays, ground truth and single scans of recordings."""
    sound = read_rows("recordings", is_sound=1.0)
    drives = {row["drive"]: row for row in sound}
    source = Source(
        f"{len(drives)} sound recordings",
        "locplan simulate MAP --recording FILE --robot SETTINGS",
        join_versions(sound),
    )
    n = len(drives)
    robots = len({row["robot"] for row in drives.values()})
    length = sum(row["length"] for row in drives.values()) / 1000
    yield source.claim("recordings.drives", "Sound recordings", fixed(n), n=n)
    yield source.claim("recordings.robots", "Robots of the sound recordings", fixed(robots), n=n)
    yield source.claim("recordings.length", "Length of sound recordings", fixed(length), "km", n)
    for settings in SETTINGS:
        rows = select(sound, settings=settings)
        errors = [row["error"] for row in rows]
        key, text = f"recordings.{settings}", f"error of AMCL in replays, {SETTINGS[settings]}"
        yield source.claim(f"{key}.median", f"Median {text}", estimate_middle(errors), "m", n)
        yield source.claim(f"{key}.least", f"Least {text}", fixed(min(errors)), "m", n)
        yield source.claim(f"{key}.most", f"Greatest {text}", fixed(max(errors)), "m", n)
        runs = sum(row["runs"] for row in rows)
        for column, sentence in (("lost", "lost at some time"), ("off_at_end", "off at the end")):
            share = compute_wilson_interval(sum(row[column] for row in rows) / runs, int(runs))
            yield source.claim(
                f"{key}.{column.split('_')[0]}",
                f"Replays {sentence}, {SETTINGS[settings]}",
                share,
                "%",
                runs,
            )
    truth = read_rows("ground_truth")
    source = Source(f"both halves of {len(truth) // 2} logs", TRUTH_COMMAND, truth[0]["version"])
    for column, text, unit in (
        ("median", "Median error of the ground truth of `recording`", "m"),
        ("most", "Greatest error of a trusted pose of `recording`", "m"),
    ):
        values = [row[column] for row in truth]
        interval = estimate_middle(values) if column == "median" else fixed(max(values))
        yield source.claim(f"recordings.truth.{column}", text, interval, unit, len(values))
    located = read_rows("locate")
    logs = Source(f"both halves of {len(located) // 2} logs", TRUTH_COMMAND, located[0]["version"])
    apart = read_rows("locate_apart")
    kept_apart = Source("seven logs kept apart", "locplan locate MAP", apart[0]["version"])
    for key, where, rows in (
        ("recordings.locate", kept_apart, apart),
        ("recordings.locate.logs", logs, located),
    ):
        total = {name: sum(row[name] for row in rows) for name in LOCATED}
        yield where.count(
            f"{key}.right",
            "Single scans that `locate` places within 0.3 m and 3 degrees",
            total["right"],
            total["count"],
        )
        yield where.count(
            f"{key}.certain",
            "Certain answers of `locate` that are right",
            total["certain_right"],
            total["certain"],
        )


def tabulate_recordings() -> str:
    """Tabulate the errors of AMCL in replays of each recording."""
    rows = read_rows("recordings")
    lines = []
    for drive in dict.fromkeys(row["drive"] for row in sorted(rows, key=lambda r: -r["is_sound"])):
        own = select(rows, drive=drive)
        cells = [drive, "yes" if own[0]["is_sound"] else "no", f"{own[0]['length']:.0f} m"]
        for row in own:
            lost = f" ({row['lost']:.0f}, {row['off_at_end']:.0f})" if row["lost"] else ""
            cells.append(f"{format_metres(row['error'])}{lost}")
        lines.append(cells)
    return markdown(("recording", "sound", "length", "defaults", "safe", "precise"), lines)


def tabulate_truth() -> str:
    """Tabulate the errors of the ground truth of recordings."""
    rows = [
        [
            f"{row['log']}, {row['scans']} scans",
            *(f"{100 * row[column]:.1f} cm" for column in ("median", "p95", "most")),
            percent(row["inside_95"]),
            percent(row["doubtful"]),
        ]
        for row in read_rows("ground_truth")
    ]
    heads = ("log", "median error", "95 %", "most", "inside the 95 % ellipse", "doubtful")
    return markdown(heads, rows)


# Settings.

BASELINE = "baseline"
LEVELS = ("usual", "turns", "slip", "kinked map", "standstill", "reversal")
"""The levels of disturbance; those that lose few robots come first."""


@dataclass(frozen=True)
class LevelResult:
    """Means over the maps or recordings of settings at one level, with the value of each."""

    error: Interval
    errors: Sequence[float]
    lost: Interval
    off_at_end: Interval
    drives: int


def summarize(rows: Rows) -> LevelResult:
    """Return the means over places, with 95 % intervals over the drives of all places."""
    errors = [log(interval_of(row, "error")) for row in rows]
    middle = float(np.mean([each.value for each in errors]))
    half = float(np.sqrt(sum((each.high - each.value) ** 2 for each in errors))) / len(rows)
    count = int(sum(row["drives"] for row in rows))
    rates = {
        column: float(np.mean([row[column] / row["drives"] for row in rows]))
        for column in ("lost", "off_at_end")
    }
    return LevelResult(
        exp(Interval(middle, middle - half, middle + half)),
        [row["error"] for row in rows],
        compute_wilson_interval(rates["lost"], count),
        compute_wilson_interval(rates["off_at_end"], count),
        count,
    )


def summarize_levels(rows: Rows, source: str) -> dict[str, tuple[int, dict[str, LevelResult]]]:
    """Return the number of places of each level, and the results of the settings there."""
    results = {}
    names = list(dict.fromkeys(row["settings"] for row in rows))
    for level in LEVELS:
        cases = [row for row in rows if (row["source"], row["level"]) == (source, level)]
        if cases:
            by_settings = {
                name: summarize([row for row in cases if row["settings"] == name]) for name in names
            }
            results[level] = len({row["place"] for row in cases}), by_settings
    return results


def claim_settings() -> Iterator[Claim]:
    """Claims on settings at each level of disturbance."""
    rows = read_rows("levels")
    for place in ("simulation", "recordings"):
        for level, (count, results) in summarize_levels(rows, place).items():
            where = "maps" if place == "simulation" else "recordings"
            source = Source(
                f"{count} {where}, {level} level",
                "python examples/levels.py examples/evidence RECORDINGS",
                rows[0]["version"],
            )
            for name, result in results.items():
                key = f"settings.{place}.{level.replace(' ', '_')}.{name}"
                text, n = f"{place}, {level}, {name} settings", result.drives
                yield source.claim(f"{key}.error", f"Error: {text}", result.error, "m", n)
                yield source.claim(f"{key}.lost", f"Lost: {text}", result.lost, "%", n)
                off = result.off_at_end
                yield source.claim(f"{key}.off", f"Off at the end: {text}", off, "%", n)


def tabulate_settings() -> str:
    """Tabulate error, and drives off at the end, of each setting at each level."""
    rows = read_rows("levels")
    lines = []
    for place in ("simulation", "recordings"):
        for level, (count, results) in summarize_levels(rows, place).items():
            cells = [f"{place} ({count})", level]
            cells += [
                f"{format_metres(r.error.value)}, {percent(r.off_at_end.value)}"
                for r in results.values()
            ]
            lines.append(cells)
    return markdown(("drives", "level", "baseline", "safe", "precise"), lines)


# Repairs.


def claim_repairs() -> Iterator[Claim]:
    """Claims on repaired maps for AMCL."""
    rows = read_rows("repairs")
    source = Source(
        "7 real maps with solid walls, 128 simulated drives each",
        "locplan repair MAP --paths 8 --drives 16",
        rows[0]["version"],
    )
    for settings, text in (("defaults", "Nav2's defaults"), ("precise", "precise settings")):
        own = select(rows, settings=settings)
        for column, what in (("lost", "on the map as it is"), ("lost_repaired", "repaired")):
            share = estimate_over_groups([[row[column]] for row in own])
            key = f"repairs.{settings}.{column}"
            yield source.claim(key, f"Drives lost, {what}, {text}", share, "%", len(own))
        ratios = [row["ratio"] for row in own]
        yield source.claim(
            f"repairs.{settings}.ratio",
            f"Error, repaired over as is, {text}",
            estimate_geometric(ratios),
            n=len(own),
        )
        worse = sum(row["ratio_low"] > 1 for row in own)
        yield source.count(
            f"repairs.{settings}.worse", f"Maps that a repair makes worse, {text}", worse, len(own)
        )


def tabulate_repairs() -> str:
    """Tabulate what repairs change on each solid map."""
    rows = read_rows("repairs")
    lines = []
    for name in dict.fromkeys(row["map"] for row in rows):
        cells = [name]
        for row in select(rows, map=name):
            cells.append(f"{percent(row['lost'])} → {percent(row['lost_repaired'])}")
            cells.append(format_interval(interval_of(row, "ratio")))
        lines.append(cells)
    heads = ("map", "lost, defaults", "error ratio", "lost, precise", "error ratio")
    return markdown(heads, lines)


def tabulate_walls() -> str:
    """Tabulate the error on maps with wrong walls, over that on the true map."""
    rows = read_rows("walls")
    lines = []
    for name, fault in dict.fromkeys((row["map"], row["fault"]) for row in rows):
        cells = [name, fault]
        cases = select(rows, map=name, fault=fault)
        cells += [format_interval(interval_of(row, "ratio")) for row in cases]
        lines.append(cells)
    heads = ("map", "fault", "defaults, wrong walls", "corrected", "precise, corrected")
    return markdown(heads, lines)


# Landmarks.


LANDMARKS = {
    "none": "without landmarks",
    "proposed": "with proposed landmarks",
    "random": "with landmarks at random places",
}


def claim_landmarks() -> Iterator[Claim]:
    """Claims on proposed landmarks."""
    keys = ("corridors.boxes", "corridors.poles", "corridors.precise", "hall", "warehouse")
    rows = read_rows("landmarks")
    groups = [rows[n : n + 3] for n in range(0, len(rows), 3)]
    for key, group in zip(keys, groups, strict=True):
        for row in group:
            source = Source(f"{row['query']}, {row['objects']}", row["command"], row["version"])
            n = int(row["drives"])
            name, text = f"landmarks.{key}.{row['places']}", LANDMARKS[row["places"]]
            lost = compute_wilson_interval(row["lost"] / n, n)
            yield source.claim(f"{name}.lost", f"Drives lost, {text}", lost, "%", n)
            yield source.claim(f"{name}.error", f"Error, {text}", interval_of(row, "error"), "m", n)


def tabulate_landmarks() -> str:
    """Tabulate drives without landmarks, with proposed ones, and with random ones."""
    rows = read_rows("landmarks")
    lines = []
    for n in range(0, len(rows), 3):
        group = rows[n : n + 3]
        cells = [group[0]["query"], group[0]["objects"], group[0]["settings"]]
        cells += [
            f"{percent(row['lost'] / row['drives'])}, {format_metres(row['error'])}"
            for row in group
        ]
        lines.append(cells)
    heads = ("route", "objects", "settings", "none", "proposed", "as many at random places")
    return markdown(heads, lines)


# Speed.


def claim_speed() -> Iterator[Claim]:
    """Claims on times."""
    for row in read_rows("speed"):
        source = Source(row["data"], row["command"], row["version"])
        yield source.claim(f"speed.{row['key']}", row["what"], fixed(row["seconds"]), "s")


def tabulate_speed() -> str:
    """Tabulate times."""
    rows = [
        [row["what"], row["data"], f"{row['seconds']:.{choose_digits(row['seconds'], 's')}f} s"]
        for row in read_rows("speed")
    ]
    return markdown(("", "data", "time"), rows)


# Places.

ERROR_KINDS = {
    "single scans": "single scans",
    "beams multiplied": "AMCL that multiplies beams",
    "defaults": "AMCL with Nav2's defaults",
}


def claim_places() -> Iterator[Claim]:
    """Claims on how fields rank simulated errors at places."""
    for row in read_rows("places"):
        source = Source(
            f"{row['places']:.0f} places on {row['maps']:.0f} real maps",
            "python examples/places.py examples/evidence MAP.yaml ...",
            row["version"],
        )
        if row["predictor"] not in ("sad, e", "scan, position", "fused, position"):
            continue
        name = row["predictor"].split(",")[0]
        kind = row["error"].split(" ")[0]
        yield source.claim(
            f"places.{name}.{kind}",
            f"Rank correlation of `{name}` with simulated errors, {ERROR_KINDS[row['error']]}",
            interval_of(row, "rank"),
            n=row["places"],
        )


def tabulate_places() -> str:
    """Tabulate the rank correlation of each predictor with each kind of error."""
    rows = read_rows("places")
    lines = []
    for name in dict.fromkeys(row["predictor"] for row in rows):
        if "heading" in name or "visible" in name:
            continue
        cells = [name]
        for kind in ERROR_KINDS:
            row = select(rows, predictor=name, error=kind)[0]
            cells.append(f"{format_interval(interval_of(row, 'rank'))}; {row['within']:.2f}")
        lines.append(cells)
    heads = ("predictor", *ERROR_KINDS.values())
    return markdown(heads, lines)


# All claims, and the page.

SECTIONS: tuple[Callable[[], Iterator[Claim]], ...] = (
    claim_lasers,
    claim_routes,
    claim_choices,
    claim_closed_loop,
    claim_nav2,
    claim_recordings,
    claim_settings,
    claim_repairs,
    claim_landmarks,
    claim_speed,
    claim_places,
)
TABLES: dict[str, Callable[[], str]] = {
    "lasers": tabulate_lasers,
    "metres": tabulate_metres,
    "routes": tabulate_routes,
    "choices": tabulate_choices,
    "closed loop": tabulate_closed_loop,
    "arrivals": tabulate_arrivals,
    "nav2": tabulate_nav2,
    "recordings": tabulate_recordings,
    "ground truth": tabulate_truth,
    "settings": tabulate_settings,
    "repairs": tabulate_repairs,
    "walls": tabulate_walls,
    "landmarks": tabulate_landmarks,
    "speed": tabulate_speed,
    "places": tabulate_places,
}
HEADLINES = (
    "lasers.fused.pooled",
    "lasers.apart.fused.pooled",
    "lasers.fused.metres",
    "lasers.apart.fused.metres",
    "routes.default.error",
    "routes.default.worse",
    "routes.calm.error",
    "routes.precise.error",
    "choices.false",
    "closed_loop.hall.shortest.arrived",
    "closed_loop.hall.recommended.arrived",
    "closed_loop.two_corridors.recommended.arrived",
    "nav2.hall.plain.arrived",
    "nav2.hall.mask.arrived",
    "nav2.agree",
    "recordings.defaults.median",
    "recordings.safe.median",
    "recordings.precise.median",
    "recordings.truth.median",
    "recordings.locate.right",
    "settings.recordings.standstill.precise.off",
    "repairs.defaults.lost",
    "repairs.defaults.lost_repaired",
    "landmarks.corridors.boxes.none.lost",
    "landmarks.corridors.boxes.proposed.lost",
    "speed.paper",
    "places.fused.single",
)
"""Keys of the claims at the top of the page."""


def fill_table(found: re.Match[str], claims: Sequence[Claim]) -> str:
    """Return a place of a table in the page with the table in it."""
    name = found[2]
    table = tabulate_claims(claims) if name == "claims" else TABLES[name]()
    return f"{found[1]}\n{table}\n\n{found[3]}"


def tabulate_claims(claims: Sequence[Claim]) -> str:
    """Tabulate the claims at the top of the page."""
    by_key = {claim.key: claim for claim in claims}
    rows = []
    for key in HEADLINES:
        claim = by_key[key]
        version = claim.version.split(":")[0]
        is_command = claim.command.startswith(("python", "locplan"))
        command = f"`{claim.command}`" if is_command else claim.command
        rows.append([claim.claim, claim.figure, claim.data, command, version])
    return markdown(("claim", "figure [95 % interval]", "data", "command", "version"), rows)


# Text of the tables.


def format_interval(interval: Interval, digits: int = 2) -> str:
    """Text such as 0.80 [0.71, 0.89]."""
    text = f"{interval.value:.{digits}f}"
    if math.isnan(interval.low):
        return text
    return f"{text} [{interval.low:.{digits}f}, {interval.high:.{digits}f}]"


def percent(share: float) -> str:
    """Text such as 80 %."""
    return f"{100 * share:.0f} %"


def format_share(share: Interval) -> str:
    """Text such as 80 % [71, 89]."""
    text = percent(share.value)
    if math.isnan(share.low):
        return text
    return f"{text} [{100 * share.low:.0f}, {100 * share.high:.0f}]"


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Text of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    main(*sys.argv[1:2])
