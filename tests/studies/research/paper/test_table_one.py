"""Table I of the paper against its reproduction, by two programs and by simulation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from studies.compare.agreement import agreement
from studies.compare.experiment import PLAIN, POINTS
from studies.research.paper import table_one
from studies.research.paper.table_one_search import NAMES, Experiment, predicted

PRINTED = json.loads((Path(__file__).parents[3] / "reference" / "paper.json").read_text())[
    "table_I"
]
KEYS = {"approach_1": PLAIN.key, "approach_2": POINTS.key}


def test_embedded_figures_are_those_printed() -> None:
    embedded = table_one.embedded()["printed"]
    for key in ("approach_1", "approach_2", "improvement"):
        assert embedded[key] == PRINTED[key]
    assert embedded["parameters"] == list(NAMES) == list(table_one.PARAMETERS)


def test_all_twelve_figures_are_reproduced() -> None:
    found = table_one.predictions_at(table_one.experiment_at(table_one.embedded_setting()))
    for key, way in KEYS.items():
        ours = found[way].std / table_one.SCALES
        assert table_one.within(ours, np.array(PRINTED[key])).all()
        np.testing.assert_allclose(ours, PRINTED["reproduced"][key], rtol=0.01)
    factors = found[PLAIN.key].std / found[POINTS.key].std
    np.testing.assert_allclose(factors, PRINTED["improvement"], rtol=0.15)


def test_a_second_program_predicts_the_same() -> None:
    """Equation (21) in closed form, which shares nothing with the model."""
    setting = table_one.embedded_setting()
    found = table_one.predictions_at(table_one.experiment_at(setting))
    theirs = predicted(Experiment(setting.q, setting.markers, setting.length))
    for own, way in zip(theirs, KEYS.values(), strict=True):
        np.testing.assert_allclose(found[way].std, own, rtol=1e-9)


@pytest.mark.long
def test_a_thousand_calibrations_scatter_as_predicted() -> None:
    experiment = table_one.experiment_at(table_one.embedded_setting())
    found = table_one.predictions_at(experiment)
    done = table_one.simulated(experiment, 1000)
    for way in KEYS.values():
        assert done.settled[way].all()
        judged = agreement(done.of(way), found[way].covariance)
        assert judged is not None
        standard_error = 1.0 / np.sqrt(2.0 * judged.trials)
        assert (np.abs(judged.ratio - 1.0) < 3.0 * standard_error).all()
        assert (np.abs(judged.bias_share) < 4.0).all(), "means equal the assigned values"
        assert judged.p > 0.01


def test_the_gain_is_the_weighting_of_approach_one() -> None:
    plain, full = table_one.random_factors(30, seed=4)
    assert plain.min() > 1.0 - 1e-9
    assert np.median(plain, axis=0).max() > 1.2
    np.testing.assert_allclose(full, 1.0, rtol=1e-9)


def test_where_the_base_stands_turned_has_no_influence() -> None:
    setting = table_one.embedded_setting()
    turned = table_one.Setting(
        setting.q + np.array([0.7, 0.0, 0.0]), setting.markers, setting.length
    )
    first, second = (
        table_one.predictions_at(table_one.experiment_at(s))[PLAIN.key].std
        for s in (setting, turned)
    )
    np.testing.assert_allclose(first, second, rtol=1e-9)


def test_printed_side_by_side() -> None:
    done = CliRunner().invoke(table_one.main, ["--trials", "50", "--settings", "5"])
    assert done.exit_code == 0, done.output
    line = next(row for row in done.output.splitlines() if row.startswith("dq2"))
    assert line.split()[:4] == ["dq2", "mdeg", "3.742", "3.650"]


@pytest.mark.parametrize(
    ("ours", "printed", "agrees"), [(0.0045, 0.004, True), (0.0047, 0.004, False), (2.2, 2.0, True)]
)
def test_agreement_is_a_share_or_the_rounding(ours: float, printed: float, agrees: bool) -> None:
    assert table_one.within(np.array([ours]), np.array([printed]))[0] == agrees
