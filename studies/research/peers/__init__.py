"""Drivers of other programs, each set the same work as posecal; they share file formats alone.

    python drive_NAME.py FOLDER ANSWER.json REPEATS

An interpreter that has the program runs a driver on a folder with ``robot.urdf``, ``work.json`` (base,
tip, joints, first guesses of the markers in m), ``fit.csv`` (joints in rad; x1, y1, z1, x2 .. in m, in
the instrument's frame) and ``heldout.csv`` (joints alone). The answer holds ``version`` and ``runs``:
``way``, ``free`` parameters, ``seconds`` of each repeat, ``converged``, and the points that the fitted
robot predicts at both tables, shape (n, markers, 3), m. Who sets the work judges them; held-out points
are in no file that a driver sees. Where a program has a tolerance it is 1e-8, SciPy's default.
"""
