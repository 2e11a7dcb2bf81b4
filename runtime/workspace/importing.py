"""An arm made from a URDF or MJCF, as the document of `tendon import --json`."""

from __future__ import annotations

from runtime.documents.models import ImportDocument, ImportedJointEntry, LimitsEntry
from symbolic.model_file.exchange.importing import ImportedArm


def import_document(made: ImportedArm, out: str) -> ImportDocument:
    """What the file states and what is unknown. out: the new model file."""
    joints = [
        ImportedJointEntry(
            joint=k,
            name=joint.name,
            type=joint.type,
            links=list(found.links),
            mass=joint.link.mass,
            limits=LimitsEntry(position=joint.limits.position, speed=joint.limits.speed, torque=joint.limits.torque),
            unknown=list(joint.unknown),
            effects={name: dict(values) for name, values in joint.effects.items()},
        )
        for k, (joint, found) in enumerate(zip(made.arm.joints, made.chain.joints, strict=True), 1)
    ]
    return ImportDocument(
        out=out,
        name=made.arm.name,
        language=made.chain.tree.language,
        base=made.chain.base,
        tip=made.chain.tip_link,
        gravity=list(made.arm.gravity),
        joints=joints,
        held=list(made.chain.held),
        notes=list(made.notes),
    )
