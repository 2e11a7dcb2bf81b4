"""Delays and lags of a joint and of all, and friction that rises from rest: hidden in the judge's plant, whose C knows
nothing of the library's laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from runtime.diagnosis.stages import begin, diagnose
from runtime.diagnosis.verdict import Diagnosis
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.recordings.recording import Recording
from runtime.report.diagnosed import document
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import Hidden as Hide
from runtime.simulation.simulate import simulate
from tests import bank
from tests.judge.bodies import ARMS, BELIEVED
from tests.judge.cases import Setting, bench, specimen
from tests.judge.hidden import Hidden, Put, at, more, same
from tests.judge.motion import desired
from tests.kept import kept

COMMAND_DELAY, COMMAND_LAG = Term("command_delay"), Term("command_lag")
SAMPLE = 1e-3  # s


def recorded(put: Put, amount: float, joints: int, excitation: str = "brief", seed: int = 7) -> Recording:
    """A run of the judge's arm with what `put` hides in it."""
    rng = np.random.default_rng(seed)
    rows = specimen(ARMS[joints], BELIEVED, rng)
    where = bench(Setting(joints=joints, excitation=excitation), desired(rng, joints, excitation), rng, False, rows)
    return where.recording(where.run(((Hidden("", amount, (0.0, 10.0), put), 0, amount),)))


def everywhere(**values: Callable[[float], float]) -> Put:
    """Sets parameters of every joint, as functions of the amount."""

    def put(rows: list[dict[str, float]], arm: dict[str, float], amount: float) -> None:
        for joint in range(len(rows)):
            at(joint, **values)(rows, arm, amount)

    return put


def rising(speed: float, form: float = 0.0) -> Put:
    """Dry friction that is smaller at creep by the amount: exp(-(v/s)^2), 1/(1 + (v/s)^2) or exp(-v/s)."""

    def put(rows: list[dict[str, float]], arm: dict[str, float], amount: float) -> None:
        more(0, DRY_POSITIVE=1.0, DRY_NEGATIVE=1.0)(rows, arm, amount)
        at(0, CREEP=lambda a: -a, CREEP_SPEED=speed, CREEP_FORM=form)(rows, arm, amount)

    return put


def diagnosed(put: Put, amount: float, joints: int, excitation: str = "brief") -> Diagnosis:
    return kept(diagnose, bank.model(f"judge{joints}"), [recorded(put, amount, joints, excitation)])


def value(found: Diagnosis, term: Term, name: str) -> float:
    return float(found.last.fit.inference.values[term][name].value)


@pytest.mark.parametrize("form", [0.0, 1.0, 2.0])
def test_friction_that_rises_from_rest_is_named(form: float) -> None:
    """In the library's own form and in two others, which leave hardly anything beside it."""
    found = diagnosed(rising(0.1, form), 0.5, 1, "full")
    term = Term("velocity_strengthening", 1)
    assert [(f.term, f.rivals) for f in found.findings] == [(term, ())]
    assert found.last.fitted.rms[0] < 1.1 * found.last.floors[0]
    if form == 0.0:
        assert value(found, term, "torque") == pytest.approx(0.5, rel=0.05)
        assert value(found, term, "speed") == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(
    ("put", "term"),
    [
        (everywhere(DELAY=same), COMMAND_DELAY),
        (everywhere(LAG=same), COMMAND_LAG),
        (at(0, DELAY=same), Term("torque_delay", 1)),
        (at(0, LAG=same), Term("torque_lag", 1)),
    ],
)
def test_what_delays_one_joint_or_all_is_named_once(put: Put, term: Term) -> None:
    """4 ms in a band of 45 Hz: a lag and a delay are apart, and so are one joint and all."""
    found = diagnosed(put, 0.004, 2)
    assert [(f.term, f.rivals) for f in found.findings] == [(term, ())]
    (name,) = found.last.fit.inference.values[term]
    # The plant's lag is a quarter of a sample shorter: it takes the command at the end of a step.
    assert value(found, term, name) == pytest.approx(0.004, abs=0.1 * SAMPLE)
    entry = document(found).to_json()["findings"][0]
    assert (entry["effect"], entry["joint"]) == (term.effect, term.joint)


def test_a_delay_of_all_joints_is_said_of_each() -> None:
    found = diagnosed(everywhere(DELAY=same), 0.004, 2)
    delays = document(found).to_json()["delay"]
    assert [d["joint"] for d in delays] == [1, 2]
    assert all(d["value"] == pytest.approx(0.004 + SAMPLE / 2, abs=0.05 * SAMPLE) for d in delays)


def test_nothing_is_named_of_an_arm_without_delay() -> None:
    found = diagnosed(everywhere(), 0.0, 2)
    assert (found.verdict, found.findings) == ("clean", ())


def test_one_joint_s_delay_is_no_delay_of_the_arm() -> None:
    """With one joint both are the same, and the joint's own name is the one that other programs know."""
    trail = begin(bank.model("judge1"), [recorded(at(0, DELAY=same), 0.004, 1)])
    offered = {t.effect for t in trail.last.base.terms()}
    assert {"torque_delay", "torque_lag"} <= offered
    assert not {"command_delay", "command_lag"} & offered


def test_a_joint_s_own_delay_adds_to_that_of_the_arm() -> None:
    """8 ms at joint 1 and 4 ms at joint 2, in both orders of the structure."""

    def put(rows: list[dict[str, float]], _arm: dict[str, float], amount: float) -> None:
        rows[0]["DELAY"], rows[1]["DELAY"] = 2 * amount, amount

    model, recording = bank.model("judge2"), recorded(put, 0.004, 2)
    motion, own = prepared(model, [recording]), Term("torque_delay", 1)
    plain = fit_motion(model, motion, structure(model))
    for terms in ((COMMAND_DELAY, own), (own, COMMAND_DELAY)):
        found = fit_motion(model, motion, {**structure(model), **{t: {} for t in terms}}, start=plain)
        times = {t: found.inference.values[t]["time"].value for t in terms}
        assert times[COMMAND_DELAY] == pytest.approx(0.004, abs=0.05 * SAMPLE)
        assert times[own] == pytest.approx(0.004, abs=0.1 * SAMPLE)


@pytest.mark.parametrize("term", [Term("torque_lag", 1), COMMAND_LAG])
def test_the_torque_that_acts_follows_the_simulated_one_with_a_lag(term: Term, drive: Model) -> None:
    """A low-pass filter of the first order gives back the torque without lag."""
    t = np.arange(4000) / 1000
    path = 0.05 * np.sin(2 * np.pi * 9 * t)[None] + 0.3 * np.sin(2 * np.pi * 0.7 * t)[None]
    quiet, late = SimulationSettings(noise=0.0), 0.008
    plain, _ = simulate(drive, settings=quiet, motion=path)
    lagging, _ = simulate(drive, [Hide(term, {"time_constant": late})], quiet, path)
    follower = signal.bilinear([1.0], [late, 1.0], fs=1000)
    acting, settled = signal.lfilter(*follower, lagging.tau[0]), slice(200, -20)
    assert np.abs(lagging.tau[0] - plain.tau[0])[settled].max() > 0.3
    # Friction steps at a reversal, which no difference over two samples follows.
    error = np.abs(acting - plain.tau[0])[settled]
    assert np.quantile(error, 0.9) < 5e-3 * np.abs(plain.tau[0]).max()
