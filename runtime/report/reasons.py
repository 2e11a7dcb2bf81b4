"""A fit and a diagnosis in sentences: why a fit may not be believed, what the gates say, what is left of a residual,
and why the verdict is what it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite

import numpy as np

from runtime.diagnosis import credibility, gates
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import GateResult
from runtime.diagnosis.settings import LEAST_MOVING_S
from runtime.diagnosis.steps import (
    Disturbance,
    Remainder,
    Step,
    after_effect,
    explained,
    lines_above,
    physics,
    remainder,
    seconds_moving,
)
from runtime.diagnosis.verdict import Diagnosis, JointVerdict
from runtime.fit_warnings import Suspicion, improper_inertia, warnings
from runtime.identification.compare import JointSeries
from runtime.identification.fit import Fit, places, quantile
from runtime.identification.identify import Unsound, unsound
from runtime.loop.improve import Improvement
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.motion.settings import RESOLVED
from runtime.report import mounting
from runtime.wording import (
    joints_said,
    number,
    numbered,
    per_turn,
    percent,
    quantity,
    sentence,
    times_floor,
    told_apart,
)

_MOVE_MORE = "move over more speeds, accelerations and positions"

_TIMES_SAID = 5
"""number of times; so many bursts are listed: a line on a page."""
_INSIDE_LIMITS = 0.05
"""part of the range; nearer to a limit of the file a stop is that limit, as well as soft stops and the zeros of
encoders are known."""
_MOST_IN_FILE = 2
"""number of parameters; so many that the file has a little wrong are listed: the table has them all."""


# a fit ---------------------------------------------------------------------------------------------------------------


def of_fit(found: credibility.JudgedFit) -> str:
    """Why a fit is refused; of a credible one its errors."""
    match found.why:
        case "wrong data":
            return _wrong_data(found.suspicions)
        case "contradiction":
            return _contradictory(found.recordings)
        case None:
            joints = (s for s in found.joints if len(s.t))
            errors = (f"{100 * s.relative:.3g} % of the torque at joint {s.joint}" for s in joints)
            return f"the fit misses {', '.join(errors)}"
        case why:
            return unreliable(why, found.fit, found.joints)


def unreliable(why: credibility.Unreliable | None, fit: Fit, joints: Sequence[JointSeries]) -> str:
    """Why a fit to data that do not look wrong may not be believed; empty for None."""
    match why:
        case None:
            return ""
        case "short motion":
            longest = max(credibility.moving_times(fit.motion))
            return f"the joints move for {longest:.1f} s only; record at least {LEAST_MOVING_S:g} s of motion"
        case "inseparable":
            names = ", ".join(credibility.inseparable(fit))
            return f"the motion does not separate {names}; {_MOVE_MORE}"
        case "worse than zero":
            at = " and ".join(f"joint {s.joint} {100 * s.relative:.3g} %" for s in joints if s.relative >= 1)
            return f"the fit is worse than no torque at all (it misses at {at} of it): the model or the data is wrong"
        case "improper inertia":
            return "; ".join(improper_inertia(fit))


def above_noise(joints: Sequence[JointSeries]) -> list[str]:
    """Joints whose error is far above the noise."""
    return [
        f"joint {s.joint}: the fit misses {100 * s.relative:.3g} % of the torque, {s.rms / s.floor.value:.2g} times "
        "its noise floor: what the model lacks is in its parameters, too; tendon diagnose looks for it"
        for s in joints
        if s.floor.value > 0 and credibility.far_above_noise(s) and not credibility.mostly_missed([s])
    ]


def warned(fit: Fit, joints: Sequence[JointSeries], wrong: Sequence[Suspicion]) -> list[str]:
    """All warnings about a fit, and the joints of whose torque more is missed than found; of wrong data only these."""
    missed = [
        f"joint {s.joint}: with all that was found, {100 * s.relative:.3g} % of its torque is missed, more than half, "
        f"{times_floor(s.rms, s.floor.value):.2g} times its noise floor: the model or the data is wrong there"
        for s in credibility.mostly_missed(joints)
    ]
    return [*warnings(fit, wrong), *([] if wrong else missed)]


def _wrong_data(found: Sequence[Suspicion]) -> str:
    return f"the data look wrong: {'; '.join(map(str, found))}"


def _contradictory(recordings: credibility.Tables) -> str:
    if recordings.inertial:
        apart, why = recordings.inertial, "another payload, another arm, or a base model that is wrong"
    else:
        apart, why = recordings.effects, "temperature, load or wear"
    values = "; ".join(map(_contradiction, apart))
    return f"the recordings contradict each other: {values}: {why}; diagnose them one by one"


def _contradiction(found: credibility.Contradiction) -> str:
    pairs = zip(found.estimates, found.recordings, strict=True)
    return f"{found.name} is {' and '.join(f'{quantity(e.value, found.unit, 3)} in {name}' for e, name in pairs)}"


def _unsound(found: Unsound) -> str:
    cure = "record faster motion, or with a finer encoder"
    match found.check:
        case "worse than none":
            worse = f"the fit is worse than no model (error {100 * found.value:.0f} %)"
            return f"{worse}: these recordings do not tell its parameters; {cure}"
        case "mostly noise":
            part = f"{100 * min(found.value, 1.0):.0f} % of the power of its torque"
            return f"{part} would be the encoder's noise, differentiated twice; {cure}"
        case "worse than plain":
            return (
                f"compensated for the encoder's noise, the fit leaves {found.value:.1f} times what plain least "
                f"squares leave of the torque: the noise is too much of what the model reads; {cure}"
            )


# the gates -----------------------------------------------------------------------------------------------------------


def closed_gates(candidate: Candidate, model: Model) -> list[str]:
    """A sentence for each gate that stays closed to a candidate."""
    return [_GATES[result.gate.name](result, candidate, model) for result in candidate.failed]


def _told(text: str, scale: float = 1.0) -> Callable[[GateResult, Candidate, Model], str]:
    """A sentence with a value and its limit, with as few digits as tell the two apart."""

    def said(result: GateResult, *_: object) -> str:
        value, limit = scale * result.value, scale * result.limit
        middle = 0.5 * (value + limit)
        return text.format(told_apart(value, middle), told_apart(limit, middle))

    return said


def _part(result: GateResult) -> str:
    text = f"{100 * result.value:.0f} ± {100 * result.spread:.0f} % of its torque"
    return text.replace("-", "−")


def _play(result: GateResult, candidate: Candidate, model: Model) -> str:
    unit = model.joints[(candidate.term.joint or 1) - 1].position_unit
    return f"the link-side encoder shows {result.value:.2g} {unit} {result.gate.name.split()[0]} play than it has"


def _resolution(result: GateResult, candidate: Candidate, model: Model) -> str:
    play = model.library.effects[candidate.term.effect].of_kind("play")
    unit = model.joints[(candidate.term.joint or 1) - 1].position_unit
    name = "play" if play is None else play.name
    return f"its {name} of {result.value:.2g} {unit} is no wider than the {result.limit:.2g} that its encoder resolves"


_GATES: Mapping[str, Callable[[GateResult, Candidate, Model], str]] = {
    gates.SCORE.name: _told("its score of {} does not reach the price of {}"),
    gates.TORQUE.name: _told("its own torque is {} of the noise floor, not more than {}"),
    gates.PART.name: _told("it is {} % of the joint's torque, not more than {} %", 100),
    gates.EDGE.name: lambda *_: "its shape lies at the edge of what was searched",
    gates.FALL.name: _told("with it and everything refitted, the error falls by {} %, not by {} %", 100),
    gates.ONCE.name: _told("it acts in {} of 40 stretches of time, not in more than {}: it may be anything"),
    gates.SIZE.name: lambda *_: "its refitted size lies at its bound, or in a sum with inertial parameters",
    gates.CONTACT.name: lambda *_: "it does not push back in both directions of motion",
    gates.TURN.name: lambda *_: "it does not repeat a whole number of times a turn, of the motor or of the joint",
    gates.REST.name: _told("a law over the same signals explains all but {} % of what both explain", 100),
    gates.HELD_OUT.name: _told(
        "recordings that were not fitted: it leaves {} % of their squared error, not less than {} %", 100
    ),
    gates.RESOLUTION.name: _resolution,
    gates.MODEL.name: lambda r, *_: f"the model as it is can produce all but {100 * r.value:.2g} % of its torque",
    gates.ENCODERS.name: lambda *_: "another reading of the encoders would give another torque",
    gates.LAG.name: lambda r, *_: f"the link-side encoder does not show it: the link lags by {_part(r)}",
    gates.RIGID.name: lambda r, *_: (
        f"the link-side encoder shows that the transmission gives way instead: the lag makes up {_part(r)}"
    ),
    gates.MORE_PLAY.name: _play,
    gates.LESS_PLAY.name: _play,
    gates.ON_LINK.name: lambda r, *_: (
        f"the torque sensor at the output does not feel it, as it would on the link: {_part(r)}"
    ),
    gates.ON_MOTOR.name: lambda r, *_: (
        f"the torque sensor at the output feels it, as it would not on the motor: {_part(r)}"
    ),
    gates.BOUND.name: lambda r, *_: f"it may be none: its 95 % interval begins at {r.value:.3g}",
    gates.BOTH_JOINTS.name: _told("its torque at one of its two joints gains {}, not {}"),
    gates.RECORDINGS.name: lambda *_: (
        "the recordings contradict each other, so that what is missing in which of them is not known"
    ),
}

WORDED = frozenset(_GATES)
"""Names of the gates that have a sentence."""


# what is left --------------------------------------------------------------------------------------------------------


def left_over(found: Remainder, effect: str | None = None) -> str:
    """What a residual holds beyond noise; effect: the name of what was added, where that was asked for."""
    if isinstance(found, Disturbance):
        return _disturbance(found)
    part = f"{100 * found.part:.0f} %"
    if found.follows is None:
        return (
            f"{part} of its variance comes back with the motion, so physics is left: "
            "an effect that is not in the library, or one in another form"
        )
    share = f"{part} of what is left comes back with the motion, most of it over {found.follows}"
    if found.own:
        return f"{share}: {effect} is the right effect in another form than the library's law"
    return f"{share}: something else is missing beside {effect}, or it has another form than the library's law"


def _disturbance(found: Disturbance) -> str:
    signs = []
    if found.line is not None:
        signs.append(f"{100 * found.line.share:.0f} % of it is at {found.line.frequency:.2f} Hz")
    if found.slow is not None:
        signs.append(f"it is {found.slow:.1f} times as dense at low frequencies as in the rest of the band")
    if found.bursts:
        times = ", ".join(f"{t:.0f}" for t in found.bursts[:_TIMES_SAID])
        signs.append(f"it comes in bursts, at {times} s")
    if found.repeats:
        what = "it does not come back with the motion: a disturbance from outside, or noise that is not white"
    else:
        what = "these data repeat no motion, which would tell physics from disturbances: record it twice"
    return f"{'; '.join(signs)}, and {what}"


# the verdict ---------------------------------------------------------------------------------------------------------


def reason(diagnosis: Diagnosis) -> str:
    """Why a diagnosis decided so: what is missing at which joints, what is said of the others, lines of the torque that
    lie above the band, and what the model file has a little wrong; of a search that was cut, a second sentence."""
    return _whole(diagnosis, _arm(diagnosis))


def of_improvement(improvement: Improvement) -> str:
    """What was added and what it left, then what is said of the other joints; else why what is left is called so."""
    left = improvement.left
    if improvement.verdict != "effect":
        return reason(left)
    joints = list(dict.fromkeys(f.joint_index for f in improvement.findings))
    others = [v for v in left.joints if v.joint not in joints and v.why not in ("standstill", "cut")]
    return _whole(left, "; ".join([*(_added(improvement, i) for i in joints), *_others(left, others, "")]))


def _added(improvement: Improvement, joint: int) -> str:
    """What was added at a joint (0-based), and how much it left of what."""
    here = [f for f in improvement.findings if f.joint_index == joint]
    first, last = improvement.steps[0], improvement.steps[-1]
    shown = all(f.candidate.twist for f in here)
    part, of = (here[-1].share(), "the twist") if shown else (explained(first, last, joint), "what was missing")
    names = " and ".join(
        " or ".join(dict.fromkeys((f.term.effect + _order(f.term, last), *(t.effect for t in f.rivals)))) for f in here
    )
    series, verdict = last.joints[joint], improvement.left.joints[joint].verdict
    times = number(times_floor(series.rms, series.floor.value), 2)
    found = after_effect(last, joint, last.fit.model.library.effects[here[-1].term.effect])
    what = "noise" if verdict == "clean" else _coloured(found or remainder(last, joint))
    return (
        f"{names} explain{'s' if len(here) == 1 else ''} {percent(part, 0)} of {of} at joint {_called(joint, last)}; "
        f"{percent(series.relative, 1)} of its torque is left, {times} × the floor: {what}"
    )


def _coloured(found: Remainder | None) -> str:
    """In a word what is left of a joint that is more than noise, or not known to be noise."""
    if isinstance(found, Disturbance):
        return "coloured, does not come back with the motion" if found.repeats else "coloured"
    if found is None:
        return "as even as noise"
    return f"coloured, follows {found.follows}" if found.follows else "coloured, comes back with the motion"


def _whole(diagnosis: Diagnosis, said: str) -> str:
    """A reason with what the model file has wrong, lines above the band, and where the search was cut."""
    why, last, compared = diagnosis.decisive.why, diagnosis.searched.last, diagnosis.recordings
    believed = why not in ("wrong data", "unsound fit")
    apart = f"{_contradictory(compared)}; " if compared.contradictory and why != "contradiction" else ""
    before = f"{apart}{_first_in_file(last) if believed else ''}"
    said = f"{before}{said}{_above_band(last)}{_also_in_file(last) if believed else ''}"
    return f"{said}. {sentence(_cut(diagnosis))}" if diagnosis.search.ended != "complete" else said


def _arm(diagnosis: Diagnosis) -> str:
    """What decides for the arm, then what is said of the other joints that move."""
    first, last = diagnosis.decisive, diagnosis.last
    others = [v for v in diagnosis.joints if v.why not in (first.why, "standstill", "cut")]
    match first.why:
        case "wrong data" | "contradiction":
            return of_joint(diagnosis, first)
        case "found":
            said = f"the model lacks {'; '.join(_sentence(f, last) for f in diagnosis.findings)}"
        case "noise":
            noise = ", ".join(_noise(last.joints[v.joint]) for v in diagnosis.joints if v.why == "noise")
            said = f"the residual is noise ({noise}): the recordings show no missing effect"
        case "cut":
            said = "what is missing is not known"
        case _:
            others = [v for v in diagnosis.joints if v is not first and v.why not in ("standstill", "cut")]
            said = of_joint(diagnosis, first)
            whole = first.why == "excitation" and not credibility.tangled(diagnosis.found.first.fit, first.joint)
            if not whole:
                said = f"joint {_called(first.joint, last)}: {said}"
    return "; ".join([said, *_others(diagnosis, others, of_joint(diagnosis, first))])


def _others(diagnosis: Diagnosis, joints: Sequence[JointVerdict], known: str) -> list[str]:
    """The verdicts of some joints: of those that are unexplained what is left, of those refused why, if that is not
    known."""
    groups: dict[tuple[str, str], list[int]] = {}
    for v in joints:
        why = of_joint(diagnosis, v) if v.verdict == "refused" else ""
        if v.verdict != "refused" or why != known:
            groups.setdefault((v.verdict, why), []).append(v.joint)
    said = []
    for (verdict, why), numbers in groups.items():
        text = f"{joints_said([i + 1 for i in numbers])} {verdict}"
        if verdict == "unexplained":
            text += f", which miss{'es' if len(numbers) == 1 else ''} {_missed(diagnosis, numbers)} of the torque"
        said.append(f"{text}: {why}" if why else text)
    return said


def _missed(diagnosis: Diagnosis, joints: Sequence[int]) -> str:
    return ", ".join(percent(diagnosis.last.joints[i].relative, 1) for i in joints)


def _cut(diagnosis: Diagnosis) -> str:
    """Where a search was cut, and what follows from it."""
    search = diagnosis.search
    by = f"its time limit after {search.refits} of" if search.ended == "time" else "its budget of"
    refits = "refit" if search.budget == 1 else "refits"
    larger = "--time-limit" if search.ended == "time" else "--budget"
    return (
        f"the search was cut by {by} {search.budget} {refits}: nothing is said of joints without a finding; "
        f"a larger {larger} goes on"
    )


def untried(diagnosis: Diagnosis) -> list[str]:
    """What was left out for want of time."""
    every = len(diagnosis.seen) + diagnosis.unseen
    left_out = f"of {every} detection limits {diagnosis.unseen} were left out for want of time"
    return [left_out] if diagnosis.unseen else []


def of_joint(diagnosis: Diagnosis, said: JointVerdict) -> str:
    """Why this is said of a joint."""
    i, first, last = said.joint, diagnosis.found.first, diagnosis.last
    here = last.joints[i]
    match said.why:
        case "wrong data":
            return _wrong_data(diagnosis.searched.suspicions)
        case "contradiction":
            return _contradictory(diagnosis.recordings)
        case "cut":
            return _cut(diagnosis)
        case "standstill":
            return f"it moves for {seconds_moving(first.fit.motion, i):.1f} s only; {LEAST_MOVING_S:g} s are needed"
        case "unsound fit":
            return _unsound(unsound(diagnosis.searched.last.fit)[i])
        case "excitation":
            return _excitation(first.fit, i)
        case "comes nearest":
            return _comes_nearest(diagnosis, said)
        case "found":
            return f"the model lacks {'; '.join(_sentence(f, last) for f in said.named)}"
        case "nothing explains":
            found = remainder(last, i)
            rest = "" if found is None else left_over(found)
            return f"no effect of the library explains the residual: {rest}{_undecided(said, diagnosis.model)}"
        case "not borne out":
            assert said.undecided is not None
            return (
                f"{said.undecided.term} passes every gate beside the fitted model, but not once all is refitted: "
                f"{'; '.join(closed_gates(said.undecided, diagnosis.model))}; record longer, or with more speeds"
            )
        case "above the floor":
            known = here.floor.source == "repeats"
            cure = (
                "record it with a finer encoder, or longer" if known else "repeat the motion, and it says what this is"
            )
            return f"what is left is as even as noise, but {_above(here)}: {cure}"
        case "held out":
            return f"what is left of the fitted recordings is noise; of those held out {_above(diagnosis.elsewhere[i])}"
        case "blind":
            half = quantity(here.rms / here.relative / 2, here.force_unit, 2)
            return f"an effect of half its torque, {half}, could be there unseen; record more speeds and positions"
        case "noise":
            return f"the residual is noise ({_noise(here)})"


def _noise(series: JointSeries) -> str:
    rms = f"{series.rms:.3g} {series.force_unit}"
    return rms if series.resolved else f"{rms}, less than the {percent(RESOLVED, 1)} of the torque that could be named"


def _above(series: JointSeries) -> str:
    rms = quantity(series.rms, series.force_unit, 3)
    return f"{rms} are left, {times_floor(series.rms, series.floor.value):.2g} times the noise floor"


def _excitation(fit: Fit, joint: int) -> str:
    """Why the motion of a joint (0-based) does not determine its parameters."""
    names = credibility.tangled(fit, joint)
    if names:
        return f"the motion does not separate {', '.join(names)}; {_MOVE_MORE}"
    return unreliable(credibility.poor_excitation(fit), fit, ())


def _comes_nearest(diagnosis: Diagnosis, said: JointVerdict) -> str:
    searched, near = diagnosis.searched, ", ".join(str(f.term) for f in said.withdrawn)
    share = 100 * explained(searched.first, searched.last, said.joint)
    rest = physics(searched.last, said.joint)
    left = "as much as half of that is left, and is no noise" if rest is None else left_over(rest)
    return f"{near} comes nearest, but explains only {share:.0f} % of what is above the noise: {left}"


def _undecided(said: JointVerdict, model: Model) -> str:
    """What a second recording would decide, as the end of a sentence."""
    near = said.undecided
    if near is None:
        return ""
    closed = "; ".join(closed_gates(near, model))
    return f"; {near.term} is not named: {closed}; record the motion again and give that as --held-out"


def _sentence(finding: Step, last: Step) -> str:
    i, shown = finding.joint_index, finding.candidate.twist
    before, after = finding.previous.fitted.relative[i], finding.fitted.relative[i]
    joint = finding.term.joint
    where = "" if joint is None else f" at joint {_called(joint - 1, last)}"
    text = f"{finding.term.effect}{where}{_order(finding.term, last)} "
    if shown is None:
        text += f"(error {100 * before:.2f} % to {100 * after:.2f} %)"
    else:
        text += f"(twist unexplained by the skew of the encoders {shown.before:.2g} to {shown.after:.2g} {shown.unit})"
    if says := of_gravity(finding, last) or _of_stop(finding, last):
        text += f", {says}"
    if finding.rivals:
        text += f", which these data cannot tell from {', '.join(map(str, finding.rivals))}"
    return text


def of_gravity(finding: Step, last: Step) -> str:
    """How the base is mounted, of a finding that adds gravity to the model file's; empty for others."""
    model, values = last.fit.model, last.fit.inference.values.get(finding.term, {})
    info = model.library.effects[finding.term.effect]
    added = {p.abroad[-1]: values[p.name].value for p in info.parameters if p.abroad.startswith("gravity")}
    if not added or not all(map(isfinite, added.values())):
        return ""
    axes, spread = "xyz" if model.spatial else "xy", None
    if info.sized and finding.term in last.fit.problem.layout.slices:
        sure = last.fit.uncertainty
        covariance = sure.covariance[np.ix_(*[places(last.fit, finding.term, sure.names)] * 2)]
        if np.isfinite(covariance).all():
            value, vector = np.linalg.eigh(covariance)
            spread = quantile(sure.degrees) * (vector * np.sqrt(np.maximum(value, 0.0))).T
    return mounting.said(model.gravity[: len(axes)], [added.get(axis, 0.0) for axis in axes], spread)


def _of_stop(finding: Step, last: Step) -> str:
    """Of a law that sets in near an end of a joint's range, where that lies inside the range which the model file
    states; empty for others."""
    model, joint = last.fit.model, finding.joint_index
    info = model.library.effects[finding.term.effect]
    limits = model.joints[joint].position_limits
    if info.of_kind("side") is None or limits is None:
        return ""
    place = next(p for p in info.shape if p.grid is not None and p.grid.of == "end")
    at, unit, (low, high) = last.shapes[finding.term][place.name], model.joints[joint].position_unit, limits
    if min(at - low, high - at) < _INSIDE_LIMITS * (high - low):
        return ""
    return (
        f"at {quantity(at, unit, 3)}, inside the limits of the file, {low:.3g} to {quantity(high, unit, 3)}: "
        "look what is in its way there, and whether the limits and the zero of the position are right"
    )


def _called(joint: int, step: Step) -> str:
    """A joint (0-based) by its number and the model file's name."""
    return numbered(joint + 1, step.joints[joint].name)


def _order(term: Term, last: Step) -> str:
    """Of a line over the motor's angle, how often it repeats."""
    model = last.fit.model
    line = model.library.effects[term.effect].line
    if line is None or term.joint is None:
        return ""
    return f" at {per_turn(last.shapes[term][line.name], model.joints[term.joint - 1].gear_ratio)}"


def _first_in_file(last: Step) -> str:
    gross = [_in_file_and_data(w) for w in credibility.wrong_in_file(last.fit) if w.gross]
    return f"check the model file first: {'; '.join(gross)}; " if gross else ""


def _also_in_file(last: Step) -> str:
    wrong = [_in_file_and_data(w) for w in credibility.wrong_in_file(last.fit) if not w.gross]
    more = f", and {len(wrong) - _MOST_IN_FILE} more" if len(wrong) > _MOST_IN_FILE else ""
    return f"; the model file is a little off, too: {', '.join(wrong[:_MOST_IN_FILE])}{more}" if wrong else ""


def _in_file_and_data(wrong: credibility.WrongInFile) -> str:
    unit = wrong.lump.unit
    return f"{wrong.lump.name} is {wrong.stated:.4g} {unit} in the model file, {wrong.estimate.value:.4g} in the data"


def _above_band(step: Step) -> str:
    """That lines of the torque over the motor's angle lie above the band, as the end of a sentence."""
    model, band = step.fit.model, step.fit.motion.band
    found = [
        f"; joint {line.joint + 1}: a line at {per_turn(line.order, model.joints[line.joint].gear_ratio)} lies above "
        f"its band, which ends at {band.cutoffs[line.joint]:g} Hz, at {line.frequency:.3g} Hz"
        for line in lines_above(step)
    ]
    return "".join(found)
