"""The commands at which the drives of an arm make the torques of a simulated recording: laws, solved for the command.

No loop is closed: motion and torque are prescribed, and a servo is told the position that gives that torque exactly.
The law reads the recorded positions, as it would along a real recording. A command is held as a real log's is, from the
instant of its row to that of the next: a row has what makes the torque in the middle between the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runtime.arrays import Array
from runtime.recordings.driven import DrivenJoint, driven_joint, rate
from runtime.recordings.recording import Recording
from runtime.simulation.simulate import SimulationError
from symbolic.model_file.arm import DescribedJoint
from symbolic.model_file.drive_laws import COMMANDS, DELAY, LAWS, SATURATION, DriveLaw


def commanded(recording: Recording, joints: Sequence[DescribedJoint]) -> Recording:
    """A recording with the commands of all drives whose law and gains are known, in place of their torques.

    Raises SimulationError where a drive cannot make the torque.
    """
    sent: dict[str, Array] = {}
    driven: list[DrivenJoint | None] = [None] * len(joints)
    for i, joint in enumerate(joints):
        law = LAWS.get(joint.drive.law or "") if joint.drive is not None else None
        if joint.drive is None or law is None or None in law.coefficients(joint.drive.gains):
            continue
        own = _command(recording, i, law, joint.drive.gains)
        for name, row in own.items():
            sent.setdefault(name, np.full(recording.q.shape, np.nan))[i] = row
        driven[i] = driven_joint(joint, law, {"q": recording.q[i], **own}, recording.t, recording.run)
    asked = sent.pop("q_desired", np.full(recording.q.shape, np.nan))
    demanded = recording.q_desired if recording.q_desired is not None else asked
    return replace(recording, q_desired=np.where(np.isnan(asked), demanded, asked), commands=sent, driven=tuple(driven))


def _command(recording: Recording, i: int, law: DriveLaw, gains: dict[str, float]) -> dict[str, Array]:
    """The columns (N,) that the law of joint i (0-based) reads."""
    t, tau, q = recording.t, recording.tau[i], recording.q[i]
    if (most := gains.get(SATURATION)) is not None and np.abs(tau).max() > most:
        raise SimulationError(
            f"joint {i + 1}: the motion asks for {np.abs(tau).max():.3g} N m (N at a prismatic joint), and the drive's "
            f"{SATURATION} is {most:g}; choose a slower motion"
        )
    signals = {"q": q, "qd": rate(q, t, [slice(0, len(t))])}
    if law.command == "q_desired":
        found = _demanded(law, gains, tau, signals, t)
    else:
        for name, (_, gain) in law.instead.items():
            if gain not in gains:
                raise SimulationError(f"joint {i + 1}: {name} of the drive is not stated; add {gain} to [joint.drive]")
            signals[name] = np.full(len(t), gains[gain])
        first, *rest = law.coefficients(gains)
        columns = law.columns(signals | {law.command: np.zeros(len(t))}, gains, lambda x: np.maximum(x, 0.0))
        others = sum(c * x for c, x in zip(rest, columns[1:], strict=True) if c)
        found = {law.command: law.inverse((tau - others) / first, signals, gains)}
    late = gains.get(DELAY, 0.0) + recording.dt / 2
    return {name: np.interp(t + late, t, row) for name, row in found.items() if name in COMMANDS}


def _demanded(
    law: DriveLaw, gains: dict[str, float], tau: Array, signals: dict[str, Array], t: Array
) -> dict[str, Array]:
    """Demanded position and rate (N,) of a servo: its error follows the torque as its own gains let it."""
    kp, kd, ki = (float(c or 0.0) for c in law.coefficients(gains))
    error, slope, total = np.zeros(len(t)), np.zeros(len(t)), 0.0
    for k, step in enumerate(np.diff(t, prepend=t[0])):
        if kd:
            # The error decays towards tau / kp with the time constant kd / kp; over a step the mean torque of its ends.
            part = -np.expm1(-kp / kd * step)
            before, mean = (error[k - 1], (tau[k - 1] + tau[k]) / 2) if k else (tau[0] / kp, tau[0])
            error[k] = before + part * ((mean - ki * total) / kp - before)
        else:
            error[k] = (tau[k] - ki * total) / (kp + ki * step)
        total += error[k] * step
        slope[k] = (tau[k] - kp * error[k] - ki * total) / kd if kd else 0.0
    return {"q_desired": signals["q"] + error, "qd_desired": signals["qd"] + slope}
