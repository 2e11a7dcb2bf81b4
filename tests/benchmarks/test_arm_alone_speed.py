"""us per sample of an arm's functions from Python: many samples in one call, one after the other, and Pinocchio's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from harness import SHORT, best, show, sized

from runtime.arrays import Array
from runtime.notebook.arm import LoadedArm, load
from runtime.notebook.exchanged import export

SAMPLES, ALONE, REPETITIONS = sized((100_000, 2_000, 7), (1_000, 20, 1))
FASTER = 20.0
"""How many times as fast as a loop of single calls a sample of many is at least; measured: 200 and more."""
NAMES = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "gravity", "jacobian")


def _others(arm: LoadedArm, folder: Path) -> tuple[dict[str, Callable[[Array, Array, Array], Array]], str]:
    """Pinocchio's functions of the same arm, by the names here; none where it is not installed."""
    try:
        import pinocchio
    except ImportError:
        return {}, "Pinocchio is not installed (the extra `benchmark`)"
    export(arm, folder / "arm.urdf")
    model = pinocchio.buildModelFromUrdf(str(folder / "arm.urdf"))
    data, tip = model.createData(), model.getFrameId(model.frames[-1].name)
    local = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def mass_matrix(q: Array, *_: Array) -> Array:
        upper = np.triu(pinocchio.crba(model, data, q))
        return upper + np.triu(upper, 1).T

    functions = {
        "inverse_dynamics": lambda *a: pinocchio.rnea(model, data, *a).copy(),
        "forward_dynamics": lambda *a: pinocchio.aba(model, data, *a).copy(),
        "mass_matrix": mass_matrix,
        "gravity": lambda q, *_: pinocchio.computeGeneralizedGravity(model, data, q).copy(),
        "jacobian": lambda q, *_: pinocchio.computeFrameJacobian(model, data, q, tip, local).copy(),
    }
    return functions, f"Pinocchio {pinocchio.__version__} in a loop of Python"


def test_many_samples_in_one_call(tmp_path: Path) -> None:
    arm = load("ur10").with_rotors(0.0)
    others, note = _others(arm, tmp_path)
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, SAMPLES, arm.n))
    rows = []
    for name in NAMES:
        function = getattr(arm, name)
        given = (q, qd, qdd)[: 3 if name.endswith("dynamics") else 1]
        each = [tuple(x[k] for x in given) for k in range(ALONE)]
        together = function(*given)
        np.testing.assert_array_equal(together[:ALONE], [function(*one) for one in each])
        many = best(lambda f=function, a=given: f(*a), REPETITIONS) / SAMPLES
        alone = best(lambda f=function, e=each: [f(*one) for one in e], REPETITIONS) / ALONE
        row = [name, f"{1e6 * many:.3f}", f"{1e6 * alone:.1f}", f"{alone / many:.0f}"]
        if other := others.get(name):
            mine = [other(q[k], qd[k], qdd[k]) for k in range(ALONE)]
            np.testing.assert_allclose(together[:ALONE], mine, atol=1e-9 * np.abs(mine).max())
            theirs = best(lambda o=other: [o(q[k], qd[k], qdd[k]) for k in range(ALONE)], REPETITIONS) / ALONE
            row += [f"{1e6 * theirs:.1f}", f"{theirs / many:.0f}"]
        rows.append(row)
        if not SHORT:
            assert alone > FASTER * many
    head = ["UR10, us per sample", "many", "alone", "ratio", "Pinocchio", "ratio"]
    show(f"{SAMPLES} samples (N, n) in one call, and one call a sample", head, rows, [note])
