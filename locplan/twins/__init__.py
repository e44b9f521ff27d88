"""Twins: places that a lidar cannot tell apart, and where a global match of a scan is safe."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
