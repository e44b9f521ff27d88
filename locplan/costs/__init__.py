"""The cost of travel: costmaps, paths, and what a path costs."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
