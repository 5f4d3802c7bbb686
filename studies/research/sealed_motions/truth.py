"""One simulated robot: its motions, its torques by MuJoCo and by laws of friction of its own, its key.

Bristles follow their differential equation (Canudas de Wit, Olsson, Astrom and Lischinsky, 1995) in
steps of a millisecond. What a cause adds to a joint's torque is scaled to a drawn share of it, beyond
what the user's model can take up.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from studies.research.sealed_motions.arms import ARMS, Arm, Array, mjcf

_RATE, _STEP = 100, 1e-3  # Hz of the log; s of the simulation
_EACH = round(1.0 / _RATE / _STEP)
_USER = ("coulomb_friction", "viscous_friction")
_SEEN = 2.0  # times the coloured noise, beyond which a term counts as visible
NULL, OUTSIDE, FRICTION = "nothing", "outside", "friction"
FAMILIES = (
    *(NULL, NULL, "armature", "payload", "inertials", "pre_sliding", "load_friction"),
    *(FRICTION, "torque_delay", "spring", "torque_ripple", OUTSIDE),
)
"""Of one round of cases."""
_LAWS = ("wear", "drag", "warming", "coupling")
_ONE_JOINT = ("armature", "spring", "torque_ripple", "load_friction")


@dataclass(frozen=True)
class Cause:
    """A cause that is there; where ``arm`` or ``payload`` for links; values that have an interval."""

    effect: str
    where: str
    seen: bool = True
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Case:
    """What is written, and the key.

    effects : of the user's model; runs : name -> time (m,), q and torque (m, n); held : names
    """

    arm: Arm
    family: str
    effects: tuple[str, ...]
    runs: dict[str, tuple[Array, Array, Array]]
    held: tuple[str, ...]
    causes: tuple[Cause, ...]
    law: str


def case(number: int, seed: int) -> Case:
    """One case of a round of families."""
    rng = np.random.default_rng([seed, number])
    family, arm = FAMILIES[number % len(FAMILIES)], ARMS[int(rng.integers(len(ARMS)))]
    count, n = int(rng.integers(6, 11)) + 2, len(arm.links)
    lasts = rng.uniform(15.0, 30.0, count)
    t = np.arange(0.0, lasts.max(), _STEP)
    q = np.array([_fourier(rng, arm, t, T) for T in lasts])
    v = np.gradient(q, _STEP, axis=1, edge_order=2)
    motion = q, v, np.gradient(v, _STEP, axis=1, edge_order=2)
    rows = [_rows(rng, T) for T in lasts]
    late = int(rng.integers(5, 16)) if family == "torque_delay" else 0
    state = [tuple(own[i, r - late] for own in motion) for i, r in enumerate(rows)]
    nominal = [_rigid(mjcf(arm), *own) for own in state]
    size = np.sqrt(np.mean(np.concatenate(nominal) ** 2, axis=0))
    size = np.maximum(size, 0.05 * size.max())
    drawn = _Drawn(rng, arm, family, rows, late, t, motion, state, nominal, size)
    extra, causes, law = drawn.causes()
    noise = [drawn.noise(len(r)) for r in rows]
    floor = np.sqrt(np.mean(np.concatenate([own[1] for own in noise]) ** 2, axis=0))
    runs = {}
    for i, r in enumerate(rows):
        torque = nominal[i] + extra[i] + sum(noise[i])
        runs[f"run{i}"] = (t[r], q[i, r] + rng.normal(scale=2e-6, size=(len(r), n)), torque)
    seen = tuple(drawn.judged(own, floor) for own in causes)
    user = () if family == FRICTION else _USER
    return Case(arm, family, user, runs, tuple(runs)[-2:], seen, law)


@dataclass
class _Drawn:
    """The choices of one case, as they are made."""

    rng: np.random.Generator
    arm: Arm
    family: str
    rows: list[Array]
    late: int
    t: Array
    motion: tuple[Array, Array, Array]
    state: list[tuple[Array, ...]]
    nominal: list[Array]
    size: Array
    terms: dict[tuple[str, str], Array] = field(default_factory=dict)
    width: float = 0.0

    def causes(self) -> tuple[list[Array], list[Cause], str]:
        """What is added to the torque of each run, the causes, and the law that is outside."""
        n, rng = len(self.arm.links), self.rng
        extra, found, law = [np.zeros_like(own) for own in self.nominal], list[Cause](), ""
        bristles = self.family == "pre_sliding"
        found += self._friction(extra, bristles)
        if self.family in ("payload", "inertials"):
            found.append(self._links(extra))
        if self.family == "torque_delay":
            found += [Cause("torque_delay", j, True, {"delay": self.late * _STEP})
                      for j in self.arm.joints]  # fmt: skip
            for i, r in enumerate(self.rows):
                early = _rigid(mjcf(self.arm), *(own[i, r] for own in self.motion))
                for j, name in enumerate(self.arm.joints):
                    self._noted("torque_delay", name, self.nominal[i][:, j] - early[:, j])
        if self.family in _ONE_JOINT:
            for j in rng.choice(n, int(rng.integers(1, 4)), replace=False).tolist():
                found.append(self._at_joint(extra, j, self.family))
        if self.family == OUTSIDE:
            law = str(rng.choice(_LAWS))
            for j in rng.choice(np.arange(1, n), 2, replace=False).tolist():
                self._at_joint(extra, j, law)
        return extra, found, law

    def _noted(self, kind: str, where: str, column: Array) -> None:
        before = self.terms.get((kind, where), np.zeros(0))
        self.terms[kind, where] = np.concatenate([before, column])

    def _friction(self, extra: list[Array], bristles: bool) -> list[Cause]:
        """Dry and viscous friction of every joint, which changes from run to run."""
        n, rng = len(self.size), self.rng
        self.width = 10.0 ** rng.uniform(-2.5, -1.9)  # rad/s
        dry, wet = rng.uniform(0.1, 0.3, n) * self.size, rng.uniform(0.05, 0.2, n) * self.size
        wet = wet / self.arm.speed
        days = 1.0 + rng.normal(scale=rng.uniform(0.05, 0.1), size=(len(extra), n))
        z = None
        if bristles:
            stiff = 10.0 ** rng.uniform(2.6, 3.8, n)
            z = _bristles(self.motion[0], stiff, rng.uniform(0.0, 0.3, n) * (rng.random(n) < 0.5))
        for i, (_, v, _) in enumerate(self.state):
            sign = v / np.hypot(v, self.width) if z is None else z[i, self.rows[i] - self.late]
            extra[i] += days[i] * (dry * sign + wet * v)
            for j, name in enumerate(self.arm.joints):
                smooth = v[:, j] / np.hypot(v[:, j], self.width)
                self._noted("coulomb_friction", name, dry[j] * smooth)
                self._noted("viscous_friction", name, wet[j] * v[:, j])
                if bristles:
                    self._noted("pre_sliding", name, dry[j] * (sign[:, j] - smooth))
        if bristles:
            return [Cause("pre_sliding", name) for name in self.arm.joints]
        if self.family != FRICTION:
            return []
        return [
            own
            for j, name in enumerate(self.arm.joints)
            for own in (
                Cause("coulomb_friction", name, True, {"friction": float(dry[j])}),
                Cause("viscous_friction", name, True, {"damping": float(wet[j])}),
            )
        ]

    def _links(self, extra: list[Array]) -> Cause:
        """A payload that the model does not know, or links of other masses."""
        n, rng = len(self.size), self.rng
        weight = sum(link.mass for link in self.arm.links)
        load, arm = np.zeros(4), self.arm
        if self.family == "payload":
            load[0] = weight * 10.0 ** rng.uniform(-2.0, -1.3)
            load[1:] = rng.uniform((-0.05, -0.05, 0.03), (0.05, 0.05, 0.13))
        else:
            some = rng.permutation(n) < max(3, n // 2)
            factors = 1.0 + some * rng.choice([-1.0, 1.0], n) * rng.uniform(0.1, 0.3, n)
            arm = arm.with_inertials(factors, some[:, None] * rng.uniform(-0.03, 0.03, (n, 3)))
        text = mjcf(arm, load.tolist())
        for i, own in enumerate(self.state):
            extra[i] += _rigid(text, *own) - self.nominal[i]
        if self.family == "payload":
            return Cause("payload", "payload", True, {"mass": float(load[0])})
        return Cause("inertials", "arm")

    def _at_joint(self, extra: list[Array], j: int, kind: str) -> Cause:
        """A term of one joint, of a drawn share of its torque."""
        rng, phase = self.rng, self.rng.uniform(0.0, 2.0 * np.pi)
        columns = [self._column(kind, i, j, phase) for i in range(len(extra))]
        beyond = _beyond(np.concatenate(columns), self._user(j))
        amount = 10.0 ** rng.uniform(-1.2, -0.6) * self.size[j] / np.sqrt(np.mean(beyond**2))
        name = self.arm.joints[j]
        for i, column in enumerate(columns):
            extra[i][:, j] += amount * column
            self._noted(kind, name, amount * column)
        values = {
            "armature": {"inertia": amount},
            "spring": {"sin": amount * np.cos(phase), "cos": amount * np.sin(phase)},
            "load_friction": {"share": amount},
            "torque_ripple": {"cos_1": amount * np.cos(phase), "sin_1": amount * np.sin(phase)},
        }.get(kind, {})
        return Cause(kind, name, True, {k: float(v) for k, v in values.items()})

    def _column(self, kind: str, run: int, j: int, phase: float) -> Array:
        q, v, a = (own[:, j] for own in self.state[run])
        sign, time = v / np.hypot(v, self.width), self.t[self.rows[run]]
        turned = self.arm.ratio * q
        made: dict[str, Any] = {
            "armature": lambda: a,
            "spring": lambda: np.sin(q + phase),
            "load_friction": lambda: np.abs(self.nominal[run][:, j]) * sign,
            "torque_ripple": lambda: np.cos(turned - phase) + 0.3 * np.cos(2.0 * turned),
            "wear": lambda: np.sin(2.0 * q + phase) * sign,
            "drag": lambda: v * np.abs(v),
            "warming": lambda: np.exp(-time / 8.0) * v,
            "coupling": lambda: self.state[run][1][:, j - 1],
        }
        return np.asarray(made[kind]())

    def _user(self, j: int) -> Array:
        """What the user's model can take up, (rows, k)."""
        name = self.arm.joints[j]
        dry, wet = (self.terms[kind, name] for kind in _USER)
        return np.column_stack([np.ones(len(dry)), dry, wet])

    def judged(self, own: Cause, floor: Array) -> Cause:
        """The cause, and whether it is visible beyond what is known and the noise (n,)."""
        if (own.effect, own.where) not in self.terms:
            return own
        j = self.arm.joints.index(own.where)
        known = self._user(j)
        if own.effect in _USER:
            known = np.delete(known, 1 + _USER.index(own.effect), axis=1)
        left = _beyond(self.terms[own.effect, own.where], known)
        seen = bool(np.sqrt(np.mean(left**2)) > _SEEN * floor[j])
        return Cause(own.effect, own.where, seen, own.values)

    def noise(self, count: int) -> tuple[Array, Array]:
        """White and coloured noise of the torque, each (count, n)."""
        rng, n = self.rng, len(self.size)
        white = rng.normal(scale=0.005, size=(count, n)) * self.size
        keep = np.exp(-1.0 / _RATE / 0.2)
        coloured = rng.normal(scale=np.sqrt(1.0 - keep**2), size=(count, n))
        for i in range(1, count):
            coloured[i] += keep * coloured[i - 1]
        return white, 0.015 * coloured * self.size


def _fourier(rng: np.random.Generator, arm: Arm, t: Array, lasts: float) -> Array:
    """A motion (N, n) from rest to rest, with what a controller leaves of it."""
    n, x = len(arm.links), np.zeros((len(t), len(arm.links)))
    for k in range(1, 6):
        wave = 2.0 * np.pi * k * 0.08 * t[:, None] + rng.uniform(0.0, 6.3, n)
        x += rng.normal(size=n) / k * np.sin(wave)
    speed = np.abs(np.gradient(x, _STEP, axis=0)).max(axis=0)
    x *= np.minimum(arm.reach / np.abs(x).max(axis=0), arm.speed * rng.uniform(0.4, 1.0) / speed)
    shake = [
        rng.uniform(0.2e-4, 1e-4, n) * np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 6.3, n))
        for f in rng.uniform(2.0, 9.0, 4)
    ]
    ramp = np.clip(np.minimum(t, lasts - t) / 2.0, 0.0, 1.0)[:, None]
    return np.asarray((x + sum(shake)) * (ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)))


def _rows(rng: np.random.Generator, lasts: float) -> Array:
    """Steps at which a run is logged, with jitter."""
    rows = np.arange(20, int(lasts / _STEP) - 20, _EACH)
    return np.asarray(rows + rng.integers(-1, 2, len(rows)))


def _bristles(q: Array, stiff: Array, peak: Array) -> Array:
    """Bending (R, N, n) of bristles, one where they slide; stiff : 1/rad; peak : more at rest."""
    step, z = np.diff(q, axis=1, prepend=q[:, :1]), np.zeros_like(q)
    for i in range(1, q.shape[1]):
        most = 1.0 + peak * np.exp(-((step[:, i] / _STEP / 0.05) ** 2))
        bent = z[:, i - 1] + stiff * step[:, i]
        z[:, i] = bent / (1.0 + stiff * np.abs(step[:, i]) / most)
    return z


def _rigid(text: str, q: Array, v: Array, a: Array) -> Array:
    """Torques (m, n) of the links by MuJoCo's inverse dynamics."""
    mujoco: Any = importlib.import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, found = mujoco.MjData(model), np.empty_like(q)
    for i in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], v[i], a[i]
        mujoco.mj_inverse(model, data)
        found[i] = data.qfrc_inverse
    return found


def _beyond(column: Array, known: Array) -> Array:
    """What known columns (m, k) leave of one (m,)."""
    return np.asarray(column - known @ np.linalg.lstsq(known, column, rcond=None)[0])
