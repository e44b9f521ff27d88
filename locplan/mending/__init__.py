"""Maps mended for the filter: walls hollowed, specks erased, and what simulated drives say."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
