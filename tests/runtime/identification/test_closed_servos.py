"""Position servos that close their loops at every instant on their own angles, while a log has a row every 5 to 33 ms:
the intervals that are stated hold the truth, and a gap is no spring."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.arrays import Array

Run = Callable[..., tuple[int, str, str]]

STEP, COUNT = 1 / 6000, 2 * np.pi / 4096  # s of the integration, rad of the encoder
KP, KD, VISCOUS, COULOMB = 9.0, 0.3, 0.05, 0.08  # N m/rad, N m s/rad, N m s/rad, N m
INERTIA, MOTOR, STOP = 0.05, 0.008, 6000.0  # kg m^2, kg m^2 before a gap, N m/rad of its flanks
ARM = 0.05, 0.02, 0.012  # kg m^2: I1 + m2 l1^2, I2 + m2 c2^2 and m2 l1 c2 of two joints in a plane
CELLS = ("q{}", "rad"), ("q{}_desired", "rad"), ("qd{}_desired", "rad/s")
RATES = 200, 60, 30  # steps a row: 30, 100 and 200 Hz

JOINT = """[[joint]]
type = "revolute"
rotor_inertia = 0.0
gear_ratio = 1.0
[joint.drive]
law = "position_servo"
{gains}[joint.link]
length = 0.2
mass = {mass}
com = [{com}, 0.0]
inertia = {inertia}
[joint.effects.coulomb]
[joint.effects.viscous]
"""
LINKS = {1: [(1.0, 0.1, 0.04)], 2: [(1e-9, 0.0, 0.026), (0.6, 0.1, 0.014)]}


def model(joints: int, gains: str) -> str:
    each = (JOINT.format(gains=gains, mass=m, com=c, inertia=i) for m, c, i in LINKS[joints])
    return 'name = "servos"\ngravity = [0.0, 0.0]\n' + "".join(each)


def motions(rng: np.random.Generator, shape: tuple[int, int]) -> Callable[[Array], tuple[Array, Array]]:
    """Sums of seven sines with another phase for every log and joint: angle and rate (B, n) at times (B, 1)."""
    omega = 2 * np.pi * np.array([0.07, 0.13, 0.29, 0.6, 1.1, 1.7, 2.5]) * rng.uniform(0.85, 1.15, (*shape, 7))
    size, phase = omega**-0.9, rng.uniform(0, 2 * np.pi, (*shape, 7))
    size *= 0.7 / np.linalg.norm(size, axis=-1, keepdims=True)

    def at(t: Array) -> tuple[Array, Array]:
        angle = omega * t[..., None] + phase
        return (size * np.sin(angle)).sum(axis=-1), (size * omega * np.cos(angle)).sum(axis=-1)

    return at


def accelerations(q: Array, qd: Array, tau: Array) -> Array:
    """(B, n) of one joint, or of two in a plane."""
    if q.shape[1] == 1:
        return tau / INERTIA
    (one, two, both), cosine, sine = ARM, np.cos(q[:, 1]), np.sin(q[:, 1])
    d11, d12 = one + two + 2 * both * cosine, two + both * cosine
    first = tau[:, 0] + both * sine * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2)
    second = tau[:, 1] - both * sine * qd[:, 0] ** 2
    both_ways = np.stack([two * first - d12 * second, d11 * second - d12 * first], axis=1)
    return np.asarray(both_ways / (d11 * two - d12**2)[:, None])


def logs(joints: int, count: int, seconds: float, seed: int, gap: float = 0.0) -> Iterator[tuple[float, Array]]:
    """Of every rate so many: its seconds a row, and t, q, q_desired and qd_desired of all joints (1 + 3 n, N)."""
    rng, every = np.random.default_rng(seed), np.repeat(RATES, count)[:, None]
    wanted = motions(rng, (len(every), joints))
    q, qd = wanted(0.0 * every)[0], np.zeros((len(every), joints))
    link, link_qd, rows = q.copy(), qd.copy(), []
    for k in range(round(seconds / STEP)):
        if not (k % every).all():
            told = wanted(k // every * every * STEP)
        rows.append(np.stack([q, *told]))
        tau = KP * (told[0] - q) + KD * (told[1] - qd) - VISCOUS * qd - COULOMB * np.tanh(qd / 2e-3)
        if gap:
            beyond = np.sign(q - link) * np.maximum(np.abs(q - link) - gap / 2, 0.0)
            across = STOP * beyond + np.where(beyond != 0, 2.0 * (qd - link_qd), 0.0)
            link_qd = link_qd + STEP * across / INERTIA
            link = link + STEP * link_qd
            qdd = (tau - across) / MOTOR
        else:
            qdd = accelerations(q, qd, tau)
        qd = qd + STEP * qdd
        q = q + STEP * (qd - STEP / 2 * qdd)
    whole = np.array(rows)
    for b, (steps,) in enumerate(every):
        read = whole[::steps, :, b].copy()
        read[:, 0] = np.round(read[:, 0] / COUNT + 0.3 * rng.standard_normal(read[:, 0].shape)) * COUNT
        yield steps * STEP, np.vstack([np.arange(len(read)) * steps * STEP, read.reshape(len(read), -1).T])


def answer(tendon: Run, verb: str, log: Array) -> dict[str, Any]:
    """What --json says of a log."""
    n = len(log) // 3
    cells = [f"{name.format(i)} [{unit}]" for name, unit in CELLS for i in range(1, n + 1)]
    np.savetxt("run.csv", log.T, fmt="%.9g", delimiter=",", header=",".join(["t [s]", *cells]), comments="")
    status, out, err = tendon(verb, "arm.toml", "run.csv", "--json", "-")
    assert status in (0, 1), err
    return dict(json.loads(out))


def stated(document: dict[str, Any], row: float) -> Iterator[tuple[float, tuple[float, float]]]:
    """Truths and intervals; row: s from row to row."""
    truth = {"viscous": VISCOUS, "coulomb": COULOMB, "kp": KP, "kd": KD}
    for effect in document["effects"]:
        yield from ((truth[effect["effect"]], p["interval"]) for p in effect["parameters"].values())
    yield from ((p["model"], p["interval"]) for p in document["inertial"])
    for joint in document["joints"]:
        yield from ((truth[name], gain["interval"]) for name, gain in joint["drive"].get("gains", {}).items())
    yield from ((row / 2, delay["interval"]) for delay in document["delay"])


@pytest.mark.parametrize("gains", [f"kp = {KP}\nkd = {KD}\n", ""])
@pytest.mark.parametrize(
    ("joints", "count"), [(1, 4), (2, 2), *(pytest.param(n, 20, marks=pytest.mark.slow) for n in (1, 2))]
)
def test_intervals_hold_the_truth(
    tendon: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, joints: int, count: int, gains: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(model(joints, gains), encoding="utf-8")
    told = [
        (low <= truth <= high)
        for row, log in logs(joints, count, 20.0, seed=count)
        for truth, (low, high) in stated(answer(tendon, "identify", log), row)
    ]
    assert len(told) >= (4 + 2 * (not gains)) * 3 * count
    assert np.mean(told) >= 0.93


@pytest.mark.parametrize("count", [2, pytest.param(12, marks=pytest.mark.slow)])
def test_a_gap_of_some_encoder_steps_is_no_spring(
    tendon: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    """Of 20 mrad, 13 steps: it is named, or nothing is."""
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(model(1, f"kp = {KP}\nkd = {KD}\n"), encoding="utf-8")
    for _, log in logs(1, count, 20.0, seed=7, gap=0.02):
        findings = answer(tendon, "diagnose", log)["findings"]
        assert [f["effect"] for f in findings[:1]] in ([], ["backlash"])
