"""The report of a comparison: one HTML file that needs nothing else, made of `templates`."""

from __future__ import annotations

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from locplan._util.files import replacing
from locplan.comparison._figures import COLOURS
from locplan.comparison._marks import SHAPES, Scale, breakable, counted, dashes, key, number
from locplan.comparison._pictures import (
    Attributes,
    Pictures,
    attributes,
    title_of,
)
from locplan.comparison._result import Comparison, Standing
from locplan.comparison._statistics import MEASURES, Run, grouped


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

    def failures(self) -> list[list[Run]]:
        """The runs without a path, grouped by kind of failure."""
        failed = (run for run in self.runs if run.status != "solved")
        kinds = grouped(
            failed, lambda r: (r.status, r.task.planner, r.task.map, r.task.config, r.note)
        )
        return list(kinds.values())

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
            settings[f"field of {title_of(case.key)}"] = made
            settings["robot radius"] = f"{case.robot_radius:g} m"
        tasks = [run.task for run in self.runs]
        seeds = sorted({task.seed for task in tasks if task.seed})
        return settings | {
            "planners": "\n".join(self.looks),
            "baseline": self.baseline,
            "weights": ", ".join(f"{weight:g}" for weight in sorted({t.weight for t in tasks})),
            "seeds": ", ".join(map(str, seeds)) or "none needed",
        }


def write_report(path: Path, comparison: Comparison) -> None:
    """Write the report, whole or not at all; names, labels and notes may hold any text."""
    environment = Environment(
        loader=PackageLoader("locplan.comparison", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    filters = breakable, counted, dashes, key, number
    environment.filters |= {each.__name__: each for each in filters}
    script = environment.get_template("report.js").render()
    text = environment.get_template("report.html").render(
        report=Report(comparison),
        comparison=comparison,
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        colours=" ".join(f"--p{n}: {colour};" for n, colour in enumerate(COLOURS)),
        shapes=SHAPES,
        attributes=attributes,
        task_attributes=_task_attributes,
        limits=Report.limits,
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")


def _task_attributes(run: Run) -> Attributes:
    """The attributes by which a run is filtered."""
    about = attributes((run.task.map, run.task.config, run.task.weight))
    return about | {"data-planner": run.task.planner, "data-status": run.status}
