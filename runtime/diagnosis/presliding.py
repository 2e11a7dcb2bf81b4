"""Dry friction's presliding under another name.

After a reversal dry friction grows over a displacement and not at once. A law of the position that holds the same loop
takes that friction over, and what tells it from bristles of the friction is its form alone: that of springs and sliders
side by side is a law of dry friction, too (Al-Bender, Lampaert & Swevers 2005, The generalized Maxwell-slip model, IEEE
Trans. Automatic Control 50(11)).
"""

from __future__ import annotations

import numpy as np

from runtime.diagnosis.settings import TAKEN_OVER
from runtime.diagnosis.steps import Finding, Step
from runtime.identification.regressors import Regressors
from runtime.model.loader import Model
from runtime.model.terms import Term


def bristles(finding: Finding) -> tuple[Term, ...]:
    """What passes every gate as well and carries the joint's dry friction, where a finding took most of that over."""
    model = finding.before.identification.model
    others = [e.term for e in finding.verdict.ranked if e.passes and e.term.joint == finding.term.joint]
    carrying = tuple(t for t in others if t != finding.term and _levels(model, t))
    info = model.library.effects[finding.term.effect]
    # A loop needs a memory; a transmission's is no friction.
    if not carrying or _levels(model, finding.term) or not info.states or info.gives_way:
        return ()
    taken = all(_level(finding.after, t) < (1 - TAKEN_OVER) * _level(finding.before, t) for t in carrying)
    return carrying if taken else ()


def _levels(model: Model, term: Term) -> list[str]:
    """Signals of a joint's dry friction that a term reads."""
    read = model.library.effects[term.effect].signals
    return [name for name in read if model.library.signal[name].needs == "friction"]


def _level(step: Step, term: Term) -> float:
    """Mean magnitude of the joint's dry friction that a term reads, as a step has it."""
    found = step.identification
    joint = (term.joint or 1) - 1
    signals = Regressors(found.model, found.motion, found.fit.prediction).signals(joint)
    names = _levels(found.model, term)
    return float(np.mean([np.mean(np.abs(s.at(name, joint))) for s in signals for name in names]))
