"""Figures 4 to 8 of the paper, in its arrangement: gray and dark, solid and dashed as its captions say."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from runtime.arrays import Array
from runtime.execution.trial import RUN_IN
from runtime.planning.evaluate import at_times
from runtime.report.plots.style import BEFORE, FAINT, INK, WIDTH, styled
from runtime.study import published
from runtime.study.identification import JointFriction
from runtime.study.study import Row, Study, StudyCase

GRAY = "#9aa5b1"
PAPER = "#bd4a07"
"""Colour of numbers that the paper prints; its curves are images."""
FRICTION_JOINT = 2
"""Joint of Figure 4."""
_PLATE = "plate of {:g} kN/m"


def drawn(study: Study, wanted: Sequence[str]) -> dict[str, Figure]:
    """The wanted figures by name; other names are ignored."""
    makers: dict[str, Callable[[], Figure]] = {
        "figure4": lambda: figure4(study.table1.joint(FRICTION_JOINT)),
        "figure5": lambda: figure5(study.curves),
        "figure6": lambda: figure6(study.table2),
        "figure7": lambda: figure7(study.table3),
        "figure8": lambda: figure8(study.table3),
    }
    return {name: makers[name]() for name in wanted if name in makers}


@styled
def figure4(found: JointFriction) -> Figure:
    """Measured friction torque of a joint over its speed, the estimated map (4), and the published one."""
    figure = Figure(figsize=(1.25 * WIDTH, 0.85 * WIDTH), layout="constrained")
    ax = figure.subplots()
    measured = found.measured()
    for number, (speed, torque) in enumerate(measured):
        label = "experiment" if number == 0 else None
        ax.plot(speed, torque, color=FAINT, alpha=0.45, lw=0.5, label=label)
    top = max(float(np.abs(speed).max()) for speed, _ in measured)
    # The map is undefined at rest.
    branch = np.linspace(1e-6 * top, top, 200)
    for number, speeds in enumerate((-branch[::-1], branch)):
        labels = ("estimated map", "published map") if number == 0 else (None, None)
        ax.plot(speeds, found.friction(speeds), color=INK, lw=1.6, label=labels[0])
        ax.plot(speeds, found.printed_friction(speeds), color=BEFORE, lw=0.9, ls=(0, (4, 4)), label=labels[1])
    ax.axhline(0, color=FAINT, lw=0.4, zorder=0)
    ax.axvline(0, color=FAINT, lw=0.4, zorder=0)
    ax.margins(x=0.02)
    ax.set_xlabel(f"speed of joint {found.joint}, rad/s")
    ax.set_ylabel(f"friction torque of joint {found.joint}, N m")
    legend = ax.legend(frameon=False, loc="upper left")
    legend.get_lines()[0].set(linewidth=1.6, alpha=1.0)
    return figure


@styled
def figure5(costs: Mapping[StudyCase, float]) -> Figure:
    """Costs of scenario 1 over the cycle time; crosses: Table II."""
    figure = Figure(figsize=(1.35 * WIDTH, 3.2), layout="constrained")
    ax = figure.subplots()
    for letter, colour, dash in (("C", INK, "-"), ("D", INK, "--"), ("A", GRAY, "-"), ("B", GRAY, "--")):
        points = sorted((case.cycle_time, cost) for case, cost in costs.items() if case.letter == letter)
        times, values = zip(*points, strict=True)
        words = ("friction" if letter in "CD" else "no friction", "spring" if letter in "BD" else "no spring")
        ax.plot(times, values, dash, color=colour, marker="o", ms=3, lw=1.3, label=f"1{letter}: {', '.join(words)}")
    printed = [(T, cost.simulation) for (T, _), cost in published.TABLE_2.items()]
    ax.plot(*zip(*printed, strict=True), "x", color=PAPER, ms=5, mew=1.2, label="Table II")
    ax.set_xlabel("cycle time T, s")
    ax.set_ylabel("cost, N²m²s")
    ax.set_ylim(0, None)
    ax.legend(frameon=False, fontsize=7.5)
    return figure


@styled
def figure6(rows: Sequence[Row]) -> Figure:
    """Commanded torque and angle of joint 4 in the experiment, cases 1B (gray) and 1D (black) at 1.2 s, their plans
    dashed, and where the paper's arm turned."""
    figure = Figure(figsize=(1.9 * WIDTH, 2.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for row in rows:
        if row.case.cycle_time != published.CYCLES_1[0] or row.case.letter not in "BD" or row.run is None:
            continue
        colour = GRAY if row.case.letter == "B" else INK
        t, q, tau = _cycle(row)
        left.plot(t, tau[3], color=colour, lw=1.2, label=f"1{row.case.letter}")
        right.plot(t, q[3], color=colour, lw=1.2, label=f"1{row.case.letter}, turns at {q[3].min():.2f} rad")
        planned_t = np.linspace(0.0, row.plan.trajectory.duration, 300)
        planned = at_times(row.plan.effort.model, row.plan.trajectory, planned_t)
        left.plot(planned_t, planned.tau[3], "--", color=colour, lw=0.8)
        right.plot(planned_t, planned.motion.q[3], "--", color=colour, lw=0.8)
        turned = published.REVERSAL[row.case.letter]
        at = float(t[np.argmin(q[3])])
        right.plot([at - 0.12, at + 0.12], [turned, turned], color=PAPER, lw=1.1)
        # On different sides, because the labels are close to each other.
        side, align = (at - 0.14, "right") if row.case.letter == "B" else (at + 0.14, "left")
        right.text(
            side, turned, f"paper, 1{row.case.letter}: {turned:.2f}", color=PAPER, fontsize=7, va="center", ha=align
        )
    if left.lines:
        left.plot([], [], "--", color=FAINT, lw=0.8, label="as planned")
    left.set_ylabel("torque of joint 4, N m")
    right.set_ylabel("q4, rad")
    for ax in (left, right):
        ax.set_xlabel("time, s")
        ax.legend(frameon=False, fontsize=7.5)
    return figure


@styled
def figure7(rows: Sequence[Row]) -> Figure:
    """Path of the end-effector at 1.6 s, softer plate on top, 2C left and 2D right: planned dashed, executed solid, and
    how far the paper's arm pressed the plate down in 2D."""
    figure = Figure(figsize=(1.5 * WIDTH, 1.6 * WIDTH), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for row in rows:
        if row.case.cycle_time != 1.6 or row.run is None or row.case.plate is None:
            continue
        ax = axes[published.PLATES.index(row.case.plate)]["CD".index(row.case.letter)]
        _path(ax, row)
        ax.set_title(f"2{row.case.letter}, {_PLATE.format(row.case.plate / 1000)}", fontsize=8.5)
    for ax in axes[-1]:
        ax.set_xlabel("x, m")
    for ax in axes[:, 0]:
        ax.set_ylabel("y, m")
    if axes[0, 0].lines:
        axes[0, 0].legend(frameon=False, fontsize=7.5)
    return figure


def _path(ax: Axes, row: Row) -> None:
    model = row.plan.effort.model
    planned = row.plan.effort.tip
    ax.plot(planned[0], planned[1], "--", color=FAINT, lw=1.1, label="optimized")
    _, q, _ = _cycle(row)
    reached = model.tip(np.ascontiguousarray(q))
    ax.plot(reached[0], reached[1], "-", color=INK, lw=1.1, label="executed")
    surface = row.plan.trajectory.contact["plate"]["position"]
    ax.axhline(surface, color=FAINT, lw=0.5, ls=":", label="the plate, unpressed")
    printed = published.COMPRESSION[row.case.plate] if row.case.letter == "D" else None
    if printed is not None:
        ax.axhline(surface - printed, color=PAPER, lw=0.9, label="the paper's, pressed down")
        ours = 100 * max(0.0, surface - float(reached[1].min()))
        said = f"pressed down {ours:.1f} cm, paper {100 * printed:.1f}"
        ax.text(0.03, 0.08, said, transform=ax.transAxes, color=PAPER, fontsize=7)


@styled
def figure8(rows: Sequence[Row]) -> Figure:
    """Torques at joint 4 in the experiment at 1.6 s: motor in 2C black, in 2D gray, its spring gray and dashed, and the
    plan's cost at joint 4 beside the paper's."""
    figure = Figure(figsize=(1.35 * WIDTH, 1.2 * WIDTH), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for row in rows:
        if row.case.cycle_time != 1.6 or row.run is None or row.case.plate is None:
            continue
        ax = axes[published.PLATES.index(row.case.plate)]
        t, q, tau = _cycle(row)
        ax.plot(t, tau[3], color=INK if row.case.letter == "C" else GRAY, lw=1.2, label=f"motor, 2{row.case.letter}")
        library, motion = row.plan.effort.model.library, {"q": np.ascontiguousarray(q[3])}
        for values in row.plan.trajectory.springs.values():
            # The torque with which the spring pushes the joint forward, along the executed motion.
            torque = -library.torque("parallel_spring", motion, values)
            ax.plot(t, torque, "--", color=GRAY, lw=1.2, label="spring, 2D")
        is_bare = row.case.letter == "C"
        left = "{:g} to {:g}".format(*published.JOINT_4_LEFT)
        paper = f"{published.JOINT_4[row.case.plate]:g}" if is_bare else left
        said = f"planned, 2{row.case.letter}: {row.plan.effort.cost[3]:.1f} N²m²s, paper {paper}"
        height = 0.95 if is_bare else 0.85
        ax.text(0.99, height, said, transform=ax.transAxes, ha="right", va="top", color=PAPER, fontsize=7)
        ax.set_title(_PLATE.format(row.case.plate / 1000), fontsize=8.5)
        ax.set_ylabel("torque of joint 4, N m")
    axes[0].legend(frameon=False, fontsize=7.5)
    axes[-1].set_xlabel("time, s")
    return figure


def _cycle(row: Row) -> tuple[Array, Array, Array]:
    """t (N,) within the cycle, q and tau (n, N) of the first cycle that counts in the first trial."""
    if row.run is None:
        raise ValueError(f"case {row.case} was not executed")
    trial = row.run.execution.trials[0]
    duration, dt = row.plan.trajectory.duration, row.run.execution.dt
    part = slice(round(RUN_IN * duration / dt), round((RUN_IN + 1) * duration / dt))
    t = trial.t[part]
    return t - t[0], trial.q[:, part], trial.tau[:, part]
