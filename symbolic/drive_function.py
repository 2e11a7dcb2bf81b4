"""The generated function of an arm's drives: torques from commands, by the laws of the model file."""

from __future__ import annotations

import sympy as sp

from symbolic.functions import Argument, Author, SymbolicFunction, output
from symbolic.model_file.arm import Arm
from symbolic.model_file.drive_laws import COMMANDS, INTEGRAL, LAWS
from symbolic.primitives import WIDTH_FORCE, ramp
from symbolic.rigid_body.lagrangian import rational

_UNITS = {"position": ("rad", "m"), "rate": ("rad/s", "m/s"), "ratio": ("1", "1"), "voltage": ("V", "V")}
_UNITS |= {"current": ("A", "A")}


def functions(author: Author, arm: Arm) -> list[SymbolicFunction]:
    """`drive_torque` of an arm whose drives all have a law with known gains; empty for any other arm."""
    drives = [joint.drive for joint in arm.joints if joint.drive is not None and joint.drive.law is not None]
    pairs = [(LAWS[drive.law or ""], drive.gains) for drive in drives]
    if len(pairs) < len(arm.joints) or any(None in law.coefficients(gains) for law, gains in pairs):
        return []
    of, used = author.coordinates, set[sp.Symbol]()
    names = [*COMMANDS, INTEGRAL]
    rows = {name: of.symbols(name) for name in ("q", "qd", *names)}
    recorder, torques = author.recorder(), []

    def switched(x: sp.Expr) -> sp.Expr:
        """A ramp over a named value: one within another would be a condition of both."""
        # A drive switches in branches on all targets: the width is dropped.
        return recorder.let("above", ramp(recorder.let("beyond", x), WIDTH_FORCE))

    for i, (law, stated) in enumerate(pairs):
        gains = {key: rational(value) for key, value in stated.items()}
        torque = law.torque({name: row[i] for name, row in rows.items()}, gains, switched)
        torques.append(torque)
    used = used.union(*(sp.sympify(e).free_symbols for e in (*torques, *(e for _, e in recorder.live(torques)))))
    inputs: list[str | Argument] = ["q", "qd"]
    inputs += [_argument(author, name) for name in names if used & set(rows[name])]
    tau = output("tau", torques, unit=of.force, meaning="torques at the joints' outputs")
    laws_said = ", ".join(dict.fromkeys(law.equation for law, _ in pairs))
    return [
        author.function(
            "drive_torque",
            inputs,
            tau,
            recorder,
            doc=f"Torques that the drives make: {laws_said}.",
            notation={"beyond": "what a limit or a dead zone is of", "above": "its part above zero"},
            source="The laws under [joint.drive] of the model file",
        )
    ]


def _argument(author: Author, name: str) -> Argument:
    of = author.coordinates
    symbols = tuple(of.symbols(name))
    if name == INTEGRAL:
        unit, meaning = of.unit("rad s", "m s"), "q_desired - q, integrated over time"
    else:
        unit, meaning = of.unit(*_UNITS[COMMANDS[name].kind]), COMMANDS[name].meaning
    return Argument(name, symbols, (len(symbols),), unit=unit, meaning=meaning)
