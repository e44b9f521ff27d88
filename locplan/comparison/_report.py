"""The report of a comparison: one HTML file that needs nothing else, made of `templates`."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from markupsafe import Markup, escape
from PIL import Image

from locplan._kernels.arrays import Floats, Singles
from locplan._util.files import replacing
from locplan._util.public import templates_of
from locplan.comparison import _figures as figures
from locplan.comparison._figures import attributes
from locplan.comparison._pictures import Pictures
from locplan.comparison._result import Comparison, Standing
from locplan.comparison._statistics import MEASURES, Run, grouped, query_of, setting_of
from locplan.field import CovarianceField
from locplan.planners import Query
from locplan.plotting import Picture, draw_field


@dataclass(frozen=True)
class Scale:
    """A scale that turns a ratio into its place in a drawing of 120 pixels."""

    low: float
    high: float

    @classmethod
    def of(cls, rows: Iterable[Standing]) -> Scale:
        """A scale that shows 1 and the intervals of J's ratios, as far as they are near 1."""
        ends = [end for row in rows for end in row.cost.estimate[1:] if math.isfinite(end)]
        # At most 10 % to either side, so that one bad planner does not hide the others.
        return cls(max(min([*ends, 0.99]), 0.9), min(max([*ends, 1.01]), 1.1))

    def at(self, ratio: float) -> str:
        """The distance of a ratio from the left [pixels], with room for arrows at both ends."""
        share = (ratio - self.low) / (self.high - self.low)
        return f"{8 + 104 * min(max(share, 0.0), 1.0):.1f}"


@dataclass(frozen=True)
class Backdrop:
    """The image of a map with its field, and where it lies in the world."""

    low: Floats
    """x and y of the lower left corner [m]."""
    scale: float
    """Pixels per metre."""
    size: tuple[int, int]
    """Width and height [pixels]."""
    data: str
    """The image as a URL."""

    @classmethod
    def of(cls, drawn: CovarianceField) -> Backdrop:
        """Draw a field without axes."""
        side = 640  # pixels of the longer side, the unit of the lines over it, too
        figure = Picture(figsize=(1, 1), dpi=side)
        axes = figure.add_axes((0, 0, 1, 1))
        draw_field(axes, drawn)
        axes.set_axis_off()
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        spans = np.array([right - left, top - bottom])
        width, height = np.ceil(side * spans / spans.max()).astype(int).tolist()
        figure.set_size_inches(width / side, height / side)
        written, small = io.BytesIO(), io.BytesIO()
        figure.savefig(written, format="png", dpi=side, facecolor="white")
        Image.open(written).convert("RGB").quantize(64).save(small, "png", optimize=True)
        data = f"data:image/png;base64,{base64.b64encode(small.getvalue()).decode()}"
        return cls(np.array([left, bottom]), float(side / spans.max()), (width, height), data)

    def pixels(self, xy: Sequence[Sequence[float]]) -> Singles:
        """Positions in the image, (n, 2); rows go down."""
        points = (np.array(xy, float).reshape(-1, 2) - self.low) * self.scale
        points[:, 1] = self.size[1] - points[:, 1]
        return points.astype(np.float32)

    def line(self, xy: Sequence[Sequence[float]]) -> str:
        """A path as an SVG path, with no more vertices than it takes to show it."""
        short = cv2.approxPolyDP(self.pixels(xy)[:, None], 0.7, False)[:, 0]
        return "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in short.tolist())


class Thumbnail(NamedTuple):
    """The paths of a query at a weight: lines over the image of a map."""

    caption: str
    alt: str
    lines: list[tuple[str, figures.Mark, float, str]]
    """Planner, line, width [pixels of the screen] and SVG path of each line."""
    ends: list[tuple[str, str]]
    """SVG path and place of the marks of start and goal."""
    legend: figures.Legend
    attributes: figures.Attributes


class Report(Pictures):
    """What the templates show of a comparison."""

    @property
    def queries(self) -> int:
        """The number of queries on all maps."""
        return len({(run.task.map, run.task.query) for run in self.runs})

    @property
    def maps(self) -> int:
        """The number of maps."""
        return len({run.task.map for run in self.runs})

    @property
    def e_unit(self) -> str:
        """The unit of e, which has no angle if the field has no rotation."""
        return next((scene.field.e_unit for scene in self.scenes.values()), "m² rad")

    def heads(self, measures: Sequence[str]) -> list[str]:
        """The heads of the columns of measures."""
        units = {name: column.unit for name, column in MEASURES.items()}
        units |= {"integrated_e": f"{self.e_unit} m", "seconds": "ms"}
        titles = {"cost": "J", "seconds": "time"}
        return [f"{titles.get(name, MEASURES[name].title)} [{units[name]}]" for name in measures]

    def filters(self) -> dict[str, list[str]]:
        """The values by which runs can be filtered, of each kind that not all runs share."""
        known = [_task_attributes(run) for run in self.runs]
        values = {name: list(dict.fromkeys(each[name] for each in known)) for name in known[0]}
        return {name[5:]: own for name, own in values.items() if len(own) > 1}  # without "data-"

    def results(
        self,
    ) -> Iterator[tuple[tuple[str | None, str], list[tuple[float, list[Standing], Scale]]]]:
        """The standings of each case, by weight, with the scale of their ratios."""
        for case, group in grouped(self.comparison.standings(), lambda r: r.setting[:2]).items():
            tables = grouped(group, lambda row: row.setting.weight)
            yield case, [(weight, rows, Scale.of(rows)) for weight, rows in tables.items()]

    def galleries(self) -> Iterator[tuple[figures.CaseKey, Backdrop, list[Thumbnail]]]:
        """Every query of every scene at every weight, as far as the limit goes."""
        room = self.limits.thumbnails
        for key, scene in self.scenes.items():
            groups = grouped(self.cases[key], lambda run: (run.task.query, run.task.weight))
            asked = [
                (query, groups[query.name, weight])
                for query in self.comparison.cases[key].queries
                for weight in sorted({weight for name, weight in groups if name == query.name})
            ]
            self.left_out["pictures"] += max(0, len(asked) - room)
            asked, room = asked[:room], max(0, room - len(asked))
            if asked:
                backdrop = Backdrop.of(scene.field)
                yield key, backdrop, [self._thumbnail(backdrop, *each) for each in asked]

    def _thumbnail(self, backdrop: Backdrop, query: Query, runs: Sequence[Run]) -> Thumbnail:
        setting, found = setting_of(runs[0]), self._typical(runs)
        paths = {planner: run for planner, run in found.items() if run is not None}
        # Ever thinner [pixels of the screen], so that none hides another.
        widths = np.linspace(4.5, 1.8, len(paths)) if len(paths) != 1 else [1.8]
        texts = {
            planner: f"{planner} {run.measures['cost']:.1f}" if run else f"{planner} no path"
            for planner, run in found.items()
        }
        caption = f"{query.name}, weight {setting.weight:g}"
        places = backdrop.pixels([query.start[:2], query.goal[:2]]).tolist()
        return Thumbnail(
            caption,
            f"Paths of {caption}, J [m]: {'; '.join(texts.values())}.",
            [
                (planner, self.lines[planner], float(width), backdrop.line(run.xy))
                for (planner, run), width in zip(paths.items(), widths, strict=True)
            ],
            [
                (figures.shape(marker), f"translate({x:.0f} {y:.0f}) scale({size})")
                for marker, size, (x, y) in zip("o*", (2, 3.4), places, strict=True)
            ],
            [(self.lines[name] if found[name] else None, text) for name, text in texts.items()],
            attributes(setting) | {"class": "map"},
        )

    def ratio(self, run: Run) -> float:
        """J of a run as a multiple of the baseline's for the same query; NaN if unknown."""
        reference = self._cost(*query_of(run), self.baseline)
        return run.measure("cost") / (reference or math.nan)

    def failures(self) -> list[list[Run]]:
        """The runs without a path, grouped by kind of failure."""

        def kind(run: Run) -> tuple[str, ...]:
            return run.status, run.task.planner, run.task.map, run.task.config, run.note

        return [*grouped((run for run in self.runs if run.status != "solved"), kind).values()]

    def statuses(self) -> str:
        """The number of runs of each status but solved, in words."""
        counts = Counter(run.status for run in self.runs if run.status != "solved")
        return ", ".join(f"{count:,} {status}" for status, count in counts.most_common())

    def settings(self) -> dict[str, str]:
        """Versions, options, the machine and the time, each by its name in the report."""
        about = self.comparison.about
        shown = (
            *("locplan", "python", "numpy", "numba", "scipy", "ompl", "machine", "workers"),
            *("began", "time_limit", "random_queries"),
        )
        settings = {key: str(about[key]) for key in shown if key in about}
        for case in self.comparison.cases.values():
            config = json.dumps(case.summary()["config"])
            made = f"{config}, u of {case.criterion}" if case.criterion else config
            settings[f"field of {figures.title_of(case.key)}"] = made
            settings["robot radius"] = f"{case.robot_radius:g} m"
        tasks = [run.task for run in self.runs]
        seeds = sorted({task.seed for task in tasks if task.seed})
        return settings | {
            "planners": "\n".join(self.marks),
            "baseline": self.baseline,
            "weights": ", ".join(f"{weight:g}" for weight in sorted({t.weight for t in tasks})),
            "seeds": ", ".join(map(str, seeds)) or "none needed",
        }


def write_report(path: Path, comparison: Comparison) -> None:
    """Write the report, whole or not at all; names, labels and notes may hold any text."""
    environment = templates_of("locplan.comparison", autoescape=True, lstrip_blocks=True)
    filters = breakable, figures.counted, dashes, key, number, figures.shape
    environment.filters |= {each.__name__: each for each in filters}
    script = environment.get_template("report.js").render()
    text = environment.get_template("report.html").render(
        report=Report(comparison),
        comparison=comparison,
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        colours=" ".join(f"--p{n}: {colour};" for n, colour in enumerate(figures.COLOURS)),
        attributes=attributes,
        task_attributes=_task_attributes,
        limits=Report.limits,
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")


def _task_attributes(run: Run) -> figures.Attributes:
    """The attributes by which a run is filtered."""
    about = attributes((run.task.map, run.task.config, run.task.weight))
    return about | {"data-planner": run.task.planner, "data-status": run.status}


def breakable(label: str) -> Markup:
    """A planner's label that may be broken between its options."""
    return Markup(str(escape(label)).replace(":", ":<wbr>").replace(",", ",<wbr>"))


def dashes(mark: figures.Mark, width: float) -> str:
    """The dashes of a line of some width, for SVG; empty for a whole line."""
    pattern = () if figures.DASHES[mark.dash] == "-" else figures.DASHES[mark.dash][1]
    return " ".join(f"{width * part:.3g}" for part in pattern)


def key(value: float) -> str:
    """The key by which a table is sorted; what is not known comes last."""
    return f"{value:.9g}" if math.isfinite(value) else "x"


def number(value: float) -> str:
    """Text with four significant digits above 10, three above 1 and two below."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else "–"
    size = math.floor(math.log10(abs(value)))
    if size < -4:
        return f"{value:.1e}".replace("e-0", "e-")
    return f"{value:,.{1 - size if size < 0 else max(0, min(2, 3 - size))}f}"
