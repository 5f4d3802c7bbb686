"""What a covariance in a span says of single values, and what it does not."""

from __future__ import annotations

import numpy as np
import pytest

from calib.model.covariance import covariance, determined


def test_values_whose_direction_is_in_the_span_are_determined(rng: np.random.Generator) -> None:
    eye = np.eye(5)
    span = np.column_stack([eye[0], eye[2], (eye[3] + eye[4]) / np.sqrt(2.0)])
    assert list(determined(span)) == [True, False, True, False, False]
    mixed = span @ rng.normal(size=(3, 3))  # another basis of the same span
    assert list(determined(mixed)) == [True, False, True, False, False]
    assert determined(rng.normal(size=(5, 5))).all()
    assert not determined(np.zeros((5, 0))).any()


def test_the_variance_outside_the_span_is_none(rng: np.random.Generator) -> None:
    """Why it must be asked: the covariance of the rest is zero, not unknown."""
    J, span = rng.normal(size=(40, 3)), np.eye(3)[:, :2]
    assert covariance(J, span)[2, 2] == 0.0
    assert not determined(span)[2]
    inverse = np.linalg.inv(J[:, :2].T @ J[:, :2])
    assert np.diag(covariance(J, span))[:2] == pytest.approx(np.diag(inverse))
