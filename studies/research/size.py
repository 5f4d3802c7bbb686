"""How large the program is, and how much of it one command runs: ``python -m studies.research.size``.

    python -m studies.research.size [CHECKOUT ..] [--json FILE] [--no-runs]

For each checkout, this one by default: lines by kind, modules, classes, names defined twice, private
functions used once, and the files and the depth of calls of four commands on the demo's files. Two
checkouts stand beside each other, so that one command compares before and after.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import os
import statistics
import subprocess
import sys
import tempfile
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PRODUCT = ("calib", "doe", "studies")
PARTS = (*PRODUCT, "research", "tests")
_RUNS = {
    "identify": ["identify", "cell.toml", "measurements.csv", "--json", "again.json"],
    "design": ["design", "cell.toml", "--candidates", "2000", "--json", "designed.json"],
    "diagnose": ["diagnose", "cell.toml", "measurements.csv", "--json", "diagnosed.json"],
    "report": ["report", "again.json", "diagnosed.json", "-o", "again.html"],
}
_TRACER = """
import sys, json
root, out, *sys.argv = sys.argv[1:]
depth = deepest = 0
files = set()
def traced(frame, event, argument):
    global depth, deepest
    name = frame.f_code.co_filename
    own = name.startswith((root + "calib/", root + "doe/", root + "studies/"))
    code = frame.f_code
    if not own or not code.co_flags & 1 or code.co_name[0] == "<":  # no body of a module, none unnamed
        return
    if event == "call":
        files.add(name)
        depth += 1
        deepest = max(deepest, depth)
    elif event == "return":
        depth -= 1
from studies.cli import run
sys.setprofile(traced)
try:
    run()
except SystemExit:
    pass
finally:
    sys.setprofile(None)
    json.dump([len(files), deepest], open(out, "w"))
"""


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("checkouts", nargs="*", type=Path, default=[Path.cwd()])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--no-runs", action="store_true", help="count, and run no command")
    asked = parser.parse_args()
    found = [sizes(path.resolve(), not asked.no_runs) for path in asked.checkouts]
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1) + "\n")
    for name in found[0]:
        print(f"{name:44}" + "".join(f"{one.get(name, '-')!s:>22}" for one in found))


def sizes(root: Path, runs: bool) -> dict[str, int | str]:
    """Every figure of one checkout, by its name."""
    found: dict[str, int | str] = {}
    for part in PARTS:
        lines: Counter[str] = Counter()
        for file in files_of(root, part):
            lines += kinds_of_lines(file.read_text())
        for kind in ("code", "imports", "docstring", "comment", "blank"):
            found[f"{part}: {kind}"] = lines[kind]
        found[f"{part}: all lines"] = lines.total()
        found[f"{part}: modules"] = len(list(files_of(root, part)))
    product = [file for part in PRODUCT for file in files_of(root, part)]
    lengths = [len(file.read_text().splitlines()) for file in product]
    found["product: all lines"] = sum(lengths)
    found["product: modules"] = len(product)
    found["product: median module"] = round(statistics.median(lengths))
    found["product: largest module"] = max(lengths)
    found |= names_of(product)
    if runs:
        found |= {f"{name}: files run, depth": text for name, text in run_by(root)}
    return found


def files_of(root: Path, part: str) -> Iterator[Path]:
    """Python files of a part; research is no part of ``studies``."""
    research = root / "studies" / "research"
    folder = research if part == "research" else root / part
    for file in sorted(folder.rglob("*.py")):
        if part != "studies" or research not in file.parents:
            yield file


def kinds_of_lines(text: str) -> Counter[str]:
    """How many lines are code, imports, docstrings, comments and blank."""
    lines = text.splitlines()
    kinds = ["blank" if not line.strip() else "code" for line in lines]
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        row = token.start[0] - 1
        if token.type == tokenize.COMMENT and lines[row].strip().startswith("#"):
            kinds[row] = "comment"
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            kind = "imports"
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            kind = "docstring" if isinstance(node.value.value, str) else "code"
        else:
            continue
        end = node.end_lineno or node.lineno
        kinds[node.lineno - 1 : end] = [kind] * (end - node.lineno + 1)
    return Counter(kinds)


def names_of(product: list[Path]) -> dict[str, int | str]:
    """Classes, names of classes met twice, and private functions by how often they are used."""
    classes: Counter[str] = Counter()
    private = used_once = 0
    for file in product:
        tree = ast.parse(file.read_text())
        nodes = list(ast.walk(tree))
        classes.update(node.name for node in nodes if isinstance(node, ast.ClassDef))
        names = Counter(node.id for node in nodes if isinstance(node, ast.Name))
        names.update(node.attr for node in nodes if isinstance(node, ast.Attribute))
        own = [
            node.name
            for node in nodes
            if isinstance(node, ast.FunctionDef)
            and node.name.startswith("_")
            and not node.name.startswith("__")
        ]
        private += len(own)
        used_once += sum(names[name] == 1 for name in own)
    twice = sorted(name for name, count in classes.items() if count > 1 and name[0] != "_")
    return {
        "product: classes": classes.total(),
        "product: class names defined twice": len(twice),
        "product: private functions": private,
        "product: private functions used once": used_once,
    }


def run_by(root: Path) -> Iterator[tuple[str, str]]:
    """Product files that each command runs on the demo's files, and the deepest call."""
    environment = os.environ | {"PYTHONPATH": str(root), "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        call = [sys.executable, "-c", "from studies.cli import run; run()", "demo", "."]
        subprocess.run(call, cwd=folder, env=environment, check=True, capture_output=True)  # noqa: S603
        for name, command in _RUNS.items():
            out = Path(folder, "count.json")
            call = [sys.executable, "-c", _TRACER, f"{root}/", str(out), "posecal", *command]
            subprocess.run(call, cwd=folder, env=environment, check=True, capture_output=True)  # noqa: S603
            files, depth = json.loads(out.read_text())
            yield name, f"{files}, {depth}"


if __name__ == "__main__":
    main()
