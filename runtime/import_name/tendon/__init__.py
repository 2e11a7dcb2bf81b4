"""Tendon for notebooks and scripts: the verbs of the command line, with their names and results.

    import tendon

    arm = tendon.load("drive.toml")
    run = tendon.recording("run1.csv", arm)  # or from arrays: tendon.recording(t=t, q=q, tau=tau)
    result = tendon.diagnose(arm, run)  # printed, a few lines; result.figures draw themselves
    print(result.findings[0].effect, result.findings[0].error_after)
    better = tendon.improve(arm, run, held_out="run2.csv")
    better.save("better.toml")
    better.arm.inverse_dynamics(q, qd, qdd)  # (n,) or (N, n), from the generated C

Errors are ValueErrors whose message is the line that the command line prints.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

from runtime.version import VERSION as __version__  # noqa: F401


def _listed() -> dict[str, tuple[str, str]]:
    lines = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    imports = [line for line in lines if isinstance(line, ast.ImportFrom)]
    found = {name.name: (str(line.module), name.name) for line in imports for name in line.names}
    return found | {"Arm": found["LoadedArm"]}


_HOMES = _listed()
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first used: CasADi, SciPy and Matplotlib take a second."""
    if name not in _HOMES:
        raise AttributeError(f"module 'tendon' has no attribute {name!r}; it has {', '.join(__all__)}")
    module, there = _HOMES[name]
    found = globals()[name] = getattr(import_module(module), there)
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
