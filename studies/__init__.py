"""studies: what a person runs.

The way of a result:

``command/<name>.py``
    Read, call, ``deliver(result, ..)``; only click is imported at its head. Shared options stand in
    ``command/options.py``.
``results/<name>.py``
    One frozen pydantic class for each object of the JSON, fields named with their unit, filled by
    keywords in ``of(found)``. ``posecal schema`` and reading back follow.
``templates/<name>.md.j2``
    What it says, as Markdown: the answer, a paragraph with what to do next, sections. ``folded`` pieces
    are for the page; ``figure`` names a function of ``figures``, drawn where the target can show it.
``render.py``
    Rules of rounding, and Markdown on a terminal (rich) and in a page (markdown-it).

To add a field: one line in its class, and one where ``of`` fills it. To add a section: lines in the
template. To add a figure: its function, and a line in ``figures/__init__.py``.
"""
