"""The elementary errors behind the parameters of a model, and priors of their sizes."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from calib.effects.base import Base
from calib.effects.protocol import Constant, Effect
from calib.effects.tool import Tool
from calib.effects.tuned import Tuned
from calib.errors import UnknownEffect
from calib.model.model import Model
from calib.model.reduction import carried_over
from calib.population.prior import Key, Prior
from calib.population.sizes import Elementary


def elementary(model: Model, full: Model, taken: Collection[Key] = ()) -> Elementary:
    """The errors whose sizes are asked, with the parameters of a model that they make up.

    full : Model, with the constants as well that those of ``model`` absorb
    taken : keys of parameters of which more is known
    Places and tunings are no errors, and what an instrument's maker states has its size.
    """
    own, every = _sized(model.effects), _sized(full.effects)
    constant = [key for key, e, _ in own if isinstance(e, Constant)]
    theirs = [(key, e, s) for key, e, s in every if isinstance(e, Constant)] if constant else []
    rest = [row for row in own if not isinstance(row[1], Constant)]
    G = np.zeros((len(constant) + len(rest), len(theirs) + len(rest)))
    if constant:
        carried = carried_over(full, model, [key for key, _, _ in theirs])
        G[: len(constant), : len(theirs)] = carried
    G[len(constant) :, len(theirs) :] = np.eye(len(rest))
    keys = [*constant, *(key for key, _, _ in rest)]
    kept = [i for i, key in enumerate(keys) if key not in taken]
    G = G[kept]
    errors = [*theirs, *rest]
    shown = np.abs(G).max(axis=0, initial=0.0) > 0.0
    errors = [own for own, some in zip(errors, shown, strict=True) if some]
    order = [(p.effect, p.where, p.name) for p in model.parameters]
    units = [(key[0], e.parameters[s].unit) for key, e, s in errors]
    places = [key[:2] for key, _, _ in errors]
    scales = {own: e.parameters[s].scale for own, (_, e, s) in zip(units, errors, strict=True)}
    classes = tuple(scales)
    return Elementary(
        tuple(keys[i] for i in kept),
        np.array([order.index(keys[i]) for i in kept], dtype=int),
        G[:, shown],
        np.array([e.parameters[s].size for _, e, s in errors]),
        classes,
        np.array([scales[own] for own in classes]),
        np.array([classes.index(unit) for unit in units], dtype=int),
        np.unique(np.array([":".join(p) for p in places]), return_inverse=True)[1].reshape(-1),
    )


def _sized(effects: Collection[Effect]) -> list[tuple[Key, Effect, int]]:
    """Every parameter that is the size of an error: its key, its effect, and its position there."""
    found = []
    for effect in effects:
        if isinstance(effect, Base | Tool):
            continue
        for k, p in enumerate(effect.parameters):
            tuning = isinstance(effect, Tuned) and k == 0
            if not tuning and not np.isfinite(effect.believed[k]):
                found.append(((p.effect, p.where, p.name), effect, k))
    return found


def stated(of: Elementary, widths: Mapping[str, float]) -> Prior:
    """The prior for widths that somebody states.

    widths : by ``kind_unit``, as in ``geometry_mrad``; a kind that is not named has any size

    Raises UnknownEffect where no such parameter is in the model.
    """
    known = {
        f"{kind}_{name}": (c, si)
        for c, (kind, unit) in enumerate(of.classes)
        for name, si in _named(unit, of.scales[c]).items()
    }
    by_class = np.full(len(of.classes), np.inf)
    for key, width in widths.items():
        if key not in known:
            there = ", ".join(known) or "no errors"
            raise UnknownEffect(
                f"[model] size_prior names {key!r}; of this model it may name {there}"
            )
        c, si = known[key]
        by_class[c] = width * si
    wide = by_class[of.of_class]
    anyhow = (np.abs(of.G) * np.isinf(wide)).any(axis=1)
    prior = of.prior(np.where(np.isinf(wide), 0.0, wide) ** 2)
    return prior.only([key for key, any_size in zip(of.keys, anyhow, strict=True) if not any_size])


def _named(unit: str, scale: float) -> dict[str, float]:
    """How a key may name a unit, with its size in SI; of micrometres millimetres as well."""
    plain = unit.replace("/", "_per_").translate(str.maketrans("", "", "() "))
    milli = {"m" + plain[1:]: 1e3 * scale} if plain.startswith("u") else {}
    return {plain: scale} | milli
