"""Simple programs that answer what ``posecal diagnose`` answers, so that its gain can be seen.

Each is what a capable colleague would script in an afternoon with ``calib``: stepwise selection of
effects by an information criterion, and regression of what is left on all that is known of a pose.
``python -m studies.research.withheld run FOLDER --answers aic`` sets them the sealed cases.
"""
