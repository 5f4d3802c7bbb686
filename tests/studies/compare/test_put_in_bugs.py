"""Bugs put into the program, one at a time: ``compare`` must notice each, and nothing without one."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calib.arm import statics
from calib.arm.robot import Robot
from calib.arm.statics import Loads, Payload, Transmitted
from calib.arrays import Array
from calib.cell import Repeatability
from calib.files import cell as cell_files
from calib.identification.estimators import Estimator
from calib.instruments import points
from calib.model import Model
from calib.noise import Noise
from calib.poses import Poses
from tests.bad_inputs.run import Heard, posecal
from tests.studies.command_line import paper_cell

pytest.importorskip("mujoco")

SMALL = ("base", "joint_compliance:A2,A3,A5")
SOFT = "joint_compliance:A3.compliance"
Bug = Callable[[pytest.MonkeyPatch], None]


def changed(where: object, name: str, change: Callable[..., Any]) -> Bug:
    """``change`` is given what the function would return, and its arguments."""

    def bug(monkeypatch: pytest.MonkeyPatch) -> None:
        right = getattr(where, name)
        monkeypatch.setattr(where, name, lambda *given: change(right(*given), *given))

    return bug


def loads_with(masses: float, gravity: float) -> Bug:
    def bug(monkeypatch: pytest.MonkeyPatch) -> None:
        right = statics.loads_of

        def wrong(robot: Robot, poses: Poses, payload: Payload, g: Array) -> Loads:
            return right(replace(robot, masses=masses * robot.masses), poses, payload, gravity * g)

        monkeypatch.setattr(statics, "loads_of", wrong)

    return bug


def torques_too_large(found: Transmitted, *given: object) -> Transmitted:
    del given
    return replace(found, local=1.3 * found.local)


def one_column(factor: float) -> Bug:
    def wrong(found: tuple[Array, Array], model: Model, *given: object) -> tuple[Array, Array]:
        del given
        found[1][..., [p.id == SOFT for p in model.parameters]] *= factor
        return found

    return changed(Model, "_jacobian", wrong)


def first_two_exchanged(points: Array, *given: object) -> Array:
    del given
    order = [1, 0, *range(2, points.shape[-2])][: points.shape[-2]]
    return points[..., order, :] if len(order) > 1 else points


STATICS: dict[str, Bug] = {
    "torque x 1.3": changed(statics, "transmitted", torques_too_large),
    "gravity's sign": loads_with(masses=1.0, gravity=-1.0),
    "link masses x 3": loads_with(masses=3.0, gravity=1.0),
}
WEIGHTS: dict[str, Bug] = {
    "weights x 3": changed(Noise, "whitening", lambda W, *_: 3.0 * W),
    "weights / 1.5": changed(Noise, "whitening", lambda W, *_: W / 1.5),
    "sigma read x 3": changed(points, "_noise", lambda own, *_: Noise.isotropic(3.0 * own.along)),
}
DERIVATIVES = {"derivative x 1.05": (one_column(1.05), "4.76 %"),
               "derivative's sign": (one_column(-1.0), "200 %")}  # fmt: skip


def small_cell(folder: Path, robot: str, effects: tuple[str, ...]) -> Path:
    """The paper's cell, these effects unknown."""
    path = paper_cell(folder, *effects)
    path.write_text(path.read_text().replace("[robot]\n", f"[robot]\n{robot}\n"))
    return path


def compared(
    folder: Path, *options: str, robot: str = "", effects: tuple[str, ...] = SMALL
) -> tuple[Heard, dict[str, Any]]:
    cell, out = small_cell(folder, robot, effects), folder / "out.json"
    call = ["compare", str(cell), str(folder / "plan.csv"), "--monte-carlo", "20", "--workers", "1"]
    heard = posecal(*call, *options, "--json", str(out))
    return heard, json.loads(out.read_text())["agreement"] if out.exists() else {}


def refuted(found: dict[str, Any], why: str) -> bool:
    return found["believed"] is False and bool(
        re.match(rf"refuted at plan\.csv.*{why}", found["says"])
    )


@pytest.mark.parametrize("robot", ["", "repeatability_mm = 0.02\nrepeatability_urad = 20"])
def test_without_a_bug_it_agrees(tmp_path: Path, robot: str) -> None:
    heard, found = compared(tmp_path, robot=robot)
    assert found["believed"] is True, found
    assert found["chi2_p"] > 0.01
    assert "Simulation and prediction agree." in heard.out
    assert "readings simulated by MuJoCo's arm" in " ".join(heard.out.split())


@pytest.mark.sampled
@pytest.mark.parametrize("bug", STATICS)
def test_statics_are_refuted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bug: str) -> None:
    STATICS[bug](monkeypatch)
    _, found = compared(tmp_path)
    assert found["chi2_p"] < 1e-12
    assert refuted(found, "kinematics, torques or masses are wrong")


def test_against_its_own_model_a_fault_of_the_statics_cancels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    STATICS["torque x 1.3"](monkeypatch)
    _, blind = compared(tmp_path, "--truth", "model")
    assert blind["believed"] is True


@pytest.mark.sampled
@pytest.mark.parametrize("bug", WEIGHTS)
def test_weights_are_refuted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bug: str) -> None:
    """Whatever the truth: the noise is not drawn by the weights."""
    WEIGHTS[bug](monkeypatch)
    _, found = compared(tmp_path, "--truth", "model")
    assert found["chi2_p"] < 1e-12
    assert refuted(found, "weighted by other noise than the cell states")


@pytest.mark.long
def test_an_arm_that_scatters_otherwise_than_stated_is_refuted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(found: Repeatability, *given: object) -> Repeatability:
        del given
        return Repeatability(3.0 * found.translation, 3.0 * found.rotation)

    changed(cell_files, "_repeatability", wrong)(monkeypatch)
    _, found = compared(tmp_path, robot="repeatability_mm = 0.02\nrepeatability_urad = 20")
    assert found["chi2_p"] < 1e-12
    assert refuted(found, "")


@pytest.mark.parametrize("bug", DERIVATIVES)
def test_derivatives_are_refuted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bug: str) -> None:
    """Before anything is simulated."""
    put, size = DERIVATIVES[bug]
    put(monkeypatch)
    _, found = compared(tmp_path, "--monte-carlo", "0")
    assert refuted(found, re.escape(f"the derivative by {SOFT} is {size} off"))


@pytest.mark.long
@pytest.mark.parametrize("truth", ["model", "mujoco"])
def test_exchanged_markers_end_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, truth: str
) -> None:
    changed(Model, "tip_points", first_two_exchanged)(monkeypatch)
    heard, _ = compared(tmp_path, "--truth", truth, effects=(*SMALL, "tool"))
    assert heard.status == 2
    assert len(heard.err.strip().splitlines()) == 1
    assert heard.err.startswith("posecal: simulated readings: identify refuses what posecal drew")
    assert "the program or an added effect is at fault" in heard.err


@pytest.mark.long
def test_degrees_of_freedom_that_are_too_many_are_refuted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changed(Estimator, "dof", lambda dof, *_: dof + 40)(monkeypatch)
    _, found = compared(tmp_path, "--monte-carlo", "200")
    assert found["chi2_p"] > 1e-3, "the refits take their noise as stated"
    assert refuted(found, "fits from raw data (do not agree|estimate another noise)")
