"""What is known of each reading: joints, loads, covariates, the move before it, and what it repeats."""

from calib.poses.poses import LAGS, Measurements, Poses, hung, poses_at

__all__ = ["LAGS", "Measurements", "Poses", "hung", "poses_at"]
