"""Other programs on blocks from a file; run by an interpreter that has them, posecal is not needed.

    python drive_designs.py NAME BLOCKS.npz POSES

prints one JSON line: version, and seconds and results of every run. What is timed is the optimisation
alone, with the blocks in memory.
"""

import importlib
import json
import random
import sys
import time
from importlib.metadata import version
from typing import Any

import numpy as np


def figaroh(matrices: Any, poses: int) -> list[dict[str, Any]]:
    """Detmax from three random starts.

    It keeps its plan to itself, so the set is taken from its last call of the criterion. Its pool keeps
    what was chosen, so a candidate may be in a plan more than once.
    """
    module = importlib.import_module("figaroh.optimal.base_optimal_calibration")

    class Watched(module.Detmax):  # type: ignore[misc, name-defined]
        def get_critD(self, chosen: Any) -> Any:
            self.seen = chosen
            return super().get_critD(chosen)

    pool = dict(enumerate(matrices))
    Watched(pool, poses).get_critD(list(range(poses)))  # imports picos
    found = []
    for seed in range(3):
        random.seed(seed)
        search = Watched(pool, poses)
        begun = time.perf_counter()
        search.main_algo()
        seconds = time.perf_counter() - begun
        found.append({"way": f"Detmax start {seed}", "seconds": seconds, "plan": search.seen})
    return found


def pydex(matrices: Any, poses: int) -> list[dict[str, Any]]:  # noqa: ARG001
    """D-optimal efforts by its cvxpy formulation; its sensitivities are set, not computed."""
    designer_class = importlib.import_module("pydex.core.designer").Designer
    found = []
    for solver in ("CLARABEL", "SCS"):
        designer = designer_class()
        designer.n_c, designer.n_spt, designer.n_mp = len(matrices), 1, matrices.shape[-1]
        designer.atomic_fims, designer.sensitivities = matrices.copy(), np.zeros(1)
        designer._model_parameters_changed = designer._candidates_changed = False
        designer._dynamic_system, designer._verbose = False, 0
        begun = time.perf_counter()
        designer.design_experiment(designer.d_opt_criterion, package="cvxpy", optimizer=solver)
        seconds = time.perf_counter() - begun
        weights = np.maximum(np.asarray(designer.efforts).ravel(), 0.0)
        found.append({"way": solver, "seconds": seconds, "weights": weights.tolist()})
    return found


if __name__ == "__main__":
    name, path, poses = sys.argv[1:]
    with np.load(path) as file:
        runs = {"figaroh": figaroh, "pydex": pydex}[name](file["matrices"], int(poses))
    print(json.dumps({"version": version(name), "runs": runs}))
