"""What a model lacks is the same on both days, but shows otherwise at other poses.

Least squares put part of it into the parameters, ``d = e + (T_after - T_before) u`` with T how the
parameters take up errors u of the drives at a day's poses, and u as large as what the fits leave
beyond the instrument. At equal poses it adds nothing, in a model that lacks nothing neither.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from calib.arrays import Array, stacked
from calib.effects import Context, Effect, catalogue
from calib.effects.protocol import ARM
from calib.model import Model
from calib.poses import Poses

_DRIVES = ("transmission_scale", "transmission_harmonic", "backlash", "gravity_sag")


def taken_up(
    model: Model, values: Array, poses: Poses, effects: tuple[Effect, ...]
) -> tuple[Array, float]:
    """How the p parameters take up effects that the model lacks, shape (p, h), SI, by least squares.

    Beside it what is left of all of them together at plausible sizes, RMS per reading, m.
    """
    whole, everything = model.extended(values, effects)
    _, J = whole.jacobian(everything, poses)
    readings, own = J.shape[0] * J.shape[1], len(model.parameters)
    J = stacked(J)
    scale = np.linalg.norm(J[:, :own], axis=0)
    moving = scale > 0.0
    kept = J[:, :own][:, moving] / scale[moving]
    taken = np.zeros((own, J.shape[1] - own))
    taken[moving] = np.linalg.lstsq(kept, J[:, own:], rcond=1e-8)[0] / scale[moving, None]
    left = (J[:, own:] - J[:, :own] @ taken) * whole.sizes[own:]
    return taken, float(np.sqrt((left**2).sum() / readings))


def lacked(model: Model, context: Context, kinds: Iterable[str]) -> Iterator[Effect]:
    """Effects of some kinds at every place where the model does not have them and they can act."""
    known = {(effect.kind, effect.where) for effect in model.effects}
    for kind in kinds:
        effect = catalogue()[kind]
        if any(name in context.lacking for name in effect.uses):
            continue
        for where in effect.places(context):
            if (kind, where) not in known and where != ARM:
                yield effect.at(context, where)


def shown_otherwise(
    model: Model,
    values: Array,
    days: tuple[Poses, Poses],
    context: Context,
    excess: float,
) -> Array:
    """How the difference of all p values follows what the model lacks, shape (p, h), SI.

    days : the poses of both; excess : float, m, RMS that the fits leave beyond the instrument
    """
    effects = tuple(lacked(model, context, _DRIVES))
    if excess <= 0.0 or not effects:
        return np.zeros((len(values), 0))
    (before, one), (after, other) = (taken_up(model, values, poses, effects) for poses in days)
    sizes = np.concatenate([[p.size for p in effect.parameters] for effect in effects])
    return np.asarray((after - before) * sizes * excess / max(one, other, 1e-12))
