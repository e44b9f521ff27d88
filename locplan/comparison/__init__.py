"""Many planners on many maps, side by side: which planner, at which weight, on which map."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from locplan.comparison.comparing import compare
    from locplan.comparison.pairs import Contrast
    from locplan.comparison.queries import Query, random_queries, read_queries
    from locplan.comparison.result import Comparison, check_result_folder
    from locplan.comparison.runs import MEASURES, STATUSES, Run, Task
    from locplan.comparison.specs import PlannerSpec, specs_of
    from locplan.comparison.statistics import Summary

# Imported when first used: the processes that plan need neither reports nor pictures.
_HOME = {
    "compare": "comparing",
    "Contrast": "pairs",
    "Query": "queries",
    "random_queries": "queries",
    "read_queries": "queries",
    "Comparison": "result",
    "check_result_folder": "result",
    "specs_of": "specs",
    "MEASURES": "runs",
    "STATUSES": "runs",
    "Run": "runs",
    "Task": "runs",
    "PlannerSpec": "specs",
    "Summary": "statistics",
}

__all__ = [
    "MEASURES",
    "STATUSES",
    "Comparison",
    "Contrast",
    "PlannerSpec",
    "Query",
    "Run",
    "Summary",
    "Task",
    "check_result_folder",
    "compare",
    "random_queries",
    "read_queries",
    "specs_of",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"locplan.comparison.{_HOME[name]}"), name)
    raise AttributeError(f"module 'locplan.comparison' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
