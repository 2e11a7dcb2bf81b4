"""Which laws of a drive the columns of a recording allow, and what the model file must then say."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import combinations

from runtime.documents.recordings import DriveLawEntry
from runtime.recordings.columns import laws_of
from symbolic.model_file.drive_laws import DriveLaw

RECORDED = "torque"
"""Where the torque itself is recorded, no law is needed."""


def allowed(signals: Mapping[str, str] | Collection[str], joints: int) -> list[DriveLawEntry]:
    """Laws by joint, a recorded torque first. signals: those that are read."""
    found = []
    for joint in range(1, joints + 1):
        if (torque := f"tau{joint}") in signals:
            found.append(DriveLawEntry(joint=joint, law=RECORDED, columns=[torque], needs=[]))
        for law in laws_of(signals, joint):
            needs = [[*keys, *law.missing] for keys in _scaling(law.law)]
            found.append(DriveLawEntry(joint=joint, law=law.law.name, columns=list(law.columns), needs=needs))
    return found


def _scaling(law: DriveLaw) -> list[tuple[str, ...]]:
    """The smallest sets of gains with which a law's command has a known scale."""
    found: list[tuple[str, ...]] = []
    keys = [gain.key for gain in law.gains]
    for count in range(1, len(keys) + 1):
        for chosen in combinations(keys, count):
            known = law.terms[0].coefficient(dict.fromkeys(chosen, 1.0)) is not None
            if known and not any(set(smaller) < set(chosen) for smaller in found):
                found.append(chosen)
    return found
