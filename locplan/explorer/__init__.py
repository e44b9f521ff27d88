"""The explorer: a page in the browser where a map's weak spots and paths are seen and changed."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
