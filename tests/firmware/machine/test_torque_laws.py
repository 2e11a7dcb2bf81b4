"""No state of the machine gives a torque that is not finite, over its ceiling, while the drives are off, or anything
but damping after a stop: every state and every event, and every float where a torque is made."""

from __future__ import annotations

import json
from pathlib import Path

import kept
import pytest
from random_arms import MIXED

from codegen.firmware.protocol import REASONS
from codegen.firmware.source_tree import machine_files
from codegen.render import arm_files, controller_files
from symbolic.effects import LIBRARY
from symbolic.model import derive

ARM = MIXED["r"]
HERE = Path(__file__).resolve().parent
MADE_BY_THE_CONTROLLER = f"{ARM.name}_controller_f32.c"


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """C of the machine of a one-jointed arm, and of the two programs."""
    directory, model = tmp_path_factory.mktemp("walk"), derive(ARM)
    files = arm_files(model) | controller_files(model, LIBRARY) | machine_files(model, LIBRARY, {})
    for path, text in files.items():
        if path.startswith("src/") or "_f32" in path:
            (directory / Path(path).name).write_text(text)
    messages = {m["name"]: m["size"] for m in json.loads(files["protocol.json"])["messages"]}
    sizes = [f"#define SIZE_{name.upper()} {messages[name]}U" for name in ("parameters", "effects", "trajectory")]
    head = "\n".join([f"#define CONTROLLER(name) {ARM.name}_controller_##name##_f32", *sizes])
    (directory / "walk.c").write_text(f"{head}\n{(HERE / 'walk.c').read_text()}")
    (directory / "floats.c").write_text((HERE / "floats.c").read_text())
    return directory


def walked(directory: Path, *flags: str) -> None:
    units = [p.name for p in sorted(directory.glob("tendon_*.c"))] + ["walk.c"]
    found = kept.figures(kept.program(directory, units, *flags))
    assert found["states"] > 1000
    every = {reason.number for reason in REASONS if reason.name != "none"}
    assert {number for number in range(32) if found["reasons"] >> number & 1} == every


def test_every_state_and_every_event(sources: Path) -> None:
    walked(sources, "-O2")


@pytest.mark.slow
def test_every_state_and_every_event_under_the_sanitizers(sources: Path) -> None:
    walked(sources, "-O1", "-g", *kept.SANITIZERS)


@pytest.mark.parametrize(("stride", "cases"), [(1009, 4), pytest.param(1, 1, marks=pytest.mark.slow)])
def test_every_float(sources: Path, stride: int, cases: int) -> None:
    """One in 1009 of them with four pairs of gain and limit in turn, or all with one pair."""
    units = [p.name for p in sorted(sources.glob("tendon_*.c")) if p.name != "tendon_damping.c"]
    units += [f"{ARM.name}_f32.c", "floats.c"]
    own = (f"-DSTRIDE={stride}U", f"-DCASES={cases}U", f'-DCONTROLLER_SOURCE="{MADE_BY_THE_CONTROLLER}"')
    found = kept.figures(kept.program(sources, units, "-O2", *own))
    assert found["wrong"] == 0
    assert found["tried"] == -(-(2**32) // stride)
