"""OMPL's sampling-based planners on a costmap."""
