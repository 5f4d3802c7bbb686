"""Next poses: the criterion against stacked least squares, the search against every subset."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

import calib
import doe
from calib import Cell
from calib.arrays import Array
from calib.cell import Load
from calib.cell.planned import Planned
from calib.diagnosis import Diagnosis
from calib.diagnosis.equivalence import Named
from calib.errors import CalibError
from doe.ahead.causes import Discrimination
from doe.ahead.forecast import Forecast, Offer
from doe.ahead.search import PoseSearch
from doe.constraints import constraints_of, scene_of
from tests.calib.diagnosis.test_diagnose import measured
from tests.doe.ahead.day import asking_only
from tests.helpers import designed

RIVALS = ([8, 9], [10, 11, 12], [13])
SCALE = 9e-6
PAIRS = ((0, 1), (0, 2), (1, 2))


def linear(seed: int, sizes: float = 1.0) -> tuple[Discrimination, Array, Array, Array]:
    """Rows of data and of 14 candidates, eight parameters modelled, three rivals that look alike."""
    rng = np.random.default_rng(seed)
    mix = rng.normal(size=(14, 14)) * 0.1 + np.eye(14)
    mix[10:13, 10:13] += 0.1
    mix[8:14] += rng.normal(size=14)  # what the rivals have in common
    rows, more = rng.normal(size=(60, 14)) @ mix.T, rng.normal(size=(14, 4, 14)) @ mix.T
    y = rows[:, 8:10] @ np.array([0.9, -0.4]) + rng.normal(size=60)
    rivals = [np.array(at) for at in RIVALS]
    return Discrimination.of(rows, y, np.full(14, sizes), rivals, PAIRS), rows, more, y


def direct(rows: Array, truth: list[int], rival: list[int], b: Array) -> float:
    """Least squares on the stacked rows, nothing projected beforehand."""
    s = rows[:, truth] @ b
    rest = rows[:, [*range(8), *rival]]
    return float(((s - rest @ np.linalg.lstsq(rest, s, rcond=None)[0]) ** 2).sum())


@pytest.mark.long
def test_search_against_every_subset() -> None:
    shares = []
    for seed in range(8):
        evidence, _, more, _ = linear(seed)
        offer = Offer(np.zeros((14, 1)), more)
        search = PoseSearch((replace(evidence, planned=72),), offer, np.zeros(1))
        values = [search.value(s) for s in itertools.combinations(range(14), 3)]
        mine = search.best_plan(3)
        assert len(set(mine)) == 3
        start = search.value([])
        shares.append((search.value(mine) - start) / (max(values) - start))
        assert search.value(mine) > np.quantile(values, 0.97)
    assert min(shares) > 0.9
    assert np.median(shares) > 0.999


@pytest.mark.parametrize(
    ("pair", "error"),
    [
        (([13], [9]), 0.02),
        (([8, 9], [10, 11]), 0.06),
        (([10, 11, 12], [13]), 0.06),
        (([8, 9], [13]), 0.06),
    ],
)
def test_probability_is_the_frequency_of_the_right_preference(
    pair: tuple[list[int], list[int]], error: float
) -> None:
    """Schwarz's choice between two fits, on simulated readings with either of them as the truth."""
    rng = np.random.default_rng(1)
    rows = linear(2)[1]
    for truth, rival in (pair, pair[::-1]):
        whole = [np.linalg.qr(rows[:, [*range(8), *own]])[0] for own in (truth, rival)]
        more = len(truth) - len(rival)
        for wanted in (1.0, 4.0, 9.0, 16.0, 25.0):
            b = rng.normal(size=len(truth))
            b *= np.sqrt(wanted / direct(rows, truth, rival, b))
            signal = rows[:, truth] @ b
            y = signal + rng.normal(size=(20_000, len(rows)))
            costs = [(y**2).sum(axis=1) - ((y @ Q) ** 2).sum(axis=1) for Q in whole]
            seen = float(np.mean(costs[1] - costs[0] > more * np.log(len(rows))))
            both = [8 + np.arange(len(truth)), 8 + len(truth) + np.arange(len(rival))]
            own = rows[:, [*range(8), *truth, *rival]]
            # Large plausible sizes: the weak prior is then no prior.
            evidence = Discrimination.of(own, signal, np.full(own.shape[1], 1e3), both, ((0, 1),))
            predicted = evidence.preferences(evidence.now)[0, 0]
            assert predicted == pytest.approx(seen, abs=error)


def diagnosed(kinds: tuple[str, ...], effect: str, values: list[float]) -> tuple[Cell, Diagnosis]:
    cell, data, _ = measured(effect, values, seed=7)
    with asking_only(*kinds):
        return cell, calib.diagnose(cell, data)


@pytest.fixture(scope="module")
def alike() -> tuple[Cell, Diagnosis]:
    """A gear ratio, or the weight of the arm: over a short range of A2 both turn it alike."""
    kinds = ("transmission_scale", "backlash", "link_weight:A3")
    return diagnosed(kinds, "transmission_scale:A2", [SCALE])


@pytest.fixture(scope="module")
def six(alike: tuple[Cell, Diagnosis]) -> doe.NextPoses:
    return doe.next_poses(*alike, count=6)


@pytest.fixture(scope="module")
def drift() -> tuple[Cell, Diagnosis]:
    values = np.array([60.0, -40.0, 0.0, 30.0, 0.0, -40.0]) * 1e-6 / 3600.0
    return diagnosed(("base_drift", "tracker_drift", "backlash"), "base_drift:base", list(values))


def test_predictions_are_those_of_stacked_least_squares(
    alike: tuple[Cell, Diagnosis], six: doe.NextPoses
) -> None:
    """Data and next poses in one regression, rows from the model, no candidates and no updates."""
    cell, found = alike
    assert found.verdict == "ambiguous"
    (prediction,) = six.predictions
    first, second = (c for c, _ in found.causes[0].named.members)
    assert prediction.rivals == (first.key, second.key)
    forecast = Forecast.after_diagnosis(cell, found, [first.effect, second.effect])
    _, rows = forecast.known.independent
    session = forecast.conditions.in_order(cell.robot, six.poses.q)
    _, J = forecast.model.jacobian(forecast.values, session)
    fresh = J.reshape(-1, J.shape[-1]) / found.noise.sigma
    at = [forecast.model.positions(c.effect) for c in (first, second)]
    rest = np.setdiff1d(np.arange(J.shape[-1]), np.concatenate(at))
    refit = found.stage.fit([second.effect])
    b = [found.causes[0].values, refit.values[refit.model.positions(second.effect)]]
    for have, predicted in (
        (rows, prediction.now),
        (np.concatenate([rows, fresh]), prediction.after),
    ):
        have = have * forecast.model.sizes
        margin = []
        for e, f in ((0, 1), (1, 0)):
            s = have[:, at[e]] @ (b[e] / forecast.model.sizes[at[e]])
            alone, beside = (
                float(np.linalg.norm(s - own @ np.linalg.lstsq(own, s, rcond=1e-12)[0]) ** 2)
                for own in (have[:, rest], have[:, np.concatenate([rest, at[f]])])
            )
            # Of one direction each: the correlation is 1 - beside / alone.
            margin.append(beside / np.sqrt(4.0 * beside + 4.0 * beside / alone))
        assert predicted == pytest.approx(ndtr(min(margin)), abs=2e-3)


def test_the_poses_chosen_beat_poses_at_random(
    alike: tuple[Cell, Diagnosis], six: doe.NextPoses
) -> None:
    cell, found = alike
    (prediction,) = six.predictions
    members = [c for c, _ in found.causes[0].named.members]
    forecast = Forecast.after_diagnosis(cell, found, [c.effect for c in members])
    r, rows = forecast.known.independent
    at = [forecast.model.positions(c.effect) for c in members]
    y = r + rows[:, np.concatenate(at)] @ forecast.values[np.concatenate(at)]
    evidence = Discrimination.of(rows, y, forecast.model.sizes, at, ((0, 1),))
    q = forecast.feasible(120, seed=5).reshape(20, 6, -1)
    random = [
        evidence.probabilities(
            evidence.now.added(evidence.columns_of(forecast.in_order(one), one))
        )[0]
        for one in q
    ]
    assert prediction.now < min(random)
    assert prediction.after > max(random)
    # In noise variances the gain is at least twice that of a random set.
    far = [float(ndtri(p)) ** 2 for p in (prediction.now, prediction.after, float(np.mean(random)))]
    assert far[1] - far[0] > 2.0 * (far[2] - far[0])


def test_poses_keep_to_the_cell(alike: tuple[Cell, Diagnosis]) -> None:
    cell, found = alike
    robot = cell.robot
    limits = robot.limits.copy()
    limits[1] = [-1.8, -0.6]
    tight = replace(
        cell,
        robot=replace(robot, limits=limits),
        load=Load(250.0, (0.3, 0.0, 0.15), 0.4),
        design=Planned(),
    )
    result = doe.next_poses(tight, found, count=4)
    assert len(result.poses) == 4
    q = result.poses.q
    assert ((q >= limits[:, 0] - 1e-9) & (q <= limits[:, 1] + 1e-9)).all()
    for constraint in constraints_of(tight):
        assert constraint.allows(scene_of(tight, q)).all()
    levels = {"A2": {"values_deg": [-90, -60], "poses_per_level": 2}}
    free = doe.next_poses(designed(cell, levels=levels), found, count=4)
    assert len(np.unique(free.poses.q[:, 1])) == 4  # the data do not keep to levels
    again = doe.next_poses(tight, found, count=4)
    np.testing.assert_array_equal(again.poses.q, q)
    with pytest.raises(CalibError, match="at least one"):
        doe.next_poses(cell, found, count=0)


def test_nothing_is_asked_where_nothing_is_in_doubt(alike: tuple[Cell, Diagnosis]) -> None:
    cell, found = alike
    first = found.causes[0]
    entry = replace(first.named.entry, rivals=first.named.entry.rivals[:1])
    alone = replace(first, named=Named(entry, first.named.members[:1]))
    sure = replace(found, causes=(alone,))
    result = doe.next_poses(cell, sure)
    assert not len(result.poses)
    assert result.predictions == ()


def test_no_pose_but_another_station_tells_drifts_apart(drift: tuple[Cell, Diagnosis]) -> None:
    cell, found = drift
    result = doe.next_poses(cell, found)
    assert not len(result.poses)
    (prediction,) = result.predictions
    assert set(prediction.rivals) == {"base_drift:base", "tracker_drift:instrument"}
    assert prediction.after < 0.6
    assert not prediction.inseparable
    assert [remedy.name for remedy in prediction.remedies] == ["another_station"]
    assert prediction.remedies[0].probability > 0.99
