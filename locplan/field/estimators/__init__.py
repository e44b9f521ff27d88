"""What fills a field: one method a module, all with the same functions."""

LAYERS: dict[str, tuple[str, ...]] = {
    "sad": (),
    "fisher": (),
    "scan": ("ambiguity", "entropy"),
}
"""What each tells of a place besides the covariance.

"ambiguity" is the probability outside the central mode, "entropy" that of the posterior [nat].
"""
