"""Checks of what users add to locplan, to be called in tests of their own."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
