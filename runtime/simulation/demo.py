"""What `tendon demo` works on: two recordings of the plant, one to fit and one to judge by."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from runtime.recordings import recording
from runtime.simulation.demo_plant import record

SEEDS = {"fitted.csv.gz": 1, "held_out.csv.gz": 2}


def record_files(directory: Path) -> list[Path]:
    """Record the drive twice, another motion each time, into `directory`. Raises OSError."""
    paths = []
    for name, seed in SEEDS.items():
        path = directory / name
        t, q, tau = record(seed)
        run = np.zeros(len(t), dtype=np.int64)
        whole = recording.Recording(
            path, t, run, q[None], tau[None], types=("revolute",), segments=(slice(0, len(t)),), temperature=(None,)
        )
        recording.write(path, whole)
        paths.append(path)
    return paths
