"""Arms that scatter from approach to approach: the law, its size, and cases without it as they were."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.arrays import Array

pytest.importorskip("mujoco")

from studies.research.withheld.draw import Case, draw_case
from studies.research.withheld.keys import key_of, write_case
from studies.research.withheld.robots import RAIL
from studies.research.withheld.scene import RATIO, Scatter, Scene
from studies.research.withheld.visible import at_rest
from tests.studies.research.withheld.scenes import PLAIN

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
