"""The cost of travel: costmaps, paths, and what a path costs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
