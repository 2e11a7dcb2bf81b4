"""An arm used alone, without a recording: one sample or many, against SymPy and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.verify.reference import Reference
from runtime.notebook.arm import LoadedArm, load
from symbolic.model import derive

ARMS = ("vishard4", "panda")


@pytest.fixture(scope="module", params=ARMS)
def arm(request: pytest.FixtureRequest) -> LoadedArm:
    """An arm in the plane, and one in space whose file states no rotors."""
    found = load(request.param)
    return found if found.model.lumps_known else found.with_rotors(0.05)


@pytest.fixture
def samples(arm: LoadedArm) -> np.ndarray:
    """(3, 19, n) positions, rates and accelerations; 19 fills no vector."""
    return np.random.default_rng(1).normal(size=(3, 19, arm.n))


def test_many_samples_are_as_one_after_the_other(arm: LoadedArm, samples: np.ndarray) -> None:
    q, qd, qdd = samples
    for function, given in (
        (arm.inverse_dynamics, (q, qd, qdd)),
        (arm.forward_dynamics, (q, qd, qdd)),
        (arm.coriolis, (q, qd)),
        (arm.regressor, (q, qd, qdd)),
        (arm.mass_matrix, (q,)),
        (arm.gravity, (q,)),
        (arm.jacobian, (q,)),
        (arm.tip, (q,)),
    ):
        together = function(*given)
        assert together.shape[0] == 19
        alone = [function(*(x[k] for x in given)) for k in range(19)]
        np.testing.assert_array_equal(together, alone)


def test_torques_are_those_of_the_symbolic_model(arm: LoadedArm, samples: np.ndarray) -> None:
    function = derive(arm.source.arm()).function("inverse_dynamics")
    assert function.struct is not None
    values = dict(zip(function.struct.symbols, arm.model.struct_values, strict=True))
    for k in range(3):
        for argument, numbers in zip(function.inputs, samples[:, k], strict=True):
            values |= dict(zip(argument.symbols, numbers, strict=True))
        expected = [float(value) for value in Reference(function)(values)]
        np.testing.assert_allclose(arm.inverse_dynamics(*samples[:, k]), expected, rtol=1e-12, atol=1e-12)


def test_forward_dynamics_undoes_inverse_dynamics(arm: LoadedArm, samples: np.ndarray) -> None:
    q, qd, qdd = samples
    np.testing.assert_allclose(arm.forward_dynamics(q, qd, arm.inverse_dynamics(q, qd, qdd)), qdd, atol=1e-9)


def test_the_parts_add_up_to_the_torque(arm: LoadedArm, samples: np.ndarray) -> None:
    q, qd, qdd = samples
    parts = np.einsum("kij,kj->ki", arm.mass_matrix(q), qdd) + np.einsum("kij,kj->ki", arm.coriolis(q, qd), qd)
    total = arm.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(parts + arm.gravity(q), total, atol=1e-11)
    np.testing.assert_allclose(arm.regressor(q, qd, qdd) @ arm.model.lump_values, total, atol=1e-11)


def test_the_coriolis_matrix_fits_the_slope_of_the_mass_matrix(arm: LoadedArm, samples: np.ndarray) -> None:
    """Ḋ = C + Cᵀ, with Ḋ from differences along q̇."""
    q, qd, _ = samples
    h = 1e-6
    slope = (arm.mass_matrix(q + h * qd) - arm.mass_matrix(q - h * qd)) / (2 * h)
    c = arm.coriolis(q, qd)
    np.testing.assert_allclose(c + c.transpose(0, 2, 1), slope, atol=1e-7)


def test_the_jacobian_is_the_slope_of_the_tip(arm: LoadedArm, samples: np.ndarray) -> None:
    q, qd, _ = samples
    h = 1e-6
    slope = (arm.tip(q + h * qd) - arm.tip(q - h * qd)) / (2 * h)
    rate = np.einsum("kij,kj->ki", arm.jacobian(q), qd)
    np.testing.assert_allclose(rate[:, :3], slope, atol=1e-8)


def test_arguments_broadcast(arm: LoadedArm, samples: np.ndarray) -> None:
    q, qd, _ = samples
    np.testing.assert_array_equal(arm.gravity(q), arm.inverse_dynamics(q, np.zeros(arm.n), 0))
    np.testing.assert_array_equal(arm.coriolis(q[0], qd)[3], arm.coriolis(q[0], qd[3]))
    np.testing.assert_array_equal(arm.gravity(np.asfortranarray(q)), arm.gravity(q.tolist()))
    assert arm.mass_matrix(q[:0]).shape == (0, arm.n, arm.n)


def test_a_wrong_shape_says_what_was_expected() -> None:
    arm = load("vishard4")
    with pytest.raises(ValueError, match=r"vishard4: q has shape \(4, 10\); expected \(4,\) or \(N, 4\)"):
        arm.gravity(np.zeros((4, 10)))
    with pytest.raises(ValueError, match=r"q \(10, 4\), qd \(9, 4\) differ; expected"):
        arm.coriolis(np.zeros((10, 4)), np.zeros((9, 4)))


def test_rotors_that_the_file_leaves_open_are_asked_for_where_they_matter() -> None:
    arm = load("ur10")
    q = np.array([0.0, -1.0, 1.0, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="rotor_inertia"):
        arm.mass_matrix(q)
    known = arm.with_rotors(0.0)
    np.testing.assert_array_equal(arm.gravity(q), known.gravity(q))
    geared = arm.with_rotors([3.0, 3.0, 1.0, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(np.diag(geared.mass_matrix(q) - known.mass_matrix(q)), [3, 3, 1, 0.5, 0.5, 0.5])
