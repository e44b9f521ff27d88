"""Pictures of maps, fields and paths.

The functions that begin with ``draw_`` draw on given Axes; the others make a whole figure.
"""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
