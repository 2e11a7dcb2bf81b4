"""Which physical effect is missing? From a fitted model's residual to named, ranked findings, or to silence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from runtime import limits
from runtime.candidates import Field
from runtime.compare import JointSeries, errors, series, warnings
from runtime.covariance import Inference
from runtime.identify import Identification, Problem, identify_motion, prepared
from runtime.judge import Evidence, Verdict, judge
from runtime.loader import Model
from runtime.motion import Motion, prepare
from runtime.recording import Recording
from runtime.terms import Structure, Term, joints_of, structure

Array = NDArray[np.float64]

_MOST_FINDINGS = 6
_LEAST_FALL = 0.005
_MOST_RIVALS = 4
_CLEARLY_LESS = 0.01
_OUTSIDE = 1.5
"""A residual above this multiple of the instruments' own noise has a source, even if nothing explains it."""
_ABOVE_NOISE = 1.15
_LEAST_MOVING_S = 2.0
_STANDS_OUT = 0.2
_DISAGREES = 0.05


@dataclass(frozen=True)
class Errors:
    """Error of every joint on one set of recordings: RMS and ‖τ − τ̂‖/‖τ‖."""

    rms: tuple[float, ...]
    relative: tuple[float, ...]


@dataclass(frozen=True)
class Step:
    """A fitted structure: after `added` (None: the model as given)."""

    added: Term | None
    identification: Identification
    joints: tuple[JointSeries, ...]
    fitted: Errors
    held_out: Errors | None


@dataclass(frozen=True)
class Finding:
    """A named effect: what speaks for it, what the data cannot tell from it, and against whom it was chosen."""

    evidence: Evidence
    rivals: tuple[Term, ...]
    verdict: Verdict
    before: Step
    after: Step

    @property
    def term(self) -> Term:
        return self.evidence.term

    @property
    def joint_index(self) -> int:
        return (self.term.joint or 1) - 1

    def share(self) -> float:
        """(rms_before² − rms_after²) / (rms_before² − floor²), at most 1."""
        i = self.joint_index
        before, after = self.before.fitted.rms[i], self.after.fitted.rms[i]
        excess = before**2 - self.before.joints[i].floor.value ** 2
        return float(np.clip((before**2 - after**2) / excess, 0.0, 1.0)) if excess > 0 else 0.0


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on a model and recordings. `steps`: the model as given, then with each finding added."""

    verdict: Literal["effect", "clean", "unexplained", "refused"]
    reason: str
    steps: tuple[Step, ...]
    findings: tuple[Finding, ...]
    last: Verdict
    seen: tuple[limits.Limit, ...]

    @property
    def model(self) -> Model:
        return self.steps[0].identification.model

    def to_json(self) -> dict[str, Any]:
        """As `tendon diagnose --json`."""
        band = self.steps[0].identification.motion.band
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "band": {"cutoff_hz": band.cutoff, "reason": band.reason},
            "skew": self.steps[-1].identification.inference.skew_json(),
            "joints": [s.to_json() for s in self.steps[0].joints],
            "parameters": inertial_json(self.model, self.steps[-1].identification.inference),
            "findings": [finding_json(self, k) for k in range(len(self.findings))],
            "ruled_out": _ranking(self.last),
            "would_have_seen": [limit.to_json() for limit in self.seen],
            "warnings": warnings(self.steps[-1].identification),
        }


def inertial_json(model: Model, inference: Inference) -> list[dict[str, Any]]:
    return inference.to_json(model)["inertial"]


def finding_json(diagnosis: Diagnosis, number: int) -> dict[str, Any]:
    finding = diagnosis.findings[number]
    i = finding.joint_index
    info = diagnosis.model.library.effects[finding.term.effect]
    values = diagnosis.steps[-1].identification.inference.values.get(finding.term, {})
    held = [None if s.held_out is None else s.held_out.rms[i] for s in (finding.before, finding.after)]
    return {
        "effect": finding.term.effect,
        "joint": finding.term.joint,
        "share": finding.share(),
        "rms_before": finding.before.fitted.rms[i],
        "rms_after": finding.after.fitted.rms[i],
        "held_out_before": held[0],
        "held_out_after": held[1],
        "evidence": finding.evidence.to_json(),
        "parameters": {name: e.to_json() for name, e in values.items()},
        "rivals": [{"effect": t.effect, "joint": t.joint} for t in finding.rivals],
        "ranking": _ranking(finding.verdict),
        "experiment": info.experiment,
        "remainder": remainder(diagnosis.steps[-1], i) if number == len(diagnosis.findings) - 1 else None,
    }


def _ranking(verdict: Verdict) -> list[dict[str, Any]]:
    """Every finalist with what speaks for it and which gates it failed."""
    return [{"effect": e.term.effect, "joint": e.term.joint, "evidence": e.to_json()} for e in verdict.ranked]


@dataclass
class Search:
    """A forward search from one structure; each step refits everything before the next effect is sought."""

    model: Model
    motion: Motion
    held_out: Motion | None = None
    steps: list[Step] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    last: Verdict = field(default_factory=lambda: Verdict((), ()))
    _ground: Field | None = None

    def start(self, known: Structure) -> Step:
        self.steps.append(self._step(None, known, None))
        return self.steps[-1]

    def _step(self, added: Term | None, known: Structure, before: Identification | None) -> Step:
        identification = identify_motion(self.model, self.motion, known, start=before.fit if before else None)
        joints = series(identification)
        fitted = Errors(tuple(j.rms for j in joints), tuple(j.relative for j in joints))
        held = None if self.held_out is None else errors_elsewhere(identification, self.held_out)
        return Step(added, identification, joints, fitted, held)

    def advance(self) -> Finding | None:
        """Add the best candidate that passes every gate; None if there is none."""
        step = self.steps[-1]
        ground = self.ground()
        floors = [s.floor.value for s in step.joints]
        self.last = judge(ground, floors)
        able = [e for e in self.last.ranked if e.passes and self._able(e.term)]
        able.sort(key=lambda e: -e.delta_bic)
        for evidence in able:
            first = evidence is self.last.ranked[0]
            evidence, after = self._refitted(evidence, self.last if first else None)
            if self._better(step, after, joints_of(self.model, evidence.term)[0]):
                group = (self.last.ranked[0].term, *self.last.rivals) if first else ()
                rivals = tuple(term for term in group if term != evidence.term)
                finding = Finding(evidence, rivals, self.last, step, after)
                self.steps.append(after)
                self.findings.append(finding)
                return finding
        return None

    def _able(self, term: Term) -> bool:
        """Whether the term's joint moves for long enough to say anything of it."""
        return any(seconds_moving(self.motion, i) >= _LEAST_MOVING_S for i in joints_of(self.model, term)[:1])

    def _refitted(self, evidence: Evidence, verdict: Verdict | None) -> tuple[Evidence, Step]:
        """The candidate and the step that adds it; one of its rivals instead, if that clearly leaves less.

        Candidates are ranked beside a base that was fitted without them; what an effect takes from others
        (a bristle from dry friction) shows only when everything is refitted.
        """
        step, rivals = self.steps[-1], verdict.rivals if verdict else ()
        contenders = [e for e in (verdict.ranked if verdict else ()) if e.term in rivals][:_MOST_RIVALS]
        best, after = evidence, self._step(evidence.term, self._with(step, evidence), step.identification)
        for rival in contenders:
            other = self._step(rival.term, self._with(step, rival), step.identification)
            joint = joints_of(self.model, rival.term)[0]
            if other.fitted.rms[joint] < (1 - _CLEARLY_LESS) * after.fitted.rms[joint]:
                best, after = rival, other
        return best, after

    def ground(self) -> Field:
        """The last step as the field on which candidates compete, with what was computed on it."""
        last = self.steps[-1].identification
        if self._ground is None or self._ground.fit is not last.fit:
            self._ground = Field(last.problem, last.fit)
        return self._ground

    def _with(self, step: Step, evidence: Evidence) -> Structure:
        """The structure with the candidate in place of what it generalises, and all shapes found so far."""
        fit = step.identification.fit
        replaced = self.ground().replaced(evidence.term)
        known: Structure = {t: dict(fit.shapes[t]) for t in fit.shapes if t not in replaced}
        known[evidence.term] = dict(evidence.candidate.shape)
        return known

    def _better(self, before: Step, after: Step, joint: int) -> bool:
        """Refitted as a whole, the error falls at the effect's joint and on the held-out recording, if any."""
        falls = after.fitted.rms[joint] < (1 - _LEAST_FALL) * before.fitted.rms[joint]
        if before.held_out is None or after.held_out is None:
            return falls
        return falls and sum(r**2 for r in after.held_out.relative) < sum(r**2 for r in before.held_out.relative)


def errors_elsewhere(identification: Identification, motion: Motion) -> Errors:
    """Error of a fit, all its values as they are, on another motion."""
    fit, model = identification.fit, identification.model
    problem = Problem(model, motion, tuple(fit.shapes), fit.prediction)
    found = []
    for i in range(model.n):
        x, fixed = problem.rows(i, fit.shapes)
        use = motion.moving(i)
        tau = motion.torque(i, fit.skew)[use]
        found.append(errors(tau - (fixed + fit.coefficients @ x)[use], tau))
    return Errors(tuple(rms for rms, _ in found), tuple(relative for _, relative in found))


def diagnose(model: Model, recordings: Sequence[Recording], held_out: Sequence[Recording] = ()) -> Diagnosis:
    """Fit the model file's structure, then name what is missing, the first first, or say why nothing can be named."""
    search = begin(model, recordings, held_out)
    while len(search.findings) < _MOST_FINDINGS and search.advance() is not None:
        pass
    return conclude(search)


def begin(model: Model, recordings: Sequence[Recording], held_out: Sequence[Recording] = ()) -> Search:
    """A search on recordings; the held-out ones are judged in the same band and never fitted."""
    motion = prepared(model, recordings)
    search = Search(model, motion, prepare(held_out, motion.band, model.library) if held_out else None)
    search.start(structure(model))
    return search


def conclude(search: Search) -> Diagnosis:
    """The verdict, once nothing more passes the gates."""
    verdict, reason = _verdict(search)
    step = search.steps[-1]
    ground = search.ground()
    floors = [s.floor.value for s in step.joints]
    able = [i for i in range(search.model.n) if seconds_moving(search.motion, i) >= _LEAST_MOVING_S]
    seen = tuple(limits.of(ground, floors, able))
    findings = tuple(search.findings)
    return Diagnosis(verdict, reason, tuple(search.steps), findings, search.last, seen)


def _verdict(search: Search) -> tuple[Literal["effect", "clean", "unexplained", "refused"], str]:
    first, last = search.steps[0], search.steps[-1]
    preface = _disagreement(search.model, last.identification.inference)
    if search.findings:
        found = "; ".join(_sentence(f) for f in search.findings)
        return "effect", f"{preface}the model lacks {found}"
    refusal = _refusal(first)
    if refusal:
        return "refused", preface + refusal
    for i in range(search.model.n):
        rest = remainder(first, i)
        if rest:
            return "unexplained", f"{preface}joint {i + 1}: no effect of the library explains the residual: {rest}"
    text = ", ".join(f"{s.rms:.3g} {s.force_unit}" for s in last.joints)
    return "clean", f"{preface}the residual is noise ({text}): the recordings show no missing effect"


def _sentence(finding: Finding) -> str:
    i = finding.joint_index
    where = f" at joint {finding.term.joint}" if finding.term.joint is not None else ""
    before, after = finding.before.fitted.relative[i], finding.after.fitted.relative[i]
    text = f"{finding.term.effect}{where} (error {100 * before:.2f} % to {100 * after:.2f} %)"
    if finding.rivals:
        text += f", which these data cannot tell from {', '.join(map(str, finding.rivals))}"
    return text


def remainder(step: Step, joint: int) -> str | None:
    """What a joint's residual holds beyond noise, in words; None if it is noise."""
    s = step.joints[joint]
    # Errors of coarse encoder steps come back with the motion, too; they are in the instruments' noise.
    if s.floor.repeatable(s.rms) and s.rms > _ABOVE_NOISE * s.floor.spectrum:
        part = min(1.0, ((s.floor.repeating or 0.0) / s.rms) ** 2)
        return (
            f"{100 * part:.0f} % of its variance comes back with the motion, so physics is left: "
            "an effect that is not in the library, or one in another form"
        )
    if s.rms > _OUTSIDE * s.floor.spectrum:
        return (
            f"it is {s.rms / s.floor.spectrum:.1f} times the noise of the instruments and does not come back with the "
            "motion"
            + ("" if s.floor.repeating is not None else " as far as these data tell, which repeat none")
            + f"{_line(step, joint)}: a disturbance from outside, or noise that is not white"
        )
    return None


def seconds_moving(motion: Motion, joint: int) -> float:
    """For how long a joint (0-based) moves faster than its encoder's noise."""
    return float(motion.moving(joint).sum()) / motion.row_rate


def _line(step: Step, joint: int) -> str:
    """The strongest line in the residual's spectrum, if one stands out."""
    motion, residual = step.identification.motion, step.identification.fit.residual[joint]
    windowed = residual * np.hanning(len(residual))
    power = np.abs(np.fft.rfft(windowed)) ** 2
    frequency = np.fft.rfftfreq(len(residual), 1 / motion.row_rate)
    peak = int(np.argmax(power[3:])) + 3
    near = power[max(3, peak - 3) : peak + 4].sum()
    return (
        f"; {100 * near / power.sum():.0f} % of it is at {frequency[peak]:.2f} Hz" if near > 0.2 * power.sum() else ""
    )


def _refusal(step: Step) -> str | None:
    """Why the data cannot decide; None if they can."""
    motion, inference = step.identification.motion, step.identification.inference
    seconds = [seconds_moving(motion, i) for i in range(motion.n)]
    if max(seconds) < _LEAST_MOVING_S:
        return f"the joints move for {max(seconds):.1f} s only; record at least {_LEAST_MOVING_S:g} s of motion"
    tangled = [
        f"{term} {name}" for term, values in inference.values.items() for name, e in values.items() if e.with_others
    ]
    tangled += [
        lump.name for lump, e in zip(step.identification.model.lumps, inference.lumps, strict=True) if e.with_others
    ]
    if tangled:
        return f"the motion does not separate {', '.join(tangled)}; move over more speeds, accelerations and positions"
    return None


def _disagreement(model: Model, inference: Inference) -> str:
    """Inertial parameters of the file that the data contradict, as the beginning of a sentence."""
    wrong = []
    for lump, e in zip(model.lumps, inference.lumps, strict=True):
        if e.interval is None:
            continue
        outside = not e.interval[0] <= lump.value <= e.interval[1]
        if outside and abs(e.value - lump.value) > _DISAGREES * abs(lump.value):
            wrong.append(f"{lump.name} is {lump.value:.4g} {lump.unit} in the model file, {e.value:.4g} in the data")
    return f"check the model file first: {'; '.join(wrong)}; " if wrong else ""
