"""Documents of the motions that are proposed: `tendon experiment --json`."""

from __future__ import annotations

from typing import Annotated

from runtime.documents.parts import Document, EffectAt, Interval, IterationsEntry, JointName, JointNumber, key
from runtime.documents.recordings import AssumedNumber, DeterminedParameter


class MotionPart(Document, frozen=True, kw_only=True):
    """A part of a motion."""

    name: Annotated[str, key("what it is")]
    seconds: Annotated[float, key("its length", "s")]


class LimitedJoint(Document, frozen=True, kw_only=True):
    """What a motion asks of a joint, and what it may ask."""

    joint: JointNumber
    name: JointName
    position: Annotated[Interval, key("smallest and largest position", "`position_unit`")]
    position_unit: Annotated[str, key("rad or m")]
    position_stated: Annotated[bool, key("whether the model file states the range")]
    speed: Annotated[float, key("largest speed", "`position_unit`/s")]
    speed_limit: Annotated[float, key("the largest that is allowed", "`position_unit`/s")]
    speed_stated: Annotated[bool, key("whether the model file states the limit")]
    acceleration: Annotated[float, key("largest acceleration", "`position_unit`/s^2")]
    acceleration_limit: Annotated[float, key("the largest that is allowed", "`position_unit`/s^2")]
    torque: Annotated[float, key("largest torque of the likeliest arm", "`force_unit`")]
    torque_at_most: Annotated[float, key("torque that hardly any possible arm exceeds", "`force_unit`")]
    torque_limit: Annotated[float, key("the largest that is allowed", "`force_unit`")]
    torque_stated: Annotated[bool, key("whether the model file states the limit")]
    force_unit: Annotated[str, key("N m or N")]


class FirstMotionDocument(Document, frozen=True, kw_only=True):
    """The motion that tells most of everything unknown: `tendon experiment --json` without --between."""

    seconds: Annotated[float, key("length of the motion", "s")]
    parts: Annotated[list[MotionPart], key("its parts, in order")]
    start: Annotated[list[float], key("pose at its beginning and end", "rad (m)")]
    joints: Annotated[list[LimitedJoint], key("what it asks of each joint")]
    tip_speed: Annotated[float, key("largest speed of the tip", "m/s")]
    tip_speed_limit: Annotated[float, key("the largest that is allowed", "m/s")]
    information: Annotated[float, key("what its Fourier part tells beyond what is assumed", "nats")]
    parameters: Annotated[
        list[DeterminedParameter],
        key("predicted: how well a recording of it, with those at hand, tells each parameter"),
    ]
    before: Annotated[
        list[DeterminedParameter] | None, key("how well the recordings at hand tell each parameter; null without any")
    ]
    rivals: Annotated[
        list[EffectAt] | None, key("effects that the recordings at hand do not tell apart; null without any")
    ]
    assumed: Annotated[list[AssumedNumber], key("inertias that the model file leaves out")]
    unchecked: Annotated[list[str], key("what nothing keeps the arm from, a sentence each")]
    search: Annotated[IterationsEntry, key("how far the search came: steps of its optimizer, and diagnoses of rivals")]
    out: Annotated[str | None, key("file of the motion; null if none was written")]
    held_out: Annotated[str | None, key("file of another motion, for validation; null if none was asked for")]


class ExportedMotionDocument(Document, frozen=True, kw_only=True):
    """A motion written for other programs: `tendon export MODEL MOTION --json`."""

    out: Annotated[str, key("path of the file")]
    to: Annotated[str, key("its format")]
    joints: Annotated[list[str], key("names of the joints")]
    unit: Annotated[str, key("unit of the positions")]
    points: Annotated[int, key("number of points", "1")]
    rate: Annotated[float, key("points a second", "Hz")]
    seconds: Annotated[float, key("length", "s")]
    speed: Annotated[float, key("pace; 1: that of the motion's file", "1")]
    start: Annotated[list[float], key("pose at its beginning", "rad (m)")]
    unchecked: Annotated[list[str], key("what nothing keeps the arm from, sentences")]
