"""The estimators of the pose covariance, one a module."""
