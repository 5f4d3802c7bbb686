"""Change a result as other programs do: values of other kinds, sizes and shapes in their places."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from typing import Any

from tests.fuzz.mutate import WORDS

_SCRIPT = "</script><script>alert(1)</script><!--\"'><img src=x onerror=alert(2)>&lt;"
_HOSTILE = (*WORDS, _SCRIPT, "javascript:alert(1)", 'x" onload="alert(1)', "y" * 20_000)
_SIZES = (
    0, 1, -1, 2, 0.0, -0.0, 0.5, 1e-320, 1e-9, -1e-9, 1e6, 1e9, 1e15, 1e16, 1e19, 1e154, 1e160,
    1e300, -1e300, 1.7e308, float("nan"), float("inf"), float("-inf"), 10**400, -(10**20), 2**63,
)  # fmt: skip
_OTHERS: tuple[Any, ...] = (
    None,
    True,
    False,
    [],
    {},
    [[]],
    [None],
    {"": None},
    "",
    [{}],
    [[1.0, 2.0]],
)


def json_mutated(text: str, lenders: tuple[str, ...], rng: random.Random) -> str | None:
    """A neighbour of a JSON text, None where it is none; ``lenders`` lend values."""
    try:
        whole = [json.loads(text)]
        other = [json.loads(rng.choice(lenders))]
    except (ValueError, RecursionError):
        return None
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        holder, key = _place(whole, rng)
        lent, at = _place(other, rng)
        _change(holder, key, lent[at], rng)
    try:
        return json.dumps(whole[0] if whole else None)
    except (ValueError, RecursionError):
        return None


def _place(whole: Any, rng: random.Random) -> tuple[Any, Any]:
    """A holder and the key of something in it, anywhere in the tree."""
    holder, key = whole, 0
    while True:
        inner = holder[key]
        if not isinstance(inner, dict | list) or not inner or rng.random() < 0.08:
            return holder, key
        holder = inner
        key = rng.choice(list(inner)) if isinstance(inner, dict) else rng.randrange(len(inner))


def _change(holder: Any, key: Any, lent: Any, rng: random.Random) -> None:
    """Replace a value, or all of its kind beside it; cut, stretch or rename what holds it."""
    old = holder[key]
    new = _new(old, lent, rng)
    way = rng.random()
    if way < 0.5 or len(holder) == 0:
        holder[key] = new
    elif way < 0.65:  # everywhere beside it
        for name in list(holder) if isinstance(holder, dict) else range(len(holder)):
            if type(holder[name]) is type(old):
                holder[name] = new
    elif way < 0.75:
        del holder[key]
        if not isinstance(holder, dict) and not holder:
            holder.append(new)
    elif isinstance(old, list) and old:
        many = rng.choice((0, 1, 2, 7, 70))
        holder[key] = old[: rng.randrange(len(old) + 1)] if many == 0 else old * many
    elif isinstance(holder, dict):
        holder[rng.choice(_HOSTILE)] = holder.pop(key)
    else:
        holder.insert(0, new)


def _new(old: Any, lent: Any, rng: random.Random) -> Any:
    kinds: tuple[Callable[[], Any], ...] = (
        lambda: rng.choice(_HOSTILE),
        lambda: rng.choice(_SIZES),
        lambda: rng.choice(_OTHERS),
        lambda: lent,
        lambda: _like(old, rng),
    )
    return rng.choice(kinds)()


def _like(old: Any, rng: random.Random) -> Any:
    """Of the same kind, so that it goes deeper."""
    if isinstance(old, bool) or old is None:
        return not old
    if isinstance(old, int) and abs(old) > 1e15:
        return -old
    if isinstance(old, int | float):
        return rng.choice((-old, 0, old * 1e3, old * 1e-6, rng.choice(_SIZES)))
    if isinstance(old, str):
        return rng.choice((old + rng.choice(_HOSTILE), rng.choice(_HOSTILE)))
    return {} if isinstance(old, dict) else [old]
