"""Comparison of planners over maps, queries and seeds, with statistics."""

from locplan.comparison.comparing import compare
from locplan.comparison.settings import Execution, RandomQueries

__all__ = ["Execution", "RandomQueries", "compare"]
