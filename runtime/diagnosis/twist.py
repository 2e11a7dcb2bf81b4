"""Elasticity and backlash as a link-side encoder shows them, also where the motor torque does not.

The twist equation (runtime/identification/twist.py) is a regression of its own, on rows of an angle: the gates that a
candidate must pass on the torque are asked on those rows, with the encoders' noise in the place of the torque's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from runtime.diagnosis.candidates import Candidate, FittedBase, TwistResidual
from runtime.diagnosis.gates import BOUND, GateResult
from runtime.diagnosis.ranking import Solutions, results
from runtime.diagnosis.score import price
from runtime.identification.estimate import Estimate
from runtime.identification.twist import TwistEquation, TwistFit, fit_twist
from runtime.model.loader import EffectInfo
from runtime.model.terms import Term
from runtime.regression.rows import Block, Columns
from runtime.regression.system import LinearSystem


@dataclass(frozen=True)
class Witnessed:
    """A transmission that gives way as its encoders show it: what speaks for it, and its parameters."""

    candidate: Candidate
    values: Mapping[str, Estimate]

    @property
    def term(self) -> Term:
        return self.candidate.term


def witnessed(base: FittedBase) -> list[Witnessed]:
    """What link-side encoders show at joints whose transmission is rigid in the fitted model, one effect a joint."""
    found = []
    for joint in range(base.model.n):
        if any(base.model.library.effects[t.effect].gives_way and t.joint == joint + 1 for t in base.known()):
            continue
        fit = fit_twist(base.fit, joint)
        passing = [w for w in _of_joint(base, fit) if w.candidate.passes] if fit else []
        # A gap is asked for beside a spring: where it is there, the spring alone is a special case.
        found += passing[-1:]
    return found


def _of_joint(base: FittedBase, fit: TwistFit) -> list[Witnessed]:
    """The spring, then the gap, as far as the twist equation tells them."""
    found = []
    for name, info in base.model.library.effects.items():
        if not info.gives_way or info.scope != "joint":
            continue
        values = _values(info, fit)
        if values is not None:
            equation = fit.equation.of_gap() if info.has_gap else fit.equation
            if (candidate := _weighed(base, fit.joint, name, equation=equation, values=values)) is not None:
                found.append((info.has_gap, Witnessed(candidate, values)))
    return [w for _, w in sorted(found, key=lambda item: item[0])]


def _values(info: EffectInfo, fit: TwistFit) -> dict[str, Estimate] | None:
    """Of the parameters that the twist tells; None where it does not tell the effect."""
    stiffness, gap = info.of_kind("stiffness"), info.of_kind("play")
    told = [(gap, fit.gap), (stiffness, fit.behind_gap)] if info.has_gap else [(stiffness, fit.stiffness)]
    found = {p.name: e for p, e in told if p is not None and e is not None}
    return found if len(found) == len(told) else None


def _weighed(
    base: FittedBase, joint: int, effect: str, equation: TwistEquation, values: Mapping[str, Estimate]
) -> Candidate | None:
    """The gates on the rows of a twist equation, whose cause is the candidate; None where its rows hold no more than
    the encoders' noise, so that nothing has a cause."""
    system = equation.unexplained.levelled()
    rows = replace(system.joints[0], piece=base.motion.row_piece(joint))
    square = system.solution.sse / rows.count
    if square <= 0:
        return None
    before = float(np.sqrt(square))
    system = system.over([replace(rows, weight=1 / before)])
    found = _solutions(system, equation.block, before)
    evidence = found.evidence(price(base.model.n, len(values), rows.independent))
    told = [*results(evidence, found.eff, _floor(base, joint), np.inf)]
    after = before * float(np.sqrt(max(found.after.sse, 0.0) / rows.count))
    return Candidate(
        Term(effect, joint + 1),
        {name: e.value for name, e in values.items()},
        searched=0,
        fall=found.before.sse - found.after.sse,
        edge=np.inf,
        twist=TwistResidual(before, after, found.eff, base.model.joints[joint].position_unit),
        evidence=evidence,
        results=(*told, *_bounds(base.model.library.effects[effect], values)),
    )


def _bounds(info: EffectInfo, values: Mapping[str, Estimate]) -> list[GateResult]:
    """Whether the interval of what sizes an effect has a finite end that is not its absence: a gap above 0, however
    stiff its flanks; a spring's compliance above 0."""
    size = info.of_kind("play") if info.has_gap else info.of_kind("stiffness")
    e = None if size is None else values.get(size.name)
    if e is None or e.interval is None:
        return []
    return [BOUND.asked(e.interval[0] if np.isfinite(e.interval[1]) else 0.0)]


def _solutions(system: LinearSystem, block: Block, rms: float) -> Solutions:
    rows, after = system.joints[0], system.with_block(block).solution
    by = [rows.whitening(after.residual[0])]
    # Whitening leaves little but noise, of which the encoders' share is not known well enough to be taken off.
    own = replace(block, columns={0: Columns(block.columns[0].rows)})
    white = system.without_noise().whitened(by, after.residual)
    white_after = white.with_block(own.whitened(by)).solution
    return Solutions(system.solution, after, white.solution, white_after, rms / float(np.sqrt(rows.count)))


def _floor(base: FittedBase, joint: int) -> float:
    motion = base.motion
    return float(np.sqrt(2 * motion.band.position_density[joint] * motion.cutoff(joint)))
