"""OMPL's sampling-based planners on a costmap.

Its names load with their first use, because half of them import OMPL.
"""

from locplan._support.public import attach_lazy_names

__getattr__, __dir__, __all__ = attach_lazy_names(__name__, __file__)
