"""What would more readings tell? Before the day, and on the day.

The readings in hand, or those of a plan, are independent rows of unit variance about what is known of
the model (:mod:`~doe.information`), and readings to come add rows of the same kind
(:mod:`~doe.forecast.coming`). All that is asked stands on these: the error at the targets
(:mod:`~doe.forecast.accuracy`), and which causes are found (:mod:`~doe.forecast.foresee`).
"""
