"""posecal by its own library, after one run to warm up; it reads the cell and the table of the work."""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import calib


def main(folder: Path, answer: Path, repeats: int) -> None:
    """Do the work and write the answer."""
    runs = []
    for way in json.loads((folder / "work.json").read_text())["cells"]:
        cell = calib.load_cell(folder / way["cell"])
        data = calib.load_measurements(cell, folder / "measurements.csv")
        held, _ = calib.load_targets(cell, folder / "targets.csv")
        seconds = []
        for fresh in [data.take(slice(None)) for _ in range(repeats + 1)]:  # poses remember results
            begun = time.process_time()
            result = calib.identify(cell, fresh)
            seconds.append(time.process_time() - begun)
        runs.append(
            {
                "way": way["way"],
                "free": result.rank,
                "seconds": seconds[1:],
                "converged": result.status != "not_converged",
                "fit": result.predict(data.poses).tolist(),
                "heldout": result.predict(held).tolist(),
            }
        )
    answer.write_text(json.dumps({"version": version("posecal"), "runs": runs}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
