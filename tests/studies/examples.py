"""Records of every kind in every turn of their story, from results that earlier versions wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.record import Record
from studies.results import read

SILENT = {"report"}  # kinds of which the terminal hears only what was written
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
    ends = {"rms_mm": 0.04, "source": "the ends of the day", "heldout_mm": None}
    model = {**lacking, "scatter_mm": 0.01, "seen": ends}
    lacking["seen"] = {**ends, "source": "held-out poses", "heldout_mm": 0.05}
    arm = {**lacking, "scatter_of": "arm"}
    chance = {**model, "unexplained_from": "the ends of the day", "unexplained_surely": False}
    moving = {**lacking, "trend_mm": 0.06, "trend_an_hour_later_mm": 0.1}
    met = {"poses_to_goal": 0, "goal_beyond_reach": False}
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
        *(
            changed("enough", **none, goal_beyond_reach=True, lacking=own)
            for own in (model, arm, chance, moving)
        ),
        *(
            changed("enough", **met, lacking={**moving, **own})
            for own in ({}, {"targets_after_h": 1.0}, {"trend_an_hour_later_mm": None})
        ),
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
        changed("compensate", rms_mm={**old["rms_mm"], "unexplained": 0.5}),
        changed("compensate", rms_mm={**old["rms_mm"], "scatter": 0.5, "trend": 0.1},
                trend_an_hour_later_mm=0.2),
    ]  # fmt: skip


def _iso9283() -> list[Record]:
    old = old_fields("iso9283")
    first, *_ = measured = [own for own in old["poses"] if own["how"] == "measured"]
    expected = [own for own in old["poses"] if own["how"] == "predicted"]
    open_ = {"value": 1.0, "low": None, "high": None}
    none = {"several": [], "distances": [], "compliance": []}
    blind = {
        **first,
        "ap_angles_mrad": None,
        "rp_angles_mrad": None,
        "drift_mm": None,
        "ap_mm": open_,
    }
    return [
        changed("iso9283"),
        changed("iso9283", poses=expected, **none, same_data=True),
        changed("iso9283", poses=[{**expected[0], "rp_mm": None}], **none),
        changed("iso9283", poses=[blind, *measured], instrument_rp_mm=5.0, distances=[],
                compliance=[{**old["compliance"][0], "mm_per_N": open_}]),
    ]  # fmt: skip


def _hand_eye() -> list[Record]:
    old = old_fields("hand-eye")
    plain, whole, *others = old["methods"]
    as_it_is = [{**plain, "used": True}, {**whole, "used": False}]
    better = [{**others[0], "px": {**plain["px"], "value": 0.1}, "better_p": 1e-4}]
    lost = [{**own, "px": None, "mm": None, "mrad": None} for own in others]
    two = [{**own, "camera": "other"} for own in (plain, whole)]
    cameras = [*old["cameras"], {**old["cameras"][0], "camera": "other", "image_px": 0.1}]
    poses = [{**own, "px": None} for own in as_it_is]
    silent = {"ahead": [], "ahead_untold": "no pose is seen", "next_poses": []}
    open_ = [{**old["ahead"][0], "open": ["a:b.c"]}]
    alone = {"arm_calibrated": False, "opencv": "OpenCV's five methods are left out"}
    return [
        changed("hand-eye"),
        changed("hand-eye", methods=[*as_it_is, *better], arm_calibrated=False, goal_mm=None),
        changed("hand-eye", methods=[*as_it_is, *lost], arm_calibrated=False, poses_to_goal=0),
        changed("hand-eye", methods=[plain, whole, *others[1:], lost[0]], poses_to_goal=7),
        changed("hand-eye", methods=[plain, whole, *two], cameras=cameras, goal_beyond_reach=True),
        changed(
            "hand-eye", methods=poses, **alone, **silent, arm_p=None, arm_untold="too few poses"
        ),
        changed(
            "hand-eye", methods=as_it_is[:1], **alone, ahead=open_, arm_p=None, arm_untold="few"
        ),
    ]


def _changes() -> list[Record]:
    old = old_fields("changes")
    first, second = old["causes"][:2]
    still = [{**p, "moved": False} for p in old["parameters"]]
    open_ = [{**p, "std": None, "family_p": None} for p in still[:3]]
    robot = [p for p in still if p["effect"] not in ("base", "tool")]
    quiet = {"status": "unchanged", "cause": "none", "causes": [], "same_as": []}
    left = {"before_mm": 0.01, "after_mm": 0.03, "p": 1e-9, "grown": True, "excess_mm": 0.02}
    alone = [{"id": "backlash:A1.half_width", "sigmas": 7.0}]
    likely = {**second, "explains": True, "likely": True, "probability": 0.45}
    lost = [{**cause, "explains": False, "likely": False} for cause in old["causes"]]
    other = {**first, "effect": "gravity_sag", "sizes": [{**first["sizes"][0], "std": None}]}
    apart = ["base:base", "tool:marker:m1"]
    return [
        changed("changes"),
        changed("changes", **quiet, parameters=still, verdict="holds", tolerance_mm=3.0),
        changed(
            "changes", **quiet, parameters=[*open_, *still[3:]], verdict=None, tolerance_mm=None
        ),
        changed("changes", cause="unclear", causes=lost, parameters=still, left=left, same_as=[]),
        changed("changes", cause="unclear", causes=[], same_as=[], hidden=[]),
        changed("changes", cause="ambiguous", causes=[first, likely], verdict="cannot_be_said"),
        changed("changes", causes=[other], parameters=robot, apart=apart, alone=alone),
    ]


def _compare() -> list[Record]:
    old = old_fields("compare")
    first, second = old["plans"]
    ids = [p["id"] for p in first["approaches"][0]["parameters"]]
    keys = ("pose plain", "points")
    pair = {
        "ids": ids[:2],
        "covariance": {key: [[4.0, 1.0], [1.0, 9.0]] for key in keys},
        "simulated": {"points": [[0.1 * k, 0.2 * k] for k in range(5)]},
    }
    curve = {"counts": [2, 3], "task_rms_mm": {key: [0.2, 0.1] for key in keys}}
    whole = {
        **first,
        "by_pose": [{**worth, "effects": {"base": 0.5}} for worth in first["by_pose"]],
        "correlation": [[1.0 if a == b else 0.1 for a in ids] for b in ids],
        "entangled": [pair],
        "by_poses": curve,
        "by_markers": curve,
    }
    points = first["approaches"][-1]
    alone = {**first, "approaches": [points], "improvement": [], "hidden_markers": 2}
    alone |= {"readings_without_pose": 1, "trials": 3}
    unknown = [{**p, "std": None} for p in points["parameters"]]
    vague = {**points, "parameters": unknown, "task_rms_mm": None, "agreement": None}
    vague |= {"from_scratch": None, "not_converged": 2}
    other = {**second, "approaches": [vague], "improvement": []}
    others = [{**p, "id": f"{p['id']}'"} for p in points["parameters"]]
    apart = {**alone, "plan": "apart.csv", "approaches": [{**points, "parameters": others}]}
    more = [{**p, "std": 2.0 * (p["std"] or 0.0)} for p in first["approaches"][2]["parameters"]]
    full = {**first["approaches"][2], "parameters": more}
    loses = {**first, "approaches": [*first["approaches"][:2], full, points]}
    many = [{**p, "id": f"{p['id']}{k}"} for k in range(4) for p in points["parameters"]]
    large = {**alone, "approaches": [{**points, "parameters": many}]}
    by = {
        "cell": "a cell",
        "instruments": ["laser (points)"],
        "plan": first["plan"],
        "poses": 15,
        "task_rms_mm": 0.11,
        "task_worst_mm": 0.2,
        "arm_rms_mm": 0.1,
        "poses_to_match": 15.0,
    }
    camera = {**by, "instruments": ["cam (camera)"], "task_rms_mm": 0.4, "arm_rms_mm": None}
    return [
        changed("compare"),
        changed("compare", plans=[whole], notes=["a note"], read_by=[by, camera]),
        changed("compare", plans=[loses], truth="mujoco"),
        changed("compare", plans=[other], trials=0, agreement={**old["agreement"], "chi2_p": None}),
        changed("compare", plans=[alone, apart]),
        changed("compare", plans=[large], agreement={**old["agreement"], "believed": False}),
    ]


def _design() -> list[Record]:
    old = old_fields("design")
    few = old["poses"][:3]
    slid = [{**pose, "joints_deg": {}, "joints_mm": {"X": 1.0}, "level": None} for pose in few]
    many = [{**p, "id": f"{p['id']}{k}"} for k in range(4) for p in old["predicted_std"]]
    landscape = {
        "joint": "A2",
        "levels_rad": [0.0, 0.5],
        "value_rad": [0.0, 0.5, 0.0, 0.5],
        "share": [1.0, 1.0, 0.3, 0.4],
        "chosen": 2,
    }
    lost = {**old["survives"], "loss_of_marker": {"m1": None, "m2": 0.1}}
    lost["loss_of_pose"] = {**lost["loss_of_pose"], "task_rms_mm": None, "efficiency": None}
    again = {"poses": ["p01"], "again": ["a01"], "dof": 6}
    again["repeatability_relative_std"] = dict.fromkeys(("common", "translation", "rotation"), 0.3)
    plain = {"reference": None, "curve": [], "against": {}, "at_targets": []}
    ordered = [
        {**pose, "time_s": 20.0 * i, "temperature_degC": 20.0 + i,
         "last_move": {"joints_deg": {**dict.fromkeys(pose["joints_deg"], 0.0), "A2": move}}}
        for i, (pose, move) in enumerate(zip(few, (5.0, -5.0, 40.0), strict=True))
    ]  # fmt: skip
    each = {"changes": 6, "after": [], "changing_s": 720, "seconds": None, "task_rms_mm": 0.02}
    blocks = [{**pose, "load_block": 1} for pose in ordered]
    once = {"changes": 1, "after": ["p03"], "changing_s": 120, "seconds": 900, "task_rms_mm": 0.02}
    trend = {"without_mm": 0.01, "ordered_mm": 0.011, "quickest_mm": 0.02, "seconds": 30}
    name = next(iter(old["against"]))
    return [
        changed("design"),
        changed("design", **plain, poses=ordered, levels_deg={}, timed=True,
                load_schedules=[each, once], trend=trend),
        changed("design", **plain, poses=blocks, levels_deg={},
                load_schedules=[each, {**once, "planned": True}]),
        changed("design", pays_until=6, matches={name: 6}, survives=lost, levels_deg={},
                proof={**old["proof"], "proved_optimal": True}),
        changed("design", matches={name: None}, landscape=landscape, reapproaches=again, extends=4,
                by_pose=[{"pose": p["pose"], "effects": {"base": 0.5}} for p in old["poses"]]),
        changed("design", **plain, poses=slid, levels_deg={}, predicted_std=many),
        changed("design", **plain, levels_mm={"X": [1.0]}, levels_deg={}, criterion="D",
                landscape={**landscape, "levels_rad": None},
                survives={**lost, "loss_of_marker": {},
                          "loss_of_pose": {**lost["loss_of_pose"], "worst": None}}),
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
    none = dict.fromkeys(old["rms_mm"])
    seen = [
        {"pose": row["pose"], "marker": row["marker"], "instrument": "cam", "heldout": row["heldout"],
         "u_px": 0.5, "v_px": -0.2, "nominal_px": [3.0, 1.0], "at_px": [40.0 * k, 30.0]}
        for k, row in enumerate(old["residuals"])
    ]  # fmt: skip
    px = {"instrument": "cam", "unit": "px", "nominal": 3.2, "fitted_all": 0.54, "fitted": 0.54}
    pixels = {"rms_mm": none, "max_mm": none, "p95_mm": none, "pair_distances_mm": {}}
    own = {"source": "noise of the readings", "instrument": "", "evaluation": "A",
           "part_of": "calibration", "distribution": "normal", "divisor": 1.0, "stated": 0.01,
           "standard_uncertainty": 0.01, "unit": "mm", "sensitivity_mm": 1.0,
           "degrees_of_freedom": 12.0, "at_one_reading_mm": 0.017, "at_targets_mm": 0.01,
           "base_placed_anew_mm": 0.008, "share": 0.5, "poses": "average"}  # fmt: skip
    scale = {**own, "source": "scale", "instrument": "laser", "unit": "um/m", "poses": "stays",
             "evaluation": "B", "degrees_of_freedom": None}  # fmt: skip
    bare = {"stated": None, "standard_uncertainty": None, "unit": "", "sensitivity_mm": None,
            "at_one_reading_mm": None, "poses": None, "part_of": "arm"}  # fmt: skip
    zero = {**scale, "source": "zero", "poses": "base"}
    total = {"standard_uncertainty_mm": 0.02, "coverage_factor": 2.1, "expanded_mm": 0.042,
             "worst_expanded_mm": 0.05, "degrees_of_freedom": 12.0}  # fmt: skip
    known = {**total, "degrees_of_freedom": None}
    sheet = {"rows": [own, scale, zero, {**own, **bare}], "calibration": known, "total": total,
             "probability": 0.95}  # fmt: skip
    judged = {"tolerance_mm": 0.1, "rule": "guarded", "verdict": "undecided", "points": 9, "passed": 6,
              "failed": 0, "undecided": 3, "largest_mm": 0.12, "expanded_mm": 0.03}  # fmt: skip
    failed = {**judged, "verdict": "fail", "rule": "simple", "failed": 3, "undecided": 0}
    nobody = {**judged, "verdict": None, "points": 0, "passed": 0, "undecided": 0}
    left = {"id": "joint_offset:A2.offset", "value": 900.0, "mean": 20.0, "std": 40.0, "score": 9.5,
            "released": True, "unit": "urad"}  # fmt: skip
    still = {
        **left,
        "id": "joint_offset:A3.offset",
        "value": 30.0,
        "score": None,
        "released": False,
    }
    of_type = {"type": "kr270", "robots": 12, "statistic": 90.0, "rows": 2, "p": 1e-18,
               "of_the_type": False, "widened": 1.0, "parameters": [still, left]}  # fmt: skip
    width = {"effect": "geometry", "width": 90.0, "unit": "um"}
    sizes = {"parameters": 2.5, "widths": [width]}
    good_type = {**of_type, "of_the_type": True, "p": 0.3, "parameters": [still]}
    return [
        changed("identify"),
        changed("identify", budget=sheet, acceptance=judged, about={"serial": "7", "operator": "A."}),
        changed("identify", budget={**sheet, "rows": [own]}, acceptance=failed),
        changed("identify", acceptance=nobody),
        changed("identify", **pixels, residuals=seen, instruments=[{**px, "heldout": 0.6}],
                rms_of_residuals_mm=None, outliers=[], heldout_outliers=[]),
        changed("identify", parameters=unknown, rms_mm=good, residuals=fitted, noise=noise, drift=rated,
                correlation=close, outliers=out, outliers_share=share, differences=True,
                weak=["a:b.c"], unused_poses=["p3"], unidentifiable=open_),
        changed("identify", rms_mm={**old["rms_mm"], "heldout": 1e-3}, drift=moved, noise=turned,
                outliers=out, outliers_share=alone, heldout_outliers=out, status="not_converged"),
        changed("identify", drift={**drift, "rates": []}, noise=told, pair_distances_mm={}),
        changed("identify", drift=rated, noise={**told, "instrument_seen": None}, absorbed=[],
                parameters=[{**p, "std": 2e-3 if p["std"] else None} for p in old["parameters"]]),
        changed("identify", of_type=of_type),
        changed("identify", of_type=good_type, sizes=sizes),
    ]  # fmt: skip


def _diagnose() -> list[Record]:
    old = old_fields("diagnose")
    first, *others = old["effects"]
    gap, noise, spectra = old["gap"], old["noise"], old["spectra"]
    quiet = {"effects": [], "located": [], "refused": [], "verdict": "unknown"}
    pose = {"located": [{"where": "arm", "depends_on": "pose", "share_of_gap": None}]}
    many = [{**first["parameters"][0], "name": f"p{i}"} for i in range(9)]
    unknown = [{**many[0], "name": f"u{i}", "std": None} for i in range(6)]
    unproved = {"heldout_before_mm": None, "heldout_after_mm": None, "closed": None}
    steps = {
        "of": "fitted poses",
        "unit": "px",
        "added": ["a:A1", "b:A2"],
        "rms_mm": [0.3, 0.1, 0.2],
    }
    plain = {**old["curves"][0], "effect": None}
    plain["panels"] = [{**plain["panels"][0], "effect": None}] * 3
    cross = {**old["curves"][1], "panels": [{**old["curves"][1]["panels"][0], "line": False}]}
    alone = {**spectra[0], "joint": "joint_4", "lines": []}
    return [
        changed("diagnose"),
        changed("diagnose", verdict="explained", effects=[first], next_poses=[], steps=steps,
                curves=[plain, cross], gap={**gap, "closed_ci95": None}),
        changed("diagnose", verdict="ambiguous", next_poses_predicted=[],
                next_poses_assume=[], gap={**gap, "closed": -0.1}),
        changed("diagnose", verdict="ambiguous", effects=[{**first, "shape_tested": False}],
                gap={**gap, **unproved}, spectra=[alone], not_asked=[], outliers=[]),
        changed("diagnose", verdict="no_gap", effects=[], located=[], steps=None, spectra=[],
                noise={**noise, "sigma_mm": 0.9}),
        changed("diagnose", verdict="explained", could_not_see=[], curves=[],
                effects=[{**first, "parameters": [*many, *unknown], "aliases": [8.0]}, *others]),
        changed("diagnose", **quiet, next_poses=[], next_poses_predicted=[]),
        changed("diagnose", **{**quiet, **pose}),
        changed("diagnose", **{**quiet, **pose, "refused": old["refused"]}),
        changed("diagnose", **{**quiet, "located": old["located"]}),
    ]  # fmt: skip


def _plan() -> list[Record]:
    old = old_fields("plan")
    alone = [{**group, "split_by": []} for group in old["twins"]]
    lost = [{"names": ["a", "b"], "reason": "they go together"}]
    never = [
        {**pair, "told_apart_times": None, "told_apart_from": None} for pair in old["look_alikes"]
    ]
    hidden = [entry for entry in old["could_not_see"] if entry["reason"]]
    return [
        changed("plan"),
        changed("plan", joints=["a1", "a2", "the_third_of_all", "a3"], hidden_markers=3, twins=alone),
        changed("plan", could_not_see=hidden, look_alikes=[], twins=[], not_asked=[],
                before_the_first_move=["p1"], approach_derived=True),
        changed("plan", joints=["a1", "a2", "a3"], look_alikes=never, unidentifiable=lost),
    ]  # fmt: skip


def _fleet() -> list[Record]:
    old = old_fields("fleet")
    first, *others = old["sessions"]
    none = {"status": None, "verdict": None, "poses": None, "sigma_mm": None, "causes": []}
    none |= {"rms_mm": dict.fromkeys(("nominal", "fitted", "heldout")), "results": []}
    lost = {**first, **none, "fault": "measurements.csv: line 3, column x_mm: is not a number"}
    alone = {"types": [], "off": [], "trends": []}
    cause = {"effect": "backlash", "where": "j2", "robots": 3, "possible": 4}
    kind = {**old["types"][0], "diagnosed": 4, "verdicts": {"explained": 3, "no_gap": 1}}
    kind |= {"causes": [{**cause, "share_ci95": [0.19, 0.99]}]}
    dated = {**first, "day": "2026-03-01", "verdict": "explained"}
    steady = {**old["trends"][0], "p": 1e-3, "days": None}
    return [
        changed("fleet"),
        changed("fleet", verbs=["identify"], sessions=[lost, *others], types=[kind]),
        changed("fleet", sessions=[dated], off=[], types=[kind], trends=[]),
        changed("fleet", sessions=[lost], **alone),
        changed("fleet", trends=[steady, *(25 * [old["trends"][0]])], off=[]),
    ]


def _prior() -> list[Record]:
    old = old_fields("prior")
    clear = {**old["types"][0], "aside": [], "unlike": [], "leaning": [], "robots": 40}
    return [changed("prior"), changed("prior", types=[clear, clear])]


def _next() -> list[Record]:
    old = old_fields("next")
    (first, *others) = old["poses"]
    doubt = {
        "rivals": ["transmission_scale:A2", "transmission_harmonic:A2"],
        "now": 0.6,
        "after": 0.97,
    }
    for_causes = [{**first, "serves": "causes"}, *others]
    for_both = [{**first, "serves": "both"}]
    form = {**doubt, "rivals": ["backlash:A3", "another form of backlash:A3"], "now": 0.3}
    stopped = {"done": True, "poses": []}
    causes = {"aim": "causes", "now": None, "after": None, "lacking_mm": None, "goal_mm": None}
    open_ = {**old["now"], "open": ["a:b.c", "a:b.d"]}
    return [
        changed("next"),
        changed("next", aim="both", poses=for_causes, doubts=[doubt], verdict="ambiguous"),
        changed("next", aim="both", poses=[first], stops=["goal"], verdict="unknown"),
        changed("next", aim="both", poses=for_both, doubts=[doubt], forms=[form], missed=2,
                shares={"causes": 0.97, "task": 0.82}, verdict="ambiguous"),
        changed("next", **stopped, **causes, stops=["nothing_found"], verdict="unknown"),
        changed("next", **stopped, stops=["goal"]),
        changed("next", **stopped, stops=["beyond_reach"], after=None),
        changed("next", **stopped, stops=["averages"], goal_mm=None, now=open_),
        changed("next", **stopped, **causes, stops=["settled"], verdict="no_gap"),
        changed("next", **stopped, **causes, stops=["no_pose_helps"], doubts=[doubt],
                verdict="ambiguous"),
    ]  # fmt: skip


def _init() -> list[Record]:
    return [changed("init"), changed("init", name="arm", notes=[])]


def _program() -> list[Record]:
    free = len(old_fields("program")["poses"])
    return [changed("program"), changed("program", stops=free, notes=["names are cut short"])]


def _import() -> list[Record]:
    old = old_fields("import")
    (first,) = old["lists"]
    bodies = {**first, "reads": "readings", "unit_from": "of the file"}
    ignored = {**first, "columns": [*first["columns"], "ux", "uy", "uz"], "ignored_columns": ["e"]}
    left = {"poses_without_points": ["p8"], "poses_without_joints": {"p9": 3},
            "points_left_out": ["TP1", "TP2", "TP3", "TP4"]}  # fmt: skip
    return [
        changed("import"),
        changed(
            "import", joint_file="joints.csv", joint_rows=30, carried_columns=["time_s"], **left
        ),
        changed("import", lists=[ignored], ignored_joint_columns=["comment"], notes=["averaged"]),
        changed("import", lists=[bodies], names="{pose}", joint_file="joints.csv", joint_rows=30),
    ]


def _report() -> list[Record]:
    return [changed("report"), changed("report", notes=["plan.csv is changed since"])]


def _demo() -> list[Record]:
    return [changed("demo"), changed("demo", folder="posecal-demo")]


EXAMPLES = {
    "init": _init(),
    "program": _program(),
    "import": _import(),
    "report": _report(),
    "demo": _demo(),
    "design": _design(),
    "plan": _plan(),
    "compare": _compare(),
    "identify": _identify(),
    "diagnose": _diagnose(),
    "enough": _enough(),
    "compensate": _compensate(),
    "iso9283": _iso9283(),
    "hand-eye": _hand_eye(),
    "fleet": _fleet(),
    "changes": _changes(),
    "prior": _prior(),
    "next": _next(),
}
