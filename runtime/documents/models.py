"""Documents of model files and of the library of effects: init, import, export and effects."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import UNSET, UnsetType

from runtime.documents.parts import Document, Interval, JointNumber, OpenInterval, Unit, key

JointKind = Annotated[str, key("revolute or prismatic")]
Gravity = Annotated[list[float], key("gravity in base axes", "m/s^2")]
Mass = Annotated[float | None, key("mass of the link; null if unknown", "kg")]
Out = Annotated[str, key("path of the written file")]
ArmName = Annotated[str, key("name of the arm")]


class LimitsEntry(Document, frozen=True, kw_only=True):
    """Limits of a joint; null where the file states none."""

    position: Annotated[Interval | None, key("smallest and largest position", "rad or m")]
    speed: Annotated[float | None, key("largest speed", "rad/s or m/s")]
    torque: Annotated[float | None, key("largest torque or force", "N m or N")]


class ImportedJointEntry(Document, frozen=True, kw_only=True):
    """A joint of an imported arm."""

    joint: JointNumber
    name: Annotated[str | None, key("name in the file")]
    type: JointKind
    links: Annotated[list[str], key("links that move rigidly with it")]
    mass: Mass
    limits: Annotated[LimitsEntry, key("its limits")]
    unknown: Annotated[list[str], key("keys that the file does not state")]
    effects: Annotated[dict[str, dict[str, float]], key("effects by name with the values that the file states", "SI")]


class ImportDocument(Document, frozen=True, kw_only=True):
    """The model file made from a URDF or MJCF: `tendon import --json`."""

    out: Out
    name: ArmName
    language: Annotated[str, key("URDF or MJCF")]
    base: Annotated[str, key("link where the arm begins")]
    tip: Annotated[str, key("link where it ends")]
    gravity: Gravity
    joints: Annotated[list[ImportedJointEntry], key("joints from the base outwards")]
    held: Annotated[list[str], key("moving joints off its way, which are held")]
    notes: Annotated[list[str], key("what to know about the import")]


class ExportedJointEntry(Document, frozen=True, kw_only=True):
    """A joint of an exported arm and the body that it moves."""

    joint: JointNumber
    name: Annotated[str, key("name in the written file")]
    type: JointKind
    mass: Annotated[float, key("mass of the body", "kg")]
    com: Annotated[list[float], key("its centre of mass in the joint's frame", "m")]
    inertia: Annotated[list[float], key("its inertia about the centre: xx, xy, xz, yy, yz, zz", "kg m^2")]
    rotor_inertia: Annotated[float | None, key("inertia of the rotor at the joint", "kg m^2 or kg")]
    damping: Annotated[float | None, key("viscous friction; null if there is none", "N m s/rad or N s/m")]
    friction: Annotated[float | None, key("dry friction; null if there is none", "N m or N")]
    stiffness: Annotated[float | None, key("stiffness of a spring; null if there is none", "N m/rad or N/m")]
    rest: Annotated[float | None, key("its rest position; null if there is none", "rad or m")]


class ExportedEffectEntry(Document, frozen=True, kw_only=True):
    """An effect of the model, and how it stands in an exported file."""

    effect: Annotated[str, key("name of the effect, numbered where a joint has several")]
    joint: Annotated[int | None, key("number of the joint, from 1; null if it is of the whole arm")]
    played: Annotated[Literal["exact", "approximated", "not"], key("whether the file has its law")]
    by: Annotated[str, key("the words of the file that stand for it; empty if none does")]
    but: Annotated[str, key("in what they differ from its law, or why none stands for it")]
    tolerance: Annotated[
        float | None, key("by which MuJoCo's motion of 0.3 s may differ; null where no simulator plays it", "1")
    ]
    share: Annotated[
        float | None,
        key(
            "rms of what the file lacks of it over that of the joint's torque; null where that is not known or nothing",
            "1",
        ),
    ]


class ExportDocument(Document, frozen=True, kw_only=True):
    """The arm written for simulators: `tendon export --json`."""

    out: Out
    name: ArmName
    missing: Annotated[float, key("rms of the torque that the bodies miss, over that of the torque", "1")]
    gravity: Gravity
    joints: Annotated[list[ExportedJointEntry], key("joints and bodies from the base outwards")]
    effects: Annotated[list[ExportedEffectEntry], key("all effects of the model with their places in the file")]
    unsaid: Annotated[list[str], key("what the format has no place for")]
    kept: Annotated[list[str], key("what the file that was written into says otherwise")]


class InitDocument(Document, frozen=True, kw_only=True):
    """The new model file: `tendon init --json`."""

    out: Out
    like: Annotated[str | None, key("model file that was copied; null if none was")]
    name: ArmName
    joints: Annotated[int, key("number of joints", "1")]
    unknown: Annotated[list[list[str]], key("keys of each joint that the file leaves open")]
    schemas: Annotated[list[str], key("JSON schemas for editors that were written beside it")]


class ProposedEntry(Document, frozen=True, kw_only=True):
    """A value that was proposed for a model file."""

    joint: Annotated[int | None, key("number of the joint, from 1; null if it is of the whole arm")]
    key: Annotated[str, key("key in the joint's table, or in the file, with the tables around it")]
    value: Annotated[float, key("proposed value", "as `unit` says")]
    unit: Unit
    why: Annotated[str, key("what it was proposed from")]


class InitControllerDocument(Document, frozen=True, kw_only=True):
    """What a model file lacks for its controller: `tendon init --controller --json`."""

    model: Annotated[str, key("the model file")]
    out: Annotated[str | None, key("path of the written file; null if nothing was written")]
    name: ArmName
    bandwidth: Annotated[float, key("of the position loop, by all gains that are proposed", "Hz")]
    limit: Annotated[str, key("why it is not higher")]
    proposed: Annotated[list[ProposedEntry], key("proposed values")]


class InitScenarioDocument(Document, frozen=True, kw_only=True):
    """A scenario that was begun: `tendon init --scenario --json`."""

    out: Out
    name: Annotated[str, key("name of the scenario")]
    model: Annotated[str, key("model file, as the scenario names it")]
    seconds: Annotated[float, key("duration of the motion", "s")]
    points: Annotated[dict[str, list[float]], key("points by name: positions of the joints or of the tip", "rad, m")]
    springs: Annotated[list[JointNumber], key("joints that may have a parallel spring")]


class UnitByJoint(Document, frozen=True, kw_only=True):
    """A unit that depends on the type of joint."""

    revolute: Unit
    prismatic: Unit


class SignalOrigin(Document, frozen=True, kw_only=True):
    """Where the value of a signal comes from; the keys depend on its kind."""

    kind: Annotated[
        Literal["Coordinate", "ArmOutput", "ArmSlope", "JointConstant", "Given"],
        key(
            "Coordinate: of a joint's motion; ArmOutput: of a function of the arm; ArmSlope: its derivative; "
            "JointConstant: of the model file; Given: by the caller"
        ),
    ]
    name: Annotated[str | UnsetType, key("coordinate, or key of the joint")] = UNSET
    step: Annotated[int | UnsetType, key("0: of the own joint; 1: of the next one outwards; -1: of the one before")] = (
        UNSET
    )
    function: Annotated[str | UnsetType, key("function of the arm")] = UNSET
    index: Annotated[
        list[int | str] | UnsetType, key("which of its values; joint: row of the joint; own: of the effect's own joint")
    ] = UNSET
    by: Annotated[str | UnsetType, key("coordinate by which it is differentiated")] = UNSET
    absent: Annotated[float | UnsetType, key("value where the caller gives none")] = UNSET


class LibrarySignal(Document, frozen=True, kw_only=True):
    """A signal that effects read."""

    name: Annotated[str, key("name of the signal")]
    unit: Annotated[UnitByJoint, key("unit of the signal")]
    meaning: Annotated[str, key("what it is")]
    needs: Annotated[str, key("what must be known to compute it")]
    source: Annotated[SignalOrigin | None, key("where its value comes from; null where a rule of its own says so")]
    known_to: Annotated[str, key("controller: known in the loop; plan: known ahead of a motion; recording: only after")]
    seen_over: Annotated[str | None, key("abscissa over which a residual shows it; null for none")]
    sensor: Annotated[str | None, key("further sensor that measures it; null for none")]


class SearchGrid(Document, frozen=True, kw_only=True):
    """Values at which a shape parameter is tried."""

    low: Annotated[float, key("smallest value, times `of`")]
    high: Annotated[float, key("largest value, times `of`")]
    count: Annotated[int, key("number of values", "1")]
    of: Annotated[str, key("quantity of the recording that the values multiply; one: none")]
    spacing: Annotated[Literal["log", "linear"], key("spacing of the values")]


class EffectParameter(Document, frozen=True, kw_only=True):
    """A parameter of an effect."""

    name: Annotated[str, key("name in the model file")]
    unit: Annotated[UnitByJoint, key("unit of the parameter")]
    meaning: Annotated[str, key("what it is")]
    role: Annotated[
        Literal["linear", "shape", "given"],
        key("linear: solved for; shape: searched on a grid; given: taken from the model file"),
    ]
    bounds: Annotated[OpenInterval, key("physical bounds; null for none", "SI")]
    grid: Annotated[SearchGrid | None, key("values at which it is tried; null unless it is a shape parameter")]
    default: Annotated[float | None, key("value of a given parameter that the model file omits; null for none", "SI")]
    kind: Annotated[str, key("kind of shape parameter: stiffness, damping, play, side, begin, end, onset, lead, lag")]
    neutral: Annotated[float, key("value at which the effect vanishes", "SI")]
    gives: Annotated[str, key("signal for other effects of which it is the value; empty for none")]
    planned: Annotated[str, key("size or place: what an optimization chooses; empty for neither")]
    scale: Annotated[float, key("typical size", "SI")]
    says: Annotated[str | None, key("its name in a plan; null: the same")]
    abroad: Annotated[str, key("its name in URDF and MJCF; empty where these have none")]
    space: Annotated[bool, key("whether only spatial arms have it")]


class EffectDocument(Document, frozen=True, kw_only=True):
    """An effect of the library."""

    name: Annotated[str, key("name in the model file")]
    scope: Annotated[
        Literal["joint", "joints", "arm", "contact"], key("where it acts; joints: a joint and the next one outwards")
    ]
    family: Annotated[str, key("heading in lists")]
    summary: Annotated[str, key("what it is, in one sentence")]
    equation: Annotated[str, key("its torque")]
    trace: Annotated[str, key("what it leaves in a residual")]
    experiment: Annotated[str, key("motion that brings it out")]
    source: Annotated[str, key("literature")]
    dissipates: Annotated[bool, key("whether its power is never negative")]
    friction: Annotated[bool, key("whether it is friction although it does not always dissipate")]
    dry: Annotated[bool, key("whether it is dry friction that presliding bristles carry")]
    has_gap: Annotated[bool, key("whether it has a gap in which nothing is transmitted")]
    carried: Annotated[bool, key("whether the transmission carries its torque on to the link")]
    one_form: Annotated[bool, key("whether its law is one of many forms of such an effect")]
    sits_at: Annotated[str | None, key("motor or link: side of an output torque sensor; null where it follows")]
    brought: Annotated[bool, key("whether a planned trajectory brings it")]
    several: Annotated[bool, key("whether a joint may have more than one")]
    generalises: Annotated[list[str], key("effects that are special cases of it and that it replaces")]
    alike_at_joints: Annotated[str, key("effect of a joint that it is at all joints alike; empty for none")]
    assumed: Annotated[bool, key("whether imported arms are given it, its values unknown")]
    gives_way: Annotated[bool, key("whether the transmission gives way: all joints feel it")]
    parameters: Annotated[list[EffectParameter], key("its parameters")]
    signals: Annotated[list[str], key("signals that it reads")]
    coefficients: Annotated[list[EffectParameter], key("coefficients in which its torque is linear")]
    recover: Annotated[
        list[Any] | None, key("linear parameters by the coefficients, in prefix notation; null: they are equal")
    ]
    states: Annotated[list[str], key("internal states")]
    deflection: Annotated[str | None, key("state that is the transmission's deflection; null for none")]


class EffectsDocument(Document, frozen=True, kw_only=True):
    """The library of effects: `tendon effects --json`; with NAME the object of that effect alone."""

    signals: Annotated[list[LibrarySignal], key("signals that effects may read")]
    lanes: Annotated[int, key("samples that the generated code of an effect evaluates at once", "1")]
    effects: Annotated[list[EffectDocument], key("effects")]
