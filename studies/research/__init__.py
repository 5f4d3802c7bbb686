"""What measures posecal and what the paper says; nothing that a user runs in production.

``python -m studies.research`` lists what is run, each as a module from a checkout: the wheel leaves
this folder out. ``truth`` simulates arms without ``calib``; ``RESULTS.md`` has what was measured.
"""
