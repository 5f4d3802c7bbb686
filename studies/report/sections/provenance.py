"""What the report rests on: results, inputs with their hashes, versions, who and when."""

from __future__ import annotations

from studies.document import Part, Section, Sentence
from studies.document.page import table_of
from studies.report.evidence import Evidence


def provenance(evidence: Evidence, told: dict[str, str]) -> Section:
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
