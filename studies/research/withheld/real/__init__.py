"""Sealed cases as real arms are: they scatter, ripple, settle and warm up, from several causes at once.

``python -m studies.research.withheld make 600 --seed 1 FOLDER --real-arms`` draws these in place of the
first families; ``run`` and ``score`` are the same.
"""
