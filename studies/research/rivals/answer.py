"""An answer in the form of ``diagnose --json``, as far as it is judged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calib import Identification

_MM = 1e3


def answer(
    verdict: str,
    before: Identification,
    heldout_after: float | None,
    effects: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Verdict, named effects with their places in that order, and held-out errors.

    before : of the user's model; heldout_after : m, 3-D RMS per point of what was found beside it
    """
    heldout_before, noise = before.rms("heldout"), before.noise
    return {
        "verdict": verdict,
        "effects": list(effects),
        "located": [{"where": e["where"], "depends_on": None} for e in effects],
        "gap": {
            "floor_mm": 3.0**0.5 * noise.sigma * _MM,
            "heldout_before_mm": None if heldout_before is None else heldout_before * _MM,
            "heldout_after_mm": None if heldout_after is None else heldout_after * _MM,
        },
    }
