from ._benchmarks import (
    read_movingai_map as read_movingai_map,
    read_scenarios as read_scenarios,
    write_ompl_logs as write_ompl_logs,
)
from ._comparing import compare as compare
from ._contrasts import Contrast as Contrast
from ._journal import Journal as Journal
from ._result import Case as Case, Comparison as Comparison, Standing as Standing
from ._settings import Execution as Execution, RandomQueries as RandomQueries
from ._specs import (
    PlannerSpec as PlannerSpec,
    parse_options as parse_options,
    specs_of as specs_of,
)
from ._statistics import (
    MEASURES as MEASURES,
    STATUSES as STATUSES,
    Run as Run,
    Summary as Summary,
    Task as Task,
)
