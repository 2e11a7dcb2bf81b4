"""The page of an execution: the arm as planned and as it moved, and joint by joint how far the two are apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.execution.execute import Execution
from runtime.execution.trial import RUN_IN, Trial
from runtime.model.terms import SURFACE, given
from runtime.planning.evaluate import Effort, at_times
from runtime.report.page.arm_motion import ArmMotion, Course, JointMarks, SpringTorque, frames, picture
from runtime.report.page.filling import embedded, filled, written
from runtime.report.page.page_figures import Drawn, drawn
from runtime.report.page.planned_page import span
from runtime.report.plots.execution_plots import JointCycles, joint_cycles
from runtime.wording import number, numbered, percent, quantity, sentence

Array = NDArray[np.float64]
Document = Mapping[str, Any]

_LEGEND = (
    "Dashed: planned, its torque with all that the model knows. Solid: executed, all cycles but those that run it in. "
    "In the other colour: the torque of a spring along the plan, as it pushes the joint forward."
)
TAGS = {"done": ("clean", "done"), "stopped": ("unexplained", "safe stop"), "refused": ("refused", "refused")}


def write_execution(directory: Path, result: Execution, document: Document) -> Path:
    """Write the page of an execution in which something moved. Raises OSError.

    document   what --json gives
    """
    return written(directory, render(result, document))


def render(result: Execution, document: Document) -> str:
    """The page; the same bytes for the same execution."""
    cycles = ExecutedCycles(result)
    model = result.plan.model
    kind, tag = TAGS[document["status"]]
    return filled(
        "sheet.html.j2",
        {
            "title": f"{model.name}: {document['plan']['scenario']} executed",
            "model": model.name,
            "tag": {"kind": kind, "text": tag},
            "headline": headline(document),
            "lines": lines(document),
            "facts": facts(document),
            "commands": [item["command"] for item in document["next"]],
            "moving": cycles.picture(),
            "legend": _LEGEND,
            "figures": cycles.figures(),
            "table": table(document),
            "notes": notes(document),
            "document": embedded(document),
        },
    )


@dataclass(frozen=True)
class ExecutedCycles:
    """The cycles that count, one over the other, at the samples of the first; where an execution was stopped before the
    first was through, the last seconds before that."""

    result: Execution

    @cached_property
    def whole(self) -> list[tuple[Trial, float]]:
        """Trials and the s at which a cycle begins in them."""
        plan = self.result.plan.trajectory
        first, most = (RUN_IN, None) if plan.periodic else (0, 1)
        found = []
        for trial in self.result.trials:
            count = int(len(trial.t) * self.result.dt / plan.duration + 1e-9)
            found += [(trial, k * plan.duration) for k in range(first, count)][:most]
        return found

    @cached_property
    def _shown(self) -> tuple[Trial, NDArray[np.intp]]:
        """The cycle that is shown: its trial, and the samples of its frames."""
        dt, duration = self.result.dt, self.result.plan.trajectory.duration
        count = max(1, round(duration / dt))
        if self.whole:
            trial, begins = self.whole[0]
            start = round(begins / dt)
        else:
            trial = max(self.result.trials, key=lambda one: len(one.t))
            start = max(0, len(trial.t) - count)
        return trial, start + frames(min(count, len(trial.t) - start))

    @cached_property
    def t(self) -> Array:
        """(F,) s since the trajectory began, over and over."""
        return np.asarray(self._shown[1] * self.result.dt, dtype=np.float64)

    @cached_property
    def planned(self) -> Effort:
        """At the frames, with everything that the model knows."""
        return at_times(self.result.plan.model, self.result.plan.trajectory, self.t, friction=True)

    def over_each_other(self, name: str) -> Array:
        """(n, K, F): `q` or `tau` of the cycles at the frames' places in them."""
        trial, at = self._shown
        if not self.whole:
            return np.asarray(getattr(trial, name)[:, at][:, None])
        places = at * self.result.dt - self.whole[0][1]
        rows = []
        for one, begins in self.whole:
            values = getattr(one, name)
            rows.append(values[:, np.minimum(np.rint((begins + places) / self.result.dt).astype(int), len(one.t) - 1)])
        return np.stack(rows, axis=1)

    @cached_property
    def _springs(self) -> dict[int, Array]:
        """By joint (1-based), along the plan."""
        return {joint: self.planned.spring[joint - 1] for joint in sorted(self.result.plan.trajectory.springs)}

    def motion(self) -> ArmMotion:
        """The first cycle that counts."""
        plan, (trial, at) = self.result.plan, self._shown
        tau = self.over_each_other("tau")
        marks: tuple[JointMarks, ...] = ()
        if tau.shape[1] > 1:
            # What differs from cycle to cycle is the floor, as repeated motion gives it.
            scatter = np.sqrt(np.mean(np.var(tau, axis=1, ddof=1), axis=1, keepdims=True))
            apart = np.abs(tau.mean(axis=1) - self.planned.tau)
            marks = (JointMarks("executed less planned", apart / np.maximum(scatter, 1e-12)),)
        return ArmMotion(
            model=plan.model,
            t=self.t,
            courses=(Course("planned", self.planned.motion.q), Course("executed", trial.q[:, at])),
            marks=marks,
            springs=tuple(
                SpringTorque(joint, torque, float(np.abs(tau[joint - 1]).max()))
                for joint, torque in self._springs.items()
            ),
            surface=None if plan.model.spatial else given(plan.model.library, plan.terms, SURFACE),
            goes_on=plan.trajectory.periodic and bool(self.whole),
        )

    def picture(self) -> dict[str, Any]:
        """The arm as planned and as it moved."""
        return picture(self.motion(), self.words())

    def words(self) -> str:
        """What the moving picture shows."""
        which = "the first cycle that counts" if self.whole else "the last seconds before the stop"
        text = f"The arm as planned, dashed, and as it moved, {which}"
        if len(self.whole) > 1:
            text += (
                "; the discs are the torque executed less that of the plan, the mean of all cycles, against the noise "
                "floor: what differs from cycle to cycle"
            )
        return f"{text}."

    @cached_property
    def joints(self) -> list[JointCycles]:
        """Position and torque of every joint, planned and executed."""
        q, tau = self.over_each_other("q"), self.over_each_other("tau")
        return [
            JointCycles(
                self.t - self.t[0],
                self.planned.motion.q[i],
                q[i],
                self.planned.tau[i],
                tau[i],
                self._springs.get(i + 1),
                joint.position_unit,
                joint.force_unit,
            )
            for i, joint in enumerate(self.result.plan.model.joints)
        ]

    def figures(self) -> list[Drawn]:
        """Position, error and torque of every joint."""
        found = []
        for k, (joint, cycles) in enumerate(zip(self.result.plan.model.joints, self.joints, strict=True), 1):
            called = numbered(k, joint.name)
            caption = f"Joint {called}: position, what it is off the plan, and torque, planned and executed."
            found.append(drawn(joint_cycles(cycles), f"executed{k}", caption))
        return found


# --- in words ---


def headline(document: Document) -> str:
    """What an execution came to."""
    return f"{document['plan']['scenario']} on {document['on']}: {_came_to(document)}"


def lines(document: Document) -> list[str]:
    """Why it stopped, and in what a simulated arm differs from its model."""
    found = [f"Safe stop: {sentence(document['reason'])}"] if document["status"] == "stopped" else []
    names = {joint["joint"]: joint["name"] for joint in document["joints"]}
    for effect in (entry for entry in document["effects"] if entry["hidden"] or entry["changed"]):
        joint, values = effect["joint"], (f"{name} {number(value)}" for name, value in effect["values"].items())
        where = "" if joint is None else f" at joint {numbered(joint, names[joint])}"
        how = "Hidden" if effect["hidden"] else "Changed"
        found.append(f"{how} in the simulated arm: {effect['effect']}{where}, {', '.join(values)}.")
    return found


def notes(document: Document) -> list[str]:
    """What a user should know of the controller."""
    return [f"The controller does not compensate {name}." for name in document["uncompensated"]]


def table(document: Document) -> dict[str, Any]:
    """Planned and executed of every joint: heads and rows, none where no cycle was completed."""
    rows = [] if document["mean"] is None else [_row(document, k) for k in range(len(document["joints"]))]
    return {"heads": _HEADS, "rows": rows}


def _came_to(document: Document) -> str:
    plan, mean = document["plan"], document["mean"]
    if mean is None:
        return "no cycle was completed"
    more = mean["total"] / plan["total"] - 1 if plan["total"] else 0.0
    apart = f"{percent(abs(more), 1)} {'more' if more > 0 else 'less'} than planned"
    return f"a cycle costs {_cost(mean['total'], document)}, {apart}"


def _cost(value: float, document: Document) -> str:
    units = {joint["force_unit"] for joint in document["joints"]}
    return quantity(value, f"({units.pop()})^2 s") if len(units) == 1 else f"{number(value)} in SI"


def facts(document: Document) -> list[dict[str, str]]:
    """Costs, cycles and how far the plate is pressed down; none where no cycle was completed."""
    plan, mean = document["plan"], document["mean"]
    if mean is None:
        return []
    found = [
        {"name": "cost planned", "value": _cost(plan["total"], document)},
        {"name": "executed", "value": _cost(mean["total"], document)},
        {"name": "cycles", "value": str(sum(len(trial["cycles"]) for trial in document["trials"]))},
    ]
    if plan["compression"] or mean["compression"]:
        pressed = f"{100 * plan['compression']:.2f} → {100 * mean['compression']:.2f} cm"
        found.append({"name": "plate pressed down, planned → executed", "value": pressed})
    return found


_HEADS = ("joint", "cost planned", "executed", "tracking rms", "largest", "range planned", "reached", "peak torque")


def _row(document: Document, k: int) -> Sequence[str]:
    plan, mean, joint = document["plan"], document["mean"], document["joints"][k]
    position, force = joint["position_unit"], joint["force_unit"]
    return [
        numbered(joint["joint"], joint["name"]),
        number(plan["cost"][k]),
        number(mean["cost"][k]),
        quantity(mean["tracking_rms"][k], position, 3),
        quantity(mean["tracking_max"][k], position, 3),
        span((plan["q_min"][k], plan["q_max"][k]), position),
        span((mean["q_min"][k], mean["q_max"][k]), position),
        quantity(mean["peak_torque"][k], force, 3),
    ]
