"""What further sensors were worth in a diagnosis: what they rule out, alone or beside the torque, and what only they
show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import Sensor
from runtime.documents.diagnosis import SensorEntry
from runtime.documents.parts import EffectAt
from runtime.model.terms import Term
from runtime.motion.motion import Motion


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
