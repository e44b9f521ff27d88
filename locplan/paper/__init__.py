"""The paper's experiments on our maps, and its claims about places.

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
