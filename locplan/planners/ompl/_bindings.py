"""OMPL's Python bindings, or one line where there are none."""

import sys

from locplan.errors import LocplanError

try:
    from ompl import base as base, geometric as geometric, util as util
    from ompl.base import Cost as Cost
except ModuleNotFoundError:
    instead = {"Windows": "WSL"} if sys.platform == "win32" else {}
    if sys.version_info >= (3, 14):
        instead["Python 3.14 and later"] = "Python 3.13"
    raise LocplanError(
        f"OMPL's planners are not available on {' with '.join(instead)}: ompl has no wheels for it;"
        f" take grid or any-angle, or {' with '.join(instead.values())}"
        if instead
        else "OMPL's planners need ompl, which is not installed: pip install 'ompl>=2.0.1'"
    ) from None
