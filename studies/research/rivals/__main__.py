"""Let a rival answer a case: ``python -m studies.research.rivals aic CELL DATA HELDOUT ANSWER``."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import click

from studies.command.options import one_line_faults

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(help="Answer as `posecal diagnose` does, by a simple method.")
@click.argument("method", type=click.Choice(["aic", "bic", "black-box"]))
@click.argument("cell_path", metavar="CELL", type=_FILE)
@click.argument("data_path", metavar="DATA", type=_FILE)
@click.argument("heldout_path", metavar="HELDOUT", type=_FILE)
@click.argument("answer_path", metavar="ANSWER", type=_FILE)
@one_line_faults
def main(
    method: str, cell_path: Path, data_path: Path, heldout_path: Path, answer_path: Path
) -> None:
    """Read the case, answer, write."""
    import calib
    from calib.errors import CalibError
    from calib.files.write import json_text, write_files
    from calib.threads import one_blas_thread

    cell = calib.load_cell(cell_path)
    data = calib.load_measurements(cell, data_path)
    heldout = calib.load_measurements(cell, heldout_path, every_marker=False)
    data, heldout = calib.in_one_session(data, heldout)
    if method == "black-box":
        from studies.research.rivals.black_box import black_box

        if find_spec("sklearn") is None:
            raise CalibError("black-box needs scikit-learn; pip install 'posecal[rivals]'")
        found = one_blas_thread(black_box)(cell, data, heldout)
    else:
        from studies.research.rivals.stepwise import stepwise

        found = one_blas_thread(stepwise)(cell, data, heldout, schwarz=method == "bic")
    write_files({answer_path: json_text(found)})


if __name__ == "__main__":
    main()
