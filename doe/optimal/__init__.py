"""Optimal designs of any kind: arrays of information in, weights, plans and proofs out.

What stands here knows no robot. Candidates are information matrices
(:class:`~doe.optimal.blocks.Blocks`), plans are sets of them by simple rules
(:class:`~doe.optimal.allowed.Allowed`), and an information function says what is best
(:class:`~doe.optimal.function.InformationFunction`): together a
:class:`~doe.optimal.selection.Selection`, which knows what no plan surpasses. Best weights come from
:mod:`~doe.optimal.relax`, which bound what any plan reaches, and whole plans from
:mod:`~doe.optimal.search`.
"""
