"""Sealed cases for ``posecal diagnose``: causes that nobody sees before the answers are committed.

``python -m studies.research.sealed make N --seed S FOLDER`` draws cases of :mod:`.truth`
and seals their keys, ``run`` lets the diagnosis answer, ``score`` checks the seals and compares.
"""
