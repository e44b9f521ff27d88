"""The simulated choice among candidate paths."""
