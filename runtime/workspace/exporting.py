"""An arm written for simulators, and a motion for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from runtime import files
from runtime.documents.experiments import ExportedMotionDocument
from runtime.documents.models import ExportDocument, ExportedEffectEntry, ExportedJointEntry
from runtime.workspace.source import CompiledArm
from symbolic.model_file.checks import ModelError

if TYPE_CHECKING:
    from runtime.experiments.options import MotionOptions
    from runtime.model.loader import Model
    from runtime.recordings.recording import Recording
    from symbolic.model_file.exchange.exporting import ExportedArm, ExportedEffect
    from symbolic.model_file.exchange.ways import Language


def export(
    compiled: CompiledArm,
    language: Language,
    out: Path,
    onto: Path | None = None,
    recordings: Sequence[Recording] = (),
    servo: str | None = None,
) -> ExportDocument:
    """Write the arm for simulators; what was written.

    onto         a URDF; the new file is a copy of it with the model's numbers
    recordings   along which the shares of the effects that the file lacks are computed; none: along a simulated motion
    servo        BAM's name of it; None: the arm's
    The bodies are those of the model file where it states them completely and they are physically possible. Otherwise
    they are possible bodies with the file's base parameters, as near to the file's as these allow. Raises ModelError
    where a base parameter is unknown, and OSError.
    """
    from symbolic.model_file.exchange.bam import bam_files, unsaid_of
    from symbolic.model_file.exchange.exporting import urdf_text
    from symbolic.model_file.exchange.mjcf_writer import mjcf_text
    from symbolic.model_file.exchange.urdf import urdf_onto

    made, missing = _with_bodies(compiled, language)
    if any(effect.standing.played != "exact" for effect in made.effects):
        # A share needs inertias, which the parameters of a servo do not.
        with suppress(ModelError) if language == "bam" else nullcontext():
            made = _with_shares(made, compiled, recordings)
    kept: list[str] = []
    written = {out: (urdf_text if language == "urdf" else mjcf_text)(made).encode()} if language != "bam" else {}
    if onto is not None:
        written[out], kept = urdf_onto(made, onto)
    elif language == "bam":
        written = bam_files(made, out, servo or made.arm.name)
        made = replace(made, keys=(*made.keys, *unsaid_of(made)))
    for path, data in written.items():
        files.replace(path, data)
    joints = [
        ExportedJointEntry(
            joint=k,
            name=joint.name,
            type=joint.joint.type,
            mass=joint.body.mass,
            com=list(joint.body.com),
            inertia=list(joint.body.inertia),
            rotor_inertia=joint.rotor,
            damping=joint.damping or None,
            friction=joint.friction or None,
            stiffness=None if joint.spring is None else joint.spring.stiffness,
            rest=None if joint.spring is None else joint.spring.rest,
        )
        for k, joint in enumerate(made.joints, 1)
    ]
    return ExportDocument(
        out=", ".join(map(str, written)),
        name=made.arm.name,
        missing=missing,
        gravity=list(made.arm.gravity),
        joints=joints,
        effects=[*map(_entry, made.effects)],
        unsaid=made.unsaid,
        kept=kept,
    )


def export_motion(model: Model, motion: Path, to: str, out: Path, options: MotionOptions) -> ExportedMotionDocument:
    """Write a motion's file for another program, checked as `tendon execute` checks it; what was written.

    Raises SimulationError, TrajectoryError, ExperimentError, OSError.
    """
    from runtime.execution.motions import read_played
    from runtime.experiments.motion_files import FORMATS, SampledMotion, joint_names, unit_of
    from runtime.simulation.motion_file import without_dust

    played = read_played(motion, model, options.speed)
    rate = options.rate_of(to, *(() if model.controller is None else (model.controller["rate"],)))
    t, *moved = played.sampled(rate)
    q, qd, qdd = map(without_dust, moved)
    notes = [*played.file.comments, f"played at {options.speed:g} of its pace"]
    made = SampledMotion(model, joint_names(model), t, q, qd, qdd, notes)
    files.replace(out, FORMATS[to].made(made, options, out))
    return ExportedMotionDocument(
        out=str(out),
        to=to,
        joints=list(made.names),
        unit=unit_of(to, options),
        points=len(t),
        rate=rate,
        seconds=float(t[-1]),
        speed=options.speed,
        start=q[:, 0].tolist(),
        unchecked=played.unchecked,
    )


def _entry(effect: ExportedEffect) -> ExportedEffectEntry:
    there = effect.standing
    return ExportedEffectEntry(
        effect=effect.name,
        joint=effect.joint,
        played=there.played,
        by=there.by,
        but=there.but,
        tolerance=there.tolerance or None,
        share=effect.share,
    )


def _with_shares(made: ExportedArm, compiled: CompiledArm, recordings: Sequence[Recording]) -> ExportedArm:
    """The arm with the share of the torque that the file lacks of each effect. Where every element of an effect has a
    place in the file, words alone say in what they differ."""
    from runtime.model.terms import Structure, Term, check_complete, structure
    from runtime.simulation.shares import shares
    from symbolic.model_file.exchange.exporting import alone

    model, known = compiled.model(), {}
    for term, values in structure(model).items():
        try:
            check_complete(model, {term: values})
            known[term] = values
        except ModelError:
            continue
    held: dict[tuple[str, int | None], Structure] = {}
    for effect in (e for e in made.effects if e.standing.played == "approximated"):
        parts = [alone(element, compiled.library) for element in effect.elements]
        if None not in parts:
            held[effect.name, effect.joint] = {Term(part[0], effect.joint): part[1] for part in parts if part}
    without = {term: held[term.name, term.joint] for term in known if (term.name, term.joint) in held}
    found = shares(model, known, recordings, without)

    def share(effect: ExportedEffect) -> float | None:
        partly = effect.standing.played == "approximated"
        if effect.standing.whole or (partly and (effect.name, effect.joint) not in held):
            return None
        of = [part for (term, k), part in found.items() if term.name == effect.name and effect.joint in (None, k + 1)]
        return max(of, default=None)

    return replace(made, effects=tuple(replace(effect, share=share(effect)) for effect in made.effects))


def _with_bodies(compiled: CompiledArm, language: Language) -> tuple[ExportedArm, float]:
    """The arm as it is written, and the rms of the torque that its bodies miss over that of the torque. Bodies that the
    file does not state, or that are impossible, are possible ones with the model's base parameters."""
    import numpy as np

    from runtime.exchange.bodies import base_map, is_possible, mobilities, project, rotors_asked
    from symbolic.model_file import likely
    from symbolic.model_file.exchange import exporting
    from symbolic.model_file.frames import parameters

    arm = compiled.arm
    bodies = likely.likely_bodies(arm)
    rotors = [
        likely.turning(body, joint) if joint.rotor_inertia is None else joint.rotor_inertia
        for joint, body in zip(arm.joints, bodies, strict=True)
    ]
    near = np.array([parameters(body) for body in bodies])
    behind = np.array(exporting.elastic(arm, compiled.library))
    if language == "bam":
        known = [joint.rotor_inertia or 0.0 for joint in arm.joints]
        return exporting.exported(arm, compiled.library, language, bodies, known, [0.0] * len(known)), 0.0
    stated = not arm.inertial and not any(joint.unknown for joint in arm.joints)
    if stated and all(map(is_possible, near)):
        moved = mobilities(arm, near, np.array(rotors), behind).tolist()
        return exporting.exported(arm, compiled.library, language, bodies, rotors, moved), 0.0
    model = compiled.model()
    B, W = base_map(arm, model.regressor)
    guessed = np.array([joint.rotor_inertia is None for joint in arm.joints])
    asked = rotors_asked(B, W, model.lump_values, near, likely=np.array(rotors), guessed=guessed)
    found = project(B, W, model.lump_values, bodies=near, rotors=asked)
    made = [exporting.body_of(body) for body in found.bodies]
    moved = mobilities(arm, found.bodies, found.rotors, behind).tolist()
    arms = exporting.exported(arm, compiled.library, language, made, found.rotors.tolist(), moved)
    return arms, found.mismatch
