"""Pictures of maps, fields and paths.

The functions that begin with ``draw_`` draw on given Axes; the others make a whole figure.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
