"""Whether a fit may be believed: errors beside noise floors, recordings beside each other, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from runtime.diagnosis import consistency
from runtime.diagnosis.settings import FAR_ABOVE_NOISE, LEAST_MOVING_S
from runtime.diagnosis.steps import seconds_moving
from runtime.documents.fits import JudgedFitDocument
from runtime.fit_warnings import Suspicion, improper_inertia, suspicions, warnings
from runtime.identification.compare import JointSeries, series
from runtime.identification.estimate import Estimate
from runtime.identification.identify import Identification
from runtime.recordings.recording import Recording
from symbolic.model_file.arm import ROTOR


@dataclass(frozen=True)
class JudgedFit:
    """A fit, the errors that it leaves at every joint, each recording's own, and why it may not be believed.

    reason: a sentence a person can act on, or none
    """

    identification: Identification
    joints: tuple[JointSeries, ...]
    recordings: consistency.Tables
    reason: str

    @property
    def verdict(self) -> Literal["fitted", "refused"]:
        return "refused" if self.reason else "fitted"

    def document(self) -> JudgedFitDocument:
        """As `tendon identify --json`, but for what was written."""
        return self.identification.document().as_part_of(
            JudgedFitDocument,
            verdict=self.verdict,
            reason=self.reason or _fitted(self.joints),
            joints=[joint.document() for joint in self.joints],
            recordings=self.recordings.recording_entries(),
            inconsistent=self.recordings.contradiction_entries(),
            warnings=[*warnings(self.identification), *([] if self.reason else above_noise(self.joints))],
        )


def judged(identification: Identification, recordings: Sequence[Recording]) -> JudgedFit:
    """A fit to these recordings, with what speaks against it."""
    joints = series(identification)
    names = [r.path.name for r in recordings]
    tables = consistency.compare(identification, names, [s.floor.spectrum for s in joints])
    return JudgedFit(identification, joints, tables, _reason(identification, joints, tables))


def _reason(identification: Identification, joints: Sequence[JointSeries], tables: consistency.Tables) -> str:
    return wrong_data(suspicions(identification)) or tables.refusal or unreliable(identification, joints)


def unreliable(identification: Identification, joints: Sequence[JointSeries]) -> str:
    """Why a fit to data that do not look wrong may not be believed; empty if nothing speaks against it."""
    return poor_excitation(identification) or _unphysical(identification, joints)


def _fitted(joints: Sequence[JointSeries]) -> str:
    errors = ", ".join(f"{100 * s.relative:.3g} % of the torque at joint {s.joint}" for s in joints if len(s.t))
    return f"the fit misses {errors}"


def wrong_data(found: Sequence[Suspicion]) -> str:
    """Suspicions as the reason of a refusal; empty without one."""
    return f"the data look wrong: {'; '.join(map(str, found))}" if found else ""


def poor_excitation(identification: Identification) -> str | None:
    """Why the motion does not tell the parameters; None if it does."""
    motion, inference = identification.motion, identification.inference
    seconds = [seconds_moving(motion, i) for i in range(motion.n)]
    if max(seconds) < LEAST_MOVING_S:
        return f"the joints move for {max(seconds):.1f} s only; record at least {LEAST_MOVING_S:g} s of motion"
    able = [s >= LEAST_MOVING_S for s in seconds]
    tangled = [
        f"{term} {name}"
        for term, values in inference.values.items()
        for name, e in values.items()
        if e.with_others and (term.joint is None or able[term.joint - 1]) and not _by_a_rotor(e)
    ]
    # With a joint held, inertias of the others are seen as sums only, and stay divided as in the file.
    tangled += [
        lump.name
        for lump, e in zip(identification.model.lumps, inference.lumps, strict=True)
        if e.with_others and all(able)
    ]
    if tangled:
        return f"the motion does not separate {', '.join(tangled)}; move over more speeds, accelerations and positions"
    return None


def _by_a_rotor(e: Estimate) -> bool:
    """Whether it is told together with a rotor that the model file leaves out: no other motion would change that."""
    return any(name.startswith(ROTOR) for name in e.with_others)


def _unphysical(identification: Identification, joints: Sequence[JointSeries]) -> str:
    """That a fit is worse than none, or far above the noise at the bound of what is physical; empty if neither."""
    worthless = [s for s in joints if s.relative >= 1]
    if worthless:
        at = " and ".join(f"joint {s.joint} {100 * s.relative:.3g} %" for s in worthless)
        return f"the fit is worse than no torque at all (it misses at {at} of it): the model or the data is wrong"
    if any(_far(s) for s in joints):
        return "; ".join(improper_inertia(identification))
    return ""


def _far(joint: JointSeries) -> bool:
    return joint.rms > FAR_ABOVE_NOISE * joint.floor.value


def above_noise(joints: Sequence[JointSeries]) -> list[str]:
    """Joints whose error is far above the noise."""
    return [
        f"joint {s.joint}: the fit misses {100 * s.relative:.3g} % of the torque, {s.rms / s.floor.value:.2g} times "
        "its noise floor: what the model lacks is in its parameters, too; tendon diagnose looks for it"
        for s in joints
        if s.floor.value > 0 and _far(s)
    ]
