"""Tuning of AMCL's settings by simulated drives."""
