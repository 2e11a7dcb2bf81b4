"""What further sensors were worth in a diagnosis, and which signals would keep a finding apart from its rivals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import Sensor
from runtime.diagnosis.steps import Step
from runtime.diagnosis.verdict import Diagnosis
from runtime.documents.diagnosis import MissingSignal, SensorEntry
from runtime.documents.parts import EffectAt
from runtime.model.loader import Model
from runtime.model.terms import Term, joints_of, sensors
from runtime.motion.motion import Motion
from runtime.recordings.columns import IN_PLANE, IN_SPACE

MEANINGS = {
    "link": "an encoder on the link side",
    "output": "a torque sensor at the joint's output",
    "temperature": "the joint's temperature",
    "force": "the force on the end-effector",
}


@dataclass(frozen=True)
class SensorWorth:
    """Of the sensors of one kind.

    columns   of the recordings
    decided   effects that pass every gate but what this sensor says of them
    against   other effects that it speaks against
    shown     effects that it shows and the motor torque does not
    """

    columns: tuple[str, ...]
    decided: tuple[Term, ...]
    against: tuple[Term, ...]
    shown: tuple[Term, ...]

    def __str__(self) -> str:
        said = [
            (self.shown, "shows what the torque does not"),
            (self.decided, "alone rules out"),
            (self.against, "speaks against" if not self.decided else "speaks with the torque against"),
        ]
        parts = [f"{what} {', '.join(map(str, terms))}" for terms, what in said if terms]
        found = "; ".join(parts) or "changed nothing: without it the same would have been found"
        return f"{' and '.join(self.columns)}: {found}"

    def document(self) -> SensorEntry:
        decided, against, shown = (
            [EffectAt(effect=t.effect, joint=t.joint) for t in terms]
            for terms in (self.decided, self.against, self.shown)
        )
        return SensorEntry(columns=list(self.columns), decided=decided, against=against, shown=shown, said=str(self))


def of(motion: Motion, weighed: Iterable[Candidate], named: Sequence[Candidate]) -> tuple[SensorWorth, ...]:
    """Of every kind of further sensor that all recordings have, what it was worth.

    weighed   all candidates of a diagnosis     named   those of its findings
    """
    names = {c.term for c in named}
    found, everything = [], [c for c in weighed if c.term not in names]
    kinds: tuple[tuple[str, str, Sensor], ...] = (
        ("twist", "q{}_link", "link encoder"),
        ("tau_link", "tau{}_link", "output sensor"),
    )
    for recorded, column, sensor in kinds:
        joints = [i for i in range(motion.n) if motion.has(recorded, i)]
        if not joints:
            continue
        said = {c.term: [r.gate.sensor == sensor for r in c.failed] for c in everything}
        decided = tuple(term for term, by in said.items() if by and all(by))
        against = tuple(term for term, by in said.items() if any(by) and not all(by))
        shown = tuple(c.term for c in named if c.twist is not None) if recorded == "twist" else ()
        columns = tuple(column.format(i + 1) for i in joints)
        found.append(SensorWorth(columns, decided, against, shown))
    return tuple(found)


def worth(diagnosis: Diagnosis) -> tuple[SensorWorth, ...]:
    """Of every kind of further sensor that all recordings have, what it was worth to a diagnosis."""
    rankings = [*(f.ranking for f in diagnosis.findings), diagnosis.ranking]
    weighed = [c for ranking in rankings for c in ranking.candidates]
    motion = diagnosis.found.first.fit.motion
    return of(motion, weighed, [f.candidate for f in diagnosis.findings])


@dataclass(frozen=True)
class Missing:
    """Columns of a recording that are not there, what they are, and the rivals from which they would tell a finding."""

    columns: tuple[str, ...]
    meaning: str
    rivals: tuple[Term, ...]

    def sentence(self) -> str:
        """For people, without a full stop."""
        return f"{' and '.join(self.columns)} ({self.meaning}) would tell it from {', '.join(map(str, self.rivals))}"


def missing(model: Model, motion: Motion, term: Term, rivals: Sequence[Term]) -> tuple[Missing, ...]:
    """The signals that are not measured and that would say which of a finding and its rivals it is."""
    found: dict[tuple[str, tuple[str, ...]], list[Term]] = {}
    for rival in rivals:
        for kind, columns in _telling(model, motion, term, rival):
            found.setdefault((kind, columns), []).append(rival)
    return tuple(Missing(columns, MEANINGS[kind], tuple(terms)) for (kind, columns), terms in found.items())


def entries(found: Sequence[Missing]) -> list[MissingSignal]:
    """As `missing_signals` of a finding, an entry a column."""
    return [
        MissingSignal(signal=column, rivals=list(dict.fromkeys(t.effect for t in m.rivals)))
        for m in found
        for column in m.columns
    ]


def _telling(model: Model, motion: Motion, one: Term, other: Term) -> list[tuple[str, tuple[str, ...]]]:
    """Kinds and columns of unmeasured signals in which two terms differ."""
    shown = {t: sensors(model.library, t.effect) for t in (one, other)}
    sides = {model.library.effects[t.effect].side for t in (one, other)}
    found: list[tuple[str, tuple[str, ...]]] = []
    for here, there in ((one, other), (other, one)):
        joint, own, rest = joints_of(model, here)[0], shown[here], shown[there]
        # A gap and a spring give way differently, too: the encoder shows the play.
        if "link" in own and not motion.has("twist", joint):
            found.append(("link", (f"q{joint + 1}_link",)))
        if "temperature" in own - rest and not all(bool(p.measured[joint]) for p in motion.pieces):
            found.append(("temperature", (f"temperature{joint + 1}",)))
        if "force" in own - rest and any(p.sensors.force is None for p in motion.pieces):
            found.append(("force", tuple(IN_SPACE if model.spatial else IN_PLANE)))
    joint = (one.joint or other.joint or 1) - 1
    if None not in sides and len(sides) > 1 and not motion.has("tau_link", joint):
        found.append(("output", (f"tau{joint + 1}_link",)))
    return list(dict.fromkeys(found))


def absent(diagnosis: Diagnosis, finding: Step) -> tuple[Missing, ...]:
    """The signals that are not in the recordings and would tell a finding from its rivals."""
    motion = diagnosis.found.first.fit.motion
    return missing(diagnosis.model, motion, finding.term, finding.rivals)
