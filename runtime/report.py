"""The report: one HTML page that holds a comparison, a diagnosis or the whole loop, and needs nothing beside it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from runtime import files
from runtime import report_figures as figures
from runtime import report_parameters as parameters
from runtime.compare import Comparison, as_written, structure_shares
from runtime.diagnose import Diagnosis, Errors, Finding, Step, finding_json
from runtime.improve import Improvement
from runtime.judge import Evidence
from runtime.terms import Term
from runtime.wording import at, number, percent, quantity, sentence, whole

Result = Comparison | Diagnosis | Improvement
Row = dict[str, Any]

NAME = "report.html"


def write_report(directory: Path, result: Result) -> Path:
    """Write `report.html` into a directory, which is made if it is not there. Raises OSError."""
    page = render(result)
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / NAME
    files.replace(path, page.encode("utf-8"))
    return path


def render(result: Result) -> str:
    """The page; the same bytes for the same result."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(_holes(_Story(result)))


@dataclass(frozen=True)
class _Story:
    """What the three kinds of results have in common: steps of a model, each fitted."""

    result: Result

    @cached_property
    def document(self) -> dict[str, Any]:
        return self.result.to_json()

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        if not isinstance(self.result, Comparison):
            return self.result.steps
        joints = self.result.joints
        errors = Errors(tuple(j.rms for j in joints), tuple(j.relative for j in joints))
        return (Step(None, self.result.identification, joints, errors, None),)

    @property
    def diagnosis(self) -> Diagnosis | None:
        """What was found in the model as given."""
        if isinstance(self.result, Improvement):
            return self.result.found
        return self.result if isinstance(self.result, Diagnosis) else None

    @property
    def left(self) -> Diagnosis | None:
        """What is said of the model at the end."""
        return self.result.left if isinstance(self.result, Improvement) else self.diagnosis

    @property
    def findings(self) -> tuple[Finding, ...]:
        return self.diagnosis.findings if self.diagnosis else ()

    @property
    def model_file(self) -> str:
        """Where the model is, as far as the result knows: its name."""
        return f"{self.steps[0].identification.model.name}.toml"

    def findings_at(self, joint: int) -> list[Finding]:
        """Findings that act on the torque of a joint (0-based), those of the whole arm among them."""
        return [f for f in self.findings if f.term.joint in (None, joint + 1)]


def _holes(story: _Story) -> dict[str, Any]:
    first, last = story.steps[0], story.steps[-1]
    motion = last.identification.motion
    return {
        "model": first.identification.model.name,
        "verdict": _verdict(story),
        "facts": _facts(story),
        "held_out": first.held_out is not None,
        "errors": [_error_block(story, i) for i in range(len(first.joints))],
        "joints": [_joint(story, i) for i in range(len(first.joints))],
        "findings": [_finding(story, k) for k in range(len(story.findings))],
        "ruled_out": _ruled_out(story),
        "parameters": parameters.tables(first.identification, last.identification),
        "inertial": parameters.inertial(last.identification),
        "experiments": _experiments(story),
        "limits": _limits(story),
        "commands": _commands(story),
        "band": {"cutoff": number(motion.band.cutoff), "reason": motion.band.reason},
        "skew": parameters.skew(last.identification.inference),
        "warnings": story.document["warnings"],
        # "<" would let a text of the user's end the script element.
        "document": json.dumps(story.document, indent=1, allow_nan=False).replace("<", "\\u003c"),
    }


# --- the verdict ---

_TAGS = {
    "effect": "effect found",
    "clean": "clean",
    "unexplained": "unexplained",
    "refused": "refused",
    "comparison": "comparison",
}


def _verdict(story: _Story) -> Row:
    diagnosis = story.diagnosis
    if diagnosis is None:
        return {"kind": "comparison", "tag": _TAGS["comparison"], "sentence": _compared(story), "more": ""}
    more = ""
    if isinstance(story.result, Improvement) and story.findings:
        more = f"With that added, what is left is {_TAGS[story.result.left.verdict]}: {story.result.left.reason}."
    kind = diagnosis.verdict
    return {"kind": kind, "tag": _TAGS[kind], "sentence": sentence(diagnosis.reason), "more": more}


def _compared(story: _Story) -> str:
    parts = []
    for s in story.steps[0].joints:
        shares = structure_shares(s)
        strongest = max(shares, key=lambda name: shares[name]) if shares else ""
        text = (
            f"joint {s.joint}: the fitted model misses {percent(s.relative)} of the torque, "
            f"{number(s.rms / s.floor.value, 2)} times the noise floor"
        )
        if strongest and shares[strongest] > 0.1:
            text += f"; {percent(shares[strongest], 0)} of what it misses follows {strongest}"
        parts.append(text)
    return sentence("; ".join(parts))


def _facts(story: _Story) -> list[Row]:
    """The few figures to take away, of the joint whose error falls most, else of the one farthest above its floor."""
    first, last = story.steps[0], story.steps[-1]
    count = len(first.joints)
    fall = [first.fitted.relative[j] - last.fitted.relative[j] for j in range(count)]
    excess = [s.rms / s.floor.value if s.floor.value else 0.0 for s in first.joints]
    i = max(range(count), key=lambda j: (fall[j], excess[j]))
    where = f", joint {i + 1}" if count > 1 else ""

    def change(before: float, after: float) -> str:
        return percent(before) if first is last else f"{percent(before)} → {percent(after)}"

    facts = [{"name": f"error{where}", "value": change(first.fitted.relative[i], last.fitted.relative[i])}]
    if first.held_out is not None and last.held_out is not None:
        held = change(first.held_out.relative[i], last.held_out.relative[i])
        facts.append({"name": f"on the held-out recording{where}", "value": held})
    facts.append({"name": f"noise floor{where}", "value": percent(figures.relative_floor(first.joints[i]))})
    return facts


_SOURCES = {"repeats": "repeated motion", "spectrum": "the spectra of torque and encoder"}


def _error_block(story: _Story, joint: int) -> Row:
    first = story.steps[0]
    # The better the model, the better the floor is known: a wrong one leaves its error in the repeats.
    series = story.steps[-1].joints[joint]
    written = as_written(first.identification)
    rows = [] if written is None else [_written_row(written[joint], series.floor.value, series.force_unit)]
    rows += [_error_row(step, joint) for step in story.steps]
    caption = f"Error of joint {joint + 1} after each step, and the noise floor."
    return {
        "joint": joint + 1,
        "rows": rows,
        "floor": f"{quantity(series.floor.value, series.force_unit)} "
        f"({percent(figures.relative_floor(series))} of the torque), from {_SOURCES[series.floor.source]}; "
        f"the instruments' own noise: {quantity(series.floor.spectrum, series.force_unit)}",
        "repeatable": {True: "yes", False: "no", None: "unknown"}[series.floor.repeatable(series.rms)],
        "figure": figures.drawn(figures.error(story.steps, joint), f"error{joint + 1}", caption),
        "structure": figures.structure(first, story.steps[-1], joint),
    }


def _written_row(written: tuple[float, float], floor: float, unit: str) -> Row:
    return {
        "step": "the file's own values",
        "error": percent(written[1]),
        "rms": quantity(written[0], unit),
        "floors": number(written[0] / floor, 3),
        "held": None,
        "held_rms": None,
    }


def _error_row(step: Step, joint: int) -> Row:
    series = step.joints[joint]
    held = step.held_out
    return {
        "step": figures.label(step) + (", fitted" if step.added is None else ""),
        "error": percent(step.fitted.relative[joint]),
        "rms": quantity(step.fitted.rms[joint], series.force_unit),
        "floors": number(step.fitted.rms[joint] / series.floor.value, 3),
        "held": None if held is None else percent(held.relative[joint]),
        "held_rms": None if held is None else quantity(held.rms[joint], series.force_unit),
    }


def _joint(story: _Story, joint: int) -> Row:
    first, last = story.steps[0], story.steps[-1]
    findings = story.findings_at(joint)
    return {
        "number": joint + 1,
        "improved": last is not first,
        "added": " and ".join(dict.fromkeys(f.term.effect for f in findings)),
        "figures": figures.of_joint(first, last, joint, findings),
    }


# --- findings, rivals and what was ruled out ---


def _finding(story: _Story, number_: int) -> Row:
    diagnosis, finding = story.diagnosis, story.findings[number_]
    assert diagnosis is not None
    document = finding_json(diagnosis, number_)
    i = finding.joint_index
    series = finding.before.joints[i]
    info = diagnosis.model.library.effects[finding.term.effect]
    alone = len(story.findings_at(i)) == 1
    held = None
    if finding.before.held_out is not None and finding.after.held_out is not None:
        held = _arrow(finding.before.held_out.relative[i], finding.after.held_out.relative[i])
    return {
        "title": f"{finding.term.effect}{at(finding.term)}",
        "summary": info.summary,
        "equation": info.equation,
        "evidence": _evidence(finding.evidence, series.floor.value, series.force_unit),
        "error": _arrow(finding.before.fitted.relative[i], finding.after.fitted.relative[i]),
        "held": held,
        "share": percent(finding.share(), 0),
        "parameters": parameters.estimates(diagnosis.steps[-1].identification.inference.values.get(finding.term, {})),
        "rivals": [f"{t.effect}{at(t)}" for t in finding.rivals],
        "remainder": document["remainder"],
        "command": _add(story, finding.term),
        # With one finding at a joint, the joint's own figures show it already.
        "figure": None if alone else figures.of_finding(finding, f"finding{number_ + 1}"),
    }


def _arrow(before: float, after: float) -> str:
    return f"{percent(before)} → {percent(after)}"


def _evidence(evidence: Evidence, floor: float, unit: str) -> Row:
    return {
        "eff": f"{quantity(evidence.eff, unit, 3)} ({evidence.eff / floor:.2f} × floor)",
        "share": percent(evidence.share, 0),
        "bic": whole(evidence.delta_bic),
        "cv": percent(1 - math.sqrt(max(1 - evidence.cv_gain, 0.0)), 1),
        "gain": whole(evidence.likelihood_gain),
    }


def _ruled_out(story: _Story) -> list[Row]:
    """The strongest candidates at every joint once the search has ended, and what kept each from being named."""
    if story.diagnosis is None:
        return []
    joints, last = story.steps[-1].joints, story.steps[-1]
    rivals = {t for f in story.findings for t in f.rivals}
    rows = []
    for series, verdict in zip(joints, story.diagnosis.last, strict=False):
        floor = series.floor.value
        for evidence in verdict.ranked:
            why = "; ".join(evidence.failed)
            if not why:
                others = " or on the held-out recording" if last.held_out is not None else ""
                why = f"passes every gate, but added, the error does not fall on what was fitted{others}"
            name = f"{evidence.term.effect}{at(evidence.term)}"
            rows.append(
                {"name": name, "rival": evidence.term in rivals, "why": why}
                | _evidence(evidence, floor, series.force_unit)
            )
    return rows


def _experiments(story: _Story) -> list[Row]:
    """Motions that tell a finding from its rivals, or bring a finding out."""
    rows = []
    for finding in story.findings:
        effects = finding.before.identification.model.library.effects
        for term in (finding.term, *finding.rivals):
            what = "finding" if term == finding.term else f"rival of {finding.term}"
            rows.append(
                {
                    "name": f"{term.effect}{at(term)}",
                    "what": what,
                    "trace": effects[term.effect].trace,
                    "experiment": effects[term.effect].experiment,
                }
            )
    return rows


def _limits(story: _Story) -> list[Row]:
    if story.left is None:
        return []
    return [
        {
            "name": f"{limit.term.effect}{at(limit.term)}",
            "limit": f"{limit.parameter} {limit.side} {quantity(limit.value, limit.unit, 3)}",
            "what": story.left.model.library.effects[limit.term.effect].summary,
        }
        for limit in story.left.seen
    ]


def _commands(story: _Story) -> list[str]:
    return [_add(story, finding.term) for finding in story.findings]


def _add(story: _Story, term: Term) -> str:
    joint = "" if term.joint is None else f" --joint {term.joint}"
    return f"tendon add {story.model_file} {term.effect}{joint}"
