"""Which signals that were not recorded would keep a finding apart from its rivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from runtime.documents.diagnosis import MissingSignal
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
