"""Recordings of the plant with every further sensor read: an encoder at the link, a torque sensor, a rigid torque."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runtime.arrays import Array
from runtime.recordings.recording import Recording

from . import sensors
from .bodies import ARMS, BELIEVED
from .cases import Setting, bench, specimen
from .hidden import ENTRIES, Hidden, Rows, Setup
from .motion import desired


@dataclass(frozen=True)
class Sensed:
    """A run of the plant, recorded without further sensors and with one of them.

    q, link   (n, N) rad, of motors and links, exact
    plant     parameters of each joint, what is hidden among them
    """

    plain: Recording
    with_link: Recording
    with_output: Recording
    with_rigid: Recording
    q: Array
    link: Array
    plant: Rows


def pushing(t: Array, most: float) -> Array:
    """(N,) N m of a hand that pushes the link of joint 1 again and again, up to `most`."""
    return most * np.maximum(np.sin(0.9 * t), 0.0) ** 2


PUSHED = {"push": Hidden("", 4.0, (0.1, 10.0), push=pushing)}


def sensed(setting: Setting, *what: tuple[str, int, float], seed: int = 7) -> Sensed:
    """Effects by name, joint (0-based) and amount, hidden in the arm of the setting."""
    bodies, rng = ARMS[setting.joints], np.random.default_rng(seed)
    rows = specimen(bodies, BELIEVED, rng)
    wanted = desired(rng, setting.joints, setting.excitation)
    where = bench(setting, wanted, rng, False, rows)
    hidden = tuple(
        (PUSHED[name] if name in PUSHED else ENTRIES[name].draw(Setup(bodies, joint, wanted, rng)), joint, amount)
        for name, joint, amount in what
    )
    run = where.run(hidden)
    plain = where.recording(run)
    return Sensed(
        plain=plain,
        with_link=replace(plain, q_link=sensors.link_angles(run)),
        with_output=replace(plain, tau_link=sensors.output_torque(where, run, hidden, 5)),
        with_rigid=replace(plain, tau_rigid=sensors.rigid_torque(where, run, hidden)),
        q=run.q,
        link=run.link,
        plant=where.plant(hidden)[0],
    )
