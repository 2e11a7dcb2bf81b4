"""What the tests of planning share: small arms without friction, and scenarios for them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from codegen.prepare import prepare_arm
from runtime.model.loader import Library, Model
from runtime.planning import scenario_file
from runtime.planning.scenario import Scenario
from symbolic.model_file.arm import Arm, Joint, Limits, planar, planar_link
from symbolic.model_file.checks import Place

LINK = planar_link(mass=2.0, com=(0.2, 0.0), inertia=0.0565)
INERTIA = 0.2365  # kg m² of one joint: 0.1 of the rotor, 0.0565, and 2 kg at 0.2 m
MASS = 2.1  # kg that one prismatic joint moves: 0.1 of the rotor and the link


def arm(
    library: Library,
    kinds: str,
    limits: Limits | None = None,
    effects: Mapping[str, dict[str, float]] | None = None,
    torque_constant: float | None = None,
) -> Model:
    """Equal joints, "r" or "p" each, in the horizontal plane; the effects are those of the last one."""
    joints = [
        Joint(
            "revolute" if kind == "r" else "prismatic",
            rotor_inertia=0.1,
            gear_ratio=100.0,
            link=LINK,
            effects=dict(effects or {}) if i == len(kinds) - 1 else {},
            limits=limits or Limits(),
            torque_constant=torque_constant,
        )
        for i, kind in enumerate(kinds)
    ]
    return Model(prepare_arm(planar(Arm(f"arm_{kinds}", (0.0, 0.0, 0.0), tuple(joints)), [0.3] * len(kinds))), library)


def parsed(model: Model, table: Mapping[str, Any]) -> Scenario:
    """A scenario as the reader of files makes it."""
    return scenario_file.fitted(scenario_file.parse(table, Place("test.toml")), model, "test.toml")


def there(model: Model, T: float, start: Mapping[str, Any], end: Mapping[str, Any], **other: Any) -> Scenario:
    """From rest at one point to rest at another, once; degree 5 unless told otherwise."""
    table = {
        "name": "there",
        "model": model.name,
        "cycle_time": T,
        "periodic": False,
        "points": {"start": {**start, "rest": True}, "end": {**end, "rest": True}},
        "phase": [{"from": "start", "to": "end", "part": 1.0, "degree": other.pop("degree", 5)}],
    }
    return parsed(model, {**table, **other})


def and_back(model: Model, T: float, start: Mapping[str, Any], end: Mapping[str, Any], **other: Any) -> Scenario:
    """From one point to another and back, over and over; degree 8, neither half turns back."""
    phase = {"part": 0.5, "degree": 8, "monotone": True}
    table = {
        "name": "and_back",
        "model": model.name,
        "cycle_time": T,
        "points": {"start": {**start, "rest": True}, "end": {**end, "rest": True}},
        "phase": [{"from": "start", "to": "end", **phase}, {"from": "end", "to": "start", **phase}],
    }
    return parsed(model, {**table, **other})
