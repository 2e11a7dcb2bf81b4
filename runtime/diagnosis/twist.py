"""Elasticity and backlash as a link-side encoder shows them, also where the motor torque does not.

The twist equation (runtime/identification/twist.py) is a regression of its own, on rows of an angle: the gates that a
candidate must pass on the torque are asked on those rows, with the encoders' noise in the place of the torque's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.further_sensors import FailedGate
from runtime.diagnosis.gates import Evidence, Figures, Shown
from runtime.identification.estimate import Estimate
from runtime.identification.twist import TwistEquation, TwistFit, fit_twist
from runtime.model.loader import EffectInfo
from runtime.model.terms import Term
from runtime.regression.system import Block, Columns, LinearSystem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Witnessed:
    """A transmission that gives way as its encoders show it: what speaks for it, and its parameters."""

    evidence: Evidence
    values: Mapping[str, Estimate]

    @property
    def term(self) -> Term:
        return self.evidence.term


def witnessed(field: CandidateField) -> list[Witnessed]:
    """What link-side encoders show at joints whose transmission is rigid in the fitted model, one effect a joint."""
    found = []
    for joint in range(field.model.n):
        if any(field.model.library.effects[t.effect].gives_way and t.joint == joint + 1 for t in field.known()):
            continue
        fit = fit_twist(field.problem, field.fit, joint)
        passing = [w for w in _of_joint(field, fit) if w.evidence.passes] if fit else []
        # A gap is asked for beside a spring: where it is there, the spring alone is a special case.
        found += passing[-1:]
    return found


def _of_joint(field: CandidateField, fit: TwistFit) -> list[Witnessed]:
    """The spring, then the gap, as far as the twist equation tells them."""
    found = []
    for name, info in field.model.library.effects.items():
        if not info.gives_way or info.scope != "joint":
            continue
        values = _values(info, fit)
        if values is not None:
            equation = fit.equation.of_gap() if info.has_gap else fit.equation
            if (evidence := _weighed(field, fit.joint, name, equation=equation, values=values)) is not None:
                found.append((info.has_gap, Witnessed(evidence, values)))
    return [w for _, w in sorted(found, key=lambda item: item[0])]


def _values(info: EffectInfo, fit: TwistFit) -> dict[str, Estimate] | None:
    """Of the parameters that the twist tells; None where it does not tell the effect."""
    stiffness, gap = info.of_kind("stiffness"), info.of_kind("play")
    told = [(gap, fit.gap), (stiffness, fit.behind_gap)] if info.has_gap else [(stiffness, fit.stiffness)]
    found = {p.name: e for p, e in told if p is not None and e is not None}
    return found if len(found) == len(told) else None


def _weighed(
    field: CandidateField, joint: int, effect: str, equation: TwistEquation, values: Mapping[str, Estimate]
) -> Evidence | None:
    """The gates on the rows of a twist equation, whose cause is the candidate; None where its rows hold no more than
    the encoders' noise, so that nothing has a cause."""
    system = equation.unexplained.levelled()
    rows = replace(system.joints[0], piece=field.motion.row_piece(joint))
    square = system.solution.sse / rows.count
    if square <= 0:
        return None
    before = float(np.sqrt(square))
    system = system.over([replace(rows, weight=1 / before)])
    figures, residual = _figures(system, equation.block, before, _floor(field, joint))
    failed = list(figures.failed_gates(_floor(field, joint), at_edge=False))
    # A finite end of the interval that is not the effect's absence: a gap above 0, however stiff its flanks; a
    # spring's compliance above 0.
    info = field.model.library.effects[effect]
    size = info.of_kind("play") if info.has_gap else info.of_kind("stiffness")
    failed += [
        FailedGate("bound", f"its {name} may be none: 95 % in [{e.interval[0]:.3g}, {e.interval[1]:.3g}]")
        for name, e in values.items()
        if e.interval is not None
        and size is not None
        and name == size.name
        and not (e.interval[0] > 0 and np.isfinite(e.interval[1]))
    ]
    after = before * float(np.sqrt(max(figures.after.sse, 0.0) / rows.count))
    shape = {name: e.value for name, e in values.items()}
    return Evidence(
        Candidate(Term(effect, joint + 1), shape, 0, figures.before.sse - figures.after.sse, at_edge=False),
        0.0,
        figures.share,
        delta_bic=figures.delta_bic,
        likelihood_gain=figures.likelihood_gain,
        cv_gain=figures.cv_gain,
        failed=tuple(failed),
        parameters=figures.white_after.system.rank,
        residual=residual,
        twist=Shown(before, after, figures.eff, field.model.joints[joint].position_unit),
    )


def _figures(system: LinearSystem, block: Block, rms: float, floor: float) -> tuple[Figures, Array]:
    rows, after = system.joints[0], system.with_block(block).solution
    by = [rows.whitening(after.residual[0])]
    # Whitening leaves little but noise, of which the encoders' share is not known well enough to be taken off.
    own = replace(block, columns={0: Columns(block.columns[0].rows)})
    white = system.without_noise().whitened(by, after.residual)
    white_after = white.with_block(own.whitened(by)).solution
    figures = Figures(
        system.solution,
        after,
        white.solution,
        white_after=white_after,
        searched=0,
        among=1,
        unit=rms / float(np.sqrt(rows.count)),
        excess=max(1 - (floor / rms) ** 2, 0.0) if rms else 0.0,
        measured=system.solution.sse,
        count=rows.count,
    )
    return figures, white.joints[0].weight * white_after.residual[0]


def _floor(field: CandidateField, joint: int) -> float:
    """RMS of white noise of both encoders in the band, taken to be alike."""
    motion = field.motion
    return float(np.sqrt(2 * motion.band.position_density[joint] * motion.cutoff(joint)))
