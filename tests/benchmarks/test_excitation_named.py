"""Of effects hidden at a part of the noise floor, the share that the diagnosis names first: with the first motion, and
with the ordinary excitation of the same length within the same ranges and speeds.

The size of an effect is what it leaves beside the fitted model on the ordinary excitation, in noise floors; both
recordings have the same arm, effect and noise.
"""

from __future__ import annotations

import os
from collections import defaultdict
from dataclasses import replace

import numpy as np
from harness import show, sized
from numpy.typing import NDArray

from runtime.diagnosis.stages import diagnose
from runtime.experiments.excitation import NoRoom
from runtime.experiments.first_proposal import ArmToMove, propose_first
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.experiments.separation import MotionPieces, TrialArm, narrowed, noisy
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.progress import of_long
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import Hidden, SimulationError, excitation, simulate
from runtime.workspace.source import Source

Array = NDArray[np.float64]

ARM, JOINTS = "vishard4", sized((1, 2, 3, 4), (1,))
EFFECTS = sized(
    ("stribeck", "velocity_strengthening", "load_friction", "lugre", "offset", "linear_spring", "torque_scale",
     "torque_delay", "elasticity", "backlash", "spring_hysteresis", "viscous_cubic", "friction_patch"),
    ("stribeck",),
)  # fmt: skip
FLOORS = (0.25, 0.5)
CASES = tuple(os.environ.get("TENDON_BENCHMARK_CASES", "").split(","))
"""Beginnings of the effects' names that are tried; all by default."""


def test_effects_named_first() -> None:
    source = Source.shipped(ARM)
    model = source.compiled.model()
    likely, assumed = source.compiled.with_likely_numbers()
    to_move = ArmToMove(model, likely.model(), likely.arm, assumed, NoRoom(), [])
    chosen = FirstMotionSettings(seconds=80.0, tip_speed=20.0)
    found = propose_first(to_move, ExperimentSettings(), chosen)
    within = narrowed(likely.model(), found.ready.ranges)
    seconds = found.first.seconds
    ordinary = excitation(within, np.random.default_rng(0), seconds / 2, 2)
    asked = [
        (Term(effect, joint), floors)
        for effect in EFFECTS
        if effect.startswith(CASES)
        for joint in JOINTS
        for floors in FLOORS
        if Term(effect, joint) not in structure(model)
    ]

    def tried(case: tuple[Term, float]) -> tuple[bool, bool] | None:
        term, floors = case
        try:
            hidden = _of_size(model, within, term, floors, ordinary)
        except SimulationError:
            return None
        return tuple(_named(model, within, hidden, path) for path in (ordinary, found.first.path))  # type: ignore[return-value]

    counts: dict[float, list[int]] = defaultdict(lambda: [0, 0, 0])
    for (_, floors), named in zip(asked, of_long(tried, asked), strict=True):
        if named is not None:
            counts[floors][0] += 1
            counts[floors][1] += named[0]
            counts[floors][2] += named[1]
    rows = [(f"{floors:g}", str(n), str(before), str(after)) for floors, (n, before, after) in counts.items()]
    show(f"effects of {ARM} named first, {seconds:.0f} s", ("floors", "cases", "ordinary", "first motion"), rows)
    assert rows


def _of_size(model: Model, within: Model, term: Term, floors: float, path: Array) -> Hidden:
    """The effect with shapes from the middle of its grid, as large as it leaves so many floors on this motion."""
    bench = replace(TrialArm.of(within, [Hidden(term, {})], ExperimentSettings()), ordinary_path=path)
    values = dict(bench.rivals[0].values)
    library = model.library[term.effect]
    for _ in range(4):
        bench = replace(bench, rivals=(Hidden(term, dict(values)),))
        rms = MotionPieces.of(bench, path).weigh()[(0, None)].rms
        if not rms > 0:
            raise SimulationError("invisible")
        ratio = floors / rms
        for p in library.parameters:
            neutral = p.neutral
            if p.role == "linear":
                values[p.name] = neutral + (values[p.name] - neutral) * ratio
            elif p.kind == "stiffness":
                values[p.name] /= ratio
            elif p.kind == "play":
                values[p.name] *= ratio
    return Hidden(term, values)


def _named(model: Model, within: Model, hidden: Hidden, path: Array) -> bool:
    plain, _ = simulate(within, settings=SimulationSettings(noise=0.0), motion=path)
    made, _ = simulate(within, [hidden], SimulationSettings(noise=0.0), path)
    level = ExperimentSettings.noise * np.sqrt(np.mean(plain.tau**2, axis=1))
    result = diagnose(model, [noisy(made, level, 7)])
    return bool(result.findings) and result.findings[0].term == hidden.term
