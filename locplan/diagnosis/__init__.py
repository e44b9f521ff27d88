"""From a map and a robot to the cure that gains most: `check`."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
