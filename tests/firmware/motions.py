"""A demanding motion of the paper's arm as C, for images that run a controller's step by itself (motion.c)."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from compositions import PLATE, POSTURE, trajectory

from codegen import prepare, render
from codegen.c.controller import Controller
from runtime.hardware.settings import Settings
from runtime.model.loader import Model
from runtime.planning.trajectory import Phase, Trajectory
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm

HERE = Path(__file__).resolve().parent
NOISE = 15
"""Counts that the encoders' noise has as values."""
LIMIT = 45.0
"""N m, which the motion asks for more than."""


def springs() -> dict[int, dict[str, float]]:
    """One at every joint, taut where the joint is below its place in POSTURE."""
    return {
        joint: {"stiffness": 900.0 * joint, "radius": 0.06, "offset": float(POSTURE[joint - 1]), "pretension": 3.0}
        for joint in range(1, 5)
    }


def free(degree: int) -> Phase:
    """All joints over a wide range."""
    rng = np.random.default_rng(5)
    return Phase("q", 0.9003, POSTURE[:, None] + np.cumsum(rng.uniform(-0.3, 0.3, (4, degree + 1)), axis=1))


def slow(degree: int) -> Phase:
    """All joints about a place, where friction is compensated less."""
    return Phase("q", 0.7, POSTURE[:, None] + 0.02 * np.random.default_rng(6).normal(size=(4, degree + 1)))


def sliding(model: Model, degree: int) -> Phase:
    """Along the plate and into it."""
    along = 0.01 * np.random.default_rng(7).normal(size=(4, degree + 1)) * [[0], [1], [3], [3]]
    return Phase("w", 1.1, model.contact_coordinates(POSTURE)[:, None] + along)


def plan(model: Model, *phases: Phase, plate: bool = True) -> Trajectory:
    """With springs at all joints; the plate where the end-effector is in POSTURE."""
    contact = {**PLATE, "plate": {**PLATE["plate"], "position": float(model.tip(POSTURE)[1])}}
    return trajectory(list(phases), springs=springs(), contact=contact if plate else {})


def write(directory: Path, arm: Arm, model: Model, plan: Trajectory, steps: int) -> None:
    """The generated C, the motion and its linker script, into a directory."""
    derived = derive(arm)
    for path, text in (render.arm_files(derived) | render.controller_files(derived, LIBRARY)).items():
        if path.endswith(("_f32.c", "_f32.h")):
            (directory / path).write_text(text)
    settings = Settings.of(prepare.prepare_firmware(arm, LIBRARY), model, plan)
    # Two of the encoders' counters overflow on the way.
    zero = [0, 2**31 - 9000, -(2**31) + 5000, -77]
    (directory / "motion.h").write_text(_header(settings, Controller.of(derived, LIBRARY).document(), zero, steps))
    for name in ("motion.c", "alone.c", "motion.ld"):
        shutil.copy(HERE / name, directory)


def units(directory: Path) -> list[str]:
    """What is compiled."""
    return sorted(path.name for path in directory.glob("*.c"))


def _header(settings: Settings, page: Mapping[str, Any], zero: list[int], steps: int) -> str:
    """The motion's settings as C."""
    t, n = settings.trajectory, page["n"]
    drive = {**settings.drive, "zero": zero, "torque_limit": [LIMIT] * n}
    config = {"parameters": settings.parameters, "effects": settings.effects, **drive}
    fields = {r["name"]: [f["name"] for f in r["fields"]] for r in page["records"]}
    contact = {name: t[name] for name in fields["vishard4_contact_f32"]}
    springs = [{name: t[f"spring_{name}"][j] for name in page["springs"]} for j in range(n)]
    lines = ['#include "vishard4_controller_f32.h"', f"#define STEPS {steps}U", f"#define NOISE {NOISE}U"]
    lines.append(f"#define PHASES {len(settings.phases)}U")
    lines.append(f"static const int32_t begin[{n}] = {_literal(zero)};")
    lines.append(f"static const vishard4_contact_f32 contact = {_literal(contact)};")
    lines.append(f"static const float points[{settings.points.size}] = {_literal(settings.points.ravel())};")
    phases = [
        f"{{.coordinates = {p['coordinates']}U, .degree = {p['degree']}U, .duration = {_literal(p['duration'])}, "
        f".points = &points[{n * p['first_row']}], .contact = {'&contact' if p['touches'] else 'NULL'}}}"
        for p in settings.phases
    ]
    lines.append(f"static vishard4_phase_f32 phases[{len(phases)}] = {{{', '.join(phases)}}};")
    lines.append(f"static vishard4_config_f32 config = {_literal(config)};")
    given = {"count": t["count"], "periodic": t["periodic"], "elbow": float(t["elbow"]), "springs": springs}
    lines.append(f"static const vishard4_trajectory_f32 trajectory = {_literal(given)[:-1]}, .phases = phases}};")
    return "\n".join(lines) + "\n"


def _literal(value: Any) -> str:
    """Of C: exact."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f".{name} = {_literal(item)}" for name, item in value.items()) + "}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "{" + ", ".join(map(_literal, value)) + "}"
    if isinstance(value, (float, np.floating)):
        return f"{float(np.float32(value)).hex()}f"
    return str(value)
