"""Recorded drives: their scans, lidar, poses and odometry, and whether a map fits them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
