"""The pages of a plan and of an execution, as sections with figures."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.documents.diagnosis import CommandEntry
from runtime.documents.parts import given
from runtime.documents.plans import ExecuteDocument, MotionDocument, OptimizeDocument
from runtime.execution.execute import Execution
from runtime.model.loader import Model
from runtime.plain_json import plain
from runtime.planning.trajectory import Trajectory
from runtime.report import motions
from runtime.report.page.html import ReportPage, add_figures, part
from runtime.report.page.moving import ExecutedCycles, planned
from runtime.report.page.page_figures import drawn
from runtime.report.plots import motion_plots
from runtime.report.sections import Commands, Facts, Group, Paragraph, Plots, Section, texts
from runtime.wording import numbered, quantity, sentence

_STATUS = {"done": ("clean", "done"), "stopped": ("unexplained", "safe stop"), "refused": ("refused", "refused")}


def plan_page(
    model: Model, trajectory: Trajectory, document: MotionDocument, commands: Sequence[CommandEntry] = ()
) -> ReportPage:
    """The page of a plan; commands: what to type next."""
    drawings = {"moving": part("arm_motion.html.j2", "arm_motion", planned(model, trajectory))}
    made = []
    for joint in motion_plots.moving_joints(document):
        called = numbered(joint, document.joints[joint - 1].name)
        caption = f"Joint {called}: position, speed and torque over one cycle, with limits and phases."
        made.append(drawn(motion_plots.plan_of_joint(document, joint), f"plan{joint}", caption))
    legend = (
        "One cycle. Dashes and dots: limits near the curve; dotted: end of a phase; shaded: in contact. The "
        "torque is the motor's; orange: the torque of a spring, positive where it pushes the joint forward."
    )
    counted = document.objective.joints if isinstance(document, OptimizeDocument) else None
    costs = [
        (f"cost of joint {j.joint}", quantity(j.cost, f"({j.units.force})^2 s"))
        for j in document.joints
        if counted is None or j.joint in counted
    ]
    plots = Plots(add_figures(drawings, made, "plan"))
    return ReportPage(
        title=f"{model.name}: {document.scenario}",
        model=model.name,
        kind="clean",
        tag="plan",
        headline=motions.plan_headline(document),
        short=[*texts(motions.spring_lines(document)), Facts(tuple(costs), large=True), Commands(tuple(commands))],
        groups=_groups(legend, [plots, motions.plan_table(document)], notes=motions.plan_warnings(document)),
        drawings=drawings,
        document=plain(document),
    )


def execution_page(result: Execution, document: ExecuteDocument) -> ReportPage:
    """The page of an execution in which something moved; document: what --json gives."""
    cycles, model = ExecutedCycles(result), result.plan.model
    kind, tag = _STATUS[document.status]
    drawings = {"moving": part("arm_motion.html.j2", "arm_motion", cycles.picture())}
    made = []
    for k, (joint, own) in enumerate(zip(model.joints, cycles.joints, strict=True), 1):
        caption = f"Joint {numbered(k, joint.name)}: position, tracking error and torque, planned and executed."
        made.append(drawn(motion_plots.joint_cycles(own), f"executed{k}", caption))
    legend = (
        "Dashed: planned, its torque with every effect of the model. Solid: executed, all cycles except the first of a "
        "trial. Orange: the torque of a spring along the plan, positive where it pushes the joint forward."
    )
    stopped = [f"Safe stop: {sentence(document.reason or '')}"] if document.status == "stopped" else []
    commands = Commands(tuple(given(document.next) or ()))
    plots = Plots(add_figures(drawings, made, "executed"))
    notes = texts(motions.uncompensated(document), "warning")
    return ReportPage(
        title=f"{model.name}: {document.plan.scenario} executed",
        model=model.name,
        kind=kind,
        tag=tag,
        headline=motions.execution_headline(document),
        short=[*texts([*stopped, *motions.differences(document), *motions.costs(document)]), commands],
        groups=_groups(legend, [plots, *motions.execution_results(document)[:1]], notes),
        drawings=drawings,
        document=plain(document),
    )


def _groups(legend: str, by_joint: Sequence[Section], notes: Sequence[Section]) -> list[Group]:
    """The moving arm, the figures and the table of its joints, and notes where there are any."""
    groups = [
        Group("The arm in motion", (Plots(("moving",)),), "motion"),
        Group("Joint by joint", (Paragraph(legend, "note"), *by_joint), "joints"),
    ]
    return [*groups, Group("Notes", tuple(notes), "notes")] if notes else groups
