"""Which column a person would take for which signal, and in which unit."""

from __future__ import annotations

import pytest

from runtime.inspection.guesses import alike, guesses
from runtime.recordings.columns import RecordedArm
from runtime.recordings.contents import RecordedField
from runtime.recordings.preview import FieldPreview


def guessed(joints: int = 1, **ranges: tuple[float, float]) -> dict[str, str]:
    """Guesses for columns with these ranges; names with __ for a space."""
    fields = [
        FieldPreview(RecordedField(name.replace("__", " ")), 1001, (low,), low, high, ((low, high),))
        for name, (low, high) in ranges.items()
    ]
    return {signal: str(cell) for signal, cell in guesses(fields, RecordedArm.without_model(joints)).items()}


def test_a_log_of_a_lab():
    found = guessed(Time_ms=(0, 5000), Pos__act=(-90, 90), Pos__ref=(-90, 90), Vel=(-50, 50), Iq_mA=(-900, 900))
    assert found == {"t": "Time_ms [ms]", "q1": "Pos act [deg]", "qd1": "Vel [deg/s]", "tau1": "Iq_mA [mA]"}


def test_joints_are_counted_wherever_their_number_stands():
    names = {f"J{k}_pos_rad": (-1.0, 1.0) for k in (1, 2)} | {f"torque_{k}": (-9.0, 9.0) for k in (0, 1)}
    found = guessed(2, time=(0, 5), **names)
    assert found == {"t": "time", "q1": "J1_pos_rad", "q2": "J2_pos_rad", "tau1": "torque_0", "tau2": "torque_1"}


TIMES = [(1.0, ""), (5000.0, " [ms]"), (5e6, " [us]"), (1e11, " [ns]"), (1e13, "")]


@pytest.mark.parametrize(("last", "unit"), TIMES)
def test_the_unit_of_time_follows_from_its_steps(last, unit):
    assert guessed(time=(0, last), q1=(0, 1), tau1=(0, 1))["t"] == f"time{unit}"


def test_tendons_own_names_are_taken_first():
    assert guessed(t=(0, 1), q1=(0, 1), tau1=(0, 1), current=(0, 9)) == {"t": "t", "q1": "q1", "tau1": "tau1"}


def test_the_same_signal_of_other_joints_is_called_alike():
    names = ["t", "J1_pos [deg]", "J1_iq", "J2_pos [deg]", "J2_iq"]
    assert alike("J2_iq", names) == ["J1_iq", "J2_iq"]
    assert alike("J1_pos", ["t", "J1_pos", "J2_pos"]) == ["J1_pos", "J2_pos"]
    assert alike("t", names) == ["t"]
