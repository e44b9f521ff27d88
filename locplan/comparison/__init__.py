"""Comparison of planners over maps, queries and seeds, with statistics."""

from locplan.comparison.experiment import compare
from locplan.comparison.settings import Execution, RandomQueries

__all__ = ["Execution", "RandomQueries", "compare"]
