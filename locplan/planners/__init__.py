"""Planners on a costmap, all through `plan`."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
