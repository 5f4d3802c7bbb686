"""``posecal demo``: the whole way on the paper's robot, from an embedded cell."""

from __future__ import annotations

from pathlib import Path

import click

from studies.commands.common import json_option, one_line_faults, seed_option


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("posecal-demo"))
@json_option
@seed_option
@one_line_faults
def demo(folder: Path, json_path: str | None, seed: int) -> None:
    """Write a complete example to FOLDER and identify it.

    The paper's KR 270 is measured by simulation at the fifteen poses of its Table II, free and with
    250 kg on the tool. Cell, plan, measurements and results are files to edit and run again.

    \b
    Example:
      posecal demo my-first-calibration
    """
    from calib import load_cell, load_plan
    from calib.errors import InputError
    from calib.files.write import json_text, write_files
    from calib.files.write_tables import measurements_csv
    from studies.commands.identify import identify
    from studies.demo import INPUTS, embedded_text, simulated

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", f"cannot be made ({error.strerror})", "name another") from None
    for name in INPUTS:
        path = folder / name
        if path.exists() and path.read_text(encoding="utf-8") != embedded_text(name):
            raise InputError(path, "", "was edited and is kept", "name another folder for the demo")
    write_files({folder / name: embedded_text(name) for name in INPUTS})
    cell = load_cell(folder / "cell.toml")
    data, model, truth = simulated(cell, load_plan(cell, folder / "plan.csv"), seed)
    true_parameters = {
        p.id: {"value": v / p.scale, "unit": p.unit}
        for p, v in zip(model.parameters, truth, strict=True)
    }
    write_files(
        {
            folder / "measurements.csv": measurements_csv(cell, data),
            folder / "truth.json": json_text({"seed": seed, "parameters": true_parameters}),
        }
    )
    click.echo(
        err=json_path == "-",
        message=f"simulated {len(data)} readings ({len(data) // 2} poses, free and loaded) "
        f"of {data.seen.shape[1]} markers\n",
    )
    context = click.get_current_context()
    context.invoke(
        identify,
        cell_path=folder / "cell.toml",
        data_path=folder / "measurements.csv",
        json_path=json_path or str(folder / "result.json"),
        urdf_path=folder / "kr270_calibrated.urdf",
        seed=seed,
    )
    click.echo(_next_steps(folder), err=json_path == "-")


def _next_steps(folder: Path) -> str:
    return f"""
In {folder}: the inputs cell.toml, kr270.urdf, plan.csv and measurements.csv; the simulated truth,
which identification never reads, in truth.json; the results result.json and kr270_calibrated.urdf.

Try next:
  posecal identify {folder}/cell.toml {folder}/measurements.csv --method two-step
  posecal identify {folder}/cell.toml {folder}/measurements.csv --approach pose --weighting plain
  posecal design {folder}/cell.toml --candidates 2000 -o {folder}/better.csv"""
