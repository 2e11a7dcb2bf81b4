"""CPU seconds and memory of a diagnosis, its parts, and its ratio to one linear fit of the same rows in NumPy.

Each recording is diagnosed in a fresh process. Parts come from samples of the stack: a sample counts for the CPU time
since the one before, and belongs to the outermost function that PARTS has.
"""

from __future__ import annotations

import json
import os
import resource
import shlex
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from types import CodeType, FrameType
from typing import Any

import numpy as np
from harness import show, sized, timed
from numpy_reference import stacked

from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.verdict import Diagnosis
from runtime.model.loader import Model
from runtime.recordings import recording
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import Recording
from runtime.report import diagnosed
from runtime.simulation import demo, simulate
from runtime.simulation.options import SimulationSettings
from runtime.workspace.source import CompiledArm, Source
from tests.first_hour import MACHINES, REAL
from tests.six_joints import six_joints

ROOT = Path(__file__).resolve().parents[2]
TENDON = "from runtime.cli.main import main; main()"
SELECTED = os.environ.get("TENDON_BENCHMARK_CASES", "")
"""Cases whose names begin so."""
SAMPLED = 2e-3
"""s of CPU time between two samples of the stack."""
FITTED = 0.2
"""s of CPU time that NumPy's fits take together: the mean of them counts, as the clock of CPU time may be coarse."""
REST = "rest"
PARTS: Mapping[str, str] = {
    "runtime.diagnosis.stages:begin": "first fit",
    "runtime.diagnosis.ranking:rank": "search",
    "runtime.diagnosis.ranking:weigh": "search",
    "runtime.diagnosis.twist:witnessed": "search",
    "runtime.diagnosis.search:paired": "pairs",
    "runtime.identification.fitting:fit_motion": "refits",
    "runtime.diagnosis.steps:Step.of": "refits",
    "runtime.diagnosis.detection_limits:of": "limits",
    "runtime.diagnosis.verdict:decide": "verdict",
    "runtime.report.diagnosed:document": "verdict",
}
"""What a function of the diagnosis, and all that it calls, belongs to; band and derivatives are with the first fit."""


@dataclass(frozen=True)
class Case:
    """A recording to diagnose.

    arm: the model; hidden: what it lacks, "" for nothing, None where that is not known; seconds: how long it is
    simulated, None: recorded otherwise; goal: CPU s wanted
    """

    arm: str
    goal: float
    hidden: str | None = ""
    seconds: float | None = None

    def model(self, folder: Path) -> Model:
        if self.arm == "six":
            return CompiledArm(six_joints(), None).model()
        machine = folder / "machine.toml"
        return (Source.read(machine, None) if machine.exists() else Source.shipped(self.arm)).compiled.model()

    def record(self, folder: Path) -> Path:
        """The recording's file; for a real machine also its model file, as a new user has it."""
        if self.arm in MACHINES:
            command = f"{MACHINES[self.arm].begun} --out machine.toml"
            subprocess.run(
                [sys.executable, "-c", TENDON, *shlex.split(command)], cwd=folder, check=True, capture_output=True
            )
            return MACHINES[self.arm].fitted
        if self.seconds is None:
            return demo.record_files(folder)[0]
        model, path = self.model(folder), folder / "recording.csv"
        hidden = [simulate.parse_hidden(self.hidden, model)] if self.hidden else []
        made, _ = simulate.simulate(model, hidden, SimulationSettings(seconds=self.seconds))
        recording.write(path, made)
        return path


CASES: Mapping[str, Case] = {
    "drive": Case("drive", 1.0, seconds=sized(1000.0, 40.0)),
    "drive, stribeck": Case("drive", 3.0, "stribeck@1", sized(1000.0, 40.0)),
    "demo": Case("drive", 2.0, "stribeck@1"),
    "vishard4": Case("vishard4", 4.0, "stribeck@2", sized(80.0, 20.0)),
    "six, stribeck": Case("six", 6.0, "stribeck@2", sized(60.0, 8.0)),
    "six, elasticity": Case("six", 6.0, "elasticity@3", 60.0),
    "tx40": Case("tx40", 15.0, None),
}
TOO_LONG = sized((), ("six, elasticity", "tx40"))
"""What the short form leaves out."""


def test_diagnosis_speed(tmp_path: Path) -> None:
    """What is hidden has to be found; seconds and ratios are printed."""
    parts = (*dict.fromkeys(PARTS.values()), REST)
    rows, shares, notes = [], [], []
    for name, case in CASES.items():
        if not name.startswith(SELECTED) or name in TOO_LONG:
            continue
        if case.arm in MACHINES and not REAL.is_dir():
            notes.append(f"{name}: left out, as ../shared/data/real is not there")
            continue
        folder = tmp_path / name
        folder.mkdir()
        found = _in_a_fresh_process(name, folder, case.record(folder))
        assert case.hidden is None or found["named"] == case.hidden
        sizes = f"{found['samples']} x {found['joints']}", f"{found['rows']}"
        seconds, fit = found["seconds"], found["fit"]
        times = f"{found['reading']:.2f}", f"{seconds:.2f}", f"{case.goal:g}"
        rows.append((name, *sizes, *times, f"{found['memory']:.0f}", f"{1e3 * fit:.1f}", f"{seconds / fit:.0f}"))
        shares.append((name, *(f"{found['parts'].get(part, 0.0):.2f}" for part in parts)))
        notes.append(f"{name}: {found['verdict']}, {found['named'] or 'nothing named'}")
    head = ("recording", "samples", "rows", "read, s", "CPU s", "goal", "MB", "NumPy, ms", "ratio")
    notes += [
        "goal: CPU s on a slower computer, for which it was set; and at most 500 MB more than reading leaves",
        "NumPy: CPU time of one numpy.linalg.lstsq of the rows of the first fit, the ratio's denominator;",
        "a ratio of 20 is the aim for one joint with nothing hidden",
    ]
    show("Diagnosis: CPU seconds and memory", head, rows, notes)
    show("Parts of the diagnosis, CPU s", ("recording", *parts), shares)


def _in_a_fresh_process(name: str, folder: Path, path: Path) -> dict[str, Any]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, __file__, name, str(folder), str(path)]
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE)
    return dict(json.loads(done.stdout))


def measured(case: Case, folder: Path, path: Path) -> dict[str, Any]:
    """One diagnosis, with what its result writes as JSON: seconds of CPU time, by part too, and MB."""
    model = case.model(folder)
    reading, data = timed(lambda: recording.read(path, RecordedArm(model.joints, model.spatial)))
    before = _memory("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    found, spent = _sampled(lambda: _diagnosed(model, data))
    memory = _memory("VmHWM") - before
    first = found.steps[0].fit
    columns, torque = stacked(first.problem, first.shapes, first.skew)
    fits, start = 0, _processor_time()
    while (fitting := _processor_time() - start) < FITTED:
        np.linalg.lstsq(columns, torque)
        fits += 1
    return {
        "samples": len(data.t),
        "joints": model.n,
        "rows": len(torque),
        "reading": reading,
        "seconds": sum(spent.values()),
        "parts": spent,
        "memory": memory,
        "fit": fitting / fits,
        "verdict": found.verdict,
        "named": " ".join(str(f.term) for f in found.findings),
    }


def _diagnosed(model: Model, data: Recording) -> Diagnosis:
    found = diagnose(model, [data])
    diagnosed.document(found).to_json()
    return found


def _sampled(work: Callable[[], Diagnosis]) -> tuple[Diagnosis, Counter[str]]:
    """What it returns, and its seconds of CPU time by part."""
    parts: dict[CodeType, str] = {resolve_name(name).__code__: part for name, part in PARTS.items()}
    spent: Counter[str] = Counter()
    last = _processor_time()

    def sample(_: int, frame: FrameType | None) -> None:
        nonlocal last
        part, now = REST, _processor_time()
        while frame is not None:
            part, frame = parts.get(frame.f_code, part), frame.f_back
        spent[part] += now - last
        last = now

    signal.signal(signal.SIGPROF, sample)
    signal.setitimer(signal.ITIMER_PROF, SAMPLED, SAMPLED)
    result = work()
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    sample(0, None)
    return result, spent


def _processor_time() -> float:
    """s of this process and of those that it began and that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _memory(key: str) -> float:
    """MB, of this process's own memory; getrusage knows a peak from before the process became what it is."""
    status = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in status if line.startswith(key)).split()[1]) / 1024


if __name__ == "__main__":
    print(json.dumps(measured(CASES[sys.argv[1]], Path(sys.argv[2]), Path(sys.argv[3]))))
