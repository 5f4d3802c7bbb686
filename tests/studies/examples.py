"""Records of every kind in every turn of their story, from results that earlier versions wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.record import Record, read

OLD = Path(__file__).parent / "old_results"


def old_fields(kind: str) -> dict[str, Any]:
    fields: dict[str, Any] = json.loads((OLD / f"{kind}.json").read_text())
    return fields


def changed(kind: str, **fields: Any) -> Record:
    """The old result with some of its fields as given."""
    record = type(read(OLD / f"{kind}.json"))
    return record.model_validate_json(json.dumps({**old_fields(kind), **fields}))


def _enough() -> list[Record]:
    old = old_fields("enough")
    none = {"goal_mm": 0.01, "poses_to_goal": None}
    lacking = {**old["lacking"], "rms_mm": 0.05, "scatter_mm": 0.04, "unexplained_mm": 0.03}
    model = {**lacking, "scatter_mm": 0.01}
    opened = {**old["end"], "unidentifiable": ["a:b.c", "a:b.d"]}
    alone = {"order": [], "plan": {"poses": 0, "measured": 0, "to_measure": 0}, "end": old["now"]}
    return [
        changed("enough"),
        changed(
            "enough", goal_mm=None, poses_to_goal=None, reason="too few poses", status="too_few"
        ),
        changed("enough", poses_to_goal=3, pays_until=0, end=opened),
        changed("enough", **none, fresh_poses_to_goal=4, pays_until=9),
        changed("enough", **none, goal_beyond_reach=True, lacking=lacking, pays_until=None),
        changed("enough", **none, goal_beyond_reach=True, lacking=model),
        changed("enough", **none, fresh=[{**old["order"][0], "pose": "fresh1"}]),
        changed("enough", **none),
        changed("enough", **{**alone, "goal_mm": None, "poses_to_goal": None, "pays_until": 0}),
    ]


def _compensate() -> list[Record]:
    old = old_fields("compensate")
    slid = [{**target, "joints_mm": {"X1": 12.5}} for target in old["targets"]]
    every = [{**target, "limited_by": None} for target in old["targets"]]
    return [
        changed("compensate", targets=slid, limited={"singular": 1}),
        changed("compensate", targets=every, limited={}, errors_at="tip",
                rms_mm={**old["rms_mm"], "scatter": 0.01}),
    ]  # fmt: skip


def _identify() -> list[Record]:
    old = old_fields("identify")
    names = ("joint_offset", "joint_offset", "base_drift")
    robot = [{**p, "effect": name} for p, name in zip(old["parameters"], names, strict=False)]
    robot[0] |= {"std_by_pose": 10.0 * robot[0]["std"], "step_two_optimism": 3.0}
    parameters = [*robot, *old["parameters"][3:]]
    unknown = [*parameters[:-1], {**parameters[-1], "std": None, "ci95": None}]
    close = [[1.0 if i == j else 0.95 for j in range(11)] for i in range(11)]
    out = [{"pose": "p1", "reason": "residual up to 3 mm"}]
    share = {"variable": "q:A2", "low": 10.0, "high": 12.0, "unit": "deg", "poses": 3, "of_poses": 8,
             "outliers": 1, "of_outliers": 1, "p": 1e-3, "beyond_all_others": None}  # fmt: skip
    alone = {**share, "beyond_all_others": 40.0}
    good = {**old["rms_mm"], "nominal": 3.0, "heldout": None, "heldout_trimmed": None}
    fitted = [row for row in old["residuals"] if not row["heldout"]]
    open_ = [{"names": ["a:b.c"], "reason": "no pose excites it"}]
    quiet = {"repeatability_mm": None, "repeatability_urad": None, "configuration_mm": None,
             "configuration_urad": None}  # fmt: skip
    noise = {**old["noise"], **quiet, "sigma_mm": 0.02}
    turned = {**old["noise"], "repeatability_mm": None, "configuration_urad": 40.0}
    told = {**noise, "source": "replicates", "instrument_seen": True}
    three = [1.0, -2.0, 3.0]
    rate = {f"{key}_per_h": three for key in ("translation_um", "translation_std_um", "rotation_urad",
                                               "rotation_std_urad")}  # fmt: skip
    drift = {**old["drift"], "verdict": "drift", "trend_p": 1e-9, "one_side": False}
    rated = {**drift, "rates": [{"station": "base", **rate}], "noise_factor": 2.0}
    moved = {**drift, "verdict": "moved", "references": 2 * drift["references"]}
    return [
        changed("identify"),
        changed("identify", parameters=unknown, rms_mm=good, residuals=fitted, noise=noise, drift=rated,
                correlation=close, outliers=out, outliers_share=share, differences=True,
                weak=["a:b.c"], unused_poses=["p3"], unidentifiable=open_),
        changed("identify", rms_mm={**old["rms_mm"], "heldout": 1e-3}, drift=moved, noise=turned,
                outliers=out, outliers_share=alone, heldout_outliers=out, status="not_converged"),
        changed("identify", drift={**drift, "rates": []}, noise=told, pair_distances_mm={}),
        changed("identify", drift=rated, noise={**told, "instrument_seen": None}, absorbed=[],
                parameters=[{**p, "std": 2e-3 if p["std"] else None} for p in old["parameters"]]),
    ]  # fmt: skip


EXAMPLES = {"enough": _enough(), "compensate": _compensate(), "identify": _identify()}
