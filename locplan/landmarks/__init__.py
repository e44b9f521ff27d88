"""Landmarks: where to put objects that keep a robot from getting lost, and whether they help."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
