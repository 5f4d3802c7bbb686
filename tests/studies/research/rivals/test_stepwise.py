"""Stepwise selection against brute force, and on a case whose cause is known."""

from __future__ import annotations

import json
from itertools import chain, combinations
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("mujoco")

import calib
from studies.research.rivals.__main__ import main
from studies.research.rivals.stepwise import Screen, stepwise
from studies.research.withheld.draw import Case, draw_case
from studies.research.withheld.keys import write_case

N, OWN, SUSPECTS = 60, 4, 5


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, Screen]:
    """A model's columns, those of suspects (one of them two columns) and a residual."""
    rng = np.random.default_rng(seed)
    model, X = rng.normal(size=(N, OWN)), rng.normal(size=(N, SUSPECTS + 1))
    X /= np.linalg.norm(X, axis=0)
    r = rng.normal(size=N) + 6.0 * X[:, 2]
    Q, _ = np.linalg.qr(model)
    rest, r_rest = X - Q @ (Q.T @ X), r - Q @ (Q.T @ r)
    columns = (*(np.array([k]) for k in range(SUSPECTS - 1)), np.array([4, 5]))
    screen = Screen(rest.T @ rest, rest.T @ r_rest, float(r_rest @ r_rest), N, columns)
    return model, X, r, screen


def test_criterion_is_that_of_whole_least_squares() -> None:
    model, X, r, screen = problem(0)
    for members in chain(*(combinations(range(SUSPECTS), k) for k in range(SUSPECTS + 1))):
        own = [c for i in members for c in screen.columns[i]]
        whole = np.hstack([model, X[:, own]])
        values = np.linalg.lstsq(whole, r, rcond=None)[0]
        expected = N * np.log(((r - whole @ values) ** 2).mean()) + 2.0 * len(own)
        assert screen.criterion(members, 2.0) == pytest.approx(expected)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[Case, Path]:
    """A single cause that nobody can overlook."""
    for seed in range(100):
        case = draw_case(np.random.default_rng([8, seed]), "single")
        if case.noncentrality[0] > 800.0 and case.causes[0].effect == "backlash":
            break
    folder = tmp_path_factory.mktemp("known") / "case"
    write_case(folder, case)
    return case, folder


def loaded(folder: Path) -> tuple[calib.Cell, calib.Measurements, calib.Measurements]:
    cell = calib.load_cell(folder / "cell.toml")
    tables = [
        calib.load_measurements(cell, folder / f"{n}.csv") for n in ("measurements", "heldout")
    ]
    return cell, *calib.in_one_session(*tables)


@pytest.mark.long
def test_great_cause_is_named_and_measured(known: tuple[Case, Path]) -> None:
    case, folder = known
    cell, data, heldout = loaded(folder)
    cause = case.causes[0]
    for schwarz in (False, True):
        found = stepwise(cell, data, heldout, schwarz=schwarz)
        assert found["verdict"] == "explained"
        first = found["effects"][0]
        assert (first["effect"], first["where"]) == (cause.effect, cause.where)
        assert first["probability"] > 0.99
        (value,) = first["parameters"]
        truth = cause.values["half_width"] * cause.size * 1e6
        assert abs(value["value"] - truth) < 5.0 * value["std"]
        gap = found["gap"]
        assert gap["heldout_after_mm"] < 0.9 * gap["heldout_before_mm"]
        assert found["located"][0]["where"] == cause.where


@pytest.mark.long
def test_command_answers_or_says_why_not(
    known: tuple[Case, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, folder = known
    answer = tmp_path / "answer.json"
    files = [str(folder / name) for name in ("cell.toml", "measurements.csv", "heldout.csv")]
    done = CliRunner().invoke(main, ["bic", *files, str(answer)])
    assert done.exit_code == 0, done.output
    assert json.loads(answer.read_text())["effects"][0]["effect"] == case.causes[0].effect
    for fault, said in ((str(tmp_path / "no.toml"), "cannot be read"), (files[0], "scikit-learn")):
        monkeypatch.setattr("studies.research.rivals.__main__.find_spec", lambda name: None)
        done = CliRunner().invoke(main, ["black-box", fault, *files[1:], str(answer)])
        assert done.exit_code == 2
        assert said in done.output
        assert len(done.output.splitlines()) == 1
