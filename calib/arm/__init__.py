"""The arm as it is drawn: rigid motions, the chain, its kinematics, the loads that run through it."""
