"""Scores of the diagnosis: what speaks for every finalist beside a model, the likeliest first, and how a search went.

python -m tests.judge.score drive run.csv --beside stribeck@1 --held-out other.csv --search
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from runtime.cli.inputs import TypedInputs
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import FALL, TORQUE
from runtime.diagnosis.search import compared
from runtime.diagnosis.stages import begin, complete
from runtime.diagnosis.steps import Step, Trail
from runtime.diagnosis.verdict import decide
from runtime.model.terms import Term
from runtime.simulation.simulate import parse_hidden
from runtime.wording import number, percent

HEAD = ("term", "gain", "dispersion", "score", "price", "floors", "closed gates")


def row(candidate: Candidate) -> tuple[str, ...]:
    e = candidate.evidence
    floors = next((r.value for r in candidate.results if r.gate is TORQUE), float("nan"))
    closed = ", ".join(f"{r.gate.name} {number(r.value, 3)}" for r in candidate.failed)
    figures = (f"{e.gain:.0f}", f"{e.dispersion:.1f}", f"{e.score:.1f}", f"{e.due:.1f}", number(floors, 3))
    return str(candidate.term), *figures, closed


def table(candidates: Iterable[Candidate]) -> str:
    rows = [HEAD, *(row(c) for c in sorted(candidates, key=lambda c: -c.evidence.gain))]
    widths = [max(len(cells[k]) for cells in rows) for k in range(len(HEAD))]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(cells, widths, strict=True)).rstrip() for cells in rows)


def beside(trail: Trail, terms: Iterable[Term]) -> Trail:
    for term in terms:
        base = trail.last.base
        found = base.search(term) if term in base.terms() else None
        if found is None:
            raise ValueError(f"--beside {term}: the model has it, or these recordings say nothing of it")
        found = base.refine(found)
        trail = trail.to(trail.with_candidates(trail.last, found).after(trail.last, found))
    return trail


def searched(trail: Trail) -> list[str]:
    """A whole search: what was refitted, added and dropped, with the errors, the final set and the verdict."""
    lines, known = list[str](), list[Step]()

    def show(step: Step) -> None:
        held = "" if step.held_out is None else f"; held out {', '.join(map(percent, step.held_out.relative))}"
        for new in (f for f in step.findings if f.term not in {k.term for k in known}):
            asked = [c for c in new.ranking.candidates if any(r.gate is FALL for r in c.results)]
            lines.extend([f"refitted:\n{table(asked)}", f"+ {'  '.join(row(new.candidate)).rstrip()}"])
        lines.extend(f"− {k.term}" for k in known if k.term not in {f.term for f in step.findings})
        lines.append(f"error {', '.join(map(percent, step.fitted.relative))}{held}")
        known[:] = step.findings

    show(trail.last)
    done = complete(trail, show)
    show(done.last)
    found = (f"{f.term} (or {', '.join(map(str, f.rivals))})" if f.rivals else str(f.term) for f in done.findings)
    lines.append(f"{done.work.refits} refits; found: {', '.join(found) or 'nothing'}")
    return [*lines, *(f"joint {v.joint + 1}: {v.verdict}, {v.why}" for v in decide(done).joints)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--held-out", type=Path, nargs="+", default=[])
    parser.add_argument("--beside", nargs="+", default=[], metavar="TERM", help="EFFECT@JOINT, added first")
    parser.add_argument("--search", action="store_true", help="follow the whole search")
    given = parser.parse_args()
    try:
        _, data, model = TypedInputs(given.model, given.recordings, given.held_out, allow_gaps=True).read()
        terms = [parse_hidden(text, model, "--beside").term for text in given.beside]
        fitted = len(given.recordings)
        trail = beside(begin(model, data[:fitted], data[fitted:]), terms)
    except (ValueError, OSError) as error:
        sys.exit(str(error))
    print("\n".join(searched(trail)) if given.search else table(compared(trail).ranking.candidates))


if __name__ == "__main__":
    main()
