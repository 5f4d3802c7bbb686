"""The independent truth: simulated arms, their errors, days of measurement, and the files of a day.

Nothing here imports ``calib`` or ``doe``. Kinematics and internal forces are MuJoCo's; errors, noise
and instruments follow formulas of this package. A reader goes from the arm to the files:

``arms``
    Arms with their masses and drives, written by hand or drawn anew.
``mechanism``
    One true arm in MuJoCo, at rest under what acts on it.
``noise``
    What an instrument adds to a reading, and how an arm scatters from approach to approach.
``conditions``, ``session``, ``scene``
    What makes a day hard, what is driven and when, and all of a day but its errors.
``formulas``, ``effects``, ``foreign``, ``causes``
    What an error does; one table of all errors; errors by other formulas; an error with its size.
``readers``
    Cameras, motion capture, wires and sockets in place of the tracker.
``files``, ``day``
    A scene as a user's files; a plain day of three arms, with targets.
"""
