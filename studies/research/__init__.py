"""What measures posecal and what the paper says; nothing that a user runs in production.

Sealed cases (``withheld``), comparisons (``benchmarks``), and the paper's own tables and figures
(``paper``). Each is run as a module from a checkout: the wheel leaves this folder out. ``RESULTS.md``
has what was measured.
"""
