"""The paper's experiments on built-in maps, and its claims about places."""

from locplan.paper.claims import one_dimensional

__all__ = ["one_dimensional"]
