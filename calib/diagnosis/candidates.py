"""Everything that might be the cause: the inactive effects of the catalogue, and unnamed curves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.diagnosis.curves import Curve, curves
from calib.diagnosis.functions import Torque
from calib.effects import GROUPS, Effect, catalogue
from calib.effects.loads import FrictionWindup
from calib.effects.protocol import Parameter
from calib.effects.thermal import LateExpansion
from calib.effects.tuned import Tuned, amounts_of
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import context_of, place_effect, placed_effects
from calib.poses import Measurements

EXCLUDED = "excluded by the cell"
"""Why a cause is not asked that the user knows the robot not to have."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect, or an unnamed curve, that may be missing in the model.

    effect : Effect, a curve where it has no name; named : whether it has one, in the catalogue
    depends_on : str, on what it depends most, as in the results
    tried : int, forms among which this one was chosen
    odds : float, how often it is met at its place, beside a cause that any arm may have
    twin_odds : float, how often it is the cause where the readings do not tell it from another
    line : int, its number among causes of its kind at its place
    echo : str, key of the cause in whose place it stands, at the tuning that is best there
    also : tuple of Candidate, other names for the same: no reading tells them from it
    """

    effect: Effect
    named: bool
    depends_on: str
    tried: int = 1
    line: int = 1
    echo: str = ""
    also: tuple[Candidate, ...] = ()
    odds: float = 1.0
    twin_odds: float = 1.0

    @property
    def choices(self) -> float:
        """Among how many its evidence counts: one that is seldom met as the best of as many."""
        return self.tried / self.odds

    @property
    def where(self) -> str:
        """Place, as in the results."""
        return self.effect.where

    @cached_property
    def key(self) -> str:
        """``effect:where``, for a curve with its variable and what it moves."""
        if not isinstance(self.effect, Curve):
            further = f" #{self.line}" if self.line > 1 else ""
            echo = f" as {self.echo}" if self.echo else ""
            form = " late" if isinstance(self.effect, LateExpansion) else ""
            return f"{self.effect.kind}:{self.where}{form}{further}{echo}"
        variable, count = self.effect.variable, len(self.effect.parameters)
        about = f" along {np.round(variable.axis, 3)}" if isinstance(variable, Torque) else ""
        return f"{type(self.effect).__name__}:{self.where} by {self.depends_on}{about} ({count})"

    @property
    def amounts(self) -> tuple[Parameter, ...]:
        """Its parameters without the tuning, such as a frequency or a time constant."""
        return amounts_of(self.effect)

    def is_like(self, other: Candidate) -> bool:
        """Whether both are causes of one kind at one place, at whatever tuning."""
        kinds = self.effect.kind, other.effect.kind
        return self.named and kinds[0] == kinds[1] and self.where == other.where

    def covers(self, other: Candidate) -> bool:
        """Whether it is a curve at the place of a cause by name, over what that depends on."""
        alike = self.where == other.where and self.depends_on == other.depends_on
        return alike and other.named and not self.named

    @cached_property
    def limits(self) -> Array:
        """Magnitudes of its amounts beyond which they are far out on this arm, shape (k,), SI."""
        return (self.effect.allowance or 1.0) * np.array([p.limit for p in self.amounts])

    def as_tuned(self, tuning: float) -> Candidate:
        """The same candidate at another tuning."""
        effect = self.effect
        return replace(self, effect=effect.tuned(tuning)) if isinstance(effect, Tuned) else self

    @cached_property
    def spread(self) -> Array | None:
        """Covariance of a curve's k coefficients a priori, shape (k, k); None for a cause by name."""
        return self.effect.spread if isinstance(self.effect, Curve) else None


@dataclass(frozen=True)
class NotAsked:
    """A cause that the data cannot speak of, and why."""

    effect: str
    reason: str


def candidates(
    cell: Cell, model: Model, data: Measurements
) -> tuple[list[Candidate], list[NotAsked]]:
    """Inactive effects at every place where they can act, and curves; and what cannot be asked.

    Those with a tuning stand there once, wherever their search begins.
    """
    context = context_of(cell, data.poses)
    # What was left out of the model is in it by what absorbs it.
    wholes = [*model.effects, *(e for e in placed_effects(cell, context) if e.parts)]
    found, missing = [], []
    second: dict[str, tuple[Candidate, ...]] = {}
    for kind, effect_type in catalogue().items():
        if kind in GROUPS:
            continue
        for where in effect_type.places(context):
            if any((e.kind, e.where) == (kind, where) or e.contains(kind, where) for e in wholes):
                continue
            if kind in cell.excluded or f"{kind}:{where}" in cell.excluded:
                missing.append(NotAsked(f"{kind}:{where}", EXCLUDED))
                continue
            try:
                effect = place_effect(kind, where, context)
            except CalibError as error:
                missing.append(NotAsked(f"{kind}:{where}", str(error)))
                continue
            expected = effect_type.expected(context, where)
            if expected.instead:
                missing.append(NotAsked(f"{kind}:{where}", expected.instead))
                continue
            effect = replace(effect, allowance=expected.allowance)
            own = Candidate(
                effect,
                True,
                effect.depends_on,
                odds=expected.odds,
                twin_odds=expected.twin_odds,
            )
            winds_up = effect_type is FrictionWindup
            repeated = FrictionWindup.repeats(where, model.effects) if winds_up else None
            if repeated is None:
                found += [own, *(replace(own, effect=e) for e in effect.forms(data.poses))]
            elif repeated:
                second[f"{repeated}:{where}"] = (own,)
    found = [replace(c, also=second.get(c.key, ())) for c in found]
    ranges = np.linalg.norm(data.points[data.seen], axis=-1)
    unnamed = [Candidate(c, False, c.variable.name) for c in curves(context, data.poses, ranges)]
    return found + unnamed, missing
