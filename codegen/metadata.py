"""metadata.json and effects.json: the description of an arm and of the library for the runtime."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from codegen.c.c_effects import LANES
from codegen.tape.tape import Tape
from symbolic import units as u
from symbolic.described import DescribedEffect, DescribedParameter, UnitOfJoint, to_json
from symbolic.effects.declaration import SIGNALS, Effect, Signal, prefix
from symbolic.functions import SymbolicFunction
from symbolic.model_file.arm import DescribedJoint, Joint
from symbolic.rigid_body.base_parameters import Lump
from symbolic.rigid_body.spatial.geometry import places


def text(data: Mapping[str, Any]) -> str:
    """Indented JSON with keys in the given order."""
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def arm(model: Any, tapes: Mapping[str, Tape]) -> dict[str, object]:
    """metadata.json of an ArmModel. The lumps' values include the arm's inertial overrides."""
    file = model.arm
    struct = model.struct
    return {
        "name": file.name,
        "gravity": list(file.stated_gravity),
        "space": file.space,
        "n": len(file.joints),
        "joints": [_joint(joint) for joint in file.joints],
        "places": [list(place) for place in places(file)],
        "effects": _values(file.effects),
        "contact": None if file.contact is None else {"x": file.contact.x, "effects": _values(file.contact.effects)},
        "controller": None if file.controller is None else asdict(file.controller),
        "lumps": [_lump(lump) for lump in model.lumps],
        "open": [number._asdict() for number in model.open],
        "struct": [
            {"name": s.name, "unit": unit, "meaning": meaning, "default": default}
            for s, unit, meaning, default in zip(
                struct.symbols, struct.units, struct.meanings, struct.defaults, strict=True
            )
        ],
        "functions": {f.name: _function(f, tapes[f.name]) for f in model.functions},
    }


def _joint(joint: Joint) -> dict[str, object]:
    units = {"force": u.FORCE.text(joint.type), "position": u.POSITION.text(joint.type)}
    document = {**to_json(joint, DescribedJoint), "units": units}
    return {**document, "unknown": list(joint.unknown)} if joint.unknown else document


def _lump(lump: Lump) -> dict[str, object]:
    said = {"name": lump.name, "unit": lump.unit, "meaning": lump.meaning, "joint": lump.joint, "value": lump.value}
    return said | ({"parts": [[j, own, float(f)] for j, own, f in lump.parts]} if lump.parts else {})


def _values(effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    return {name: dict(values) for name, values in effects.items()}


def _function(function: SymbolicFunction, tape: Tape) -> dict[str, object]:
    return {
        "inputs": [[a.name, list(a.shape)] for a in function.inputs],
        "outputs": [[o.name, list(o.shape)] for o in function.outputs],
        "doc": function.doc,
        "source": function.source,
        "operations": tape.count(),
    }


def library(effects: Sequence[Effect]) -> dict[str, object]:
    """effects.json."""
    return {
        "signals": [_signal(signal) for signal in SIGNALS],
        "lanes": LANES,
        "effects": [_effect(effect) for effect in effects],
    }


def _signal(signal: Signal) -> dict[str, object]:
    source = signal.source
    return {
        "name": signal.name,
        "unit": to_json(signal.unit, UnitOfJoint),
        "meaning": signal.meaning,
        "needs": signal.needs,
        "source": None if source is None else {"kind": type(source).__name__, **asdict(source)},
        "known_to": signal.known_to,
        "seen_over": signal.seen_over,
        "sensor": signal.sensor,
    }


def _effect(effect: Effect) -> dict[str, object]:
    """The declaration of an effect and what follows from its equations."""
    return {
        **to_json(effect, DescribedEffect),
        "signals": [s.name for s in effect.signals],
        "coefficients": [to_json(c, DescribedParameter) for c in effect.coefficients],
        "from_parameters": None if effect.form is None else [prefix(e) for e in effect.form.from_parameters],
        "recover": None if effect.form is None else [prefix(e) for e in effect.form.recover],
        "states": [s.name for s in effect.states],
        "deflection": effect.deflection,
    }
