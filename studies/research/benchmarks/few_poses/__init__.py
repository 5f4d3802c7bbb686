"""What an identification is worth when poses are few: held-out error, and whether its claims hold.

    python -m studies.research.benchmarks.few_poses [--days 40] [--peers FOLDER] [--json FILE]

The first 8, 10, 12, 15, 20 and 40 of one day's poses, drawn anywhere within the limits, go to posecal,
to a ridge whose one penalty is chosen by cross-validation, and, on request, to FIGAROH's estimators
``map`` and ``map_cv``. The truth is plain NumPy (``truth``), and what counts is the distance of the
predicted from the true points at 200 other poses. Days take turns with one marker and three, and with
an arm that comes back exactly or to within 0.02 mm and 20 urad, of which the cell says nothing.

Coverage: of 95 % intervals of parameters, whose truth is what a fit to exact readings of the 200 poses
finds (its residual is checked, so the constants that posecal drops are absorbed without error); of the
coordinates of points at 50 of those poses, by the covariance and its degrees of freedom; and of what
``posecal identify`` promises at its own targets. Errors of one day go together, so the interval of a
share counts no more than what the days scatter by.
"""
