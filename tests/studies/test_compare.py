"""Predicted covariances and refits of both approaches, by cameras and by arms that scatter."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

import calib
from calib import Cell, Poses
from calib.arm.se3 import fit_rigid, rotate, transform
from calib.arrays import Array
from calib.cell import Repeatability
from calib.cell.planned import Planned
from calib.files.write_tables import plan_csv
from calib.noise import Noise
from calib.observations import with_measured_shape
from calib.poses import Measurements, poses_at
from studies.compare import simulate
from studies.compare.experiment import POINTS, WAYS, experiment_of, predict
from studies.compare.simulate import MOST_TRIALS, Refits, agreement, engine, refits
from studies.results.compare import (
    Agreement,
    ComparedApproach,
    ComparedPlan,
    OverallAgreement,
    compared,
)
from tests.camera_cells import camera_text, kr270_cell
from tests.helpers import (
    cell_of,
    first_markers,
    random_poses,
    random_robot,
    read_by,
    simulated,
    with_effects,
)
from tests.studies.command_line import paper_cell, refused, result, run


def compare(cell: Cell, plan: Poses, trials: int = 0, seed: int = 0) -> ComparedPlan:
    """One plan, compared."""
    (found,) = compared(cell, {"p": plan}, trials, seed=seed)
    return found


def known_std(own: ComparedApproach) -> Array:
    """Standard deviations in their units, NaN where open."""
    return np.array([p.std for p in own.parameters], dtype=float)


def random_cell(seed: int, dof: int, markers: int, *effects: str) -> tuple[Cell, Poses]:
    """A cell with nothing special about it and twelve poses in it."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, dof, prismatic=(1,) if seed % 3 == 0 else ())
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (markers, 3)), effects)
    return cell, random_poses(rng, robot, 12)


@settings(max_examples=4)
@given(st.integers(0, 10_000), st.integers(3, 7), st.integers(3, 6))
def test_full_covariance_makes_the_approaches_equal(seed: int, dof: int, markers: int) -> None:
    """For known marker geometry; base, geometry and compliances estimated, tracker noise."""
    cell, plan = random_cell(seed, dof, markers, "base", "geometry", "joint_compliance")
    cell = replace(cell, instruments=read_by(Noise(3e-6, 5e-6, 0.0, 2e-6)))
    experiment = experiment_of(cell, plan, seed=seed)
    found = {way.key: predict(experiment, way) for way in WAYS}
    points, full = found["points"].covariance, found["pose full"].covariance
    scale = np.sqrt(np.diag(points))
    scale[scale == 0.0] = 1.0
    np.testing.assert_allclose(
        full / np.outer(scale, scale), points / np.outer(scale, scale), atol=1e-9
    )
    known = np.isfinite(found["points"].std)
    np.testing.assert_allclose(found["pose full"].std[known], found["points"].std[known], rtol=1e-9)
    for key in ("pose plain", "pose normalised"):
        assert (found[key].std[known] > found["points"].std[known] * (1.0 - 1e-9)).all()


def test_prediction_is_the_inverse_of_the_information(kr270: Cell, table_two: Poses) -> None:
    """Against the observation matrices of the public interface."""
    B = calib.observation(kr270, table_two).reshape(-1, 42) / kr270.noise.across
    scale = np.linalg.norm(B, axis=0)
    std = np.sqrt(np.diag(np.linalg.inv((B / scale).T @ (B / scale)))) / scale
    found = predict(experiment_of(kr270, table_two), POINTS)
    np.testing.assert_allclose(found.std, std, rtol=1e-6)


def test_one_marker_leaves_approach_two(kr270: Cell, table_two: Poses) -> None:
    found = compare(first_markers(kr270, 1), table_two, 4)
    assert [own.key for own in found.approaches] == ["points"]
    assert not found.improvement


def test_a_parameter_that_the_plan_leaves_open_is_said(kr270: Cell, table_two: Poses) -> None:
    """A1 parallel to gravity: its compliance cannot be seen, the others can."""
    cell = with_effects(
        kr270, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6", "joint_offset:A1"
    )
    few = table_two.take(np.arange(3))
    points = compare(cell, few, 6).points
    open_ = np.isnan(known_std(points))
    assert open_.any()
    assert not open_.all()
    assert points.task_rms_mm is None
    simulated = np.array([p.monte_carlo_std for p in points.parameters], dtype=float)
    np.testing.assert_array_equal(np.isnan(simulated), open_)
    experiment = experiment_of(cell, few)
    done = refits(experiment, [predict(experiment, POINTS)], 6)
    assert not done["points"].errors[:, open_].any()


def drawn(cov: Array, trials: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).multivariate_normal(np.zeros(len(cov)), cov, trials)


def p_of(errors: Array, cov: Array) -> float:
    """How probable errors (trials, p) are under a predicted covariance."""
    return agreement(errors, cov).p


COV = np.array([[4.0, 1.9, 0.0], [1.9, 1.0, 0.0], [0.0, 0.0, 9.0]]) * 1e-12


def test_p_values_are_uniform_or_rarer_where_the_prediction_is_right() -> None:
    p = np.array([p_of(drawn(COV, 200, seed), COV) for seed in range(400)])
    for level in (0.01, 0.05, 0.2):
        assert np.mean(p < level) < level + 3.0 * np.sqrt(level / 400)
    assert np.mean(p < 0.2) > 0.03, "and not for want of power"


WRONG = {
    "too wide": drawn(COV * 1.3, 500),
    "too narrow": drawn(COV / 1.3, 500),
    "biased": drawn(COV, 500) + np.array([0.3e-6, 0.0, 0.0]),
    "uncorrelated": drawn(np.diag(np.diag(COV)), 500),
}


@pytest.mark.parametrize("how", WRONG)
def test_a_wrong_prediction_is_refuted(how: str) -> None:
    assert p_of(WRONG[how], COV) < 1e-3


def test_agreement_of_directions_that_are_fixed_and_of_nothing() -> None:
    joined = np.array([[1.0, 1.0], [1.0, 1.0]]) * 1e-12
    errors = np.repeat(np.random.default_rng(0).normal(0.0, 1e-6, (300, 1)), 2, axis=1)
    assert p_of(errors, joined) > 0.01
    assert agreement(errors[:1], joined) is None
    assert agreement(errors, np.zeros((2, 2))) is None


def parallel_arm(seed: int, markers: int, *effects: str) -> tuple[Cell, Poses]:
    """Four parallel axes and a slide along them: base and markers share a direction."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 4, prismatic=(2,))
    turned = np.broadcast_to(np.eye(3), (5, 3, 3))
    shifted = np.array([[0, 0, 0.4], [0.3, 0, 0], [0.25, 0, 0.1], [0, 0, 0], [0, 0, -0.1]])
    robot = replace(
        robot, origins=transform(turned, shifted), axes=np.tile([0.0, 0.0, 1.0], (4, 1))
    )
    points = rng.uniform(-0.1, 0.1, (markers, 3))
    low, high = robot.sample_limits().T
    return cell_of(robot, points, effects), poses_at(rng.uniform(low, high, (15, 4)))


@pytest.mark.long
def test_no_way_is_better_than_the_points_where_base_and_tool_overlap() -> None:
    """One marker component is dropped there; the shape that #1 measures must not mix with it."""
    cell, plan = parallel_arm(1, 3, "base", "tool", "geometry")
    assert len(calib.parameters(cell)) < 6 + 9 + 18
    found = compare(cell, plan, 300)
    for own in found.approaches:
        assert (known_std(own) > known_std(found.points) * (1.0 - 1e-6)).all()
        assert own.agreement.chi2_p > 1e-3, own.key
    (full,) = (own for own in found.approaches if own.key == "pose full")
    np.testing.assert_allclose(known_std(full), known_std(found.points), rtol=1e-6)


def test_open_parameters_are_the_same_for_every_way(kr270: Cell, table_two: Poses) -> None:
    cell = with_effects(kr270, "base", "tool", "geometry")
    few = replace(table_two.take(np.arange(4)))
    found = compare(replace(cell, load=None), few)
    robot = [p.effect == "geometry" for p in found.points.parameters]
    open_ = np.isnan(known_std(found.points))[robot]
    assert open_.any()
    for own in found.approaches:
        assert not (np.isfinite(known_std(own))[robot] & open_).any()


def test_a_load_effect_is_predicted_on_an_elastic_arm(kr270: Cell, table_two: Poses) -> None:
    """On a rigid one it would move nothing, and every figure would be undefined."""
    elastic = [e for e in kr270.effects if "stiffness" in e or "compliance" in e]
    anchors = {"A2": np.array([[-0.686, 0.0, 0.123], [0.185, 0.0, 0.0]])}
    cell = replace(with_effects(kr270, *elastic, "gravity_compensator:A2"), anchors=anchors)
    for own in compare(cell, table_two).approaches:
        assert np.isfinite(known_std(own)).all()


def test_shape_of_markers_seen_in_turn_is_the_best_fit(kr270: Cell, table_two: Poses) -> None:
    """Six markers, three at a time: the least-squares shape, against SciPy."""
    from scipy.optimize import least_squares

    rng = np.random.default_rng(0)
    cell = with_effects(cell_of(kr270.robot, rng.uniform(-0.2, 0.2, (6, 3)), ()), "base", "tool")
    experiment = experiment_of(cell, table_two)
    seen = np.zeros((15, 6), dtype=bool)
    for i in range(15):
        seen[i, rng.permutation(6)[:4]] = True
    exact = experiment.model.predict(experiment.nominal, experiment.poses)
    points = exact + 1e-5 * rng.standard_normal(exact.shape)
    data = Measurements(experiment.poses, points, seen, np.full(seen.shape, np.nan))
    measured = with_measured_shape(experiment.model, data, experiment.nominal)
    shape = experiment.model.marker_positions(measured)

    def misfit(flat: Array) -> Array:
        own = flat.reshape(6, 3)
        T = fit_rigid(points, own, seen.astype(float))
        rest = points - rotate(T[:, None, :3, :3], own) - T[:, None, :3, 3]
        return (rest * seen[..., None]).ravel() * 1e5

    best = least_squares(misfit, cell.markers.ravel(), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    ours = float((misfit(shape.ravel()) ** 2).sum())
    assert ours == pytest.approx(2.0 * best.cost, rel=1e-6)


@pytest.mark.parametrize(
    ("trials", "p", "failed", "believed", "says"),
    [
        (0, 0.5, 0, None, "nothing was simulated"),
        (19, 0.5, 0, None, "19 simulated experiments are too few to tell: simulate 20 or more"),
        (40, 0.5, 0, True, "simulation and prediction agree"),
        (40, 1e-4, 0, False, "refuted for points at p: believe the simulated figures"),
        (40, 0.5, 3, False, "3 of 40 fits of points at p did not converge: the plan hardly"),
    ],
)
def test_too_few_trials_and_fits_that_fail_are_no_belief(
    trials: int, p: float, failed: int, believed: bool | None, says: str
) -> None:
    plan = compare(*random_cell(1, 3, 1, "tool"), trials=20)
    (own,) = plan.approaches
    agreed = Agreement(worst_ratio=1.1, chi2_p=p)
    changed = own.model_copy(update={"agreement": agreed, "not_converged": failed})
    judged = OverallAgreement.of([plan.model_copy(update={"approaches": (changed,)})], trials)
    assert judged.believed is believed
    assert judged.says.startswith(says)


EFFECTS = ("base", "tool", "joint_offset", "joint_compliance:A2,A3")


@pytest.fixture(scope="module")
def again(kr270: Cell, table_two: Poses) -> tuple[Cell, Poses]:
    """An arm that scatters; Table II, and three of its poses once more."""
    cell, arm = with_effects(kr270, *EFFECTS), Repeatability(3e-5, 1e-4)
    plan = poses_at(np.concatenate([table_two.q, table_two.q[[1, 5, 9]]]))
    return replace(cell, repeatability=arm, design=Planned()), plan


@pytest.mark.long
def test_refits_scatter_as_predicted(again: tuple[Cell, Poses]) -> None:
    """Both approaches in every weighting, free and loaded in one visit, poses visited again."""
    found = compare(*again, trials=100, seed=2)
    assert len(found.approaches) == 4
    for own in found.approaches:
        assert own.agreement.chi2_p > 1e-3
        assert own.monte_carlo_task_rms_mm == pytest.approx(own.task_rms_mm, rel=0.12)
    cell, plan = again
    blind = compare(replace(cell, repeatability=None), plan)
    assert found.points.task_rms_mm > 2.0 * blind.points.task_rms_mm


def test_a_prediction_that_forgets_the_arm_is_refuted(again: tuple[Cell, Poses]) -> None:
    """Errors of the right size for an arm that scatters, judged as of one that does not."""
    experiment = experiment_of(*again)
    way = experiment.ways[-1]
    forgetful = predict(replace(experiment, arm=None), way)
    assert p_of(drawn(predict(experiment, way).covariance, 200), forgetful.covariance) < 1e-6


TWO_READ = """repeatability_mm = 0.03
repeatability_urad = 100
[markers_mm]
m1 = [279.2, -16.4, -91.9]
m2 = [279.2, -25.2, 96.1]
[bodies.target]
position_mm = [280, 0, 0]
[instruments.laser]
kind = "points"
sigma_mm = 1e-9
[instruments.probe]
kind = "pose"
sigma_mm = 1e-9
sigma_urad = 1e-6
[load]
mass_kg = 10
com_mm = [0, 0, 0]
"""


def test_the_arm_comes_elsewhere_at_each_visit(tmp_path: Path, table_two: Poses) -> None:
    """One rigid motion about the tip a visit, free and loaded, of the stated size, whoever reads."""
    path = kr270_cell(tmp_path, TWO_READ, effects=("base", "tool", "joint_offset:A2,A3"))
    experiment = experiment_of(calib.load_cell(path), table_two)
    exact = experiment.model.predict(experiment.truth, experiment.poses)
    off = experiment.drawn(200, np.random.default_rng(3)) - exact
    frames = experiment.model.state(experiment.truth, experiment.poses).frames
    away = exact[:, :2, :3] - frames.o[:, -1:]
    turned = axes_turned(exact, off)
    for marker in range(2):
        shift = off[:, :, marker, :3] - np.cross(turned, away[:, marker])
        assert spread(shift) == pytest.approx(3e-5, rel=0.05)
    np.testing.assert_allclose(turned[:, ::2], turned[:, 1::2], atol=1e-9)
    assert (np.abs(np.diff(turned[:, ::2], axis=1)).max(axis=(0, 2)) > 1e-5).all()
    assert spread(turned) == pytest.approx(1e-4, rel=0.05)
    np.testing.assert_allclose(np.corrcoef(turned[:, 0].T), np.eye(3), atol=0.3)


def axes_turned(exact: Array, off: Array) -> Array:
    """Small rotation (trials, m, 3) of the body that the second instrument reads, in base axes."""
    x, y = exact[:, 2, 3:6], exact[:, 2, 6:]
    z = np.cross(x, y)
    moved = off[:, :, 2, 3:6], off[:, :, 2, 6:]
    by_x, by_y = -(moved[0] * z).sum(-1), (moved[0] * y).sum(-1)
    return ((moved[1] * z).sum(-1))[..., None] * x + by_x[..., None] * y + by_y[..., None] * z


def spread(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's cell with its elastostatic model, two poses of its plan at each level, and fewer."""
    path = tmp_path_factory.mktemp("cell")
    paper_cell(path, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
    rows = (path / "plan.csv").read_text().splitlines()
    two = [row for k, row in enumerate(rows[1:]) if k % 3]
    (path / "plan.csv").write_text("\n".join([rows[0], *two, ""]))
    (path / "shorter.csv").write_text("\n".join([rows[0], *rows[1::2], ""]))
    return path


@pytest.fixture(scope="module")
def shown(folder: Path) -> tuple[dict[str, Any], str]:
    """The JSON of two plans, compared, and what is printed; two figures."""
    plans = (folder / "plan.csv", folder / "shorter.csv")
    more = ("--monte-carlo", 60, "--workers", 1, "--figures", folder / "figures")
    return result(folder / "out.json", "compare", folder / "cell.toml", *plans, *more)


@pytest.mark.long
def test_figures_are_consistent(shown: tuple[dict[str, Any], str]) -> None:
    plans, ratios, task = shown[0]["plans"], [], []
    for plan in plans:
        ways = {(own["approach"], own["weighting"]): own for own in plan["approaches"]}
        plain, points = ways["pose", "plain"], ways["points", "full"]
        pairs = zip(plain["parameters"], points["parameters"], plan["improvement"], strict=True)
        for a, b, gain in pairs:
            assert gain["factor"] == pytest.approx(a["std"] / b["std"])
            assert b["monte_carlo_std"] == pytest.approx(b["std"], rel=0.3)
        full = pytest.approx(ways["pose", "full"]["task_rms_mm"], rel=1e-9)
        assert points["task_rms_mm"] == full
        task.append(points["task_rms_mm"])
        for own in plan["approaches"]:
            ratios += [p["monte_carlo_std"] / p["std"] for p in own["parameters"]]
    whole, half = task
    assert half > whole
    worst = shown[0]["agreement"]["worst_ratio"]
    assert any(worst == pytest.approx(r) for r in ratios)


@pytest.mark.long
def test_the_answer_comes_first(folder: Path, shown: tuple[dict[str, Any], str]) -> None:
    _, said = shown
    assert said.startswith("kr270 milling cell: Best of 2 plans: plan.csv, with an expected error")
    assert re.search(r"error of [\d.]+ mm RMS from marker points \(#2\)\.", said)
    for words in (
        "shorter.csv has to be measured",
        "60 simulated experiments a plan",
        "Weighted by its full covariance, #1 equals #2",
        "2 figures to",
    ):
        assert words in said
    made = {path.name for path in (folder / "figures").iterdir()}
    assert made == {"deviations_by_approach.svg", "ellipses.svg"}


def test_figures_of_a_plan_that_leaves_parameters_open(small: Path) -> None:
    """What cannot be drawn is left out; the result is not lost with it."""
    plan = small / "plan.csv"
    plan.write_text("\n".join([*plan.read_text().splitlines()[:3], ""]))
    call = ("compare", small / "cell.toml", plan, "--monte-carlo", 20, "--workers", 1)
    _, said = result(small / "out.json", *call, "--figures", small / "figures")
    assert "plan.csv does not determine" in said
    assert "deviations_by_approach" in {path.stem for path in (small / "figures").iterdir()}


def of_small(folder: Path) -> tuple[object, ...]:
    return "compare", folder / "cell.toml", folder / "plan.csv"


def test_nothing_simulated(small: Path) -> None:
    found, said = result(small / "out.json", *of_small(small), "--monte-carlo", 0)
    assert found["trials"] == 0
    assert found["agreement"]["worst_ratio"] is None
    assert found["agreement"]["chi2_p"] is None
    assert found["plans"][0]["approaches"][0]["parameters"][0]["monte_carlo_std"] is None
    assert "Nothing was simulated" in said


BOARD = '[boards.b]\non = "tip"\nsquares = [8, 11]\npitch_mm = 20\n'
CAMERA = "position_mm = [4500, 0, 1000]\nrpy_deg = [-90, 0, {}]"


@pytest.fixture
def photographed(tmp_path: Path) -> Path:
    """Poses that show the board to a camera before the arm, and a cell with one that looks away."""
    for name, turn in (("away", -90), ("ahead", 90)):
        camera = camera_text("cam", "world", CAMERA.format(turn))
        path = kr270_cell(tmp_path, BOARD, camera, effects=("base", "tool", "geometry"))
        path.rename(tmp_path / f"{name}.toml")
    cell, rng = calib.load_cell(tmp_path / "ahead.toml"), np.random.default_rng(0)
    turns = np.array([0, -60, 90, 0, 30, 0])
    turns = turns + rng.uniform(-1.0, 1.0, (15, 6)) * (20, 20, 20, 34, 34, 34)
    poses = poses_at(np.radians(turns), names=tuple(f"p{i}" for i in range(15)))
    (tmp_path / "near.csv").write_text(plan_csv(cell, poses))
    return tmp_path


@pytest.mark.long
def test_a_camera_alone_is_predicted_simulated_and_drawn(photographed: Path) -> None:
    figures, cell = photographed / "figures", photographed / "ahead.toml"
    call = ("compare", cell, photographed / "near.csv", "--monte-carlo", 40, "--workers", 1)
    found, _ = result(photographed / "r.json", *call, "--figures", figures)
    (plan,) = found["plans"]
    assert [own["approach"] for own in plan["approaches"]] == ["points"]
    assert found["agreement"]["believed"] is True
    assert {path.stem for path in figures.glob("*.svg")} >= {"deviations_by_approach", "ellipses"}


@pytest.mark.parametrize("trials", [0, 20])
def test_a_camera_that_sees_nothing_is_refused_in_a_line(photographed: Path, trials: int) -> None:
    call = ("compare", photographed / "away.toml", photographed / "near.csv")
    line = refused(*call, "--monte-carlo", trials)
    for words in ("away.toml", "cam sees no point at any pose of near.csv", "posecal design"):
        assert words in line


# -- Who computes the trials changes no digit; faults end in one line


NOWHERE = "tcp://127.0.0.1:1"


@contextmanager
def pool(who: str) -> Iterator[Executor | None]:
    """Two processes, alone or as a dask cluster."""
    if who == "processes":
        with engine(workers=2) as processes:
            yield processes
    else:
        distributed = pytest.importorskip("distributed")
        local = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
        with (
            distributed.LocalCluster(n_workers=2, threads_per_worker=1, **local) as cluster,
            engine(scheduler=cluster.scheduler_address) as workers,
        ):
            yield workers


@cache
def computed(trials: int, executor: Executor | None = None) -> dict[str, Refits]:
    """Refits of a small experiment without what its model remembers, here or by others."""
    cell, plan = random_cell(1, 3, 3, "tool", "joint_compliance")
    experiment = experiment_of(cell, plan.take(np.arange(5)))
    predictions = [predict(experiment, way) for way in experiment.ways]
    fresh = replace(experiment, model=replace(experiment.model))
    return refits(fresh, predictions, trials, seed=(5, 1), executor=executor)


@pytest.mark.long
@pytest.mark.parametrize("who", ["processes", "dask"])
def test_no_digit_depends_on_who_computes(who: str) -> None:
    with pool(who) as executor:
        for trials in (MOST_TRIALS, MOST_TRIALS + 17):  # one block; a whole one and a part
            here, there = computed(trials), computed(trials, executor)
            assert len(here) == 4
            assert here.keys() == there.keys()
            for way, own in here.items():
                assert len(own.cost) == trials
                assert own.errors.any()
                np.testing.assert_array_equal(there[way].errors, own.errors)
                np.testing.assert_array_equal(there[way].settled, own.settled)


def die(*_: object) -> None:
    os._exit(1)


FAR, HERE = ("--scheduler", NOWHERE), ("--monte-carlo", "200", "--workers", "2")
FAULTS = {  # what is patched, options, words
    "nothing listens": ((simulate, "_PATIENCE_S", 1), FAR, f"--scheduler: .*{NOWHERE}"),
    "no dask": ((sys.modules, "distributed", None), FAR, "dask is not installed.*pip install"),
    "a worker dies": ((simulate, "refit", die), HERE, "--workers: 2.*a worker died"),
}


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_who_cannot_compute_is_told_in_a_line(
    fault: str, small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place, name, value), options, words = FAULTS[fault]
    if fault == "nothing listens":
        pytest.importorskip("distributed")
    change = monkeypatch.setitem if place is sys.modules else monkeypatch.setattr
    change(place, name, value)
    line = refused(*of_small(small), *options)
    assert line.startswith("posecal: --")
    assert re.search(words, line)


@pytest.mark.long
def test_a_fault_of_a_block_is_not_hidden(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "refit", divmod)
    done = run(*of_small(small), *HERE)
    assert isinstance(done.exception, TypeError)


# -- Predicted covariance against 400 refits of the paper's experiment (Tables II to IV)

TRIALS = 400


@pytest.mark.long
def test_prediction_and_simulation_agree(kr270: Cell, table_two: Poses) -> None:
    """The demonstration's truth, a base far off included; fits start a tenth away from it."""
    _, _, truth = simulated(kr270, table_two, 0)
    experiment = replace(experiment_of(kr270, table_two), truth=truth, nominal=0.9 * truth)
    prediction = predict(replace(experiment, nominal=experiment.truth), POINTS)
    done = refits(experiment, [prediction], TRIALS, seed=1)
    assert done["points"].settled.all()
    errors, cov = done["points"].errors, prediction.covariance
    std = np.sqrt(np.diag(cov))

    bias = errors.mean(axis=0) / (std / np.sqrt(TRIALS))
    assert np.abs(bias).max() < 4.0, "the mean error lies within Monte Carlo error"

    ratio = errors.var(axis=0, ddof=1) / std**2
    low, high = chi2.ppf([0.0005, 0.9995], TRIALS - 1) / (TRIALS - 1)
    assert (ratio > low).all(), "every variance inside its 99.9 % chi-square band"
    assert (ratio < high).all()
    assert ratio.mean() == pytest.approx(1.0, abs=0.045), "within 4.5 % of the Cramer-Rao bound"

    whitened = np.linalg.solve(np.linalg.cholesky(cov), errors.T)
    total, dof = float((whitened**2).sum()), TRIALS * errors.shape[1]
    assert 1e-3 < chi2.cdf(total, dof) < 1.0 - 1e-3, "the whole covariance, correlations included"
