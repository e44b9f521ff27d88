"""Twins: places that a lidar mistakes for others, and where a global match of a scan is safe."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
