from ._comparing import compare as compare
from ._pairs import Contrast as Contrast
from ._result import Comparison as Comparison
from ._result import check_result_folder as check_result_folder
from ._runs import MEASURES as MEASURES
from ._runs import STATUSES as STATUSES
from ._runs import Run as Run
from ._runs import Task as Task
from ._specs import PlannerSpec as PlannerSpec
from ._specs import specs_of as specs_of
from ._statistics import Summary as Summary

__all__ = [
    "MEASURES",
    "STATUSES",
    "Comparison",
    "Contrast",
    "PlannerSpec",
    "Run",
    "Summary",
    "Task",
    "check_result_folder",
    "compare",
    "specs_of",
]
