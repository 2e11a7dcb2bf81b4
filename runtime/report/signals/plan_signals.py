"""What is shown of a joint's planned motion, and of its execution beside it: the same numbers as report/plots draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.report.plots.execution_plots import JointCycles
from runtime.report.plots.plan_plots import both_ways, near_limits
from runtime.report.signals.panels import DrawnCurve, DrawnLine, SignalPanel, around, curve
from runtime.report.signals.signal_set import SignalSet
from runtime.wording import number, numbered, quantity

Array = NDArray[np.float64]
Document = Mapping[str, Any]

PLANNED, SPRING, EXECUTED = "planned", "spring", "executed"
LIMIT, ENDS = "limit", "end of a phase"


def of_plan(document: Document, joint: int) -> SignalSet:
    """Position, speed and torque of a joint (1-based) over one cycle, with its limits and the ends of the phases.

    document   as planning.results gives it
    """
    samples, entry = document["samples"], document["joints"][joint - 1]
    force, position, limits = entry["units"]["force"], entry["units"]["position"], entry["limits"]
    q, qd, tau = (np.array(samples[name][joint - 1]) for name in ("q", "qd", "tau"))
    lines = {"position": q, "speed": qd, "motor torque": tau}
    drawn = [DrawnLine("motor torque", "motor torque", "after")]
    if joint in {spring["joint"] for spring in document["springs"]}:
        lines[SPRING] = np.array(samples["spring"][joint - 1])
        drawn.append(DrawnLine(SPRING, SPRING, "before"))
    rows = (
        ("Position", position, [DrawnLine("position", PLANNED, "ink")], limits["position"]),
        ("Speed", f"{position}/s", [DrawnLine("speed", PLANNED, "ink")], both_ways(limits["speed"])),
        ("Torque", force, drawn, both_ways(limits["torque"])),
    )
    ends = np.cumsum([phase["duration"] for phase in document["phases"]])[:-1]
    panels = tuple(
        _panel(f"{name} over one cycle", f"{name.lower()}, {unit}", shown, lines, (stated, unit), ends)
        for name, unit, shown, stated in rows
    )
    units = {"position": position, "speed": f"{position}/s"}
    return SignalSet(_title(entry), np.array(samples["t"]), lines, {}, panels, 0.0, force, units)


def of_execution(called: str, cycles: JointCycles) -> SignalSet:
    """Position, tracking error and torque of a joint, planned and executed: the mean of all cycles."""
    position, force = cycles.position_unit, cycles.force_unit
    error = cycles.q - cycles.q_planned
    rows = (
        ("Position", "position", position, cycles.q, cycles.q_planned),
        ("Off the plan", "error", position, error, None),
        ("Torque", "torque", force, cycles.torque, cycles.torque_planned),
    )
    lines: dict[str, Array] = {}
    panels = []
    for title, name, unit, values, planned in rows:
        drawn = []
        if planned is not None:
            lines[f"planned {name}"] = planned
            drawn.append(DrawnLine(f"planned {name}", PLANNED, "ink"))
        if name == "torque" and cycles.spring is not None:
            lines[SPRING] = cycles.spring
            drawn.append(DrawnLine(SPRING, SPRING, "before"))
        lines[name] = values.mean(axis=0)
        drawn.append(DrawnLine(name, EXECUTED, "after"))
        panel = _panel(title, f"{name}, {unit}", drawn, lines, (None, unit), np.empty(0))
        panels.append(replace(panel, note=_cycles(values, unit)))
    units = dict.fromkeys(("position", "planned position", "error"), position)
    return SignalSet(f"Joint {called}", cycles.t, lines, {}, tuple(panels), 0.0, force, units)


def _cycles(values: Array, unit: str) -> str:
    """Of how many cycles (K, F) a mean is, and how far they are apart; of a single one nothing."""
    apart = quantity(float(np.ptp(values, axis=0).max()), unit, 2)
    return "" if len(values) < 2 else f"The mean of {len(values)} cycles, which differ by up to {apart}."


def _panel(
    title: str,
    label: str,
    drawn: Sequence[DrawnLine],
    lines: Mapping[str, Array],
    limits: tuple[Sequence[float] | None, str],
    ends: Array,
) -> SignalPanel:
    """Over the time; a limit that is near is drawn, one that is far away is said.

    limits   and their unit     ends   s, of phases
    """
    values = [lines[line.line] for line in drawn]
    stated, unit = limits
    near = [] if stated is None else near_limits(values[0], stated)
    low, high = around([*values, np.array(near)])
    far = [limit for limit in stated or () if limit not in near]
    span = np.array([0.0, 1e9])  # a limit holds at all times
    curves: list[DrawnCurve] = [curve(LIMIT, "before", span, np.full(2, limit), dashed=True) for limit in near]
    curves += [curve(ENDS, "faint", np.full(2, end), np.array([low, high]), dashed=True) for end in ends]
    note = "" if not far else f"{'Limits' if len(far) > 1 else 'A limit'} further away: {_said(far, unit)}."
    return SignalPanel("time", title, "time", ("time, s", label), low, high, tuple(drawn), tuple(curves), note=note)


def _said(limits: Sequence[float], unit: str) -> str:
    return " and ".join([*map(number, limits[:-1]), quantity(limits[-1], unit)])


def _title(entry: Document) -> str:
    return f"Joint {numbered(entry['joint'], entry['name'])}"
