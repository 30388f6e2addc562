"""Tyre friction from a car's inertial sensor: the published IMM-EKF and a smoother on the same model."""
