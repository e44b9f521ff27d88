"""From a map and a robot to the failures and the fixes that help: `check`."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
