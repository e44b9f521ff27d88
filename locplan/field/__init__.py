"""The covariance field of a map: its estimators, its settings, and its store."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
