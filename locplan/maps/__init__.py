"""Occupancy grid maps: read, written, generated."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
