"""Least squares on the products: terms of each joint, inertials of all links, and torque constants.

    effort_j = g_j Y_j (phi_0 + S x) + X_j b_j ,     x ~ N(0, I / lambda)

with S plausible changes of the inertials. Where g_j is free, the effort is a current whose constant is
unknown, or a torque whose scale is asked. Products of g and x make the fit one of a few Gauss-Newton
steps; joints are weighed by their residual variance.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from calib.arrays import Array, IntArray
from calib.motion.gram import Products, Term
from calib.motion.regressor import PER_LINK

Inertials: TypeAlias = Literal["none", "payload", "inertials"]
_STEPS = 6  # of Gauss-Newton where scales and inertials are both free
_TINY = 1e-9


@dataclass(frozen=True)
class MotionModel:
    """What is fitted.

    terms : for each joint, its terms; scaled : whether the scale of its effort is free
    inertials : which of them are; ridge : lambda
    """

    terms: tuple[tuple[Term, ...], ...]
    scaled: tuple[bool, ...]
    inertials: Inertials = "none"
    ridge: float = 100.0

    def adding(self, joint: int, term: Term) -> MotionModel:
        """With a term, in the place of another variant of its kind."""
        own = (*(t for t in self.terms[joint] if t[0] != term[0]), term)
        return replace(self, terms=(*self.terms[:joint], own, *self.terms[joint + 1 :]))

    def without(self, joint: int, kind: str) -> MotionModel:
        """Without a kind at a joint."""
        own = tuple(t for t in self.terms[joint] if t[0] != kind)
        return replace(self, terms=(*self.terms[:joint], own, *self.terms[joint + 1 :]))


@dataclass(frozen=True, eq=False)
class MotionFit:
    """Values.

    g : ndarray, shape (n,); x : ndarray, shape (10 n,), changes of inertials in plausible sizes
    b : for each joint the values of its terms, (k_j,)
    combination : ndarray, shape (n, K), the residual of each joint as a combination of its columns
    """

    model: MotionModel
    g: Array
    x: Array
    b: tuple[Array, ...]
    combination: Array = field(repr=False)

    def squares(self, products: Products, *, moving: bool = False) -> Array:
        """Sum of squared residuals of every run and joint, shape (r, n)."""
        G = products.moving if moving else products.G
        c = self.combination
        return np.asarray(np.maximum(np.einsum("jk,rjkl,jl->rj", c, G, c, optimize=True), 0.0))


def sizes_of(products: Products) -> Array:
    """Plausible changes of inertials, shape (10 n,): of masses m, first moments m L, inertias m L^2."""
    robot = products.robot
    masses = np.maximum(robot.masses, 0.05 * max(float(robot.masses.max(initial=0.0)), 1.0))
    L = max(float(robot.reach) / robot.dof, 0.05)
    each = np.array([1.0, *[L] * 3, *[L**2] * 6])
    return np.asarray((masses[:, None] * each).ravel())


def chosen(products: Products, inertials: Inertials) -> IntArray:
    """Places of the inertials that are free."""
    whole = np.arange(products.columns.inertials)
    return whole[{"none": len(whole), "payload": -PER_LINK, "inertials": 0}[inertials] :]


def fit(
    products: Products, model: MotionModel, weights: Array, start: MotionFit | None = None
) -> MotionFit:
    """The fit of all runs.

    weights : ndarray, shape (n,), of squared residuals of each joint; start : values to begin with
    """
    free, S = chosen(products, model.inertials), sizes_of(products)
    scaled = np.array(model.scaled)
    g = np.ones(len(scaled)) if start is None else np.where(scaled, start.g, 1.0)
    x = np.zeros(len(S))
    if start is not None:
        x[free] = start.x[free]
    elif scaled.any():
        g = _scales(products, model, g)
    for _ in range(_STEPS if scaled.any() and len(free) else 1):
        g, x, b = _step(products, model, weights, (free, S), g, x)
    return MotionFit(model, g, x, b, _combination(products, model, g, x, b))


def _scales(products: Products, model: MotionModel, g: Array) -> Array:
    """Scales by the nominal links."""
    free = products.columns.inertials
    plain = replace(model, inertials="none")
    found, _, _ = _step(
        products, plain, np.ones(len(g)), (np.arange(0), np.ones(free)), g, np.zeros(free)
    )
    return found


def _step(
    products: Products,
    model: MotionModel,
    weights: Array,
    inertials: tuple[IntArray, Array],
    g: Array,
    x: Array,
) -> tuple[Array, Array, tuple[Array, ...]]:
    """One step of Gauss-Newton, the terms of each joint eliminated first."""
    free, _ = inertials
    A, rhs, parts = _normal(products, model, weights, inertials, g, x)
    step = np.linalg.solve(A, rhs) if len(free) else rhs
    x = x.copy()
    x[free] += step
    b, g = [], g.copy()
    for j, (to_local, of_r) in enumerate(parts):
        local = of_r - to_local @ step
        if model.scaled[j]:
            g[j] = local[0]
            local = local[1:]
        b.append(local)
    return g, x, tuple(b)


def _normal(
    products: Products,
    model: MotionModel,
    weights: Array,
    inertials: tuple[IntArray, Array],
    g: Array,
    x: Array,
) -> tuple[Array, Array, list[tuple[Array, Array]]]:
    """Normal equations of the inertials, and what the terms of each joint are by these."""
    free, S = inertials
    n, K = len(g), products.columns.width
    torque = rigid_torque(products, x)
    A, rhs = model.ridge * np.eye(len(free)), -model.ridge * x[free]
    parts = []
    for j in range(n):
        rigid = torque[j]
        own = np.zeros((K, 0)) if not model.scaled[j] else rigid[:, None]
        places = [p for term in model.terms[j] for p in products.columns.of(j, term)]
        L = np.concatenate([own, np.eye(K)[:, places]], axis=1)
        r = np.zeros(K)
        r[-1] = 1.0
        if not model.scaled[j]:
            r = r - rigid * g[j]
        G = products.total[j]
        D = np.zeros((K, len(free)))
        D[free, np.arange(len(free))] = g[j] * S[free]
        GL, GD = G @ L, G @ D
        inner = _inverse(L.T @ GL)
        to_local, of_r = inner @ (GL.T @ D), inner @ (GL.T @ r)
        A += weights[j] * (D.T @ GD - (GL.T @ D).T @ to_local)
        rhs += weights[j] * (GD.T @ r - (GL.T @ D).T @ of_r)
        parts.append((to_local, of_r))
    return A, rhs, parts


def information(products: Products, found: MotionFit, weights: Array) -> Array:
    """Of the inertials that are free, the ridge's with it and the terms eliminated, shape (f, f).

    Scales are held: with them free, smaller links seem to be nearer to any others.
    """
    inertials = chosen(products, found.model.inertials), sizes_of(products)
    model = replace(found.model, scaled=(False,) * len(found.g))
    return _normal(products, model, weights, inertials, found.g, found.x)[0]


def _inverse(A: Array) -> Array:
    """Of a scaled normal matrix, columns that nothing moves left at zero."""
    size = np.sqrt(np.maximum(np.diag(A), 0.0))
    outer = np.outer(size, size)
    outer = np.where(outer > 0.0, outer, np.inf)
    return np.asarray(np.linalg.pinv(A / outer, rcond=_TINY, hermitian=True) / outer)


def rigid_torque(products: Products, x: Array) -> Array:
    """The torque of each joint as its file has it, with changed links, as combinations (n, K)."""
    torque = products.nominal.copy()
    torque[:, : len(x)] += sizes_of(products) * x
    return np.asarray(torque)


def _combination(
    products: Products, model: MotionModel, g: Array, x: Array, b: tuple[Array, ...]
) -> Array:
    c = -g[:, None] * rigid_torque(products, x)
    for j, terms in enumerate(model.terms):
        c[j, [p for term in terms for p in products.columns.of(j, term)]] -= b[j]
    c[:, -1] = 1.0
    return c


def left_out(
    products: Products, model: MotionModel, weights: Array
) -> tuple[Array, list[MotionFit]]:
    """Squared residuals of every part by the fits without its fold, shape (r, n), and these fits."""
    squares, fits = np.zeros(products.counts.shape), []
    whole = fit(products, model, weights)
    for f in products.folds:
        rest, out = products.parted(f)
        fits.append(fit(rest, model, weights, whole))
        squares[products.fold == f] = fits[-1].squares(out)
    return squares, fits
