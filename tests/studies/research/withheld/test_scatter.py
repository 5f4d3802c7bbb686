"""Arms that scatter from approach to approach: the law, its size, and cases without it as they were."""

from __future__ import annotations

import hashlib
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import chi2

from calib.arrays import Array

pytest.importorskip("mujoco")

from studies.research.withheld.__main__ import main
from studies.research.withheld.draw import Case, draw_case, with_scatter
from studies.research.withheld.keys import cell_text, key_of, write_case
from studies.research.withheld.robots import ARMS, RAIL
from studies.research.withheld.scene import RATIO, Scatter, Scene
from studies.research.withheld.seal import read_json
from studies.research.withheld.visible import Projector, at_rest, modelled_columns
from tests.studies.research.withheld.scenes import PLAIN, scene_of

# Of the files before arms scattered: sha256 over cell, table of the hold-out, table and URDF.
UNTOUCHED = {
    (3, "null"): "136056e61882f022",
    (6, "null"): "76b6d383ec80ffdf",
    (8, "outside"): "28066001d5292f55",
}
KINDS = ("joints", "tip")


@pytest.fixture(scope="module", params=KINDS)
def case(request: pytest.FixtureRequest) -> Case:
    """A null on the rail's arm that scatters at one of both places."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "studies.research.withheld.draw._conditions", lambda rng: replace(PLAIN, hidden=True)
        )
        for seed in range(40):
            found = draw_case(np.random.default_rng([7, seed]), "null", arm_noise=True)
            scatter = found.scene.scatter
            assert scatter is not None
            if found.scene.arm is RAIL and scatter.joints.any() == (request.param == "joints"):
                return found
    raise AssertionError("no such case in forty")


def by_differences(scene: Scene, scatter: Scatter) -> Array:
    """Readings moved by one standard deviation of each joint and of the tip, (N, M, 3, n + 6)."""
    arm, step = scene.arm, 1e-6
    q = scene.session.q + scene.compliance * at_rest(scene, scene.mechanism(), ()).torque

    def points(dq: Array, tip: Array) -> Array:
        markers = scene.markers + tip[:3] + np.cross(tip[3:], scene.markers)
        posed = replace(scene, markers=markers).mechanism().posed(q + dq)
        return np.asarray(posed.points @ scene.R.T)

    columns = []
    for k, size in enumerate(scatter.std):
        unit = np.eye(arm.dof + 6)[k] * step
        ends = [points(s * unit[: arm.dof], s * unit[arm.dof :]) for s in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2 * step) * size)
    return np.stack(columns, axis=-1)


def covariance(case: Case, rows: np.ndarray) -> Array:
    """Of chosen readings (N, M), written out: noise of each point, what readings of one stay share."""
    scene = case.scene
    assert scene.scatter is not None
    A = by_differences(scene, scene.scatter)[rows].reshape(-1, scene.arm.dof + 6)
    stay = np.repeat(np.nonzero(rows)[0] // 2, 3)  # free and loaded follow each other
    return np.asarray(
        (A @ A.T) * (stay[:, None] == stay) + scene.noise.sigma**2 * np.eye(len(stay))
    )


@pytest.mark.parametrize(("index", "family"), UNTOUCHED)
def test_without_the_option_cases_stay(index: int, family: str, tmp_path: Path) -> None:
    """To the last digit: seeds of published figures must give the same files."""
    case = draw_case(np.random.default_rng([77, index]), family)
    write_case(tmp_path / f"case_{index:04d}", case)
    own = sorted((tmp_path / f"case_{index:04d}").iterdir())
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in own)).hexdigest()
    assert digest.startswith(UNTOUCHED[index, family])
    key = key_of(case, "case", index, "salt")
    assert "arm_noise" not in key
    assert "arm_noise" not in key["conditions"]


@pytest.mark.long
def test_readings_err_by_their_covariance(case: Case) -> None:
    """Chi-square of all that was read, and the same with the arm taken for exact, far off."""
    r = (case.noisy - case.clean)[case.seen].ravel()
    total = float(r @ np.linalg.solve(covariance(case, case.seen), r))
    assert 0.001 < chi2.sf(total, len(r)) < 0.999
    assert chi2.sf(float(r @ r) / case.scene.noise.sigma**2, len(r)) < 1e-12


@pytest.mark.long
def test_noncentrality_under_the_true_covariance(case: Case) -> None:
    """The projector against dense generalised least squares."""
    scene, still = case.scene, case.state
    rows = case.seen & ~scene.session.held[:, None]
    S = covariance(case, rows)
    J = np.swapaxes(modelled_columns(scene, still), -1, -2) @ scene.R.T
    J = np.swapaxes(J[rows], -1, -2).reshape(len(S), -1)
    d = np.random.default_rng(0).normal(size=still.readings.shape) * 1e-5
    own = d[rows].ravel()
    white = np.linalg.inv(np.linalg.cholesky(S))
    WJ, Wd = white @ (J / np.linalg.norm(J, axis=0)), white @ own
    U, s, _ = np.linalg.svd(WJ, full_matrices=False)
    left = Wd - U[:, s > 1e-9 * s[0]] @ (U[:, s > 1e-9 * s[0]].T @ Wd)
    found = Projector(scene, still, rows).left(d)
    assert found @ found == pytest.approx(left @ left, rel=1e-4)
    exact = Projector(replace(scene, scatter=None), still, rows).left(d)
    assert exact @ exact > 1.1 * (found @ found)


@pytest.mark.long
def test_size_at_the_markers_and_what_the_cell_says(case: Case) -> None:
    scene = case.scene
    assert scene.scatter is not None
    columns = by_differences(scene, scene.scatter)
    ratio = np.sqrt(np.mean(np.sum(columns**2, axis=(-2, -1))) / 3.0) / scene.noise.sigma
    assert RATIO[0] * 0.999 < ratio < RATIO[1] * 1.001
    rng, still = np.random.default_rng(3), at_rest(scene, scene.mechanism(), ())
    place, turn = scene.scatter.repeatability(scene.arm, still)
    moves, turns = [], []
    for _ in range(30):
        wander = scene.scatter.drawn(rng, np.arange(scene.count))
        stood = at_rest(scene, scene.mechanism(), [wander])
        moves.append(stood.o[:, -1] + 0.0)
        turns.append(stood.R_link[:, -1])
    # The tip frame stands where its twist begins, so that of a loose tip moves with its markers.
    if scene.scatter.tip.any():
        assert place == pytest.approx(scene.scatter.tip[0])
    else:
        spread = np.std(moves, axis=0, ddof=1)
        assert place == pytest.approx(np.sqrt(np.mean(spread**2)), rel=0.04)
    small = np.swapaxes(still.R_link[:, -1], -1, -2) @ np.array(turns)
    vectors = np.stack(
        [small[..., 2, 1] - small[..., 1, 2], small[..., 0, 2] - small[..., 2, 0],
         small[..., 1, 0] - small[..., 0, 1]], axis=-1,
    ) / 2.0  # fmt: skip
    assert turn == pytest.approx(np.sqrt(np.mean(vectors**2)), rel=0.04)


@pytest.mark.long
def test_drawn_evenly_and_said_in_half() -> None:
    scenes = [scene_of(arm) for arm in ARMS]
    still = [at_rest(scene, scene.mechanism(), ()) for scene in scenes]
    rng, drawn, ratios = np.random.default_rng(1), Counter[str](), []
    for _ in range(200):
        k = int(rng.integers(len(scenes)))
        scene = with_scatter(rng, scenes[k], still[k])
        assert scene.scatter is not None
        drawn["joints"] += bool(scene.scatter.joints.any())
        drawn["said"] += scene.repeatability is not None
        squares = np.mean(scene.scatter.squares(scene.arm, still[k]))
        ratios.append(np.sqrt(squares / 3.0) / scene.noise.sigma)
        said = tomllib.loads(cell_text("case", scene))["robot"].get("repeatability_mm")
        assert (said is not None) == (scene.repeatability is not None)
        if scene.repeatability is not None:
            assert said == pytest.approx(scene.repeatability[0] * 1e3, rel=1e-3)
    assert 75 < drawn["joints"] < 125
    assert 75 < drawn["said"] < 125
    assert RATIO[0] <= min(ratios) < 1.1
    assert 2.7 < max(ratios) <= RATIO[1] * (1 + 1e-9)
    assert np.median(ratios) == pytest.approx(np.sqrt(3.0), rel=0.12)


@pytest.mark.long
def test_command_and_floor(tmp_path: Path) -> None:
    """What a perfect model leaves of held-out readings is the floor of the key."""
    options = ["make", "8", "--seed", "2", str(tmp_path / "cases"), "--arm-noise"]
    assert CliRunner().invoke(main, options).exit_code == 0
    keys = [read_json(path) for path in sorted((tmp_path / "cases" / "keys").glob("case_*.json"))]
    ratios = [key["heldout_noise_rms_mm"] / key["floor_mm"] for key in keys]
    np.testing.assert_allclose(np.mean(ratios), 1.0, atol=0.1)
    for key in keys:
        assert key["floor_mm"] > np.sqrt(3.0) * key["sigma_mm"]
        assert key["conditions"]["arm_noise"] in ("said", "unsaid")
        cell = (tmp_path / "cases" / "cases" / key["case"] / "cell.toml").read_text()
        assert ("repeatability_urad" in cell) == (key["conditions"]["arm_noise"] == "said")
