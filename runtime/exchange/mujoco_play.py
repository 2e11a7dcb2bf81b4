"""An exported MJCF played by MuJoCo: the motion that torques at the joints make there, from a state on.

MuJoCo integrates by `implicitfast`, of first order: its methods of a single step advance bristles exactly, so that they
are stable however stiff, which its Runge-Kutta method is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.arrays import Array
from runtime.exchange.settings import AT_REST, HOLD, PLAY_STEP, ROUNDS


class PlayError(ValueError):
    """MuJoCo cannot play the file or the torques; the message says why and what to do."""


class Played:
    """An MJCF that `tendon export` wrote, compiled. Raises PlayError."""

    def __init__(self, path: Path) -> None:
        mujoco = _mujoco()
        try:
            self.model: Any = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, OSError) as error:
            newer = f"this is MuJoCo {mujoco.__version__}, and what `tendon export` writes is for 4.0 or newer"
            raise PlayError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}; {newer}") from error
        model = self.model
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.data = mujoco.MjData(model)
        # Passive actuators have no control or no gain, and second joints of elastic ones no motor.
        driven = [k for k in range(model.nactuator) if model.actuator_ctrlnum[k] and model.actuator_gainprm[k, 0]]
        self.n = len(driven)
        self.motors: list[int] = model.actuator_trnid[: self.n, 0].tolist()
        self.behind = [k for k in range(model.njnt) if k not in self.motors]
        if not driven or driven != list(range(self.n)) or self.motors != sorted(set(self.motors)):
            raise PlayError(f"{path}: its first actuators are not a motor for each joint; write it by tendon export")
        self.gear: Array = model.actuator_gear[: self.n, 0]
        # MuJoCo delays by whole steps and a half: the torques are shifted here, by the time that the file states.
        self.delay: Array = model.actuator_delay[: self.n].copy()
        model.actuator_delay[: self.n] = 0.0

    def play(
        self,
        t: ArrayLike,
        tau: ArrayLike,
        q: ArrayLike,
        qd: ArrayLike,
        bent: Array | None = None,
        rests: Array | None = None,
        step: float = PLAY_STEP,
    ) -> tuple[Array, Array]:
        """The motion under torques at the joints, linear between samples.

        t (m,) s, rising; tau (m, n) N m or N     q, qd (n,) at the first sample     step: the longest, s
        bent (2, n)   how far the motors of elastic joints are ahead of their links there, and at which rate; without
                      it, as the load bends them with which the rigid arm would accelerate
        rests (P,)    where yielding springs are slack there, as of `rests`
        Bristles, and yielding springs without `rests`, begin as they are after a long way in the direction of qd, and
        the drives have had the first torque for long. Returns q and qd (m, n), of the motors where joints are
        elastic; NaN from where the motion runs away. Raises PlayError.
        """
        import mujoco

        times, torques = np.asarray(t, dtype=np.float64), np.asarray(tau, dtype=np.float64)
        if torques.shape != (len(times), self.n) or len(times) < 2 or not (np.diff(times) > 0).all():
            raise PlayError(f"torques of shape {torques.shape}: expected ({len(times)}, {self.n}) at rising times")
        model, data = self.model, self.data
        self._begin(torques[0], np.asarray(q, dtype=np.float64), np.asarray(qd, dtype=np.float64), bent, rests)
        out = np.full((2, *torques.shape), np.nan)
        at, rate = model.jnt_qposadr[self.motors], model.jnt_dofadr[self.motors]
        out[:, 0] = data.qpos[at], data.qvel[rate]
        steps = np.diff(times)
        pieces = np.maximum(np.ceil(steps / HOLD - 1e-9), 1).astype(int)
        controls = self._controls(times, torques, pieces)
        for k, (dt, count) in enumerate(zip(steps / pieces, pieces.tolist(), strict=True)):
            substeps = ceil(dt / step - 1e-9)
            model.opt.timestep = dt / substeps
            for control in islice(controls, count):
                data.ctrl[: self.n] = control
                mujoco.mj_step(model, data, substeps)
            if data.warning.number.any():  # MuJoCo has begun anew
                break
            out[:, k + 1] = data.qpos[at], data.qvel[rate]
        return out[0], out[1]

    def _controls(self, times: Array, torques: Array, pieces: NDArray[np.int_]) -> Iterator[Array]:
        """The motors' controls (n,) in the middle of each of the pieces of the intervals, as late as the drives are."""
        parts = zip(times, np.diff(times), pieces.tolist(), strict=False)
        middles = np.concatenate([begin + dt * (np.arange(count) + 0.5) / count for begin, dt, count in parts])
        acting = [np.interp(middles - late, times, row) for late, row in zip(self.delay, torques.T, strict=True)]
        return iter(np.stack(acting, axis=1) / self.gear)

    def windows(self, t: Array, tau: Array, q: Array, qd: Array, bent: Array, rests: Array) -> Array:
        """Positions (W, K, n) in windows. t (K,) s, tau (W, K, n); at their beginnings q, qd (W, n), bent (W, 2, n) and
        rests (W, P), as of `play`."""
        return np.array([self.play(t, *each)[0] for each in zip(tau, q, qd, bent, rests, strict=True)])

    def rests(self, q: Array) -> Array:
        """(N, P) where each yielding spring is slack along a motion q (N, n), at whose beginning it is unbent."""
        model = self.model
        found = np.empty((len(q), len(self._yielding)))
        for column, k in enumerate(self._yielding):
            limit, rest = model.tendon_springyield[k], q[0, self._joint(k)]
            for row, x in enumerate(q[:, self._joint(k)].tolist()):
                rest = min(max(rest, x - limit), x + limit)
                found[row, column] = rest
        return found

    @property
    def _yielding(self) -> list[int]:
        return np.flatnonzero(self.model.tendon_plasticadr >= 0).tolist() if self.model.ntendon else []

    def _joint(self, tendon: int) -> int:
        return self.motors.index(int(self.model.wrap_objid[self.model.tendon_adr[tendon]]))

    def _begin(self, tau: Array, q: Array, qd: Array, bent: Array | None, rests: Array | None) -> None:
        """Set the state of the first sample, with the memories of effects."""
        import mujoco

        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qpos[model.jnt_qposadr[self.motors]] = q
        data.qvel[model.jnt_dofadr[self.motors]] = qd
        data.ctrl[: self.n] = tau / self.gear
        self._activate(qd)
        if self.behind and bent is None:
            self._deflect()
        elif bent is not None:
            ahead = bent[:, [self.motors.index(joint - 1) for joint in self.behind]]
            data.qpos[model.jnt_qposadr[self.behind]], data.qvel[model.jnt_dofadr[self.behind]] = -ahead
        for column, k in enumerate(self._yielding):
            joint, place = self._joint(k), model.tendon_plasticadr[k]
            slipped = q[joint] - _direction(qd[joint]) * model.tendon_springyield[k]
            data.plastic[place : place + 2] = slipped if rests is None else rests[column]

    def _activate(self, qd: Array) -> None:
        """Fill the memories of lags and bristles."""
        import mujoco

        model, data = self.model, self.data
        for a in range(model.nactuator):
            place = model.actuator_actadr[a]
            if place < 0:
                continue
            if a < self.n:
                data.act[place] = data.ctrl[a]
            elif model.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_DCMOTOR:
                joint = self.motors.index(model.actuator_trnid[a, 0])
                # Where the compiler puts the LuGre model's numbers.
                stiffness, (coulomb, static, speed) = model.actuator_dynprm[a, 5], model.actuator_biasprm[a, 3:6]
                level = coulomb + (static - coulomb) * np.exp(-((qd[joint] / speed) ** 2))
                data.act[place] = _direction(qd[joint]) * level / stiffness

    def _deflect(self) -> None:
        """Bend each elastic joint as the load bends it with which the rigid arm would accelerate.

        Dry friction at rest depends on how the joints are bent: a few rounds suffice.
        """
        import mujoco

        model, data = self.model, self.data
        motors, behind = model.jnt_dofadr[self.motors], model.jnt_dofadr[self.behind]
        places, own = model.jnt_qposadr[self.behind], model.jnt_stiffness[self.behind]
        stiffness, slack = np.array([self._spring(joint) for joint in self.behind]).T
        inertia = np.zeros((model.nv, model.nv))
        for _ in range(ROUNDS):
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, inertia)
            force = data.qfrc_actuator + data.qfrc_passive + data.qfrc_constraint - data.qfrc_bias
            acceleration = np.linalg.solve(inertia[np.ix_(motors, motors)], force[motors])
            # Of the passive forces, those of springs at the link, without the joint's own.
            carried = data.qfrc_passive[behind] + own * data.qpos[places]
            load = inertia[np.ix_(behind, motors)] @ acceleration + data.qfrc_bias[behind] - carried
            data.qpos[places] = -load / stiffness - np.sign(load) * slack

    def _spring(self, joint: int) -> tuple[float, float]:
        """Stiffness of a second joint, and half the gap before it."""
        model = self.model
        if model.jnt_stiffness[joint] > 0:
            return float(model.jnt_stiffness[joint]), 0.0
        mobility = model.dof_invweight0[model.jnt_dofadr[joint]]
        return float(-model.jnt_solref[joint, 0] / mobility), float(model.jnt_range[joint, 1])


def _direction(rate: float) -> float:
    return float(np.sign(rate)) if abs(rate) > AT_REST else 0.0


def _mujoco() -> Any:
    try:
        import mujoco
    except ImportError as error:
        raise PlayError(
            "the package mujoco is not installed: pip install mujoco, or install Tendon with the extra `mjcf`"
        ) from error
    # Warnings are counted in the data; by default they are also written to a file where the user is.
    mujoco.set_mju_user_warning(lambda _: None)
    return mujoco
