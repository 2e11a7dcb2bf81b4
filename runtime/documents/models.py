"""Documents of model files: import and export."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from runtime.documents.parts import Document, Interval, JointNumber, key

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
    effects: Annotated[dict[str, dict[str, Any]], key("effects by name with the values that the file states", "SI")]


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

    @classmethod
    def of(cls, out: str, made: Mapping[str, Any]) -> ImportDocument:
        """From ImportedArm.document()."""
        joints = [ImportedJointEntry(**{**joint, "limits": LimitsEntry(**joint["limits"])}) for joint in made["joints"]]
        return cls(**{**made, "out": out, "joints": joints})


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


class ExportDocument(Document, frozen=True, kw_only=True):
    """The arm written for simulators: `tendon export --json`."""

    out: Out
    name: ArmName
    missing: Annotated[float, key("rms of the torque that the bodies miss, over that of the torque", "1")]
    gravity: Gravity
    joints: Annotated[list[ExportedJointEntry], key("joints and bodies from the base outwards")]
    unsaid: Annotated[list[str], key("what the format has no place for")]
    kept: Annotated[list[str], key("what the file that was written into says otherwise")]

    @classmethod
    def of(cls, out: str, made: Mapping[str, Any]) -> ExportDocument:
        """From exporting.document()."""
        return cls(**{**made, "out": out, "joints": [ExportedJointEntry(**joint) for joint in made["joints"]]})


Directory = Annotated[str, key("directory of the generated files")]
EffectsDirectory = Annotated[str, key("directory of the library of effects")]
Files = Annotated[list[str], key("generated files")]
EffectsFiles = Annotated[list[str], key("files of the library of effects")]
Operations = Annotated[
    dict[str, dict[str, int]], key("operations of each generated function by kind; arithmetic: their sum", "1")
]


class GenerateDocument(Document, frozen=True, kw_only=True):
    """What was generated: `tendon generate --json`."""

    name: ArmName
    directory: Directory
    effects_directory: EffectsDirectory
    files: Files
    effects_files: EffectsFiles
    operations: Operations
    stale: Annotated[list[str], key("files that --check found out of date")]


class AddDocument(Document, frozen=True, kw_only=True):
    """What was added and generated: `tendon add --json`."""

    model: Annotated[str, key("path of the model file")]
    added: Annotated[str, key("effect and joint that were added")]
    name: ArmName
    directory: Directory
    effects_directory: EffectsDirectory
    files: Files
    effects_files: EffectsFiles
    operations: Operations
