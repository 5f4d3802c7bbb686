"""What would more readings tell? Before the day, on the day, and after a diagnosis.

Every answer stands on one linearisation of the readings (:mod:`doe.problem.linearisation`), one
probability of detection (:mod:`calib.diagnosis.detection_limit`), one likeness of two causes
(:mod:`~doe.ahead.information`) and one list of what could be changed (:mod:`~doe.ahead.remedies`).
"""
