"""Documents of replays: how far a model's motion comes from the recorded one."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, UnsetType

from runtime.documents.models import ArmName
from runtime.documents.parts import Document, Interval95, IterationsEntry, JointName, JointNumber, JointOrArm, Unit, key
from runtime.documents.provenance import Origin


class MotionErrorEntry(Document, frozen=True, kw_only=True):
    """The error of a joint's motion in windows that begin at the recorded state."""

    seconds: Annotated[float, key("longest of the windows", "s")]
    windows: Annotated[int, key("number of windows", "1")]
    rms: Annotated[float | None, key("modelled less recorded position, rms; null where the motion runs away", "`unit`")]
    share: Annotated[float | None, key("the same over the motion within the windows, rms; null without any", "1")]
    promised: Annotated[float | None, key("the part that the torque's error makes, rms", "`unit`")]
    rest: Annotated[float | None, key("the part that is left without the torque's error, rms", "`unit`")]
    apart: Annotated[
        float | UnsetType | None,
        key("played in MuJoCo: difference to the motion by Tendon's equations, rms; absent elsewhere", "`unit`"),
    ] = UNSET


class ReplayedJoint(Document, frozen=True, kw_only=True):
    """A joint's motion under the recorded torque (open loop) and under its controller (closed loop)."""

    joint: JointNumber
    name: JointName
    unit: Annotated[str, key("unit of positions: rad or m")]
    controller: Annotated[
        Literal["gains", "law"] | None,
        key("what makes the torque in closed loop: gains of the model file, the drive's law; null for nothing"),
    ]
    open_loop: Annotated[list[MotionErrorEntry], key("windows of 0.1, 0.3 and 1 s")]
    closed_loop: Annotated[MotionErrorEntry | None, key("the whole recording; null without any controller")]
    agrees: Annotated[
        bool | None, key("whether the torque's error makes most of the motion's; null for a joint that does not move")
    ]
    reason: Annotated[str, key("why, in a sentence")]


class ReplayStep(Document, frozen=True, kw_only=True):
    """A model that was replayed."""

    added: Annotated[str | None, key("the effect that was added last, or the model's file; null for the first")]
    player: Annotated[Literal["tendon", "mujoco"], key("whose equations of motion")] = "tendon"
    joints: Annotated[list[ReplayedJoint], key("each joint")]


class ReplayDocument(Document, frozen=True, kw_only=True):
    """Recorded torques or commands drive the model: `tendon replay --json`."""

    provenance: Origin = UNSET
    arm: ArmName
    fitted: Annotated[bool, key("whether the parameters were fitted to other recordings, with --fit")]
    steps: Annotated[list[ReplayStep], key("each model, before and after, by each player")]
    page: Annotated[str | UnsetType, key("path of the report")] = UNSET


class RefinedParameter(Document, frozen=True, kw_only=True):
    """A parameter that output error sought."""

    joint: JointOrArm
    name: Annotated[str, key("base parameter, parameter of an effect or gain of the drive")]
    unit: Unit
    before: Annotated[float, key("with the smallest error of the torque", "`unit`")]
    after: Annotated[float, key("with the smallest error of the motion", "`unit`")]
    interval: Interval95


class RefinedMotion(Document, frozen=True, kw_only=True):
    """The motion of a joint in windows of the fitted recordings."""

    joint: JointNumber
    unit: Annotated[str, key("unit of positions: rad or m")]
    before: Annotated[MotionErrorEntry, key("with the smallest error of the torque")]
    after: Annotated[MotionErrorEntry, key("with the smallest error of the motion")]


class OutputErrorEntry(Document, frozen=True, kw_only=True):
    """Parameters with which the simulated motion comes nearest to the recorded one."""

    better: Annotated[bool, key("whether the error fell; if not, the parameters are those of the torque")]
    skew: Annotated[float, key("samples by which the torque is taken later", "samples")]
    parameters: Annotated[list[RefinedParameter], key("each that was sought")]
    motions: Annotated[list[RefinedMotion], key("each joint that moves")]
    search: Annotated[IterationsEntry, key("how many Gauss-Newton steps were made")]
