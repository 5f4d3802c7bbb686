"""What a result says at target poses: the error to expect, and commands that lower it.

Read in this order: :mod:`~calib.prediction.estimate` is what a result knows of the robot,
``discrepancy`` what its model leaves, ``targets`` the expected error of both at target poses. On these
rest ``compensate``, with the search of ``commands``, and the ``budget``.
"""
