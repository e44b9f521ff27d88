"""The paper's experiments on our maps, their figures, and its claims about places.

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
