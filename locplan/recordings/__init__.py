"""Recorded drives: their scans, lidar, poses and odometry, and whether a map fits them."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
