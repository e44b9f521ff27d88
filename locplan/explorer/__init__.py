"""The explorer: a page in the browser where a map's weak spots and paths are seen and changed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
