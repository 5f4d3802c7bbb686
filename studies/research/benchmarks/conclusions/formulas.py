"""Errors of joints, arm and base by formulas that the catalogue does not use."""

from __future__ import annotations

import numpy as np

from studies.research.benchmarks.conclusions.true_causes import Act
from studies.research.withheld.actions import Action, State
from studies.research.withheld.catalogue import segment
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene


def smooth_hysteresis(moves: Array, knee: float) -> Array:
    """Friction that is won over gradually: tanh of the last move over a knee."""
    return np.tanh(moves / knee)


def hysteresis_by_rate(moves: Array, longest: Array, knee: float) -> Array:
    """The same by the speed of arrival, which is the joint's share of the longest move."""
    return np.tanh(moves / np.where(longest > 0.0, longest, 1.0) / knee)


def play_with_dead_band(moves: Array, band: float) -> Array:
    """Side of a play that only moves longer than a band turn over; shape (N,)."""
    sides, side = np.zeros(len(moves)), 0.0
    for i, move in enumerate(moves):
        side = float(np.sign(move)) if abs(move) > band else side
        sides[i] = side
    return sides


def eccentric(q: Array, phase: float, second: float, second_phase: float) -> Array:
    """Angle error of a wheel off its centre, exact in the eccentricity, and of an oval one."""
    turn = q - phase
    off = np.sin(turn) / (1.0 - 0.1 * np.cos(turn))
    return np.asarray(off + second * np.sin(2.0 * q - second_phase))


def hardening(torque: Array, share: float) -> Array:
    """Torque less a cubic, which takes a share of the largest torque's effect."""
    most = float(np.abs(torque).max()) or 1.0
    return np.asarray(torque * (1.0 - share * (torque / most) ** 2))


def lagging(temperature: Array, time: Array, lag: float) -> Array:
    """What follows a temperature with a time constant [s], in balance at first; shape (N,)."""
    follows = np.empty_like(temperature)
    follows[0] = temperature[0]
    for i in range(1, len(time)):
        keep = np.exp(-(time[i] - time[i - 1]) / lag)
        follows[i] = keep * follows[i - 1] + (1.0 - keep) * temperature[i]
    return follows


def fading_ripple(q: Array, cycles: float, phase: float, fade: float) -> Array:
    """A ripple whose amplitude varies by a third about once a turn."""
    return np.asarray((1.0 + 0.33 * np.sin(q + fade)) * np.sin(cycles * q + phase))


def two_constants(time: Array, short: float, long: float, share: float) -> Array:
    """What is left of a warm-up of two masses."""
    t = time - time[0]
    return np.asarray(share * np.exp(-t / short) + (1.0 - share) * np.exp(-t / long))


def stretched(time: Array, tau: float) -> Array:
    """What is left of a foundation's settling: exp(-(t / tau)^0.6)."""
    return np.asarray(np.exp(-(((time - time[0]) / tau) ** 0.6)))


def smooth_step(time: Array, at: float, width: float) -> Array:
    """From 0 to 1 about a moment, within some widths [s]."""
    return np.asarray(0.5 * (1.0 + np.tanh((time - at) / width)))


def growing(degrees: Array) -> Act:
    """Links that grow with (N,) kelvins, by 1 um/(m K) at size one."""

    def act(scene: Scene, state: State) -> Action:  # noqa: ARG001
        action = scene.nothing()
        for frame in range(1, scene.arm.dof + 2):
            action.twist[:, frame, :3] = np.outer(degrees, 1e-6 * segment(scene, frame))
        return action

    return act
