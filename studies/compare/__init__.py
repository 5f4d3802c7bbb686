"""``posecal compare``: estimators and plans, the predicted covariance beside simulation."""
