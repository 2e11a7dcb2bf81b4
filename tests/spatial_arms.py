"""Arms in space for tests: those of the literature by their modified DH tables, and random ones."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
from scipy.linalg import expm

from codegen.tape.tape import Tape
from symbolic.functions import SymbolicFunction
from symbolic.model import ArmModel, derive
from symbolic.model_file.arm import Arm, Frame, Joint, Link
from symbolic.model_file.frames import rotation

Array = np.ndarray[Any, np.dtype[np.float64]]

TABLES = {
    "ur10e": [(0, 0, 0.1807), (1, 0, 0), (0, -0.6127, 0), (0, -0.57155, 0.17415), (1, 0, 0.11985), (-1, 0, 0.11655)],
    "puma560": [(0, 0, 0), (-1, 0, 0.2435), (0, 0.4318, -0.0934), (-1, -0.0203, 0.4331), (1, 0, 0), (-1, 0, 0)],
    "rx90": [(0, 0, 0), (1, 0, 0), (0, 0.45, 0), (-1, 0, 0.45), (1, 0, 0), (-1, 0, 0)],
    "panda": [
        *[(0, 0, 0.333), (-1, 0, 0), (1, 0, 0.316), (1, 0.0825, 0)],
        *[(-1, -0.0825, 0.384), (1, 0, 0), (1, 0.088, 0)],
    ],
    "iiwa": [(0, 0, 0.36), (-1, 0, 0), (1, 0, 0.42), (1, 0, 0), (-1, 0, 0.4), (-1, 0, 0), (1, 0, 0)],
}
"""Twist in quarter turns, a, d in m; all joints revolute, gravity along −z of the base."""


def link(rng: random.Random) -> Link:
    """A body that can be: inertias of a box about its centre, turned a little."""
    mass, com = rng.uniform(0.5, 8.0), [rng.uniform(-0.15, 0.15) for _ in range(3)]
    a, b, c = (mass / 12 * rng.uniform(0.05, 0.4) ** 2 for _ in range(3))
    off = [0.1 * min(a, b, c) * rng.uniform(-1, 1) for _ in range(3)]
    inertia = (b + c, off[0], off[1], a + c, off[2], a + b)
    x, y, z = (round(e, 4) for e in com)
    xx, xy, xz, yy, yz, zz = (round(e, 6) for e in inertia)
    return Link(round(mass, 3), (x, y, z), (xx, xy, xz, yy, yz, zz))


def known(name: str, gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)) -> Arm:
    """An arm of TABLES with invented bodies and rotors; the axes are the z axes of its frames."""
    rng, joints = random.Random(name), []
    for quarters, a, d in TABLES[name]:
        twist = quarters * math.pi / 2
        at = (a, -round(math.sin(twist)) * d, round(math.cos(twist)) * d)
        origin = Frame((at[0] + 0.0, at[1] + 0.0, at[2] + 0.0), (twist, 0.0, 0.0))
        rotor = round(rng.uniform(0.1, 2.0), 3)
        joints.append(Joint("revolute", rotor, 100.0, origin=origin, link=link(rng)))
    return Arm(name, gravity, tuple(joints), tip=Frame((0.0, 0.0, 0.1)))


def drawn(types: str, seed: int, general: float = 0.3, gravity: tuple[float, float, float] | None = None) -> Arm:
    """A random chain. `types`: "r" or "p" a joint; general: the share of angles that are no quarter turns."""
    rng = random.Random(f"{types}{seed}")

    def angle() -> float:
        return round(rng.uniform(-3, 3), 3) if rng.random() < general else rng.randint(-1, 2) * math.pi / 2

    def length() -> float:
        return round(rng.uniform(-0.5, 0.5), 3) if rng.random() < 0.6 else 0.0

    joints = []
    for kind in types:
        axis = rng.choice([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)])
        if rng.random() < general / 2:
            axis = (0.6, 0.0, 0.8)
        origin = Frame((length(), length(), length()), (angle(), angle(), angle()))
        rotor = round(rng.uniform(0.05, 1.0), 3)
        joints.append(
            Joint("revolute" if kind == "r" else "prismatic", rotor, 50.0, axis=axis, origin=origin, link=link(rng))
        )
    pull = gravity or rng.choice([(0.0, 0.0, -9.81), (0.0, 0.0, 0.0), (1.0, -2.0, -9.0), (0.0, -9.81, 0.0)])
    tip = Frame((length(), length(), length()), (angle(), angle(), angle()))
    return Arm(f"drawn_{types}_{seed}", pull, tuple(joints), tip=tip)


def cross(u: Array) -> Array:
    """(3, 3) of u x."""
    return np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])


def standing(frame: Frame) -> Array:
    """(4, 4) by exponentials of roll, pitch and yaw."""
    turns = [expm(angle * cross(np.eye(3)[k])) for k, angle in enumerate(frame.rpy)]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turns[2] @ turns[1] @ turns[0], frame.xyz
    return T


def places(arm: Arm, q: Array) -> tuple[list[Array], Array]:
    """(4, 4) of every joint's frame, and of the tip's, in the base: products of exponentials."""
    home, moved, found = np.eye(4), np.eye(4), []
    for joint, x in zip(arm.joints, q, strict=True):
        home = home @ standing(joint.origin)
        axis = home[:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
        twist = np.zeros((4, 4))
        if joint.type == "revolute":
            twist[:3, :3], twist[:3, 3] = cross(axis), -cross(axis) @ home[:3, 3]
        else:
            twist[:3, 3] = axis
        moved = moved @ expm(twist * x)
        found.append(moved @ home)
    return found, moved @ home @ standing(arm.tip)


def torques(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """Another route to the torques: Newton and Euler for every body about its centre of mass, in the base's axes and
    the file's frames; nothing is merged, and no frame but the file's is used."""
    R, p, w, al = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3)
    a, bodies, axes = -np.array(arm.gravity), [], []
    for joint, x, v, acc in zip(arm.joints, q, qd, qdd, strict=True):
        reach = R @ np.array(joint.origin.xyz)
        R = R @ np.array(rotation(joint.origin.rpy))
        z = R @ np.array(joint.axis) / np.linalg.norm(joint.axis)
        if joint.type == "prismatic":
            reach = reach + z * x
            a = a + 2 * np.cross(w, z * v) + z * acc
        p, a = p + reach, a + np.cross(al, reach) + np.cross(w, np.cross(w, reach))
        if joint.type == "revolute":
            al, w = al + z * acc + np.cross(w, z * v), w + z * v
            x1, y1, z1 = np.array(joint.axis) / np.linalg.norm(joint.axis)
            cross = np.array([[0, -z1, y1], [z1, 0, -x1], [-y1, x1, 0]])
            R = R @ (np.eye(3) + np.sin(x) * cross + (1 - np.cos(x)) * cross @ cross)
        xx, xy, xz, yy, yz, zz = joint.link.inertia or (0,) * 6
        inertia = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
        c = R @ np.array(joint.link.com)
        force = (joint.link.mass or 0.0) * (a + np.cross(al, c) + np.cross(w, np.cross(w, c)))
        bodies.append((p + c, force, inertia @ al + np.cross(w, inertia @ w)))
        axes.append((p, z))
    tau = []
    for i, (joint, (at, z)) in enumerate(zip(arm.joints, axes, strict=True)):
        force = sum((f for _, f, _ in bodies[i:]), np.zeros(3))
        moment = sum((n + np.cross(c - at, f) for c, f, n in bodies[i:]), np.zeros(3))
        own = moment if joint.type == "revolute" else force
        tau.append(own @ z + (joint.rotor_inertia or 0.0) * qdd[i])
    return np.array(tau)


def body_parameters(link: Link) -> dict[str, float]:
    """Inertia tensor about the joint frame's origin, by Steiner, first moments and mass."""
    m, c = link.mass, np.array(link.com)
    xx, xy, xz, yy, yz, zz = link.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + m * (c @ c * np.eye(3) - np.outer(c, c))
    named = {"XX": (0, 0), "XY": (0, 1), "XZ": (0, 2), "YY": (1, 1), "YZ": (1, 2), "ZZ": (2, 2)}
    moments = dict(zip(("MX", "MY", "MZ"), m * c, strict=True))
    return {name: float(tensor[place]) for name, place in named.items()} | moments | {"M": m}


_MODELS: dict[str, ArmModel] = {}
_TAPES: dict[int, tuple[SymbolicFunction, Tape]] = {}
"""By identity: a function has no hash."""


def derived(arm: Arm) -> ArmModel:
    """The arm's model, derived once a process."""
    key = repr(arm)
    if key not in _MODELS:
        _MODELS[key] = derive(arm)
    return _MODELS[key]


def tape(function: SymbolicFunction) -> Tape:
    """The function's tape, made once a process."""
    if id(function) not in _TAPES:
        _TAPES[id(function)] = function, Tape.of(function)
    return _TAPES[id(function)][1]


def call(model: ArmModel, name: str, *vectors: Array) -> Array:
    """A function in double precision at the model file's values, in its shape."""
    function = model.function(name)
    values = dict(zip(model.struct.symbols, model.struct.defaults, strict=True))
    for argument, vector in zip(function.inputs, vectors, strict=True):
        values |= dict(zip(argument.symbols, map(float, vector), strict=True))
    found = tape(function).evaluate(values, {"const": float, "sin": math.sin, "cos": math.cos})
    return np.array(found, dtype=float).reshape(function.outputs[0].shape)


def state(n: int, seed: int) -> list[Array]:
    """q, qd and qdd, each (n,)."""
    rng = np.random.default_rng(seed)
    return [rng.uniform(-2, 2, n) for _ in range(3)]
