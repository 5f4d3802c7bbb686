"""What a plan can tell, in the units of the file formats."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from calib.diagnosis.power import POWER
from calib.diagnosis.rounds import ALPHA
from calib.effects.protocol import LoadEffect
from doe.prospect.confounded import remedies_of
from doe.prospect.detectability import Detectability
from doe.prospect.foresee import PowerAnalysis
from doe.prospect.likeness import SURE

_UM = 1e6


def power_fields(found: PowerAnalysis) -> dict[str, Any]:
    """The fields of ``diagnose --plan-only --json``, without provenance.

    ``could_not_see`` : every cause with the ``minimum_detectable`` size of one ``parameter``, the best
    seen, null with a ``reason`` where no size would be found; ``rms_um`` is how far that size moves the
    markers, ``plausible`` a usual size, ``parameters`` all of them, each taken alone, with the part of
    their signal that is ``left`` beside the model.
    ``look_alikes`` : causes and what each is taken for (``like``) at its smallest size: correlation
    ``rho`` over plausible parameters and in the worst direction, the probability of preferring the
    right one at the smallest size, and the size from which on that is ``sure``, of the same parameter
    and as a multiple; null where no size would do.
    ``twins`` : groups that stand for each other at these poses at any size, and what would split them.
    """
    view = found.view
    every = {one.key: one for one in (*found.seen, *found.hidden)}
    return {
        "plan_only": True,
        "readings": len(view.data),
        "points": int(view.data.seen.sum()),
        "hidden_markers": int((~view.data.seen).sum()),
        "before_the_first_move": [
            name for name, waits in zip(view.data.poses.names, view.waiting, strict=True) if waits
        ],
        "asked": view.asked,
        "alpha": ALPHA,
        "power": POWER,
        "sure": SURE,
        "approach_derived": view.data.poses.approach_derived,
        "elastic_assumed": _assumed(found),
        "unidentifiable": [{"names": list(u.names), "reason": u.reason} for u in view.lost],
        "could_not_see": [_cause(every[c.key]) for c in view.suspects],
        "look_alikes": _look_alikes(found),
        "twins": [
            {"members": [_named(found.seen[i]) for i in group], "split_by": [c.says for c in ways]}
            for group, ways in zip(found.confounded, remedies_of(found), strict=True)
        ],
        "not_asked": [{"effect": n.effect, "reason": n.reason} for n in view.missing],
    }


def _assumed(found: PowerAnalysis) -> bool:
    """Whether sizes hold for compliances that nobody has identified yet."""
    through = any(isinstance(cause.candidate.effect, LoadEffect) for cause in found.seen)
    return found.view.assumed and through


def _named(cause: Detectability) -> dict[str, Any]:
    return {"effect": cause.candidate.effect.kind, "where": cause.candidate.where}


def _cause(cause: Detectability) -> dict[str, Any]:
    lead, parameters = cause.lead, cause.parameters
    main = parameters[lead]
    return {
        **_named(cause),
        "parameter": main.name,
        "minimum_detectable": _finite(cause.smallest[lead] / main.scale),
        "unit": main.unit,
        "plausible": main.size / main.scale,
        "rms_um": _finite(cause.moved[lead] * _UM),
        "noncentrality": _finite(cause.needed),
        "directions": cause.directions,
        "reason": cause.reason or None,
        "parameters": [
            {
                "name": p.name,
                "minimum_detectable": _finite(size / p.scale),
                "unit": p.unit,
                "left": share,
            }
            for p, size, share in zip(parameters, cause.smallest, cause.share, strict=True)
        ],
    }


def _look_alikes(found: PowerAnalysis) -> list[dict[str, Any]]:
    if found.alike is None:
        return []
    rho, worst = found.alike.rho, found.alike.rho_worst
    needed = np.array([cause.needed for cause in found.seen])
    chance = found.alike.preferred(needed, found.view.field.rows)
    entries = []
    for i, j in found.pairs:
        cause, times = found.seen[i], float(found.times[i, j])
        main = cause.parameters[cause.lead]
        entries.append(
            {
                **_named(cause),
                "like": _named(found.seen[j]),
                "rho": float(rho[i, j]),
                "rho_worst": float(worst[i, j]),
                "probability_at_minimum": float(chance[i, j]),
                "told_apart_times": _finite(times),
                "told_apart_from": _finite(times * cause.smallest[cause.lead] / main.scale),
                "parameter": main.name,
                "unit": main.unit,
            }
        )
    return entries


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
