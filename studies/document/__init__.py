"""What a result says, once: sections of sentences, tables and figures, which two renderers show.

``terminal`` shows the short form, ``page`` all of it, as HTML. Neither knows any kind of result.
"""

from studies.document.parts import (
    Column,
    Detail,
    Document,
    Figure,
    Mood,
    Part,
    Raw,
    Section,
    Sentence,
    Table,
    pictures_of,
)
from studies.document.rules import (
    COUNT,
    FOUR,
    HUNDREDTH,
    JOINT,
    MM,
    MRAD,
    NAMES,
    PERCENT,
    PROVED,
    STD,
    TEXT,
    Rule,
    listed,
    mm,
    plural,
)

__all__ = [
    "COUNT",
    "FOUR",
    "HUNDREDTH",
    "JOINT",
    "MM",
    "MRAD",
    "NAMES",
    "PERCENT",
    "PROVED",
    "STD",
    "TEXT",
    "Column",
    "Detail",
    "Document",
    "Figure",
    "Mood",
    "Part",
    "Raw",
    "Rule",
    "Section",
    "Sentence",
    "Table",
    "listed",
    "mm",
    "pictures_of",
    "plural",
]
