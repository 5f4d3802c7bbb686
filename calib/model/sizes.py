"""The elementary errors behind the parameters of a model, and priors of their sizes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from calib.effects.geometry import Geometry
from calib.effects.protocol import Constant, Effect, Parameter
from calib.effects.tool_base import Base, Tool
from calib.effects.tuned import Tuned
from calib.errors import UnknownEffect
from calib.inference.widths import Elementary, Key, SizePrior
from calib.model.model import Model
from calib.model.reduction import axis_component, carried_over

OFFSET = "joint_offset"
_ZEROS = 3.0
"""How much larger zeros of joints err than what is machined: arms are put to zero by hand, industrial
ones to 0.02 to 0.06 deg, service robots to a degree."""


class _Error(NamedTuple):
    """One parameter that is the size of an error; ``zero``: that of a joint's variable."""

    key: Key
    parameter: Parameter
    constant: bool
    zero: bool

    @property
    def kind(self) -> tuple[str, str]:
        """Errors that have one width."""
        return OFFSET if self.zero else self.key[0], self.parameter.unit

    @property
    def size(self) -> float:
        """A plausible size, SI."""
        return self.parameter.size * (_ZEROS if self.zero else 1.0)


def elementary(model: Model, full: Model) -> Elementary:
    """The errors whose sizes are asked, with the parameters of a model that they make up.

    full : Model, with the constants as well that those of ``model`` absorb
    Places and tunings are no errors, and what an instrument's maker states has its size.
    """
    own = _errors(model)
    constant, rest = [e for e in own if e.constant], [e for e in own if not e.constant]
    theirs = [e for e in _errors(full) if e.constant] if constant else []
    G = np.eye(len(own), len(theirs) + len(rest), len(theirs) - len(constant))
    if constant:
        G[: len(constant), : len(theirs)] = carried_over(full, model, [e.key for e in theirs])
    keys, errors = tuple(e.key for e in (*constant, *rest)), (*theirs, *rest)
    scales = {e.kind: e.parameter.scale for e in errors}
    classes = tuple(scales)
    places = np.array([f"{e.key[0]}:{e.key[1]}" for e in errors])
    return Elementary(
        keys,
        np.array([model.keys.index(key) for key in keys], dtype=int),
        G,
        np.array([e.size for e in errors]),
        classes,
        np.array(list(scales.values())),
        np.array([classes.index(e.kind) for e in errors], dtype=int),
        np.unique(places, return_inverse=True)[1].reshape(-1),
    )


def _errors(model: Model) -> list[_Error]:
    return [
        _Error(p.key, p, isinstance(e, Constant), _is_zero(model, e, k))
        for e in model.effects
        if not isinstance(e, Base | Tool)
        for k, p in enumerate(e.parameters)
        if not (isinstance(e, Tuned) and k == 0)
    ]


def _is_zero(model: Model, effect: Effect, k: int) -> bool:
    """Whether a parameter is the zero of a joint."""
    if isinstance(effect, Geometry):
        return axis_component(model.robot, effect) == effect.components[k]
    return effect.kind == OFFSET


def stated(of: Elementary, widths: Mapping[str, float]) -> SizePrior:
    """The prior for widths that somebody states.

    widths : by ``kind_unit``, as in ``geometry_mrad``, which holds for zeros of joints as well where
        ``joint_offset_mrad`` is not named; a kind that is not named has any size

    Raises UnknownEffect where no such parameter is in the model.
    """
    named = [_named(unit, scale) for (_, unit), scale in zip(of.classes, of.scales, strict=True)]
    by_class, known = np.full(len(of.classes), np.inf), set()
    for c, (kind, _) in enumerate(of.classes):
        for also in ("geometry", kind) if kind == OFFSET else (kind,):
            for unit, si in named[c].items():
                known.add(f"{also}_{unit}")
                if f"{also}_{unit}" in widths:
                    by_class[c] = widths[f"{also}_{unit}"] * si
    for key in widths:
        if key not in known:
            there = ", ".join(sorted(known)) or "no errors"
            raise UnknownEffect(
                f"[model] size_prior has {key!r}; of this model it may have {there}"
            )
    wide = by_class[of.of_class]
    anyhow = (np.abs(of.G) * np.isinf(wide)).any(axis=1)
    prior = of.prior(np.where(np.isinf(wide), 0.0, wide) ** 2)
    return prior.only([key for key, any_size in zip(of.keys, anyhow, strict=True) if not any_size])


def _named(unit: str, scale: float) -> dict[str, float]:
    """How a key may name a unit, with its size in SI; of micrometres millimetres as well."""
    plain = unit.replace("/", "_per_").translate(str.maketrans("", "", "() "))
    milli = {"m" + plain[1:]: 1e3 * scale} if plain.startswith("u") else {}
    return {plain: scale} | milli
