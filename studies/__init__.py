"""studies: what a person runs.

The way of a result, one folder a kind, ``studies/<kind>/``:

``record.py``
    A :class:`studies.record.Record`: every field of its JSON with its type and the unit in its name, or
    with :class:`studies.record.From` where the result calls it otherwise; and
    ``<kind>_record(found, .., made_from)``, which fills it from what the library found
    (:meth:`studies.record.Entry.from_result`) and states only what is neither a copy nor a change of
    unit. Where it needs more of the library than types it stands in ``make.py``.
``telling.py``
    ``told(record) -> Document``, by attributes alone: the headline (the answer: the terminal begins
    with it, "At a glance" of a page collects it), and sections of sentences, tables and figures, each
    written once. The terminal leaves out figures, ``Detail`` and columns of ``detail``. Every rounding
    is a rule of ``document``, for columns and sentences alike. Figures of the record are drawn when
    they are wanted; where they are many they stand in ``pictures.py``. Of a kind with little to tell
    it stands in ``record.py``.
``command.py``
    Read, call, ``deliver(record, ..)``; only click is imported at its head.

Nothing here knows who tells it or reads it: ``kinds.py`` alone names the folder of each kind, and
``results.py`` reads a file as the kind it says it is.

To add a kind: its folder, its line in ``kinds.py``, its command in ``cli.py``; its sections stand on
the page by themselves. To add a field: one line in the record, named as in the result or with its
``From``. ``posecal schema`` follows by itself. To add a section: a :class:`studies.document.Section`
in ``told``; one that needs the inputs of a result again (the arm, errors against joints) is a function
in ``report/page.py``.
"""
