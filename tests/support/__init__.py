"""Helpers that tests import: maps, recordings, oracles, ROS readers, and a browser."""
