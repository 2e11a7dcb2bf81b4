"""Rivals of a finding followed to their ends, and the best of the sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from runtime.diagnosis.acceptance import clearly_better, is_accepted, ruled_out, whitened_bic
from runtime.diagnosis.settings import MOST_FINDINGS
from runtime.diagnosis.steps import Step, Trail, remainder
from runtime.model.terms import Term


def is_open(trail: Trail) -> bool:
    """Whether more may be sought; several of one effect at a joint count once."""
    named = {(f.term.effect, f.term.joint) for f in trail.findings}
    return not trail.suspicions and len(named) < MOST_FINDINGS


def branches(trail: Trail) -> tuple[int, list[Trail]]:
    """The number of the first finding that has rivals, and trails that have one of these in its place; none where
    nothing comes after it, or is left at its joint, that would separate them.

    A rival takes something else along (a spring in gravity's place bends the load that friction reads), so that the
    sets as wholes are apart where the first effects are not.
    """
    findings = trail.findings
    number = next((k for k, f in enumerate(findings) if f.rivals), None)
    if number is None:
        return 0, []
    later = len(findings) > number + 1
    if not later and remainder(trail.last, findings[number].joint_index) is None:
        return number, []
    made = [_instead(trail, number, term) for term in findings[number].rivals[:3]]  # time
    return number, [branch for branch in made if branch is not None]


def _instead(trail: Trail, number: int, term: Term) -> Trail | None:
    """A trail that differs from this one from a finding on: it has one of its rivals in its place; None where
    that rival was not weighed, or refitted is not accepted."""
    finding = trail.findings[number]
    candidate = finding.ranking.of(term)
    if candidate is None:
        return None
    before = finding.previous
    branch = replace(trail, last=before, taken_back=frozenset())
    after = branch.with_candidates(before, candidate)
    if not is_accepted(before, after, term):
        return None
    rivals = tuple(t for t in (finding.term, *finding.rivals) if t != term)
    return branch.to(after.after(before, candidate, finding.ranking, rivals))


def best_branch(trails: Sequence[Trail], number: int) -> Trail:
    """The trail whose whole set explains most, the first unless another is clearly better; its rivals at that finding
    are the terms of those that are not clearly worse."""
    ends = [t.last for t in trails]
    scores = whitened_bic(ends[0].base.system, ends)
    best = 0
    for k in range(1, len(trails)):
        if clearly_better(ends[k], ends[best], scores[k], scores[best]):
            best = k
    chosen = trails[best]
    if len(chosen.findings) <= number:
        return chosen
    worse = [clearly_better(ends[best], end, scores[best], score) for end, score in zip(ends, scores, strict=True)]
    heads = [t.findings[number].term if len(t.findings) > number else None for t in trails]
    finding = chosen.findings[number]
    lost = {head for head, gone in zip(heads, worse, strict=True) if gone and head is not None}
    refuted_ones = {head for head in lost if ruled_out(head, ends[best], finding.joint_index)}
    rivals = tuple(t for t in finding.rivals if t not in refuted_ones and t != finding.term)
    return with_rivals(chosen, {finding: rivals})


def with_rivals(trail: Trail, rivals: dict[Step, tuple[Term, ...]]) -> Trail:
    """The trail with other rivals at some of its findings, of which none is refuted."""
    last = trail.first
    for finding in trail.findings:
        last = replace(finding, before=last)
        if finding in rivals:
            last = replace(last, rivals=rivals[finding], refuted=())
    return trail.to(last)
