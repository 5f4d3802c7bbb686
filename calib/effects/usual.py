"""How large errors of an arm of this reach and weight usually are.

What is known before anything is measured is a prior, never a wall: it weighs causes against each other
and says which size is far out.

Joints yield. A drive is chosen for what it carries, so that it turns by about a milliradian under the
weight of the arm: strain-wave gears of small arms yield by 15 to 210 urad/(N m) (Harmonic Drive, CSF
catalogue, K1 of sizes 32 to 14), cycloidal gears of large ones by 0.3 to 6 (Nabtesco, RV-E catalogue,
RV-320E to RV-20E).
"""

from __future__ import annotations

from calib.effects.context import Context

_TURNS = 1e-3  # rad, of a joint under the weight of its arm
_LEVER = 0.25  # of the reach, at which the arm's weight pulls, on average over joints and poses
_DENSITY, _POWER = 50.0, 2.5  # kg of an arm with a reach of one metre, and how that grows
_HEAVY = 100.0  # kg: of 2.7 m, a KR 270 has 1100 kg; of 1.3 m, a UR10 has 29
_INDUSTRIAL = 30.0  # kg for each metre of reach: above, gears have a stated lost motion
_SOFT = 1e-5  # rad/(N m), of the arm for which the limits of compliances stand
_G = 9.80665


def weight(context: Context) -> float:
    """Mass of the moving arm, kg: as its file has it, else that of an industrial arm of its reach."""
    known = float(context.robot.masses.sum())
    return known or _DENSITY * context.robot.reach**_POWER


def softness(context: Context) -> float:
    """By how much a joint usually yields, rad/(N m)."""
    carried = weight(context) * _LEVER + context.payload.mass
    return _TURNS / (carried * _G * context.robot.reach)


def softer(context: Context) -> float:
    """How many times softer than an arm of 10 kg and a metre's reach it may be; one at least."""
    return max(1.0, softness(context) / _SOFT)


def heavy(context: Context) -> bool:
    """Whether makers build springs and large gears into an arm of this weight."""
    return weight(context) >= _HEAVY


def light(context: Context) -> bool:
    """Whether it may be a service robot: its known weight is small, or nothing is known of it."""
    return float(context.robot.masses.sum()) < _INDUSTRIAL * context.robot.reach
