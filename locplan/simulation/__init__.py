"""Simulated localization: drives with a particle filter, and evaluations of fields by them."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
