from ._comparing import PLANNERS as PLANNERS, compare as compare
from ._pairs import Contrast as Contrast
from ._result import Comparison as Comparison, check_result_folder as check_result_folder
from ._runs import MEASURES as MEASURES, STATUSES as STATUSES, Run as Run, Task as Task
from ._specs import PlannerSpec as PlannerSpec, specs_of as specs_of
from ._statistics import Summary as Summary
