"""The paper's experiments on built-in maps, and its claims about places."""

from locplan.paper.claims import compare_models_along_strips

__all__ = ["compare_models_along_strips"]
