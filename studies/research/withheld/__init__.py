"""Sealed cases for ``posecal diagnose``: truth by a program that shares no model code with it.

``python -m studies.research.withheld make N --seed S FOLDER`` draws cases and seals their keys, ``run``
lets the diagnosis answer, ``score`` checks the seals and compares. Nothing that makes the truth imports
``calib`` or ``doe``: kinematics, statics and noise are MuJoCo's and this package's own.
"""
