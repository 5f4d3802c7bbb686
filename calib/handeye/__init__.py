"""Hand-eye calibration: where a camera sits, how good that is, and whether the arm limits it.

A camera in the hand sees a target that stands in the world; a camera that stands in the world sees a
target on the hand. With ``F`` the carrier of the camera, the tip in base axes or the base in tip axes,
both are ``C_i = (F_i E)^-1 W``: ``C`` the target as image i shows it, ``E`` the camera on its carrier,
``W`` the target on the other one.
"""
