"""Any effect of the library, to try: what it is, where, and a button that adds it."""

from __future__ import annotations

from runtime.studio.history import PlacedEffect
from runtime.studio.page.parts import button, put
from runtime.studio.page.view import PageView
from runtime.studio.shown import EffectOffered


def library(view: PageView) -> None:
    """Choose an effect and its place, and add it."""
    assert view.here is not None
    offered = {e["effect"]: e for e in view.studio.library(view.here.number) if e["places"]}
    put("h2", "Try another effect")
    put("p", "Added, fitted and judged on the same recordings; what it does can be undone.", "of")
    if not offered:
        put("p", "Every effect of the library is in the model.", "of")
        return
    name, joint = view.offered or ("", None)
    chosen = offered.get(name) or next(iter(offered.values()))
    place = joint if joint in chosen["places"] else chosen["places"][0]
    with put("div", classes="acts"):
        view.controls.choice(
            "try-effect",
            "effect",
            [(e["effect"], f"{e['effect']} ({e['family']})") for e in offered.values()],
            chosen["effect"],
            lambda value: view.set(offered=(value, place)),
        )
        _places(view, chosen, place)
        effect = PlacedEffect(chosen["effect"], place)
        button(f"Add {effect}", lambda: view.act(lambda: view.studio.add(effect)), disabled=view.busy, data_do="try")
    put("p", chosen["summary"])
    with put("p"):
        put("code", f"torque = {chosen['equation']}")


def _places(view: PageView, chosen: EffectOffered, place: int | None) -> None:
    if len(chosen["places"]) > 1:
        options = [("" if p is None else str(p), "whole arm" if p is None else f"joint {p}") for p in chosen["places"]]
        here = "" if place is None else str(place)
        view.controls.choice(
            "try-where",
            "where",
            options,
            here,
            lambda v: view.set(offered=(chosen["effect"], int(v) if v else None)),
        )
