"""The report: one HTML page that holds a comparison, a diagnosis or the whole loop, and needs nothing beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from runtime.diagnosis.steps import Step, seconds_moving
from runtime.estimation.compare import JointSeries, as_written, structure_shares
from runtime.loop.improve import Improvement
from runtime.plain_json import plain
from runtime.report import loop
from runtime.report.page import page_figures as figures
from runtime.report.page import page_findings as found
from runtime.report.page import page_parameters as parameters
from runtime.report.page import recorded_motion
from runtime.report.page.filling import embedded, filled, looking, written
from runtime.report.signals import joint_signals
from runtime.report.summary import Result, ResultSummary
from runtime.wording import MORE_THAN_NOISE, number, numbered, percent, quantity, sentence, times_floor

Row = dict[str, Any]


def write_report(directory: Path, result: Result | ResultSummary) -> Path:
    """Write `report.html` into a directory, which is made if it is not there. Raises OSError."""
    return written(directory, render(result))


def render(result: Result | ResultSummary) -> str:
    """The page; the same bytes for the same result."""
    summary = result if isinstance(result, ResultSummary) else ResultSummary(result)
    return filled("report.html.j2", _holes(summary))


def _holes(summary: ResultSummary) -> dict[str, Any]:
    first, last = summary.first, summary.last
    motion = last.identification.motion
    joints = range(len(first.joints))
    return {
        "model": first.identification.model.name,
        "verdict": verdict(summary),
        "short": _short(summary),
        "held_out": first.held_out is not None,
        "errors": [_error_block(summary, i) for i in summary.telling],
        "moving": recorded_motion.of_result(summary),
        "joints": [_joint(summary, i) for i in summary.telling],
        "findings": found.findings(summary),
        "ruled_out": found.ruled_out(summary),
        "left_over": found.left_over(summary),
        "to_record": found.to_record(summary),
        "parameters": parameters.tables(summary),
        "inertial": parameters.by_place(summary, parameters.inertial(last.identification)),
        "several": parameters.recordings(summary.left.recordings) if summary.left else None,
        "experiments": found.experiments(summary),
        "limits": found.limits(summary),
        "commands": _commands(summary),
        "about": summary.invocation.about,
        "recorded": [_recorded(summary, i) for i in joints],
        "band": {"cutoff": number(motion.band.cutoff), "reason": motion.band.explained},
        "sensors": [] if summary.diagnosis is None else loop.sensors(summary.document),
        "skew": parameters.skew(last.identification.inference),
        "warnings": summary.document.warnings,
        "document": embedded(plain(summary.document)),
        "looking": looking(),
    }


# --- in short ---

_TAGS = {
    "effect": "effect found",
    "more": "effect found, more is left",
    "clean": "clean",
    "unexplained": "unexplained",
    "refused": "refused",
    "comparison": "comparison",
}


def verdict(summary: ResultSummary) -> Row:
    """The answer: its kind, that in words, a sentence, and what is to be added to it."""
    diagnosis = summary.diagnosis
    if diagnosis is None:
        return {"kind": "comparison", "tag": _TAGS["comparison"], "sentence": _compared(summary), "more": ""}
    more = ""
    if isinstance(summary.result, Improvement) and summary.findings:
        more = f"With that added, what is left is {_TAGS[summary.result.left.verdict]}: {summary.result.left.reason}."
    left = summary.left
    if left is not None and left.verdict == "clean" and any(summary.peaks):
        more = " ".join([more, f"Its spectrum has peaks that hold little: {_peaks(summary)}."]).strip()
    kind = "more" if summary.more_is_left else diagnosis.verdict
    return {"kind": kind, "tag": _TAGS[kind], "sentence": sentence(diagnosis.reason), "more": more}


def _peaks(summary: ResultSummary) -> str:
    return "; ".join(
        f"joint {summary.called(i)} at {', '.join(f'{f:.2f} Hz' for f in found)}"
        for i, found in enumerate(summary.peaks)
        if found
    )


def _compared(summary: ResultSummary) -> str:
    parts = []
    every = summary.first.joints
    loud = [s for s in every if len(every) == 1 or s.rms >= MORE_THAN_NOISE * s.floor.value]
    for s in loud:
        shares = structure_shares(s)
        strongest = max(shares, key=lambda name: shares[name]) if shares else ""
        text = (
            f"joint {numbered(s.joint, s.name)}: the fitted model misses {percent(s.relative)} of the torque, "
            f"{number(times_floor(s.rms, s.floor.value), 2)} times the noise floor"
        )
        if strongest and shares[strongest] > 0.1:
            text += f"; {percent(shares[strongest], 0)} of what it misses follows {strongest}"
        parts.append(text)
    if not loud:
        return "What is left of every joint's torque is at its noise floor."
    if quiet := len(every) - len(loud):
        parts.append(
            "the other joint is at its noise floor"
            if quiet == 1
            else f"the other {quiet} joints are at their noise floors"
        )
    return sentence("; ".join(parts))


def _short(summary: ResultSummary) -> Row:
    """Error before, after and floor of every joint, and what to type next."""
    to_type = [*summary.copying(), *summary.adding()] or summary.drafting()[:1]
    return {
        "changed": summary.first is not summary.last,
        "rows": [_short_row(summary, i) for i in summary.telling],
        "commands": to_type,
        "improved": getattr(summary.document, "improved_model", None),
    }


def _short_row(summary: ResultSummary, joint: int) -> Row:
    first, last, floor = summary.first, summary.last, summary.held_out_floor(joint)
    held = None
    if first.held_out is not None and last.held_out is not None:
        held = {
            "before": percent(first.held_out.relative[joint]),
            "after": percent(last.held_out.relative[joint]),
            "floor": None if floor is None else percent(floor),
        }
    return {
        "joint": summary.called(joint),
        "before": percent(first.fitted.relative[joint]),
        "after": percent(last.fitted.relative[joint]),
        "floor": percent(summary.floor(joint)),
        "instruments": _instruments(summary, joint),
        "held": held,
        **({} if summary.moves(joint) else dict.fromkeys(("before", "after", "floor"), "–")),
    }


def _instruments(summary: ResultSummary, joint: int) -> str | None:
    """The instruments' own noise relative to the torque, where an unexplained floor holds more than that."""
    floor = summary.last.joints[joint].floor
    explained = summary.left is None or summary.left.verdict != "unexplained"
    if explained or floor.value <= MORE_THAN_NOISE * floor.spectrum:
        return None
    return percent(summary.floor(joint) * floor.spectrum / floor.value)


# --- the error ---

_SOURCES = {"repeats": "repeated motion", "spectrum": "the spectra of torque and encoder"}


def _error_block(summary: ResultSummary, joint: int) -> Row:
    first, series = summary.first, summary.last.joints[joint]
    held_floor = summary.held_out_floor(joint)
    written = as_written(first.identification)
    rows = [] if written is None else [_written_row(written[joint], series.floor.value, series.force_unit)]
    rows += [_error_row(summary, step, joint) for step in summary.steps]
    caption = f"Error of joint {joint + 1} after each step; the marks across the bars are the noise floor."
    return {
        "joint": summary.called(joint),
        "quiet": _quiet(summary, joint),
        "rows": rows,
        "floor": f"{quantity(series.floor.value, series.force_unit)} "
        f"({percent(summary.floor(joint))} of the torque), from {_SOURCES[series.floor.source]}; "
        f"the instruments' own noise: {quantity(series.floor.spectrum, series.force_unit)}",
        "held_floor": None if held_floor is None else _held_floor(summary, joint, held_floor),
        "repeatable": _repeatable(series),
        "figure": figures.drawn(figures.error(summary.steps, joint, held_floor), f"error{joint + 1}", caption),
        "structure": figures.structure(first, summary.last, joint),
    }


def _repeatable(series: JointSeries) -> str:
    if series.rms <= MORE_THAN_NOISE * series.floor.value:
        return "it is at the noise floor"
    return {True: "yes", False: "no", None: "unknown, no motion was repeated"}[series.floor.repeatable(series.rms)]


def _held_floor(summary: ResultSummary, joint: int, relative: float) -> str:
    floor = summary.held_out_floors[joint]
    unit = summary.last.joints[joint].force_unit
    return f"{quantity(floor.value, unit)} ({percent(relative)}), from {_SOURCES[floor.source]}"


def _written_row(written: tuple[float, float], floor: float, unit: str) -> Row:
    return {
        "step": "the file's own values",
        "error": percent(written[1]),
        "rms": quantity(written[0], unit),
        "floors": number(times_floor(written[0], floor), 3),
        "held": None,
        "held_rms": None,
        "held_floors": None,
    }


def _error_row(summary: ResultSummary, step: Step, joint: int) -> Row:
    series = summary.last.joints[joint]
    held, held_floor = step.held_out, summary.held_out_floor(joint)
    floors = None if held is None or held_floor is None else number(times_floor(held.relative[joint], held_floor), 3)
    return {
        "step": figures.label(step) + (", fitted" if step.added is None else ""),
        "error": percent(step.fitted.relative[joint]),
        "rms": quantity(step.fitted.rms[joint], series.force_unit),
        "floors": number(times_floor(step.fitted.rms[joint], series.floor.value), 3),
        "held": None if held is None else percent(held.relative[joint]),
        "held_rms": None if held is None else quantity(held.rms[joint], series.force_unit),
        "held_floors": floors,
    }


def _quiet(summary: ResultSummary, joint: int) -> str | None:
    """What is said of one of several joints in place of showing it, where nothing is to be seen; None: it is shown."""
    if len(summary.first.joints) == 1 or not summary.at_floor(joint):
        return None
    if not summary.moves(joint):
        return "it never moves, and nothing of it is compared"
    return f"at its noise floor, error {percent(summary.last.fitted.relative[joint])}"


def _joint(summary: ResultSummary, joint: int) -> Row:
    first, last = summary.first, summary.last
    quiet = _quiet(summary, joint)
    findings = summary.findings_at(joint)
    return {
        "number": joint + 1,
        "called": summary.called(joint),
        "quiet": quiet,
        "improved": last is not first,
        "added": " and ".join(dict.fromkeys(f.term.effect for f in findings)),
        "figures": figures.of_joint(first, last, joint, findings),
        "signals": None if quiet else _signals(summary, joint),
    }


def _signals(summary: ResultSummary, joint: int) -> str | None:
    """Of a joint that is looked into, its signals with their numbers; None where it never moves."""
    if not summary.moves(joint):
        return None
    added = " + ".join(dict.fromkeys(f.term.effect for f in summary.findings_at(joint)))
    return embedded(joint_signals.of_joint(summary.first, summary.last, joint, added).embedded())


# --- what to type, and what was recorded ---


def _commands(summary: ResultSummary) -> Row:
    return {
        "known": summary.given is not None,
        "improved": getattr(summary.document, "improved_model", None),
        "adding": [*summary.copying(), *summary.adding(), *summary.refitting()],
        "drafting": summary.drafting(),
    }


def _recorded(summary: ResultSummary, joint: int) -> Row:
    """The range of motion of a joint, on the rows that count."""
    series, motion = summary.first.joints[joint], summary.first.identification.motion
    unit = series.position_unit
    some = len(series.t) > 0
    return {
        "joint": summary.called(joint),
        "moving": f"{number(seconds_moving(motion, joint), 3)} s",
        "position": f"{number(series.q.min(), 3)} … {number(series.q.max(), 3)} {unit}" if some else "–",
        "speed": f"{number(float(np.abs(series.qd).max()), 3)} {unit}/s" if some else "–",
        "acceleration": f"{number(float(np.abs(series.qdd).max()), 3)} {unit}/s²" if some else "–",
        "temperature": "not measured"
        if series.warmth is None
        else f"rises {number(float(np.ptp(series.warmth)), 2)} K",
        "repeated": "no" if series.floor.repeating is None else "yes",
    }
