"""Landmarks: where to put objects that keep a robot from getting lost, and whether they help."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
