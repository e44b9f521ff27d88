"""The report of a comparison: one HTML file that needs nothing else."""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
