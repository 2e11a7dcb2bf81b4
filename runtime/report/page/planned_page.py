"""The page of a plan: the arm in motion, limits and phases, what every joint is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.model.loader import Model
from runtime.model.terms import SURFACE, given
from runtime.planning.evaluate import at_times, mounted
from runtime.planning.trajectory import Trajectory
from runtime.report import plans
from runtime.report.page.arm_motion import MOST_FRAMES, ArmMotion, Course, SpringTorque, picture
from runtime.report.page.filling import embedded, filled, written
from runtime.report.page.page_figures import Drawn, drawn
from runtime.report.plots import plan_plots
from runtime.wording import number, numbered, quantity

Document = Mapping[str, Any]

_STEP = 0.01
"""s from one frame to the next, if that does not make too many of them."""
_LEGEND = (
    "One cycle. Dashed across: limits that are near; dotted: where a phase ends; shaded: in contact. "
    "The torque is the motor's; a spring's, dashed, is what it pushes the joint forward with."
)


def write_plan(
    directory: Path, model: Model, trajectory: Trajectory, document: Document, commands: Sequence[str] = ()
) -> Path:
    """Write the page of a plan. Raises OSError.

    document   as planning.results.document gives it     commands   what to type next
    """
    return written(directory, render(model, trajectory, document, commands))


def render(model: Model, trajectory: Trajectory, document: Document, commands: Sequence[str] = ()) -> str:
    """The page; the same bytes for the same plan."""
    goal = document.get("objective")
    return filled(
        "sheet.html.j2",
        {
            "title": f"{model.name}: {document['scenario']}",
            "model": model.name,
            "tag": {"kind": "clean", "text": "plan"},
            "headline": plans.headline(document),
            "lines": spring_lines(document),
            "facts": [
                {"name": f"cost of joint {j['joint']}", "value": quantity(j["cost"], f"({j['units']['force']})^2 s")}
                for j in document["joints"]
                if goal is None or j["joint"] in goal["joints"]
            ],
            "commands": list(commands),
            "moving": moving(model, trajectory),
            "legend": _LEGEND,
            "figures": figures(document),
            "table": table(document),
            "notes": notes(document),
            "document": embedded(document),
        },
    )


def spring_lines(document: Document) -> list[str]:
    """Every spring in words."""
    return [f"Spring at joint {s['joint']}: {s['text']}." for s in document["springs"]]


def notes(document: Document) -> list[str]:
    """What a user should know before trusting the plan."""
    left_out = document.get("left_out", {})
    return [*document.get("warnings", []), *(f"Not in the plan: {term}, {why}." for term, why in left_out.items())]


def figures(document: Document) -> list[Drawn]:
    """Of every joint that moves its position, speed and torque over one cycle."""
    found = []
    for joint in plan_plots.moving_joints(document):
        called = numbered(joint, document["joints"][joint - 1]["name"])
        caption = f"Joint {called}: position, speed and torque over one cycle, with limits and phases."
        found.append(drawn(plan_plots.plan_of_joint(document, joint), f"plan{joint}", caption))
    return found


def table(document: Document) -> dict[str, Any]:
    """What is asked of every joint, and its limits: heads and rows."""
    return {"heads": _HEADS, "rows": [_row(joint) for joint in document["joints"]]}


def moving(model: Model, trajectory: Trajectory) -> dict[str, Any]:
    """The arm's picture over one cycle."""
    return picture(planned_motion(model, trajectory), _what(model, trajectory))


def planned_motion(model: Model, trajectory: Trajectory) -> ArmMotion:
    """One cycle of a trajectory."""
    count = int(np.clip(np.ceil(trajectory.duration / _STEP), 2, MOST_FRAMES))
    t = np.linspace(0.0, trajectory.duration, count, endpoint=not trajectory.periodic)
    seen = at_times(model, trajectory, t)
    return ArmMotion(
        model=model,
        t=t,
        courses=(Course("planned", seen.motion.q),),
        springs=tuple(
            SpringTorque(joint, seen.spring[joint - 1], float(np.abs(seen.tau[joint - 1]).max()))
            for joint in sorted(trajectory.springs)
        ),
        surface=None if model.spatial else given(model.library, mounted(model, trajectory), SURFACE),
        goes_on=trajectory.periodic,
    )


def _what(model: Model, trajectory: Trajectory) -> str:
    kind = "over and over" if trajectory.periodic else "from rest to rest"
    return f"The planned motion of {model.name}, {trajectory.duration:g} s, {kind}; the thin line is the tip's way."


_HEADS = ("joint", "cost", "peak torque", "its limit", "peak speed", "its limit", "range", "allowed")


def _row(joint: Document) -> list[str]:
    limits, position, force = joint["limits"], joint["units"]["position"], joint["units"]["force"]
    allowed = limits["position"]
    return [
        numbered(joint["joint"], joint["name"]),
        quantity(joint["cost"], f"({force})^2 s"),
        quantity(joint["peak_torque"], force),
        _stated(limits["torque"], force),
        quantity(joint["peak_speed"], f"{position}/s"),
        _stated(limits["speed"], f"{position}/s"),
        span(joint["range"], position),
        "none stated" if allowed is None else span(allowed, position),
    ]


_AT_ZERO = 1e-6
"""Part of a range below which an end of it is 0, as far as a solver tells."""


def span(ends: Sequence[float], unit: str) -> str:
    """A range in words, an end of it 0 where it is to a solver."""
    far = max(map(abs, ends))
    low, high = (0.0 if abs(end) < _AT_ZERO * far else end for end in ends)
    return f"{number(low)} … {quantity(high, unit)}"


def _stated(limit: float | None, unit: str) -> str:
    return "none stated" if limit is None else quantity(limit, unit)
