"""Many planners on many maps, side by side: which planner, at which weight, on which map."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
