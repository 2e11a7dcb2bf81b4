"""From a changed length to compiled C and the CasADi module, everything from an empty cache: below 3 s."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from harness import best, show, sized, timed

from codegen.toolchain import build

ROOT = Path(__file__).resolve().parents[2]
TARGET = 3.0
LENGTH = 0.2345
ROUNDS = sized(4, 1)

# The parts of `tendon generate` one after another, in a process of their own; prints `name seconds` a line.
PARTS = """
import sys, time
from pathlib import Path
clock = time.perf_counter()
def lap(name):
    global clock
    now = time.perf_counter()
    print(name, now - clock)
    clock = now
import runtime.workspace.source, symbolic.effects, symbolic.model_file.reader, symbolic.model, codegen.render
lap("import")
source = runtime.workspace.source.Source.read(Path(sys.argv[1]), None)
arm = source.arm()
lap("read")
model = symbolic.model.derive(arm)
lap("derive")
codegen.render.arm_files(model)
lap("emit")
codegen.render.effect_files(tuple(source.compiled.library.values()))
lap("effects")
"""


def test_generate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Time of the whole command and of its parts; the host's compiler then takes what it wrote."""
    changed = tmp_path / "vishard4.toml"
    changed.write_text(_with_other_length((ROOT / "symbolic" / "arms" / "vishard4.toml").read_text()))
    whole, arm, effects, processor = [], [], [], []
    parts: list[dict[str, float]] = []
    for number in range(ROUNDS):
        cache, out = tmp_path / f"cache{number}", tmp_path / f"generated{number}"
        monkeypatch.setenv("TENDON_CACHE", str(cache))
        command = "from runtime.cli.main import main; main()"
        arguments = ("-c", command, "generate", str(changed), "--out", str(out / "vishard4"))
        before = _processor_time()
        whole.append(timed(lambda: _python(*arguments))[0])  # noqa: B023
        arm.append(_compiling(out / "vishard4", build.STRAIGHT))
        processor.append(_processor_time() - before)
        parts.append(_laps(_python("-c", PARTS, str(changed))))
        effects.append(_compiling(out / "effects", build.LOOPS))
    text = (tmp_path / "generated0" / "vishard4" / "vishard4_f64.c").read_text()
    assert f"parameters->l1 = {LENGTH};" in text
    least = {name: min(p[name] for p in parts) for name in parts[0]}
    _report(best(lambda: _python("-c", "pass"), ROUNDS), least, min(whole), min(arm), min(effects))
    load, cores = os.getloadavg()[0], os.cpu_count()
    print(f"processor time of the total: {min(processor):.2f} s; load of the machine {load:.1f} on {cores} cores")


def _with_other_length(text: str) -> str:
    """The first joint's, whatever it is in the file."""
    changed, count = re.subn(r"^length = .*$", f"length = {LENGTH}", text, count=1, flags=re.MULTILINE)
    assert count == 1
    assert changed != text
    return changed


def _processor_time() -> float:
    """Seconds of processor time that finished child processes have used: what a loaded machine does not lengthen."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _python(*arguments: str) -> str:
    """The output of a Python process in the project's folder."""
    result = subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


def _laps(text: str) -> dict[str, float]:
    return {name: float(seconds) for name, seconds in (line.split() for line in text.splitlines())}


def _compiling(directory: Path, level: str) -> float:
    """Seconds to compile a directory's double-precision C, as codegen.prepare does it."""
    files = {path.name: path.read_text() for path in directory.glob("*_f64.[ch]")}
    return timed(lambda: build.shared_library(files, "code", level))[0]


def _report(start: float, parts: Mapping[str, float], whole: float, arm: float, effects: float) -> None:
    total = whole + arm
    lines = [
        ("start of Python", start),
        ("imports (SymPy, Jinja, Typer)", parts["import"]),
        ("model file and library of effects read", parts["read"]),
        ("derivation", parts["derive"]),
        ("emission: the arm's C and CasADi", parts["emit"]),
        ("emission: the library of effects", parts["effects"]),
        ("tendon generate, measured as one process", whole),
        ("host compilation of the arm", arm),
        ("total", total),
        ("host compilation of the library (once, it does not depend on the arm)", effects),
        ("total with it", total + effects),
    ]
    verdicts = [
        f"{name}: {'PASS' if seconds < TARGET else 'short of the target'} ({seconds:.2f} s, target {TARGET:g} s)"
        for name, seconds in (("a changed length", total), ("with the library too", total + effects))
    ]
    rows = [(name, f"{seconds:.3f}", f"{100 * seconds / total:.0f} %") for name, seconds in lines]
    command = " ".join([*build.compiler(), *build.vector_flags()])
    show(
        "A changed length of vishard4 to compiled code, empty cache",
        ("part", "s", "of total"),
        rows,
        [*verdicts, f"minima of {ROUNDS} runs; compiler: {command}"],
    )
