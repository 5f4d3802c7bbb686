"""The page: its sections in their order, the frame with styles and scripts, and its record."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from markupsafe import Markup

from calib import Cell
from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.instruments import ArmCamera, Camera, Instrument, Tracker
from calib.poses import Measurements, Poses
from studies.document import (
    Detail,
    Document,
    Figure,
    Part,
    Raw,
    Section,
    Sentence,
    labelled,
    plural,
)
from studies.document.page import Writer, shown, table_of, template
from studies.identify.record import IdentifyRecord
from studies.identify.telling import point_errors
from studies.kinds import KINDS
from studies.plots import residuals
from studies.record import Record
from studies.report.arm_scene import scene
from studies.report.arm_view import figure_html
from studies.report.evidence import MeasuredTables, ReportedResult, ReportEvidence, load_evidence
from studies.report.summary import certificate, summary

if TYPE_CHECKING:
    pass


def cell(own: Cell) -> Section:
    """What was measured with what."""
    facts = table_of(("", ""), list(_facts(own)))
    units = np.where(own.robot.prismatic, "mm", "deg")
    scale = np.where(own.robot.prismatic, 1e3, 180.0 / np.pi)
    joints = table_of(
        ("joint", "moves", "from", "to", "unit", "mass of its link [kg]"),
        [
            (name, "slides" if slides else "turns",
             *(float(x) if np.isfinite(x) else None for x in limits * factor), unit, mass or None)
            for name, slides, limits, factor, unit, mass in zip(
                own.robot.joints, own.robot.prismatic, own.robot.limits, scale, units,
                own.robot.masses.tolist(), strict=True,
            )
        ],
        "Joints, with the limits of the cell",
    )  # fmt: skip
    return Section("cell", "The cell", (facts, joints))


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
    places = [
        f"{own.marker_names[i]} ({', '.join(shown(x * 1e3) for x in own.markers[i].tolist())}) mm"
        for i in own.single_markers
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
    parts = [noise.deviations(np.array([away, 0.0, 0.0])) for away in (1.0, 5.0)]
    near, far = (
        f"{shown(float(along) * 1e3)} mm along and {shown(float(across) * 1e3)} mm across the beam"
        for along, across in parts
    )
    return f"{near} at 1 m, {far} at 5 m"


Reading = tuple[Poses, int]
_SAME_JOINTS = 1e-6  # rad or m


def against(cell: Cell, data: MeasuredTables, record: IdentifyRecord) -> Iterator[Section]:
    """Errors against what they may depend on, of poses that the tables hold."""
    found = point_errors(record)
    read = [data.reading(*row) for row in zip(found.poses, found.heldout.tolist(), strict=True)]
    rows = [row for row in read if row is not None]
    if not rows:
        return
    found = found.take(np.array([row is not None for row in read], dtype=bool))
    variables, sigma = dict(_variables(cell.robot, rows)), record.noise.instrument_mm * 1e-3
    rms = found.by_pose(found.after)
    figure = Figure(lambda: residuals.against(rms, variables, sigma, found.heldout))
    yield Section("against", "What is left, against what it may depend on", (figure,))


def _variables(robot: Robot, rows: list[Reading]) -> Iterator[tuple[str, Array]]:
    q = np.array([poses.q[i] for poses, i in rows])
    for k, (joint, slides) in enumerate(zip(robot.joints, robot.prismatic, strict=True)):
        yield (
            (f"{joint} [mm]", q[:, k] * 1e3) if slides else (f"{joint} [deg]", np.degrees(q[:, k]))
        )
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
        (own.path.name, "diagnose --plan-only" if own.kind == "plan" else own.kind,
         own.record.version, str(own.record.seed))
        for own in evidence.results
    ]  # fmt: skip
    inputs = {(one.file, one.sha256): one.state for own in evidence.results for one in own.inputs}
    warnings = [f"{own.path.name}: {w}" for own in evidence.results for w in own.record.warnings]
    parts: list[Part] = [
        table_of(("", ""), list(told.items())),
        table_of(("result", "command", "posecal", "seed"), commands, "Results"),
        table_of(("file", "sha256", "today"), [(*one, s) for one, s in inputs.items()], "Inputs"),
        *(Sentence(note, "note") for note in (*evidence.notes, *warnings)),
    ]
    return Section("provenance", "Where the figures come from", tuple(parts))


def arm(evidence: ReportEvidence, cell: Cell) -> Iterator[Section]:
    """The measured poses where there are any, else those of the first plan."""
    shown: Poses | Measurements
    design = evidence.first("design")
    if evidence.data:
        shown = next(iter(evidence.data.values())).data
    elif design is not None and design.path in evidence.plans:
        shown = evidence.plans[design.path]
    else:
        return
    drawn = scene(cell, shown.take(_once(shown)))
    yield Section("arm", "The arm at all poses", (Raw(figure_html(drawn, "arm-view")),))


def _once(shown: Poses | Measurements) -> IntArray:
    """Where each configuration comes first."""
    poses = shown.poses if isinstance(shown, Measurements) else shown
    rounded = np.round(poses.q / _SAME_JOINTS).astype(np.int64)
    return np.sort(np.unique(rounded, axis=0, return_index=True)[1])


def sections(evidence: ReportEvidence, told: dict[str, str]) -> Iterator[Section]:
    """All sections that the evidence allows.

    told : what the user tells of the measurement, by label
    """
    yield summary(evidence, told)
    if evidence.cell is not None:
        yield from arm(evidence, evidence.cell)
        yield cell(evidence.cell)
    for kind in KINDS:
        several = evidence.of(kind)
        for number, result in enumerate(several, 1):
            for own in _of(evidence, result):
                if len(several) > 1:  # under a name of its own
                    key, title = f"{own.key}-{number}", f"{own.title}: {result.path.name}"
                    own = replace(own, key=key, title=title)
                yield own
    yield from certificate(evidence, told)
    yield provenance(evidence, told)


def _of(evidence: ReportEvidence, result: ReportedResult) -> Iterator[Section]:
    """What a record tells, and an identification with its tables, where these are unchanged."""
    yield from result.told.sections
    tables, record = evidence.data.get(result.path), result.record
    if evidence.cell is not None and tables is not None and isinstance(record, IdentifyRecord):
        yield from against(evidence.cell, tables, record)


def asset(name: str) -> Markup:
    """The text of a file, to stand inside ``<style>`` or ``<script>``."""
    return Markup((files("studies.report") / name).read_text(encoding="utf-8"))  # noqa: S704


_STYLES = ("page.css", "arm_view.css")
_SCRIPTS = ("page.js",)


def report_page(
    results: Sequence[Path], title: str | None, told: dict[str, str]
) -> tuple[str, tuple[str, ...]]:
    """The report as HTML that names nothing outside itself, and notes on what had to be left out.

    title : str, None for the name of the cell
    told : what the user tells of the measurement (operator, instrument ..), by label

    Raises InputError where a file is no result, or one that misses what results of its kind hold.
    """
    evidence, writer = load_evidence(results), Writer.fresh()
    named = [own.record.cell for own in evidence.results if own.record.cell] or ["Calibration"]
    name = named[0] if evidence.cell is None else evidence.cell.name
    html = template("studies.report", "page.html.j2").render(
        title=title or name,
        told=told,
        sections=[(own, writer.section(own)) for own in sections(evidence, told)],
        styles=[asset(name) for name in _STYLES],
        scripts=[asset(name) for name in _SCRIPTS],
    )
    return html, evidence.notes


class ReportRecord(Record):
    """A page of results, which are its inputs.

    page : the file; notes : what had to be left out of it
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["report"] = "report"
    page: str
    notes: tuple[str, ...]


def told(record: ReportRecord) -> Document:
    """Of how many results, and what it lacks."""
    about = Sentence(f"{record.page}: one page of {plural(len(record.inputs), 'result')}")
    parts = (about, *labelled("note", record.notes))
    return Document((), (Section("report", "A page of results", (Detail(parts),)),))
