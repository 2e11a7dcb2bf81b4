"""MuJoCo as a plant: what is hidden is put in as mechanisms of its own, and its solver moves the arm in closed loop.

The parameters by which effects enter are those of laws.h as far as MuJoCo has a mechanism for them, and a few more.
Dry friction is its `frictionloss`, whose level is set anew each period where it depends on rate, angle or load. A
bristle and a ripple are its passive DC motor's LuGre friction and cogging, springs with a side or a yield are tendons
over one joint, a lag and a delay are the actuator's own, an elastic joint is a second hinge behind the motor's. Source:
the XML reference of MuJoCo 4.0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array

from . import mujoco_arms
from .bodies import in_space
from .plant import PERIOD, RanAwayError, Run

Index = NDArray[np.intp]
Row = Mapping[str, float]

STIFF = ([3.0 * PERIOD, 1.0], [0.99, 0.99, 1e-3, 0.5, 2.0])
"""solref and solimp of friction, welds and gaps: as near to rigid as steps of PERIOD allow (two of them at least)."""
INTEGRATOR = mujoco.mjtIntegrator.mjINT_RK4
WEAK = 0.005  # impedance of a yielding limit
GENTLE = 0.05  # and of a soft friction
FAR = 1e3  # rad, beyond every angle
CONTROLLER = {"KP", "KD", "OBSERVER"}
STILL = 1e-3  # rad/s; slower, a bristle is taken to hold
OWN = frozenset({*mujoco_arms.bodies(1)[0].parameters(), *mujoco_arms.bodies(6)[0].parameters()})
GIVEN = OWN - {"ROTOR", "DRY_POSITIVE", "DRY_NEGATIVE", "VISCOUS_POSITIVE", "VISCOUS_NEGATIVE", "CUBIC"} | CONTROLLER
"""Parameters of a row that the arm itself says, and the controller's."""
Each = Callable[[int], None]


@dataclass
class Plan:
    """An arm being built. joints: of the motors; bodies: those that they turn; axes as in the file."""

    spec: mujoco.MjSpec
    joints: list[Any]
    bodies: list[Any]
    tendons: list[str] = field(default_factory=list)

    def tendon(self, parts: Mapping[str, float], **values: Any) -> None:
        """A fixed tendon: its length is the sum of angles times the parts."""
        made = self.spec.add_tendon(name=f"tendon{len(self.tendons)}")
        self.tendons.append(made.name)
        for name, part in parts.items():
            made.wrap_joint(name, part)
        made.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        for key, value in values.items():
            setattr(made, key, value)

    def spring(self, joint: str, stiffness: float, ends: tuple[float, float], **values: Any) -> None:
        """A spring on one joint that acts where its angle is outside the ends."""
        self.tendon({joint: 1.0}, stiffness=[stiffness, 0.0, 0.0], springlength=list(ends), **values)


def plan(n: int, rows: Sequence[Row], arm: Row) -> Plan:
    """The arm of n joints with all that rows and arm say. KeyError for a parameter that MuJoCo has nothing for."""
    spec = mujoco_arms.spec(n)
    spec.compiler.degree = False
    spec.option.timestep = PERIOD
    spec.option.integrator = INTEGRATOR
    spec.option.gravity = [arm.get(f"GRAVITY_{axis}", 0.0) for axis in "XYZ"]
    if "WALL" not in arm:
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    joints = list(spec.joints)
    made = Plan(spec, joints, [joint.parent for joint in joints])
    for i, row in enumerate(rows):
        _joint(made, i, row)
    _arm(made, arm)
    return made


def _joint(p: Plan, i: int, row: Row) -> None:
    known = set(GIVEN)

    def value(name: str, default: float = 0.0) -> float:
        known.add(name)
        return float(row.get(name, default))

    joint, body = p.joints[i], p.bodies[i]
    joint.armature = value("ROTOR")
    dry, wet = (value("DRY_POSITIVE"), value("DRY_NEGATIVE")), (value("VISCOUS_POSITIVE"), value("VISCOUS_NEGATIVE"))
    if dry[0] != dry[1] or wet[0] != wet[1]:
        raise KeyError("MuJoCo's friction is the same in both directions")
    joint.damping = [wet[0], 0.0, value("CUBIC")]
    joint.solref_friction, joint.solimp_friction = STIFF
    if value("BRISTLE"):
        _passive(p, joint, lugre=[row["BRISTLE"], value("BRISTLE_DAMPING"), dry[0], dry[0], 1.0])
    else:
        joint.frictionloss = max(dry[0], 1e-9)
    if value("SOFT"):
        # At a small impedance nearly none of the other torques' acceleration is in it.
        joint.solref_friction, joint.solimp_friction = [row["SOFT"], 1.0], [GENTLE, GENTLE, *STIFF[1][2:]]
    _drive(p, joint, value)
    if value("RIPPLE"):
        _passive(p, joint, cogging=[row["RIPPLE"], round(value("RIPPLE_ORDER")), value("RIPPLE_PHASE")])
    bent = value("CABLE_SQUARE"), value("CABLE_CUBE")
    joint.stiffness, joint.springref = [value("SPRING"), *bent], 0.0 if any(bent) else value("SPRING_REST")
    value("SPRING_REST")
    if value("PULL"):
        p.spring(joint.name, row["PULL"], (value("PULL_FROM"), FAR))
    if value("STOP"):
        at, side = value("STOP_AT"), value("STOP_SIDE")
        p.spring(joint.name, row["STOP"], (-FAR, at) if side > 0 else (at, FAR))
    if value("RANGE"):
        at, side = value("RANGE_AT"), value("RANGE_SIDE")
        _limited(joint, (-FAR, at) if side > 0 else (at, FAR))
        joint.solref_limit, joint.solimp_limit = _yielding(row["RANGE"])
    if value("YIELD"):
        width = value("YIELD_WIDTH")
        p.spring(joint.name, row["YIELD"] / width, (0.0, 0.0), springyield=width)
    _transmission(p, joint, body, value)
    if value("COUPLED"):
        _across(p, i, 1.0, frictionloss=row["COUPLED"])
    value("COUPLED_CREEP"), value("COUPLED_SPEED")
    if value("GEAR_DRY"):
        wet_gear = [value("GEAR_VISCOUS"), 0.0, 0.0]
        _across(
            p, i, value("GEAR_RATIO"), frictionloss=row["GEAR_DRY"], damping=wet_gear, armature=value("GEAR_INERTIA")
        )
    if value("BENDS"):
        across = np.cross(joint.axis, [1.0, 0.0, 0.0] if abs(joint.axis[0]) < 0.5 else [0.0, 1.0, 0.0])
        _behind(joint, body, "bends", across, row["BENDS"], value("BENDS_DAMPING"))
    if value("HEAVIER"):
        body.mass *= row["HEAVIER"]
        body.inertia = np.array(body.inertia) * row["HEAVIER"]
        body.fullinertia = np.array(body.fullinertia) * row["HEAVIER"]
    for name in ("CREEP", "CREEP_SPEED", "CREEP_FORM", "LOAD", "PATCH", "PATCH_START", "PATCH_END", "PATCH_EDGE"):
        value(name)  # enter the level of friction while the arm moves
    known |= {name for name in row if not row[name]}
    if unknown := set(row) - known:
        raise KeyError(*sorted(unknown))


def _drive(p: Plan, joint: Any, value: Callable[..., float]) -> None:
    motor = p.spec.add_actuator(name=f"{joint.name}_motor", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_motor()
    motor.gear = [value("GAIN", 1.0), 0.0, 0.0, 0.0, 0.0, 0.0]
    if value("LIMIT_FORM"):
        motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.forcerange = [-value("LIMIT"), value("LIMIT")]
    if late := value("DELAY"):
        motor.delay, motor.nsample = late, int(np.ceil(late / PERIOD)) + 1
    if lag := value("LAG"):
        motor.dyntype, motor.dynprm = mujoco.mjtDyn.mjDYN_FILTEREXACT, [lag] + [0.0] * 9


def _passive(p: Plan, joint: Any, **values: list[float]) -> None:
    made = p.spec.add_actuator(name=f"{joint.name}_passive", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    made.set_to_dcmotor([0.0, 0.0], 1.0, ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE), **values)


def _limited(joint: Any, ends: tuple[float, float]) -> None:
    joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, list(ends)


def _behind(joint: Any, body: Any, name: str, axis: Array, stiffness: float, damping: float) -> Any:
    """One more hinge of the same body, behind the motor's."""
    made = body.add_joint(name=f"{joint.name}_{name}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, pos=joint.pos)
    made.stiffness, made.damping = [stiffness, 0.0, 0.0], [damping, 0.0, 0.0]
    return made


def _transmission(p: Plan, joint: Any, body: Any, value: Callable[..., float]) -> None:
    stiffness, damping, gap = value("STIFFNESS"), value("STIFFNESS_DAMPING"), value("GAP")
    value("GAP_EXPONENT"), value("GAP_DEPTH"), value("HARDENING")
    if gap:
        behind = _behind(joint, body, "behind", joint.axis, 0.0, 0.1 * damping)
        p.spring(behind.name, stiffness, (-0.5 * gap, 0.5 * gap))
    elif stiffness:
        _behind(joint, body, "behind", joint.axis, stiffness, damping)
    if loose := value("LOOSE"):
        behind = _behind(joint, body, "behind", joint.axis, 0.0, 0.0)
        _limited(behind, (-0.5 * loose, 0.5 * loose))
        behind.solref_limit, behind.solimp_limit = STIFF


def _across(p: Plan, i: int, ratio: float, **values: Any) -> None:
    parts = {p.joints[i].name: 1.0, p.joints[i + 1].name: ratio}
    p.tendon(parts, solref_friction=STIFF[0], solimp_friction=STIFF[1], **values)


def _arm(p: Plan, arm: Row) -> None:
    last = p.bodies[-1]
    p.spec.option.density = arm.get("DENSITY", 0.0)
    p.spec.option.viscosity = arm.get("THICKNESS", 0.0)
    if arm.get("PAYLOAD"):
        radius = arm.get("PAYLOAD_RADIUS", 0.0) or 0.01
        body = p.spec.worldbody.add_body(name="payload", gravcomp=1.0, explicitinertial=True)
        body.mass, body.inertia = arm["PAYLOAD"], [arm["PAYLOAD"] * radius**2] * 3
        body.add_freejoint(name="payload_free")
        weld = p.spec.add_equality(name="grip", type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
        weld.name1, weld.name2, weld.active = last.name, "payload", False
        weld.solref, weld.solimp = STIFF
    if arm.get("HANGING"):
        hung = last.add_body(name="hanging", pos=_local(p, arm), explicitinertial=True)
        hung.mass, hung.inertia, hung.ipos = arm["HANGING"], [1e-4] * 3, [arm["HANGING_LENGTH"], 0.0, 0.0]
        axis = [0.0, 0.0, 1.0] if "GRAVITY_Z" not in arm or not arm["GRAVITY_Z"] else [0.0, 1.0, 0.0]
        swing = hung.add_joint(name="swing", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        swing.stiffness, swing.damping = [arm["HANGING_STIFFNESS"], 0.0, 0.0], [arm["HANGING_DAMPING"], 0.0, 0.0]
    if arm.get("WALL"):
        ball = last.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0.0, 0.0], pos=_local(p, arm))
        wall = p.spec.worldbody.add_geom(name="wall", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5.0, 5.0, 0.1])
        wall.pos, wall.quat = _wall(arm)
        for geom in (ball, wall):
            geom.solref, geom.solimp = _yielding(arm["WALL"])
            geom.friction, geom.mass, geom.condim = [0.0, 0.0, 0.0], 0.0, 1


def _yielding(amount: float) -> tuple[list[float], list[float]]:
    """solref and solimp of a limit or contact that returns by amount, 1/s^2, times depth, whatever inertia is there.

    At a small impedance it takes hardly any of the motor's torque; MuJoCo divides solref by impedance.
    """
    return [-WEAK * amount, -WEAK * 0.2 * np.sqrt(amount)], [WEAK, WEAK, *STIFF[1][2:]]


def _wall(arm: Row) -> tuple[Array, Array]:
    normal = np.array([arm[f"WALL_{axis}"] for axis in "XYZ"])
    quat = np.zeros(4)
    mujoco.mju_quatZ2Vec(quat, normal / np.linalg.norm(normal))
    return np.array([arm[f"WALL_AT_{axis}"] for axis in "XYZ"]), quat


def _local(p: Plan, arm: Row) -> Array:
    """(3,) m, where something is carried, in the last body's frame: in space it is said in base axes at zero angles."""
    bodies = mujoco_arms.bodies(len(p.bodies))
    if not in_space(bodies):
        return np.array([bodies[-1].length + arm.get("PAYLOAD_AHEAD", 0.0), 0.0, 0.0])
    place = np.array([arm[f"PAYLOAD_{axis}"] for axis in "XYZ"])
    model = p.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    body = model.body(p.bodies[-1].name).id
    found: Array = data.xmat[body].reshape(3, 3).T @ (place - data.xpos[body])
    return found


# in motion -----------------------------------------------------------------------------------------------------------


def simulate(n: int, rows: Sequence[Row], arm: Row, desired: Array, forward: Array, pushes: Array) -> Run:
    """The arm in closed loop along desired (3, n, N): a position controller at 1 / PERIOD, whose command MuJoCo's
    drives hold. forward (n, N) N m: feedforward; pushes (n, N) N m: from outside on the links. Raises RanAwayError."""
    p = plan(n, rows, arm)
    model = p.spec.compile()
    data = mujoco.MjData(model)
    mujoco.set_mju_user_warning(lambda _: None)  # it is counted in data.warning
    at = np.array([model.joint(j.name).qposadr[0] for j in p.joints])
    dof = np.array([model.joint(j.name).dofadr[0] for j in p.joints])
    behind = {i: model.joint(f"{j.name}_behind") for i, j in enumerate(p.joints) if _has(model, f"{j.name}_behind")}
    on_link = np.array([behind[i].dofadr[0] if i in behind else d for i, d in enumerate(dof)])
    data.qpos[at], data.qvel[dof] = desired[0, :, 0], desired[1, :, 0]
    each = [*_levels(model, data, rows, at, dof), *_taken_up(model, data, p, arm)]
    kp, kd = (np.array([row[name] for row in rows]) for name in ("KP", "KD"))
    count = desired.shape[2]
    q, v, tau, held = (np.empty((count + 1, n)) for _ in range(4))
    twist = np.zeros((count + 1, n))
    wanted, speed, feed, push = (np.ascontiguousarray(x.T) for x in (desired[0], desired[1], forward, pushes))
    share = _share(model, data, p, rows, dof)
    rows_of_twist = [(i, j.qposadr[0]) for i, j in behind.items()]
    before = np.zeros(n)
    for k in range(count):
        q[k], v[k] = data.qpos[at], data.qvel[dof]
        tau[k] = data.ctrl[:n] = feed[k] + kp * (wanted[k] - q[k]) + kd * (speed[k] - v[k])
        data.qfrc_applied[on_link] = push[k]
        for step in each:
            step(k)
        mujoco.mj_step(model, data)
        at_end = share()
        held[k], before = 0.5 * (before + at_end), at_end.copy()
        for i, address in rows_of_twist:
            twist[k, i] = data.qpos[address]
        if k % 100 == 0 and data.warning.number.any():
            break
    q[count], v[count] = data.qpos[at], data.qvel[dof]
    if data.warning.number.any() or not np.isfinite(q).all() or np.abs(v).max() > 100.0:
        raise RanAwayError(f"MuJoCo: {data.warning.number}")
    change = np.diff(v, axis=0) / PERIOD
    found = (q[:-1], tau[:-1], np.diff(q, axis=0) / PERIOD, change, np.maximum(held[:-1], 0), np.maximum(-held[:-1], 0))
    return Run(*(np.ascontiguousarray(x.T) for x in (*found, (q + twist)[:-1])))


def _has(model: mujoco.MjModel, joint: str) -> bool:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) >= 0


def _share(model: mujoco.MjModel, data: mujoco.MjData, p: Plan, rows: Sequence[Row], dof: Index) -> Callable[[], Array]:
    """What tells how much of its level each joint's dry friction has, from -1 to 1; of a bristle, by its torque."""
    bristles = [(i, model.actuator(f"{j.name}_passive").id) for i, j in enumerate(p.joints) if rows[i].get("BRISTLE")]
    gentle = [i for i, row in enumerate(rows) if row.get("BRISTLE") or row.get("SOFT")]
    rubbing = np.flatnonzero(model.dof_frictionloss[dof] > 0.0)
    place = (np.cumsum(model.dof_frictionloss > 0.0) - 1)[dof[rubbing]]
    out = np.zeros(len(dof))

    def share() -> Array:
        out[rubbing] = -data.efc_force[data.ne + place] / model.dof_frictionloss[dof[rubbing]]
        for i, actuator in bristles:
            out[i] = -data.actuator_force[actuator] / rows[i]["DRY_POSITIVE"]
        for i in gentle:  # above STILL it is whole to those who believe in dry friction
            v = data.qvel[dof[i]]
            out[i] = np.sign(v) if abs(v) > STILL else min(max(out[i], -1.0), 1.0)
        return out

    return share


def _levels(model: mujoco.MjModel, data: mujoco.MjData, rows: Sequence[Row], at: Index, dof: Index) -> list[Each]:
    """Sets the level of each joint's friction that depends on its state, period by period."""
    moved = [i for i, row in enumerate(rows) if any(row.get(x) for x in ("CREEP", "LOAD", "PATCH"))]
    base = model.dof_frictionloss[dof].copy()

    def level(i: int) -> float:
        row, d = rows[i], dof[i]
        out = base[i]
        if row.get("CREEP"):
            out += row["CREEP"] * np.exp(-((data.qvel[d] / row["CREEP_SPEED"]) ** 2))
        if row.get("LOAD"):  # of the period before
            passed = data.qfrc_actuator[d] + data.qfrc_passive[d] + data.qfrc_constraint[d]
            out += row["LOAD"] * abs(passed - model.dof_armature[d] * data.qacc[d])
        if row.get("PATCH") and row["PATCH_START"] < data.qpos[at[i]] < row["PATCH_END"]:
            out += row["PATCH"]
        return float(out)

    def each(_k: int) -> None:
        for i in moved:
            model.dof_frictionloss[dof[i]] = level(i)

    return [each] if moved else []


def _taken_up(model: mujoco.MjModel, data: mujoco.MjData, p: Plan, arm: Row) -> list[Each]:
    """Puts the payload into the gripper in its time: it is held there by a weld and has its weight from then on."""
    if not arm.get("PAYLOAD"):
        return []
    hand, payload, weld = model.body(p.bodies[-1].name).id, model.body("payload").id, model.equality("grip").id
    free = model.joint("payload_free")
    where, start = _local(p, arm), round(arm["PAYLOAD_TIME"] / PERIOD)
    model.eq_data[weld][:11] = [0.0, 0.0, 0.0, *where, 1.0, 0.0, 0.0, 0.0, 1.0]

    def each(k: int) -> None:
        if k != start:
            return
        mujoco.mj_forward(model, data)
        turned = data.xmat[hand].reshape(3, 3)
        centre = data.xpos[hand] + turned @ where
        jacobian, turning = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, turning, centre, hand)
        q, v = free.qposadr[0], free.dofadr[0]
        data.qpos[q : q + 3], data.qpos[q + 3 : q + 7] = centre, data.xquat[hand]
        data.qvel[v : v + 3], data.qvel[v + 3 : v + 6] = jacobian @ data.qvel, turned.T @ (turning @ data.qvel)
        data.eq_active[weld], model.body_gravcomp[payload] = 1, 0.0

    return [each]
