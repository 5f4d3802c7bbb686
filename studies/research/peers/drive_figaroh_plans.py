"""FIGAROH's Detmax on problems from a file, by an interpreter that has it.

    python drive_figaroh_plans.py PROBLEMS.npz ANSWER.json

Detmax keeps its plan to itself, so the plan is taken from its last call of the criterion. Its pool
keeps what was chosen, so a pose may be in a plan more than once. CPU seconds are those of the exchange.
"""

import json
import random
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from figaroh.optimal.base_optimal_calibration import Detmax

STARTS = 3


class Watched(Detmax):  # type: ignore[misc]
    """Detmax that shows what it chose."""

    def get_critD(self, chosen):  # type: ignore[no-untyped-def]
        """The criterion of a plan, which is kept."""
        self.seen = list(chosen)
        return super().get_critD(chosen)


if __name__ == "__main__":
    problems, runs = np.load(sys.argv[1]), []
    for name in (key for key in problems.files if not key.endswith("_poses")):
        pool, poses = dict(enumerate(problems[name])), int(problems[f"{name}_poses"])
        Watched(pool, poses).get_critD(list(range(poses)))  # imports picos
        for start in range(STARTS):
            random.seed(start)
            search = Watched(pool, poses)
            begun = time.process_time()
            search.main_algo()
            seconds = time.process_time() - begun
            plan = [int(k) for k in search.seen]
            runs.append({"problem": name, "seconds": seconds, "plan": plan})
    Path(sys.argv[2]).write_text(json.dumps({"version": version("figaroh"), "runs": runs}))
