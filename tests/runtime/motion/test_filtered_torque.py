"""Torques that were low-passed before they were recorded: what is near half the sampling rate is no noise floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from runtime.arrays import Array
from runtime.diagnosis.stages import diagnose
from runtime.identification.compare import compare
from runtime.motion.band import choose_band
from runtime.recordings.recording import Recording
from tests import bank
from tests.kept import kept

PASSED = 60.0  # Hz


def smooth(x: Array) -> Array:
    return np.asarray(sosfiltfilt(butter(2, PASSED, fs=1000.0, output="sos"), x))


def filtered(recording: Recording) -> Recording:
    """As a logger writes it that filters forwards and backwards."""
    return replace(recording, q=smooth(recording.q), tau=smooth(recording.tau))


def test_a_filtered_torque_is_noticed() -> None:
    run = bank.recording("clean")
    inertia = np.array([[0.2365]])
    assert choose_band([run], inertia).filtered == (False,)
    assert choose_band([filtered(run)], inertia).filtered == (True,)


def test_its_floor_is_that_of_the_residual() -> None:
    """The filter passes all of the band, in which the noise is as it was."""
    (joint,) = kept(compare, bank.model("drive"), [filtered(bank.recording("clean"))]).joints
    assert joint.floor.spectrum == pytest.approx(joint.rms, rel=0.3)


def test_nothing_is_missing_in_a_filtered_recording() -> None:
    found = kept(diagnose, bank.model("drive"), [filtered(bank.recording("clean"))])
    assert (found.verdict, found.findings) == ("clean", ())


def test_what_is_missing_in_a_filtered_recording_is_named() -> None:
    found = kept(diagnose, bank.model("drive"), [filtered(bank.recording("parallel spring"))])
    assert [f.term.effect for f in found.findings] == ["parallel_spring"]
