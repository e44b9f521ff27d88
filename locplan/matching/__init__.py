"""Matching: the pose of a scan on a map, near a pose or anywhere."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
