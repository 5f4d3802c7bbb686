"""Optimal designs of any kind: arrays of information in, weights, plans and proofs out.

No module here knows a robot. Candidates are information matrices (:mod:`~doe.optimal.blocks`), plans
are sets of them by simple rules (:mod:`~doe.optimal.allowed`), and an information function says what is
best (:mod:`~doe.optimal.function`). Best weights come from :mod:`~doe.optimal.relax`, whole plans from
:mod:`~doe.optimal.search`.
"""
