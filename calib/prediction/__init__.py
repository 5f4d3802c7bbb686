"""What a result says at target poses: the error to expect, and commands that lower it.

Read in this order: :mod:`~calib.prediction.discrepancy` is what a model leaves, ``trend`` what goes on
through the day, ``estimate`` what a result knows of the robot, and the expected error of all that. On
these rest ``compensate``, with the search of ``commands``, and the ``budget``.
"""
