"""Serve locplan's masks to Nav2, and warn where a pose match is degenerate."""
