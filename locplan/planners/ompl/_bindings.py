"""OMPL's Python bindings, or one line where there are none."""

import sys

from locplan.errors import LocplanError

try:
    from ompl import base as base, geometric as geometric, util as util
    from ompl.base import Cost as Cost
except ModuleNotFoundError:
    raise LocplanError(
        "OMPL's planners are not available on Windows: ompl has no wheels for it; take grid or"
        " any-angle, or WSL"
        if sys.platform == "win32"
        else "OMPL's planners need ompl, which is not installed: pip install 'ompl>=2.0.1'"
    ) from None
