"""Compiled effects with a memory, along a motion, against the declared equations step by step."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.prepare import prepare_effects
from runtime.model.loader import Library
from tests.effect_values import simulate

T = np.arange(400) / 1000
LOAD = 5 * np.cos(2 * np.pi * 4 * T) + np.sin(2 * np.pi * 11 * T)


@pytest.fixture(scope="module")
def library() -> Library:
    return Library(prepare_effects())


@pytest.mark.parametrize(
    ("effect", "signals", "parameters"),
    [
        ("spring_hysteresis", {"q": 0.1 * LOAD}, {"torque": 0.7, "width": 0.2}),
        # Gap, both flanks and bounces: all branches of the step.
        (
            "backlash",
            {
                "load": LOAD,
                "link_inertia": 0.2 + 0.05 * np.sin(9 * T),
                "coupling": 0.1,
                "coupling_rate": 0.3,
                "coupling_slope": 2.0,
            },
            {"gap": 2e-3, "stiffness": 3000.0, "damping": 4.0},
        ),
        (
            "backlash",
            {"load": LOAD, "link_inertia": 0.2, "coupling": 0.2, "coupling_rate": 0.0, "coupling_slope": 0.0},
            {"gap": 0.0, "stiffness": 1e9, "damping": 4.0},
        ),
    ],
)
def test_compiled_memory_follows_the_declaration(
    library: Library, effect: str, signals: dict[str, np.ndarray | float], parameters: dict[str, float]
) -> None:
    found = library.torque(effect, signals, parameters, dt=1e-3)
    each = {name: np.broadcast_to(value, T.shape) for name, value in signals.items()}
    expected = simulate(effect, parameters, 1e-3, [{k: float(v[i]) for k, v in each.items()} for i in range(len(T))])
    # Differences in rounding, carried on by the bounces of a stiff flank.
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())
