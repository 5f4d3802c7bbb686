"""The sections of a report, in the order of the page: what results say, and what they are of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from calib import Cell
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.instruments import ArmCamera, Camera, Instrument, Tracker
from calib.poses import Measurements, Poses
from studies.day import ways_in_turn
from studies.design.record import DesignRecord
from studies.document import Figure, Part, Raw, Section, Sentence
from studies.document.page import shown, table_of
from studies.identify.pictures import point_errors
from studies.identify.record import IdentifyRecord
from studies.kinds import KINDS
from studies.plots import residuals
from studies.report.arm_scene import scene
from studies.report.arm_view import figure_html
from studies.report.cameras import coverage
from studies.report.certificate import certificate
from studies.report.evidence import ReportedResult, ReportEvidence
from studies.report.summary import summary


def cell(evidence: ReportEvidence) -> Section | None:
    """What was measured with what."""
    if evidence.cell is None:
        return None
    own = evidence.cell
    facts = table_of(("", ""), list(_facts(own)))
    units = np.where(own.robot.prismatic, "mm", "deg")
    scale = np.where(own.robot.prismatic, 1e3, 180.0 / np.pi)
    joints = table_of(
        ("joint", "moves", "from", "to", "unit", "mass of its link [kg]"),
        [
            (name, "slides" if slides else "turns", *_range(limits * factor), unit, mass or None)
            for name, slides, limits, factor, unit, mass in zip(
                own.robot.joints, own.robot.prismatic, own.robot.limits, scale, units,
                own.robot.masses.tolist(), strict=True,
            )
        ],
        "Joints, with the limits of the cell",
    )  # fmt: skip
    return Section("cell", "The cell", (facts, joints))


def _range(
    limits: np.ndarray[tuple[int], np.dtype[np.float64]],
) -> tuple[float | None, float | None]:
    low, high = (float(x) if np.isfinite(x) else None for x in limits)
    return low, high


def _facts(own: Cell) -> Iterator[tuple[str, str]]:
    robot = own.robot
    yield "robot", f"{robot.name}, {robot.dof} joints, {robot.base} to {robot.tip}"
    yield from _read_by(own)
    if own.load is not None:
        at = ", ".join(shown(x * 1e3) for x in own.load.com)
        yield (
            "load of a plan's second reading",
            f"{shown(own.load.mass)} kg at ({at}) mm of {_tip(robot, robot.loaded, 'the tip')}",
        )
    if own.payload.mass:
        at = _tip(robot, own.payload.frame, "the tip")
        yield "payload", f"{shown(float(own.payload.mass))} kg" + f" on {at}" * (at != "the tip")
    yield "what the model contains", ", ".join(own.effects)


def _tip(robot: Robot, frame: int, usual: str) -> str:
    """The name of the tip of a frame; what it is called where it is that of the robot."""
    return usual if frame == -1 else robot.tips[frame - robot.dof - 1]


def _read_by(own: Cell) -> Iterator[tuple[str, str]]:
    """The instruments, and what they read."""
    parts = (*own.bodies.values(), *own.seats.values())
    ridden = {i for part in parts for i in range(part.start, part.stop)}
    places = [
        f"{name} ({', '.join(shown(x * 1e3) for x in place)}) mm"
        for i, (name, place) in enumerate(zip(own.marker_names, own.markers.tolist(), strict=True))
        if i not in ridden
    ]
    if places:
        yield "reference points", ", ".join(places)
    for instrument in own.instruments:
        if isinstance(instrument, Tracker):
            yield "noise of one coordinate", _noise(own)
            yield "instrument", _riding(own, instrument) or _stands(own)
        elif isinstance(instrument, Camera):
            yield f"camera {instrument.name}", ", ".join(_camera(own, instrument))
        else:
            found = "place found by the fit"
            yield f"{instrument.kind} {instrument.name}", _riding(own, instrument) or found


def _riding(own: Cell, instrument: Instrument) -> str:
    """On which link it rides; "" where it stands in the world."""
    link = own.link_under(instrument)
    return "" if link is None else f"on {link}, its place there found by the fit"


def _stands(own: Cell) -> str:
    if own.instrument is None:
        return "place not given: it may stand anywhere"
    return f"at ({', '.join(shown(x * 1e3) for x in own.instrument.tolist())}) mm from the base"


def _camera(cell: Cell, own: Camera) -> Iterator[str]:
    standing = "on the arm" if isinstance(own, ArmCamera) else "in the world"
    yield _riding(cell, own) or standing
    fx, fy, cx, cy = (shown(float(x)) for x in own.lens.values[:4])
    yield f"focal length {fx} and {fy} px, centre {cx} and {cy} px"
    if own.image is not None:
        yield "images of {:g} x {:g} px".format(*own.image)
    yield f"noise {shown(own.sigma)} px"
    yield "sees " + ", ".join(f"{b.name} ({len(b.points)} points)" for b in own.boards)


def _noise(own: Cell) -> str:
    """Along and across the beam where these differ, or grow with range."""
    noise = own.noise
    if not noise.grows:
        return f"{shown(noise.along * 1e3)} mm"
    near, far = (
        noise.deviations(np.array([1.0, 0.0, 0.0])),
        noise.deviations(np.array([5.0, 0.0, 0.0])),
    )
    said = [f"{shown(float(along) * 1e3)} mm along and {shown(float(across) * 1e3)} mm across the beam"
            for along, across in (near, far)]  # fmt: skip
    return f"{said[0]} at 1 m, {said[1]} at 5 m"


Reading = tuple[Poses, int]


def against(evidence: ReportEvidence, result: ReportedResult) -> Section | None:
    """Errors against what they may depend on; None where cell or tables are gone."""
    cell, data, record = evidence.cell, evidence.data.get(result.path), result.record
    if cell is None or data is None or not isinstance(record, IdentifyRecord):
        return None
    found = point_errors(record)
    read = [data.reading(*row) for row in zip(found.poses, found.heldout.tolist(), strict=True)]
    rows = [row for row in read if row is not None]
    if not rows:
        return None
    found = found.take(np.array([row is not None for row in read], dtype=bool))
    variables, sigma = dict(_variables(cell.robot, rows)), record.noise.instrument_mm * 1e-3
    rms = found.by_pose(found.after)
    figure = Figure(lambda: residuals.against(found.poses, rms, variables, sigma, found.heldout))
    return Section("against", "What is left, against what it may depend on", (figure,))


def _variables(robot: Robot, rows: list[Reading]) -> Iterator[tuple[str, Array]]:
    q = np.array([poses.q[i] for poses, i in rows])
    for k, (joint, slides) in enumerate(zip(robot.joints, robot.prismatic, strict=True)):
        shown = (
            (f"{joint} [mm]", q[:, k] * 1e3) if slides else (f"{joint} [deg]", np.degrees(q[:, k]))
        )
        yield shown
    force = np.array([float(np.linalg.norm(poses.wrench[i, :3])) for poses, i in rows])
    if np.ptp(force) > 0.0:
        yield "force on the tool [N]", force
    time = _known([None if poses.time is None else poses.time[i] for poses, i in rows])
    if time is not None:
        yield "time [h]", (time - time.min()) / 3600.0
    heat = _known([None if p.temperature is None else p.temperature[i] for p, i in rows])
    if heat is not None:
        yield "temperature [degC]", heat


def _known(values: list[float | None]) -> Array | None:
    """What every reading has, None where one lacks it."""
    return None if None in values else np.array(values, dtype=np.float64)


def provenance(evidence: ReportEvidence, told: dict[str, str]) -> Section:
    """Everything needed to make the same figures again."""
    commands = [
        (
            result.path.name,
            "diagnose --plan-only" if result.kind == "plan" else result.kind,
            result.record.version,
            str(result.record.seed),
        )
        for result in evidence.results
    ]
    inputs = {
        (entry.file, entry.sha256): entry for result in evidence.results for entry in result.inputs
    }
    parts: list[Part] = [
        table_of(("", ""), list(told.items())),
        table_of(("result", "command", "posecal", "seed"), commands, "Results"),
        table_of(
            ("file", "sha256", "today"),
            [(entry.file, entry.sha256, entry.state) for entry in inputs.values()],
            "Inputs",
        ),
    ]
    parts += [Sentence(note, "note") for note in evidence.notes]
    for result in evidence.results:
        parts += [
            Sentence(f"{result.path.name}: {line}", "note") for line in result.record.warnings
        ]
    return Section("provenance", "Where the figures come from", tuple(parts))


def arm(evidence: ReportEvidence) -> Section | None:
    """The measured poses where there are any, else those of the first plan."""
    if evidence.cell is None:
        return None
    shown: Poses | Measurements
    level, ways = None, list[tuple[str, Array]]()
    design = evidence.first("design")
    if evidence.data:
        path, measured = next(iter(evidence.data.items()))
        shown = measured.data
    elif design is not None and design.path in evidence.plans:
        path, shown = design.path, evidence.plans[design.path]
        if isinstance(design.record, DesignRecord):
            level = design.record.level_joint
            moves = {row.pose: row.last_move for row in design.record.poses}
            ways = ways_in_turn(design.record.day, moves, evidence.cell.robot, shown.q)
    else:
        return None
    lit = evidence.highlight[path]
    kept = _once(lit, shown)
    number = {name: i for i, name in enumerate(_names(kept))}
    stops = [(number[lit[name]], way) for name, way in ways]
    drawn = scene(evidence.cell, kept, level_joint=level, stops=stops)
    return Section("arm", "The arm at each pose", (Raw(figure_html(drawn, "arm-view")),))


def _names(shown: Poses | Measurements) -> tuple[str, ...]:
    return (shown.poses if isinstance(shown, Measurements) else shown).names


def _once(highlight: Mapping[str, str], shown: Poses | Measurements) -> Poses | Measurements:
    """One pose of each configuration, under the name that the page lights."""
    poses = shown.poses if isinstance(shown, Measurements) else shown
    names = [highlight[name] for name in poses.names]
    first = np.array([names.index(name) for name in dict.fromkeys(names)])
    kept = replace(poses.take(first), names=tuple(names[i] for i in first))
    return replace(shown.take(first), poses=kept) if isinstance(shown, Measurements) else kept


OF_THE_CELL: tuple[Callable[[ReportEvidence], Section | None], ...] = (arm, cell)

WITH_INPUTS: dict[str, tuple[Callable[[ReportEvidence, ReportedResult], Section | None], ...]] = {
    "identify": (coverage, against),
}
"""What is told of a record and its inputs, where these are unchanged."""


def sections(
    evidence: ReportEvidence, told: dict[str, str]
) -> Iterator[tuple[Section, Mapping[str, str]]]:
    """All sections that the evidence allows, each with the names of its poses that the page highlights.

    told : what the user tells of the measurement, by label
    """
    yield summary(evidence, told), {}
    for about in OF_THE_CELL:
        section = about(evidence)
        if section is not None:
            yield section, {}
    for kind in KINDS:
        several = evidence.of(kind)
        for number, result in enumerate(several, 1):
            highlight = evidence.highlight.get(result.path, {})
            for section in _of(evidence, result):
                own = _own(section, result, number) if len(several) > 1 else section
                yield own, highlight
    for section in certificate(evidence, told):
        yield section, {}
    yield provenance(evidence, told), {}


def _of(evidence: ReportEvidence, result: ReportedResult) -> Iterator[Section]:
    yield from result.told.sections
    told = [tell(evidence, result) for tell in WITH_INPUTS.get(result.kind, ())]
    yield from (section for section in told if section is not None)


def _own(section: Section, result: ReportedResult, number: int) -> Section:
    """The section under a name of its own, where several results are of its kind."""
    title = f"{section.title}: {result.path.name}"
    return replace(section, key=f"{section.key}-{number}", title=title)
