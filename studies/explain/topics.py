"""The topics by name: those written in ``topics``, and one for each effect and criterion."""

from __future__ import annotations

import difflib
from importlib.resources import files

from calib.errors import InputError
from studies.document import Document
from studies.explain.generated import criterion_text, effect_text, made
from studies.explain.text import document_of, title_of

_FIRST = ("words", "cell", "columns", "instruments", "effects", "conventions", "limits")
_MEASURED = "measured-"


def written() -> dict[str, str]:
    """Texts by name: what one meets first, then the rest, then what was measured."""
    found = {
        file.name.removesuffix(".md"): file.read_text(encoding="utf-8")
        for file in (files("studies.explain") / "topics").iterdir()
        if file.name.endswith(".md")
    }
    order = [*_FIRST, *sorted(found, key=lambda name: (name.startswith(_MEASURED), name))]
    return {name: found[name] for name in dict.fromkeys(order)}


def titles() -> dict[str, str]:
    """What each written topic is about."""
    return {name: title_of(text) for name, text in written().items()}


def topic(name: str) -> Document:
    """A topic. Raises InputError, naming the closest, where there is none of this name."""
    from calib.effects import catalogue as effects
    from doe.criteria import catalogue as criteria

    texts = written()
    if name in texts:
        text = texts[name]
    elif name in effects():
        text = effect_text(name)
    elif name in criteria():
        text = criterion_text(name)
    else:
        close = difflib.get_close_matches(name, [*texts, *effects(), *criteria()], n=1)
        hint = f"did you mean {close[0]}?" if close else "posecal explain lists them"
        raise InputError("explain", "", f"no topic {name!r}", hint)
    return document_of(text, made)
