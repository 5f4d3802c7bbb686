"""What would more readings tell? Before the day, and on the day.

Every answer is a question asked of one forecast (:mod:`~doe.forecast.forecast`): what is known now, and
the rows that readings to come would add (:mod:`~doe.forecast.likeness`).
"""
