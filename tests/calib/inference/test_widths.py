"""Widths of the size prior: at the maximum, from beyond a valley, and what a class of none has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.inference import Design, GaussianBlock, Variances
from calib.inference.reml import reml
from calib.inference.restricted import MixedModel, RestrictedLikelihood
from calib.inference.widths import widths
from tests.calib.inference.designs import simple_design


def classes(sizes: tuple[float, ...], each: int = 12, seed: int = 0) -> Design:
    """Rows of unit noise that errors of some classes move, sizes in units of the plausible ones."""
    rng = np.random.default_rng(seed)
    m, rows = 40, 3
    J = rng.normal(size=(m, rows, 2))
    r = rng.normal(size=(m, rows))
    blocks = []
    for j, size in enumerate(sizes):
        columns = 300.0 * rng.normal(size=(m, rows, each))
        root = 1e-3 * np.eye(each)
        r = r + columns @ (1e-3 * size * rng.normal(size=each))
        blocks.append(GaussianBlock(f"class {j}", columns, root, np.zeros(each), None))
    design = simple_design(np.zeros((m, rows, 1)), np.arange(m), J, r)
    return replace(design, blocks=tuple(blocks), effects=())


UNIT = Variances(np.ones(1), np.zeros(0), np.ones(2))


@pytest.mark.parametrize("sizes", [(1.0, 1.0), (0.2, 5.0), (300.0, 1.0), (1000.0, 1000.0)])
def test_sizes_are_found(sizes: tuple[float, ...]) -> None:
    found = widths(classes(sizes), UNIT)
    assert found.converged
    ratio = found.variances.amplitudes / sizes
    assert (ratio > 0.4).all()
    assert (ratio < 2.0).all()


def test_without_knowledge_it_is_the_maximum_of_the_restricted_likelihood() -> None:
    design = classes((0.5, 4.0))
    found = widths(design, UNIT, known=0.0).variances
    slope = RestrictedLikelihood(MixedModel.of(design), design.theta(found)).derivatives[0]
    assert np.abs(slope[1:]).max() < 5e-3
    best = reml(design)
    again = widths(design, best, known=0.0).variances
    np.testing.assert_allclose(again.amplitudes, best.amplitudes, rtol=2e-3)


def test_a_class_without_errors_shrinks_and_counts_as_known() -> None:
    found = widths(classes((0.0, 1.0)), UNIT)
    assert found.variances.amplitudes[0] < 0.5
    assert 0.0 < found.by_prior < 24.0


def test_stated_blocks_keep_their_amplitudes() -> None:
    design = classes((1.0, 2.0))
    stated = replace(design.blocks[0], amplitude=0.3)
    found = widths(replace(design, blocks=(stated, design.blocks[1])), UNIT)
    assert found.variances.amplitudes[0] == 0.3
    assert found.variances.amplitudes[1] != 1.0
