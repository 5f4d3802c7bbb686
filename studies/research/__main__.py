"""All that is run in this folder, one line each."""

from __future__ import annotations

import ast
from pathlib import Path

HERE = Path(__file__).parent


def commands() -> dict[str, str]:
    """Module -> first line of its docstring, of all that end in a call of ``main``."""
    found = {}
    for path in sorted(HERE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        runs = 'if __name__ == "__main__":' in text and not path.name.startswith("drive_")
        if runs and path != Path(__file__):
            inner = path.relative_to(HERE).with_suffix("").parts
            says = ast.get_docstring(ast.parse(text)) or ""
            found[".".join(inner).removesuffix(".__main__")] = says.partition("\n")[0]
    return found


if __name__ == "__main__":
    for name, says in commands().items():
        print(f"python -m studies.research.{name:20} {says}")
