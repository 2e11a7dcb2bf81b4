"""The verdict: in one sentence with what to do next, and in full with the evidence of each finding."""

from __future__ import annotations

from functools import partial

from runtime.studio.history import PlacedEffect
from runtime.studio.page import questions
from runtime.studio.page.joints import change
from runtime.studio.page.start import cure_button, cures
from runtime.studio.page.view import TAGS, PageView, button, put, report_sections
from runtime.wording import percent

KINDS = (*TAGS, "unexplained", "refused")
"""Verdicts that have a colour."""


def banner(view: PageView) -> None:
    """The verdict in one sentence, the errors, and the next thing to do."""
    step, found = view.step, view.verdict
    kind, tag = ("comparison", "comparison") if found is None else (found.kind, found.tag)
    kind = kind if kind in KINDS else "comparison"
    with put("p", classes="of"):
        put("span", tag, f"tag {kind}")
        put("span", f"step {step.number}: {step.title}")
    put("h1", _sentence(view).replace(" %", "\N{NO-BREAK SPACE}%"))
    if found is not None and found.more:
        put("p", found.more)
    elif found is None and step is not view.given:
        at_floor = all(joint.at_floor for joint in view.overview.joints)
        put("p", "The residual of every joint is at its noise floor." if at_floor else view.overview.sentence)
    _facts(view)
    if kind != "refused":
        cures(view, view.overview.cures)
    with put("div", classes="acts"):
        for cure in view.overview.cures if kind == "refused" else ():
            cure_button(view, cure)  # the sentence says what is wrong
        _next(view)


def _sentence(view: PageView) -> str:
    """The verdict; before it where the model fails, or what the step did to the error."""
    step = view.step
    if view.verdict is not None:
        return view.verdict.sentence
    if step.parent is None or step.kind == "given":
        return view.overview.sentence
    pairs = list(zip(view.studio.history.step(step.parent).joints, step.joints, strict=True))
    own = [pair for pair in pairs if pair[1].joint == step.changed[0].joint]
    old, new = max(own or pairs, key=lambda pair: abs(pair[0].relative - pair[1].relative))
    before, after = percent(old.relative), percent(new.relative)
    what = f"{'With' if step.kind == 'added' else 'Without'} {', '.join(map(str, step.changed))}"
    if before == after:
        does = "fall" if step.kind == "added" else "rise"
        return f"{what} the error of joint {new.called} does not {does}: it stays at {after}."
    how = "falls" if new.relative < old.relative else "rises"
    return f"{what} the error of joint {new.called} {how} from {before} to {after}."


def _facts(view: PageView) -> None:
    """Errors of the joint that is shown, from the model as given to this step."""
    step, joint = view.step, view.joint.joint - 1
    here, first = step.joints[joint], view.given.joints[joint]
    before, held_before = (None, None) if step is view.given else (first.relative, first.held)
    facts = {"error": change(before, here.relative), "noise floor": percent(here.relative_floor)}
    if view.verdict is not None and view.verdict.unexplained:
        facts["sensor noise alone"] = percent(view.joint.instruments)
    if here.held is not None:
        facts["error, held out"] = change(held_before, here.held)
        if here.held_floor is not None:
            facts["noise floor, held out"] = percent(here.held_floor)
    with put("dl", classes="facts"):
        for name, value in facts.items():
            with put("div"):
                put("dt", name if len(step.joints) == 1 else f"joint {here.called}: {name}")
                put("dd", value)


def _next(view: PageView) -> None:
    """The next step of the loop, then links to the details."""
    studio, closed, found = view.studio, view.closed, view.verdict
    if found is None:
        button(
            "Look for missing effects", lambda: view.act(studio.diagnose), "first", disabled=closed, data_do="diagnose"
        )
        return
    if found.findings:
        names = " and ".join(finding.title for finding in found.findings)
        text = f"Add {names} and fit again" if len(names) < 70 else f"Add all {len(found.findings)} and fit again"
        effects = [finding.placed for finding in found.findings]
        button(text, lambda: view.act(studio.add, *effects), "first", disabled=closed, data_do="add")
    if found.findings:
        put("a", "See the evidence", href="#findings")
    elif found.kind != "refused":
        put("a", "Would an effect be named in this motion?", href="#ask")
    for group in found.details:
        put("a", group.title, href=f"#{group.name}")


def findings(view: PageView) -> None:
    """The findings, each with its evidence and a button that adds it."""
    found = view.verdict
    assert found is not None
    several = len(found.findings) > 1
    put("h2", "Findings" if several else "Finding")
    for k, finding in enumerate(found.findings, start=1):
        with put("article", classes="card"):
            put("h3", f"{k}. {finding.title}" if several else finding.title, id_=f"finding{k}")
            with put("div", classes="acts"):
                _add(view, finding.placed, f"Add {finding.title}", "first")
                if view.joint.joint != finding.shows_at:
                    button(f"Show joint {finding.shows_at}", partial(view.show_joint, finding.shows_at))
                for rival in finding.rivals:
                    _add(view, rival, f"Add {rival} instead")
                effects = [finding.placed, *finding.rivals]
                text = f"Design a motion: {' or '.join(map(str, effects))}"
                design = partial(view.act, view.studio.design, *effects)
                button(text, design, disabled=view.closed, data_do="design")
            report_sections(finding.card)
            with put("div", data_values=finding.title):
                put("h4", "Try other values before you add it")
                questions.sliders(view, finding, f"{finding.placed}-")


def _add(view: PageView, effect: PlacedEffect, text: str, classes: str = "") -> None:
    button(text, lambda: view.act(view.studio.add, effect), classes, disabled=view.closed, data_do="add-one")


def details(view: PageView) -> None:
    """The rest of the diagnosis: what is unexplained, what to record, candidates that were not named, limits."""
    assert view.verdict is not None
    report_sections(view.verdict.details, level=2)
