"""Sections of optimize and sweep, and of execute on the simulated arm and on a real one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec import UnsetType

from runtime.documents.experiments import ExportedMotionDocument
from runtime.documents.parts import given
from runtime.documents.plans import (
    BoardEntry,
    CycleEntry,
    DrivesEntry,
    ExecuteDocument,
    InfeasibleDocument,
    MotionDocument,
    OptimizeDocument,
    PlannedJointEntry,
    PredictionEntry,
    SpringValues,
    SweepDocument,
)
from runtime.report.fits import at_named
from runtime.report.sections import Bullets, Commands, Group, Paragraph, Section, TableSection, cut, table, texts, words
from runtime.wording import fixed, joints_said, number, numbered, percent, quantity, unit

_GOALS = {
    "torque_squared": "the squared torque over a cycle",
    "peak_torque": "the largest torque over its limit",
    "electrical_energy": "the electrical energy",
    "positive_work": "the positive work",
}
Choice = Mapping[str, dict[str, float] | float | None]
_AT_ZERO = 1e-6
"""Part of a range below which an end of it counts as 0, as a solver's accuracy has it."""
_MOST_LETTERS = 100
"""Letters of a reason in a table's cell; --json and the table of jobs have all of it."""


def plan(document: OptimizeDocument | InfeasibleDocument) -> list[Section]:
    """A plan: its cost, its springs, what it asks of every joint, and how the solver fared."""
    if isinstance(document, InfeasibleDocument):
        return texts([f"INFEASIBLE: {document.reason}", *cut(document.search)])
    solver = document.solver
    met = sum(a.met for a in solver.attempts)
    return [
        *texts([plan_headline(document), *cut(document.search), *spring_lines(document)]),
        plan_table(document),
        Paragraph(f"{met} of {len(solver.attempts)} starts met all constraints; {solver.seconds:.2f} s"),
        *plan_warnings(document),
    ]


def plan_headline(document: MotionDocument) -> str:
    """What a plan costs; a plan that was read from its file has no objective, only costs of its joints."""
    friction = "with" if document.friction else "without"
    begin = f"{document.scenario} in {number(document.cycle_time, 6)} s, {friction} friction: "
    if not isinstance(document, OptimizeDocument):
        return f"{begin}{_GOALS['torque_squared']} of all joints is {_total(document.joints)}"
    goal = document.objective
    of = joints_said(goal.joints, len(document.joints))
    return f"{begin}{_GOALS[goal.goal]} of {of} is {quantity(goal.value, goal.unit)}"


def _total(entries: Sequence[PlannedJointEntry]) -> str:
    units = {joint.units.force for joint in entries}
    total = sum(joint.cost for joint in entries)
    return quantity(total, f"({units.pop()})^2 s") if len(units) == 1 else f"{number(total)} in SI"


def spring_lines(document: MotionDocument) -> list[str]:
    """Every spring, and the springs of a catalogue that were compared."""
    catalogue = document.catalogue if isinstance(document, OptimizeDocument) else []
    lines = []
    for spring in document.springs:
        bought = any(str(spring["joint"]) in sizes for choice in catalogue for sizes in _sizes(choice))
        sought = (
            f" (from the catalogue; sought {quantity(float(spring['sought']), str(spring['unit']))})" if bought else ""
        )
        lines.append(f"Spring at joint {spring['joint']}: {spring['text']}{sought}.")
    lines += _gain(document)
    if len(catalogue) > 1:
        units = {str(spring["joint"]): str(spring["unit"]) for spring in document.springs}
        lines.append(f"Springs compared, the best first: {'; '.join(_choice(c, units) for c in catalogue)}.")
    return lines


def _gain(document: MotionDocument) -> list[str]:
    """What the springs save, beside the best motion without them."""
    if not isinstance(document, OptimizeDocument):
        return []
    goal, without = document.objective, document.objective.without_springs
    if isinstance(without, UnsetType):
        return []
    if without is None:
        return ["Without springs, no motion meets all constraints."]
    saved = 100 * (1 - goal.value / without)
    found = f"springs save {saved:.0f} %" if round(saved) > 0 else "springs save nothing"
    return [f"The best motion without springs costs {quantity(without, goal.unit)}: {found}."]


def _sizes(choice: Choice) -> list[Mapping[str, float]]:
    return [by_joint for by_joint in choice.values() if isinstance(by_joint, dict)]


def _choice(choice: Choice, units: Mapping[str, str]) -> str:
    sizes = [item for by_joint in _sizes(choice) for item in by_joint.items()]
    listed = ", ".join(f"{size:g} {units[joint]}" for joint, size in sizes)
    cost = choice["cost"]
    return f"{listed} {number(cost) if isinstance(cost, float) else 'infeasible'}"


def plan_table(document: MotionDocument) -> TableSection:
    """What a plan asks of every joint, and its limits."""
    rows = []
    for joint in document.joints:
        limits, position, force = joint.limits, joint.units.position, joint.units.force
        allowed = limits.position
        rows.append(
            (
                numbered(joint.joint, joint.name),
                quantity(joint.cost, f"({force})^2 s"),
                quantity(joint.peak_torque, force),
                _stated(limits.torque, force),
                quantity(joint.peak_speed, f"{position}/s"),
                _stated(limits.speed, f"{position}/s"),
                span(joint.range, position),
                "none stated" if allowed is None else span(allowed, position),
            )
        )
    return table(("joint", "cost", "peak torque", "limit", "peak speed", "limit", "range", "limits"), rows)


def span(ends: Sequence[float], of: str) -> str:
    """A range; an end that is 0 to a solver's accuracy is 0."""
    far = max(map(abs, ends))
    low, high = (0.0 if abs(end) < _AT_ZERO * far else end for end in ends)
    return f"{number(low)} … {quantity(high, of)}"


def _stated(limit: float | None, of: str) -> str:
    return "none stated" if limit is None else quantity(limit, of)


def plan_warnings(document: MotionDocument) -> list[Section]:
    """What a user should know before relying on a plan."""
    if not isinstance(document, OptimizeDocument):
        return []
    left_out = (f"not in the plan: {term}, {why}" for term, why in document.left_out.items())
    return list(texts([*document.warnings, *left_out], "warning"))


def sweep(document: SweepDocument) -> list[Section]:
    """A row a variation: the best cost, how the seeds spread about it, its springs, and what failed."""
    variations = document.variations
    several = any(v.jobs > 1 for v in variations)
    sprung = any(v.springs for v in variations)
    wrong = any(v.reason for v in variations)
    rows = []
    for v in variations:
        cells = ["" if x is None else f"{x:g}" if isinstance(x, float) else str(x) for x in v.at.values()]
        cells.append(number(v.best))
        if several:
            cells += [number(v.median), number(v.worst), "–" if v.close is None else percent(v.close)]
        if sprung:
            cells.append("; ".join(map(_spring_sizes, v.springs)))
        if wrong:
            reason = v.reason or ""
            shortened = reason if len(reason) <= _MOST_LETTERS else reason[: _MOST_LETTERS - 1] + "…"
            counts = {"infeasible": v.infeasible, "failed": v.failed}
            cells += [", ".join(f"{count} {what}" for what, count in counts.items() if count), shortened]
        rows.append(cells)
    spread = ("median", "worst", "within 1 %") if several else ()
    heads = (*variations[0].at, "best", *spread, *(("springs",) if sprung else ()))
    new = document.jobs - document.found_finished
    return [
        Paragraph(f"{document.scenario}, {document.arm}: {document.goal}"),
        table((*heads, *(("no plan", words("why")) if wrong else ())), rows),
        Paragraph(f"{document.table}: {document.jobs} jobs, {new} of them now, {document.seconds:.1f} s"),
    ]


def _spring_sizes(spring: SpringValues) -> str:
    size, *others = (number(float(value)) for key, value in spring.items() if key not in ("joint", "unit"))
    return f"{spring['joint']}: {', '.join((size + unit(str(spring['unit']), ' '), *others))}"


_SAME_RATE = 0.01


def execution(document: ExecuteDocument) -> list[Section]:
    """What ran, cost and tracking beside the plan's, the plate, why it stopped, and what to type next."""
    warned = unchecked(document.unchecked)
    if document.status == "refused" and document.reason and not document.exceeded:
        foreseen, board = given(document.prediction), given(document.board)
        return [
            *warned,
            *(prediction(foreseen) if foreseen else []),
            *(_board(board) if board else []),
            Paragraph(f"REFUSED, nothing has moved: {document.reason}."),
        ]
    return [
        *warned,
        *texts([execution_headline(document), *_played(document), *_conditions(document)]),
        *execution_results(document),
        *_end(document),
    ]


def unchecked(sentences: Sequence[str]) -> list[Section]:
    """What nothing keeps the arm from."""
    return [Paragraph("NOT CHECKED:"), Bullets(tuple(sentences))] if sentences else []


def exported_motion(document: ExportedMotionDocument) -> list[Section]:
    """What nothing keeps the arm from, what was written, and where it starts."""
    return [*unchecked(document.unchecked), *texts(exported_motion_lines(document))]


def exported_motion_lines(document: ExportedMotionDocument) -> list[str]:
    """What was written, and where it starts."""
    start = ", ".join(number(x) for x in document.start)
    return [
        f"{document.out}: {document.points} points at {quantity(document.rate, 'Hz')}, "
        f"{quantity(document.seconds, 's')}, positions in {document.unit}, of {', '.join(document.joints)}",
        f"It begins at ({start}): bring the arm there first, and play it slowly first (speed 0.2).",
    ]


def execution_headline(document: ExecuteDocument) -> str:
    """What was executed, and how often."""
    plan, count = document.plan, len(document.trials)
    done = sum(len(trial.cycles) for trial in document.trials)
    cycles = f", {done} cycles of {quantity(plan.duration, 's')}" if plan.periodic else ""
    friction = "compensated" if document.friction_compensation else "not compensated"
    trials = f"{count} trial{'' if count == 1 else 's'}{cycles}"
    return f"{plan.scenario} on {document.on}: {trials}; friction {friction}."


def _played(document: ExecuteDocument) -> list[str]:
    """The pace, and how the samples of a motion's file became a trajectory."""
    pace = "" if document.speed == 1.0 else f"Played at {number(document.speed)} of its pace. "
    if (played := given(document.played)) is None:
        return [pace.strip()] if pace else []
    return [
        f"{pace}{played.samples} samples at {quantity(played.rate, 'Hz')}, {quantity(played.seconds, 's')}; the "
        f"controller runs at {quantity(played.controller_rate, 'Hz')} and follows {played.phases} polynomials through "
        "them."
    ]


def execution_results(document: ExecuteDocument) -> list[Section]:
    """Planned and executed of every joint, the cost of a cycle, and the plate; nothing if no cycle was completed."""
    if document.mean is None:
        return []
    return [_execution_table(document, document.mean), *texts(costs(document))]


def prediction(document: PredictionEntry) -> list[Section]:
    """What the simulated arm did, before a real one does it."""
    rows = []
    for joint in document.joints:
        force, position = joint.force_unit, joint.position_unit
        rows.append(
            (
                numbered(joint.joint, joint.name),
                quantity(joint.torque, force, 3),
                quantity(joint.torque_limit, force, 3),
                quantity(joint.speed, f"{position}/s", 3),
                quantity(joint.speed_limit, f"{position}/s", 3),
                quantity(joint.room, position, 3),
            )
        )
    heads = ("joint", "peak torque", "limit", "speed", "limit", "room to the end of the range")
    made: list[Section] = [Paragraph("The same on the simulated arm:"), table(heads, rows)]
    distance = document.plate
    if distance is not None:
        pressed = f"presses the plate down by {-100 * distance:.2f} cm"
        where = pressed if distance < 0 else f"stays {100 * distance:.2f} cm off the plate"
        made.append(Paragraph(f"The end-effector {where}."))
    return made


def _board(document: BoardEntry) -> list[Section]:
    """Where the arm stands, before it is asked to move."""
    if document.standing is None:
        return [Paragraph(f"The arm cannot be asked where it stands: {document.text}.")]
    stands = tuple(
        f"joint {numbered(joint.joint, joint.name)}: stands at {joint.position:.3f} {joint.position_unit}, "
        f"the motion starts at {joint.start:.3f}"
        for joint in document.standing
    )
    return [Paragraph("The board answers and takes the motion; the arm"), Bullets(stands)]


def _conditions(document: ExecuteDocument) -> list[str]:
    """How the arm differs from the model, and what firmware, board, link and drives did."""
    lines = differences(document)
    if image := given(document.image):
        lines.append(f"Firmware for {image.target}, {image.text} bytes, by {image.compiler}.")
    if (every := given(document.every) or 1) > 1:
        lines.append(f"The line carries one record in {every} control periods; the others are left out.")
    period, measured = document.period, document.period_measured
    if measured is not None and abs(measured / period - 1.0) > _SAME_RATE:
        lines.append(
            f"The board's records are {1e3 * measured:.4g} ms apart, by the model file {1e3 * period:.4g} ms:"
            " set its timer to the rate in [controller], or the rate to the timer's."
        )
    link = given(document.link)
    here = sum(link.damaged.values()) if link else 0
    lost = sum((link.board or {}).get(kind, 0) for kind in ("bad_frame", "bad_crc", "bad_header")) if link else 0
    if here or lost:
        lines.append(f"The link has damaged {lost} frames on their way to the board and {here} on their way back.")
    if drives := given(document.drives):
        lines += _drives(document, drives)
    return [*lines, *uncompensated(document), *_watched(document)]


def _watched(document: ExecuteDocument) -> list[str]:
    """Of every trial, the joints whose model the board's monitor no longer believes; a line where it believes all."""
    names = {joint.joint: joint.name for joint in document.joints}
    said = [(trial.trial, entry) for trial in document.trials for entry in given(trial.watched) or []]
    lines = []
    for trial, entry in said:
        if entry.since is not None:
            follows = "" if entry.signal == "none" else f"; the residual follows the {entry.signal}"
            lines.append(
                f"Monitor, trial {trial}: the model of joint {numbered(entry.joint, names[entry.joint])} "
                f"{_SAID[entry.verdict]} since {quantity(entry.since, 's', 3)}{follows}."
            )
    return lines or (["Monitor: the model of every joint holds."] if said else [])


_SAID = {"drifts": "has drifted", "broken": "no longer holds"}
"""The monitor's verdicts in words."""


def differences(document: ExecuteDocument) -> list[str]:
    """How a simulated arm differs from its model."""
    names = {joint.joint: joint.name for joint in document.joints}
    lines = []
    for entry in document.effects:
        if entry.hidden or entry.changed:
            values = ", ".join(f"{name} {number(value)}" for name, value in entry.values.items())
            how = "hidden" if entry.hidden else "changed"
            lines.append(f"{how}: {entry.effect}{at_named(entry.joint, names)}: {values}")
    return lines


def uncompensated(document: ExecuteDocument) -> list[str]:
    """Effects of the model that the controller leaves out."""
    names = ", ".join(document.uncompensated)
    return [f"The controller does not compensate: {names}."] if names else []


def _drives(document: ExecuteDocument, drives: DrivesEntry) -> list[str]:
    """How punctual the control loop was, and what the drives made of its torques."""
    lines = [
        f"The drives' frames fill {percent(drives.load)} of {drives.channel}. Periods began late by "
        f"{1e3 * drives.late_rms:.2g} ms rms, {1e3 * drives.late_worst:.2g} ms at worst; "
        f"{drives.overruns} left out, {drives.missed_answers} answers late or missing."
    ]
    if drives.overruns and not drives.real_time:
        lines.append("  Without real-time priority (ulimit -r 30, or as root) a busy computer is late.")
    for joint, step, limited in zip(document.joints, drives.resolution, drives.limited_by_drive, strict=True):
        less = f"; its drive held back in {limited} periods" if limited else ""
        called = numbered(joint.joint, joint.name)
        lines.append(f"  joint {called}: torques are rounded to {quantity(step, joint.force_unit)}{less}")
    return lines


def _execution_table(document: ExecuteDocument, mean: CycleEntry) -> TableSection:
    plan, spread = document.plan, document.spread
    rows = [
        (
            numbered(joint.joint, joint.name),
            number(plan.cost[k]),
            number(mean.cost[k]),
            "–" if spread is None else number(spread.cost[k], 2),
            number(mean.tracking_rms[k], 3),
            quantity(mean.tracking_max[k], joint.position_unit, 3),
            _range(plan.q_min[k], plan.q_max[k]),
            _range(mean.q_min[k], mean.q_max[k]),
            quantity(mean.peak_torque[k], joint.force_unit, 3),
        )
        for k, joint in enumerate(document.joints)
    ]
    heads = ("joint", "cost planned", "executed", "±", "tracking rms", "max", "range planned", "reached", "peak torque")
    return table(heads, rows)


def _range(low: float, high: float) -> str:
    return f"{fixed(low)} … {fixed(high)}"


def costs(document: ExecuteDocument) -> list[str]:
    """The cost of a cycle beside the plan's, saturated torques, and how far the plate is pressed down."""
    plan, mean, spread = document.plan, document.mean, document.spread
    if mean is None:
        return []
    units = {joint.force_unit for joint in document.joints}
    of = unit(f"({units.pop()})^2 s") if len(units) == 1 else "in SI"
    scatter = "" if spread is None else f" ± {number(spread.total, 2)}"
    off = mean.total / plan.total - 1 if plan.total else None
    more = "" if off is None else f", {percent(abs(off))} {'more' if off > 0 else 'less'} than that"
    lines = [f"Cost of a cycle: {number(mean.total)}{scatter} {of}; planned {number(plan.total)}{more}."]
    if not plan.friction:
        modelled = number(plan.modelled.total)
        lines.append(f"  It was planned without friction; with the model's friction the plan itself costs {modelled}.")
    if mean.saturated:
        lines.append(f"Torques were at their limits for {percent(mean.saturated)} of the time.")
    planned, reached = plan.compression, mean.compression
    if reached is not None and planned is not None and max(reached, planned) > 0:
        lines.append(f"Plate: pressed down by {100 * reached:.2f} cm, planned {100 * planned:.2f} cm.")
    return lines


def _end(document: ExecuteDocument) -> list[Section]:
    made: list[Section] = []
    if document.status == "refused":
        exceeded = tuple(item.text for item in document.exceeded)
        made += [Paragraph("REFUSED before the motion, nothing was executed:"), Bullets(exceeded)]
    if document.status == "stopped":
        made.append(Paragraph(f"SAFE STOP: {document.reason}."))
    recording, mounted = given(document.recording), given(document.model_out)
    if recording:
        made.append(Paragraph(f"Recording: {recording}"))
    elif document.trials:
        made.append(Paragraph("With --out RUN.csv.gz the recording is kept."))
    if mounted:
        made.append(Paragraph(f"Model with the springs and contact of this motion: {mounted}"))
    if (added := given(document.statistics)) is not None:
        made.append(Paragraph(f"What the board added up: {added}"))
    elif document.statistics is None:
        made.append(Paragraph("The board has sent nothing that it added up."))
    if following := given(document.next):
        made.append(Group("Next", (Commands(tuple(following)),)))
    elif recording:
        made.append(
            Paragraph(
                "The motion brings springs or a contact of its own: with --model-out FILE, compare against that model."
            )
        )
    return made
