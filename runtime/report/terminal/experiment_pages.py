"""A proposed experiment for people, from the dictionary that --json writes."""

from __future__ import annotations

from runtime.model.terms import Term
from runtime.report.terminal.cells import Document, say
from runtime.wording import number, numbered, sentence


def show(document: Document) -> None:
    """The verdict, the motion and what it asks of the joints, what it separates, and what the diagnosis made of it."""
    say(("SEPARATED: " if document["separated"] else "NOT SEPARATED: ") + sentence(document["reason"]), "")
    for rival in document["rivals"]:
        values = ", ".join(f"{name} {number(value)}" for name, value in rival["values"].items())
        say(f"{_name(rival)} as it was simulated: {values}")
    motion = document["motion"]
    say(f"Motion: {number(motion['seconds'], 3)} s, {motion['times']} times through")
    say(*(f"  {piece}" for piece in motion["pieces"]))
    say(*(_joint(joint) for joint in motion["joints"]))
    if not all(j[f"{what}_stated"] for j in motion["joints"] for what in ("position", "speed", "torque")):
        say("  assumed: the model file states no limit; of the torque, what the ordinary excitation asks of the model")
    say("", "Left of the torque of one when the other has explained what it can, in noise floors:")
    say(*(_separation(s) for s in document["separations"]), "")
    _trials("this motion", document["trials"])
    _trials("the ordinary excitation", document["ordinary_trials"])
    for change in document["relief"]:
        enough = "enough" if change["enough"] else "not enough"
        say(f"With {change['change']}: {number(change['sigmas'], 3)} standard deviations apart, {enough}.")
    if document.get("out"):
        say(f"Written: {document['out']}")


def _name(place: Document) -> str:
    return str(Term(place["effect"], place["joint"]))


def _joint(j: Document) -> str:
    low, high = (number(x, 3) for x in j["position"])
    least, most = (number(x, 3) for x in j["position_limits"])
    known = {what: "" if j[f"{what}_stated"] else " assumed" for what in ("position", "speed", "torque")}
    speed, force, at_most = (number(j[key], 3) for key in ("speed", "torque", "torque_with_rivals"))
    rivals = f", {at_most} with a rival" if at_most != force else ""
    return (
        f"  joint {numbered(j['joint'], j['name'])}: {low} to {high} {j['position_unit']} "
        f"(of {least} to {most}{known['position']}), "
        f"up to {speed} {j['position_unit']}/s (of {number(j['speed_limit'], 3)}{known['speed']}) "
        f"and {force} {j['force_unit']}{rivals} (of {number(j['torque_limit'], 3)}{known['torque']})"
    )


def _separation(s: Document) -> str:
    other = "the model as it is" if s["explained_by"] is None else _name(s["explained_by"])
    after, before = number(s["after"], 3), number(s["before"], 3)
    return f"  {_name(s['hidden'])} by {other}: {after}, with the ordinary excitation {before}"


def _trials(motion: str, trials: list[Document]) -> None:
    wrong = dict.fromkeys(t["problem"] for t in trials if not t["right"])
    say(f"Diagnosed with {motion}: " + (f"{'; '.join(wrong)}." if wrong else f"right in all {len(trials)} recordings."))
