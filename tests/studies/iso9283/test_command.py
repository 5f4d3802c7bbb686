"""``posecal iso9283`` on cycles of an arm that other code simulates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from tests.calib.uncertainty import common_days as days
from tests.plain_arm import rotation
from tests.studies.command_line import result

CYCLES, POSES = 30, 4
AGAIN = 4e-5  # rad, of each joint, from approach to approach
NOMINAL = np.concatenate([days.TRUE[:15], np.zeros(5)])  # of that arm, as it should be
SILENT = {name: np.zeros(count) for name, count in days.COMPONENTS.items()}
PULL = np.array([0.0, 0.0, -300.0])


def points(q: Array, joints: Array, **given: Array) -> Array:
    """What markers do at commanded joints when each approach ends a little elsewhere."""
    return days.points(days.TRUE, q + joints, **given)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A day of calibration; thirty cycles over four poses; a pose from two sides; a load hung on."""
    folder = tmp_path_factory.mktemp("iso")
    rng = np.random.default_rng(9)
    days.write_cell(folder, "")
    q = days.joints(30, rng)
    (folder / "day.csv").write_text(days.table(q, days.read(points(q, 0.0 * q), SILENT, rng)))
    result(folder / "result.json", "identify", folder / "cell.toml", folder / "day.csv")
    q = np.tile(days.joints(POSES, rng), (CYCLES, 1))
    seen = days.read(points(q, AGAIN * rng.standard_normal(q.shape)), SILENT, rng)
    (folder / "cycles.csv").write_text(days.table(q, seen))
    np.savez(folder / "cycles.npz", q=q, seen=seen)
    two = days.joints(2, rng)
    q = np.tile(two, (12, 1))
    side = np.repeat([1.0, -1.0], 12)
    gap = np.zeros(q.shape)
    gap[:, 0] = 1e-4 * side
    signs = {f"approach_J{k}": side if k == 1 else np.ones(24) for k in range(1, 6)}
    table = days.table(q, days.read(points(q, gap), SILENT, rng), more=signs)
    (folder / "sides.csv").write_text(table)
    q = np.repeat(days.joints(3, rng), 2, axis=0)
    free, loaded = points(q, 0.0 * q), points(q, 0.0 * q, force=PULL)
    seen = np.where((np.arange(6) % 2)[:, None, None], loaded, free)
    force = {
        f"{c}_N": np.where(np.arange(6) % 2, PULL[k], 0.0) for k, c in enumerate(("fx", "fy", "fz"))
    }
    moment = dict.fromkeys(("mx_Nm", "my_Nm", "mz_Nm"), np.zeros(6))
    table = days.table(q, days.read(seen, SILENT, rng), more=force | moment)
    (folder / "loads.csv").write_text(table)
    np.savez(folder / "loads.npz", q=q, free=free, loaded=loaded)
    return folder


def criteria(folder: Path, table: str, *more: object) -> tuple[dict[str, Any], str]:
    call = ("iso9283", folder / "cell.toml", folder / f"{table}.csv", *more)
    return result(folder / f"{table}.json", *call)


def arrays(folder: Path, table: str) -> dict[str, Array]:
    with np.load(folder / f"{table}.npz") as found:
        return dict(found)


def test_cycles_give_the_criteria_of_the_standard(folder: Path) -> None:
    """RP, AD and RD as plain numpy has them of the same readings; AP as of an arm without errors."""
    fields, told = criteria(folder, "cycles", folder / "result.json")
    raw = arrays(folder, "cycles")
    seen = raw["seen"][:, 0].reshape(CYCLES, POSES, 3)
    commanded = days.points(NOMINAL, raw["q"][:POSES])[:, 0]
    assert not fields["same_data"]
    assert "too good" not in told
    assert [own["how"] for own in fields["poses"]] == ["measured"] * POSES
    true = days.points(days.TRUE, raw["q"][:POSES])[:, 0]
    for k, own in enumerate(fields["poses"]):
        away = np.linalg.norm(seen[:, k] - seen[:, k].mean(axis=0), axis=1)
        assert own["cycles"] == CYCLES
        assert own["rp_mm"]["value"] == pytest.approx(
            1e3 * (away.mean() + 3 * away.std(ddof=1)), rel=1e-4
        )
        assert own["drift_mm"] == pytest.approx(
            1e3
            * max(
                np.linalg.norm(seen[j : j + 10, k].mean(0) - seen[:10, k].mean(0)) for j in (10, 20)
            ),
            rel=1e-3,
        )
        off = 1e3 * np.linalg.norm(true[k] - commanded[k])
        assert own["ap_mm"]["value"] == pytest.approx(off, abs=0.05)
        # Corrected commands would meet it as the identified arm does.
        assert own["ap_identified_mm"]["value"] < 0.06 < own["ap_mm"]["value"]
        assert len(own["rp_angles_mrad"]) == 3
    assert len(fields["distances"]) == POSES * (POSES - 1) // 2
    for own in fields["distances"]:
        a, b = int(own["first"][1:]), int(own["second"][1:])
        apart = 1e3 * np.linalg.norm(seen[:, a] - seen[:, b], axis=1)
        asked = 1e3 * np.linalg.norm(commanded[a] - commanded[b])
        assert own["ad_mm"]["value"] == pytest.approx(apart.mean() - asked, abs=0.05)
        assert own["rd_mm"]["value"] == pytest.approx(3 * apart.std(ddof=1), rel=1e-3)


def test_angles_of_the_tip(folder: Path) -> None:
    """Mean turn against the nominal arm: the joints' offsets and their sag, about their axes."""
    fields, _ = criteria(folder, "cycles", folder / "result.json")
    q = arrays(folder, "cycles")["q"][:POSES]
    for k, own in enumerate(fields["poses"]):
        pairs = [days.points(values, q[k : k + 1])[0] for values in (NOMINAL, days.TRUE)]
        H = (pairs[0] - pairs[0].mean(0)).T @ (pairs[1] - pairs[1].mean(0))
        U, _, Vt = np.linalg.svd(H)
        R = Vt.T @ np.diag([1, 1, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
        turn = 0.5e3 * np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        # Three points 0.2 m apart read to 10 um leave 0.1 mrad, a thirtieth of it in the mean.
        assert np.linalg.norm(own["ap_angles_mrad"]) == pytest.approx(turn, abs=0.1)


def test_without_a_result_the_base_is_told_to_flatter(folder: Path) -> None:
    fields, told = criteria(folder, "day")
    assert fields["same_data"]
    assert "AP is too good" in told
    assert "No pose was measured twice" in told
    assert {own["how"] for own in fields["poses"]} == {"predicted"}
    own, told = criteria(folder, "day", folder / "result.json")
    assert own["same_data"]
    assert "AP is too good" in told


def test_what_was_not_repeated_is_predicted_with_intervals(folder: Path) -> None:
    """AP of nominal commands, and that of the simulator's own arm within most intervals."""
    fields, _ = criteria(folder, "day", folder / "result.json")
    q = np.array([[float(c) for c in row.split(",")[2:7]]
                  for row in (folder / "day.csv").read_text().splitlines()[1::3]])  # fmt: skip
    off = days.points(days.TRUE, q)[:, 0] - days.points(NOMINAL, q)[:, 0]
    true = 1e3 * np.linalg.norm(off, axis=1)
    held = [
        own["ap_mm"]["low"] <= true[int(own["pose"][1:])] <= own["ap_mm"]["high"]
        for own in fields["poses"]
    ]
    assert len(held) == 30
    assert np.mean(held) > 0.8


def test_sides_from_which_a_pose_was_reached(folder: Path) -> None:
    """0.2 mrad of the first joint between the sides, at the marker's distance from its axis."""
    fields, told = criteria(folder, "sides", folder / "result.json")
    assert len(fields["several"]) == 2
    assert {own["approach"] for own in fields["poses"]} == {"+++++", "-++++"}
    q = np.array([[float(c) for c in row.split(",")[2:7]]
                  for row in (folder / "sides.csv").read_text().splitlines()[1::3]])  # fmt: skip
    for own in fields["several"]:
        at = q[int(own["pose"][1:])][None]
        step = np.array([[1e-4, 0, 0, 0, 0]])
        moved = (points(at, step) - points(at, -step))[0, 0]
        assert own["ways"] == 2
        assert own["vap_mm"] == pytest.approx(1e3 * np.linalg.norm(moved), abs=0.015)
    assert "vAP" in told


def test_static_compliance_measured_and_predicted(folder: Path) -> None:
    fields, _ = criteria(folder, "loads", folder / "result.json")
    raw = arrays(folder, "loads")
    measured = [own for own in fields["compliance"] if own["how"] == "measured"]
    assert [own["direction"] for own in measured] == ["-z"] * 3
    # Along the base's z axis, which the tracker's frame has turned.
    down = rotation(days.BASE[3:]) @ np.array([0.0, 0.0, -1.0])
    for k, own in enumerate(measured):
        moved = (raw["loaded"] - raw["free"])[2 * k + 1, 0] @ down
        true = 1e3 * moved / 300.0
        assert own["mm_per_N"]["low"] <= true <= own["mm_per_N"]["high"]
        assert own["mm_per_N"]["value"] == pytest.approx(true, abs=2e-4)
        place = ("predicted", own["pose"], "z")
        (expected,) = [
            other
            for other in fields["compliance"]
            if (other["how"], other["pose"], other["direction"]) == place
        ]
        assert expected["mm_per_N"]["value"] == pytest.approx(true, rel=0.1)
