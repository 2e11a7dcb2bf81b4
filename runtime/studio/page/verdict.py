"""The verdict: at the head of the page in one sentence with what to do next, below it the cards of what was found."""

from __future__ import annotations

from functools import partial
from typing import Any

from runtime.studio.history import PlacedEffect, SessionStep
from runtime.studio.page import trying
from runtime.studio.page.parts import button, filled_part, folded, put
from runtime.studio.page.start import cure_button, cures
from runtime.studio.page.view import PageView
from runtime.studio.shown import Row, VerdictShown
from runtime.wording import number, percent

KINDS = ("effect", "more", "clean", "unexplained", "refused")
"""Of a verdict: each has its colour."""

TAGS = {"effect": "effect found", "more": "effect found, more is left", "clean": "clean"}


def banner(view: PageView) -> None:
    """One sentence, the errors, and the next thing to do."""
    step, found = view.here, view.verdict
    assert step is not None
    kind, tag = ("comparison", "comparison") if found is None else (found["kind"], found["tag"])
    kind = kind if kind in KINDS else "comparison"
    with put("p", classes="of"):
        put("span", tag, f"tag {kind}")
        put("span", f"step {step.number}: {step.title}")
    put("h1", _sentence(view, step, found).replace(" %", "\N{NO-BREAK SPACE}%"))
    if found is not None and found["more"]:
        put("p", found["more"])
    elif found is None and step.parent is not None:
        quiet = all(joint["at_floor"] for joint in view.shown["joints"])
        put("p", "What is left of every joint's torque is at its noise floor." if quiet else view.shown["sentence"])
    _facts(view, step)
    if kind != "refused":
        cures(view, view.shown["cures"])
    with put("div", classes="acts"):
        for cure in view.shown["cures"] if kind == "refused" else ():
            cure_button(view, cure)  # the sentence says what is wrong
        _next(view, found)


def _sentence(view: PageView, step: SessionStep, found: VerdictShown | None) -> str:
    """The verdict; of a step that is not diagnosed what it did to the error, of the model as given where it fails."""
    if found is not None:
        return found["sentence"]
    if step.parent is None:
        return view.shown["sentence"]
    before = view.studio.history.step(step.parent)
    pairs = list(zip(before.joints, step.joints, strict=True))
    old, new = max(pairs, key=lambda pair: abs(pair[0].relative - pair[1].relative))
    how = "falls" if new.relative < old.relative else "rises"
    names = ", ".join(map(str, step.changed))
    done = f"With {names}" if step.kind == "added" else f"Without {names}"
    return f"{done} the error of joint {new.called} {how} from {percent(old.relative)} to {percent(new.relative)}."


def _facts(view: PageView, step: SessionStep) -> None:
    """Errors of the joint that is looked into, from the model as given to this step."""
    first, joint = view.studio.history.steps[0], view.joint["joint"] - 1
    given, here = first.joints[joint], step.joints[joint]

    def fall(before: float, after: float) -> str:
        return percent(after) if step.number == 0 else f"{percent(before)} → {percent(after)}"

    facts = [("error", fall(given.relative, here.relative)), ("noise floor", percent(here.relative_floor))]
    if view.verdict is not None and view.verdict["left_over"]:
        facts.append(("noise of the instruments alone", percent(view.joint["instruments"])))
    if here.held is not None and given.held is not None:
        facts.append(("error, held out", fall(given.held, here.held)))
        if here.held_floor is not None:
            facts.append(("noise floor, held out", percent(here.held_floor)))
    with put("dl", classes="facts"):
        for name, value in facts:
            with put("div"):
                put("dt", name if len(step.joints) == 1 else f"joint {here.called}: {name}")
                put("dd", value)


def _next(view: PageView, found: VerdictShown | None) -> None:
    """The next step of the loop first."""
    studio, busy = view.studio, view.busy
    if found is None:
        button(
            "Look for what is missing", lambda: view.act(studio.diagnose), "first", disabled=busy, data_do="diagnose"
        )
        return
    effects = [placed(card) for card in found["findings"]]
    if effects:
        names = " and ".join(card["title"] for card in found["findings"])
        text = f"Add {names} and fit again" if len(names) < 70 else f"Add all {len(effects)} and fit again"
        button(text, lambda: view.act(lambda: studio.add(*effects)), "first", disabled=busy, data_do="add")
    if found["findings"]:
        put("a", "See the evidence", href="#findings")
    if found["left_over"]:
        put("a", "What is left unexplained", href="#left-over")
    if found["to_record"]:
        put("a", "What to record", href="#record")
    if found["limits"]:
        put("a", "What was looked for and not found", href="#limits")
    if not effects and found["kind"] != "refused":
        put("a", "Would I see an effect in this motion?", href="#ask")


def placed(row: Row) -> PlacedEffect:
    """An effect and its place, of a card or of a rival."""
    return PlacedEffect(row["effect"], row["joint"])


def cards(view: PageView) -> None:
    """What was found, each with its evidence and a button."""
    found = view.verdict
    assert found is not None
    put("h2", "Findings" if len(found["findings"]) > 1 else "Finding")
    for k, card in enumerate(found["findings"], start=1):
        with put("article", classes="card"):
            put("h3", f"{k}. {card['title']}" if len(found["findings"]) > 1 else card["title"], id_=f"finding{k}")
            with put("div", classes="acts"):
                _add(view, placed(card), f"Add {card['title']}", "first")
                shows = int(card["shows_at"])
                if view.joint["joint"] != shows:
                    button(f"Show joint {shows}", partial(view.set, chosen=shows))
                for rival in card["rival_terms"]:
                    effect = placed(rival)
                    _add(view, effect, f"Try {effect} instead")
                trying.designing(view, [placed(card), *map(placed, card["rival_terms"])])
            filled_part("finding_of", {**card, "figures": []})
            with put("div", data_values=card["title"]):
                put("h4", "Try other values before it is added")
                trying.values(view, card, f"{placed(card)}-")


def _add(view: PageView, effect: PlacedEffect, text: str, classes: str = "") -> None:
    button(text, lambda: view.act(lambda: view.studio.add(effect)), classes, disabled=view.busy, data_do="add-one")


def beside(view: PageView) -> None:
    """What else the data say: what is left, what to record, what was ruled out, and what would have been seen."""
    found = view.verdict
    assert found is not None
    if found["left_over"]:
        put("h2", "What is left unexplained", id_="left-over")
        filled_part("left_over_of", found["left_over"], len(view.shown["joints"]) > 1)
    if found["to_record"]:
        put("h2", "What to record", id_="record")
        filled_part("to_record_of", found["to_record"])
    if found["experiments"]:
        put("h2", "The experiment that would decide", id_="experiment")
        filled_part("experiments_of", found["experiments"])
    _not_found(found)
    if found["kind"] != "effect" and found["commands"]:
        put("h2", "Go on in a terminal", id_="terminal")
        for command in found["commands"]:
            put("p", f"This {command['what']}:", "of")
            put("pre", str(command["command"]))
    if found["warnings"]:
        put("h2", "Warnings")
        for warning in found["warnings"]:
            put("p", warning, "warning")


def _not_found(found: VerdictShown) -> None:
    ruled: dict[str, Any] = found["ruled_out"]
    if count := sum(map(len, ruled.values())):
        put("h2", "Considered, and not named")
        with folded(f"{number(count)} candidates and what each of them lacks"):
            filled_part("ruled_out_of", ruled)
    if found["limits"]:
        put("h2", "What was looked for and not found", id_="limits")
        put("p", "With this these recordings would have shown it; a smaller effect may be present and unseen.", "of")
        filled_part("limits_of", found["limits"])
