"""Units in which answers give parameters, as the table of effects has them."""

from __future__ import annotations

SI = {
    "urad": 1e-6,
    "um": 1e-6,
    "mm": 1e-3,
    "kg": 1.0,
    "N": 1.0,
    "1": 1.0,
    "N/mm": 1e3,
    "ppm": 1e-6,
    "ppm/h": 1e-6,
    "ppm/K": 1e-6,
    "urad/rad": 1e-6,
    "um/m": 1e-6,
    "um/rad": 1e-6,
    "urad/m": 1e-6,
    "urad/(N m)": 1e-6,
    "nm/N": 1e-9,
    "um/h": 1e-6,
    "urad/h": 1e-6,
    "um/(m K)": 1e-6,
    "1/turn": 1.0,
    "N m": 1.0,
    "s": 1.0,
    "min": 60.0,
    "readings": 1.0,
}

_BY_PREFIX = {
    "cos_": "urad",
    "sin_": "urad",
    "half_width": "urad",
    "offset": "urad",
    "compliance": "urad/(N m)",
    "tilt": "urad/(N m)",
    "spring": "N/mm",
    "preload": "N",
    "mass": "kg",
    "weight": "1",
    "growth": "um/(m K)",
    "from_": "urad/rad",
    "com_": "mm",
    "scale": "urad/rad",
    "cycles": "1/turn",
    "per_move": "urad/rad",
    "per_speed": "urad",
    "torque": "N m",
    "tau": "min",
    "at": "s",
}
_BY_EFFECT = {
    ("tracker_scale", "scale"): "ppm",
    ("payload", "scale"): "1",
}
_SLIDING = {"urad": "um", "urad/(N m)": "nm/N", "urad/rad": "um/m"}


def unit(effect: str, name: str, slides: bool = False, timed: bool = True) -> str:
    """Unit of a parameter; slides : it belongs to a prismatic joint; timed : the file has a clock."""
    if name in ("tau", "at") and not timed:
        return "readings"
    if name in ("x", "y", "z", "rx", "ry", "rz"):
        turns = name.startswith("r")
        if effect == "tool_compliance":
            return "urad/(N m)" if turns else "nm/N"
        return ("urad" if turns else "um") + ("/h" if effect.endswith("drift") else "")
    if (effect, name) in _BY_EFFECT:
        return _BY_EFFECT[effect, name]
    found = next(shown for prefix, shown in _BY_PREFIX.items() if name.startswith(prefix))
    return _SLIDING.get(found, found) if slides else found
