"""Compiled code as NumPy functions: shapes, values against each other, and every error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.model import loader
from runtime.model.loader import Library, LoaderError, Model

# Sums of some fifty terms of order 1 to 100, each rounded at 1e-16.
CLOSE = {"rtol": 1e-12, "atol": 1e-11}


@pytest.fixture
def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    return tuple(rng.normal(size=(3, 4, 9)))


def test_the_arm_as_data(model: Model) -> None:
    assert (model.name, model.n) == ("vishard4", 4)
    assert [joint.type for joint in model.joints] == ["revolute"] * 4
    assert model.lump_values == pytest.approx([lump.value for lump in model.lumps])
    assert all(lump.unit for lump in model.lumps)
    assert model.joints[0].force_unit == "N m"
    assert model.metadata["functions"]["inverse_dynamics"]["operations"]["arithmetic"] <= 73


def test_shapes(model: Model, motion: tuple[np.ndarray, ...]) -> None:
    q, qd, qdd = motion
    n, samples, p = 4, 9, len(model.lumps)
    assert model.inverse_dynamics(q, qd, qdd).shape == (n, samples)
    assert model.regressor(q, qd, qdd).shape == (n, p, samples)
    assert model.inertia(q).shape == model.coriolis(q, qd).shape == (n, n, samples)
    assert (
        model.call("gravity", {"q": q}).shape
        == model.call("tip_load", {"q": q, "qd": qd, "qdd": qdd}).shape
        == (n, samples)
    )
    assert model.tip(q).shape == (3, samples)
    assert model.tip_jacobian(q).shape == (3, n, samples)
    assert model.call("moment_jacobian", {"q": q}).shape == (2, n, samples)
    assert model.contact_coordinates(q).shape == model.call("contact_bias", {"q": q, "qd": qd}).shape == (4, samples)
    assert model.call("contact_jacobian", {"q": q}).shape == (4, 4, samples)
    assert model.inverse_dynamics(q, qd, qdd).flags.c_contiguous


def test_functions_agree_with_each_other(model: Model, motion: tuple[np.ndarray, ...]) -> None:
    q, qd, qdd = motion
    tau = model.inverse_dynamics(q, qd, qdd)
    parts = np.einsum("ijn,jn->in", model.inertia(q), qdd) + np.einsum("ijn,jn->in", model.coriolis(q, qd), qd)
    np.testing.assert_allclose(parts + model.call("gravity", {"q": q}), tau, **CLOSE)
    np.testing.assert_allclose(np.einsum("ipn,p->in", model.regressor(q, qd, qdd), model.lump_values), tau, **CLOSE)
    np.testing.assert_allclose(model.forward_dynamics(q, qd, tau), qdd, rtol=1e-9, atol=1e-9)


def test_contact_and_back(model: Model, motion: tuple[np.ndarray, ...]) -> None:
    q, qd, qdd = motion
    q = 0.9 * np.tanh(q) + np.array([[0.0], [1.2], [0.0], [0.0]])  # away from the stretched arm
    w = model.contact_coordinates(q)
    np.testing.assert_allclose(model.contact_inverse(w, 1.0), q, rtol=1e-9, atol=1e-9)
    wdd = np.einsum("ijn,jn->in", model.call("contact_jacobian", {"q": q}), qdd) + model.call(
        "contact_bias", {"q": q, "qd": qd}
    )
    np.testing.assert_allclose(model.contact_acceleration(q, qd, wdd), qdd, rtol=1e-9, atol=1e-9)


def test_one_sample_needs_no_axis(model: Model, motion: tuple[np.ndarray, ...]) -> None:
    one = model.inverse_dynamics(*(a[:, 0] for a in motion))
    assert one.shape == (4,)
    np.testing.assert_array_equal(one, model.inverse_dynamics(*motion)[:, 0])
    w = model.contact_coordinates([0.1, 1.0, 0.2, 0.3])
    assert model.contact_inverse(w, 1.0) == pytest.approx([0.1, 1.0, 0.2, 0.3])


def test_no_samples(model: Model) -> None:
    assert model.tip(np.empty((4, 0))).shape == (3, 0)


def test_strided_and_integer_input(model: Model, motion: tuple[np.ndarray, ...]) -> None:
    q = motion[0]
    np.testing.assert_array_equal(model.tip(q[:, ::2]), model.tip(q)[:, ::2])
    np.testing.assert_array_equal(model.tip(np.zeros((4, 3), dtype=int)), model.tip(np.zeros((4, 3))))


def test_other_lumps(model: Model, motion: tuple[np.ndarray, ...]) -> None:
    doubled = model.inverse_dynamics(*motion, lumps=2 * model.lump_values)
    np.testing.assert_allclose(doubled, 2 * model.inverse_dynamics(*motion), **CLOSE)
    with pytest.raises(LoaderError, match=r"lumps has shape \(2,\), expected"):
        model.inertia(motion[0], lumps=[1.0, 2.0])


def test_wrong_shapes(model: Model, motion: tuple[np.ndarray, ...]) -> None:
    q, qd, _ = motion
    with pytest.raises(LoaderError, match=r"vishard4: tip: q has shape \(9, 4\), expected \(4, 4\); pass \(4, N\)"):
        model.tip(q.T)
    with pytest.raises(LoaderError, match=r"coriolis: qd has shape \(4, 8\), expected \(4, 9\)"):
        model.coriolis(q, qd[:, :8])
    with pytest.raises(LoaderError, match="q has shape"):
        model.tip(q[:3])


def test_a_function_that_is_not_there(model: Model) -> None:
    with pytest.raises(LoaderError, match='arm "vishard4" has no function "hop"; it has: inverse_dynamics'):
        model.call("hop", {})


def test_a_directory_without_code(tmp_path: Path, library: Library) -> None:
    with pytest.raises(LoaderError, match="no compiled code here"):
        loader.Model(tmp_path, library)


RATE = np.linspace(-2, 2, 11)


def test_columns_and_torque_agree(library: Library) -> None:
    """For every effect without a memory: torque = fixed + columns times the coefficients."""
    rng = np.random.default_rng(2)
    signals = {name: rng.uniform(0.1, 2, 50) for name in library.signals}
    for name, info in library.effects.items():
        if info.states:
            continue
        shape = {p.name: 0.5 for p in info.shape}
        coefficients = rng.uniform(0.1, 2, len(info.coefficients))
        full = library.recover(name, coefficients, shape)
        rows = library.columns(name, signals, shape)
        assert rows.shape == (1 + len(info.coefficients), 50)
        expected = rows[0] + coefficients @ rows[1:] if len(coefficients) else rows[0]
        np.testing.assert_allclose(library.torque(name, signals, full), expected, err_msg=name, **CLOSE)


def test_memory_runs_along_the_samples(library: Library) -> None:
    """A bristle loads up to the friction level within some micrometres of motion, and keeps it."""
    rate = np.full(400, 0.1)
    way = 1e-3 * np.cumsum(rate)
    found = library.columns("lugre", {"q": way, "qd": rate, "level": 2.0}, {"stiffness": 1000.0}, dt=1e-3)
    # The fixed part is the bristle's torque less the Coulomb level that another effect carries.
    assert found[0, 0] == pytest.approx(-2.0)
    assert abs(found[0, -1]) < 1e-6
    assert np.all(np.diff(found[0]) >= 0)


def test_a_number_stands_for_all_samples(library: Library) -> None:
    torque = library.torque("viscous", {"qd": RATE, "load": 0.0}, {"coefficient": 2.0})
    np.testing.assert_allclose(torque, 2 * RATE)
    offset = library.torque("offset", {"qd": RATE}, {"torque": 3.0})
    np.testing.assert_array_equal(offset, np.full(11, 3.0))


def test_what_an_effect_misses(library: Library) -> None:
    with pytest.raises(LoaderError, match='there is no effect "stribek"'):
        library.torque("stribek", {}, {})
    with pytest.raises(LoaderError, match='effect "viscous" reads qd, which is not among the signals given'):
        library.torque("viscous", {"q": RATE}, {"coefficient": 1.0})
    with pytest.raises(LoaderError, match='effect "stribeck" needs a value of: torque'):
        library.torque("stribeck", {"qd": RATE}, {"speed": 1.0})
    with pytest.raises(LoaderError, match='effect "viscous" has no parameter "factor"; it has: coefficient'):
        library.torque("viscous", {"qd": RATE}, {"factor": 1.0})
    with pytest.raises(LoaderError, match="signals differ in length: qd 11, load 3"):
        library.torque("load_friction", {"qd": RATE, "load": np.ones(3)}, {"coefficient": 1.0})
    with pytest.raises(LoaderError, match=r'signal "qd" has shape \(2, 2\), expected a number or \(N,\)'):
        library.torque("viscous", {"qd": np.ones((2, 2))}, {"coefficient": 1.0})
    with pytest.raises(LoaderError, match='effect "lugre" has states and needs a step dt > 0'):
        library.columns("lugre", {"q": RATE, "qd": RATE, "level": 1.0}, {"stiffness": 1.0})


def test_effects_as_data(library: Library) -> None:
    info = library["stribeck"]
    assert info.scope == "joint"
    assert [p.name for p in info.linear] == ["torque"]
    speed = info.parameter("speed")
    assert speed.role == "shape"
    assert (speed.unit.text("revolute"), speed.unit.text("prismatic")) == ("rad/s", "m/s")
    assert speed.bounds == (0.0, np.inf)
    assert speed.grid is not None
    assert speed.grid.of == "rate"
