"""Sufficient statistics of an arm's linear parameters: products of regressor and torque, added up on the board."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from codegen.c.c_code import Precision, assign, indent
from codegen.monitor.settings import HALF_POWER, ROWS_OVER_CUTOFF, STAGE, STAGES
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.controller_law import Site
from symbolic.described import declared
from symbolic.effects.declaration import SIGNAL, Effect
from symbolic.model import ArmModel
from symbolic.model_file.arm import ArmMonitor, Control

_MOTION = ("q", "qd", "qdd")
_READ = {SIGNAL[name].symbol for name in _MOTION}


def kernels(period: float) -> list[NDArray[np.float64]]:
    """(TAPS,) each: smoothing, and first and second derivative of what is smoothed, of frames `period` s apart.

    Moving means commute with differences: STAGES means of a signal, fewer of its differences over a mean's length. The
    short kernels make the three agree to the fourth order of frequency times period. Source: B-splines, Unser 1999.
    """

    def means(count: int) -> NDArray[np.float64]:
        found = np.ones(1)
        for _ in range(count):
            found = np.convolve(found, np.full(STAGE, 1 / STAGE))
        return found

    difference = np.zeros(STAGE + 1)
    difference[0], difference[-1] = 1 / (STAGE * period), -1 / (STAGE * period)
    made = [
        np.convolve(means(STAGES), np.array([1, 10, 1]) / 12),
        np.convolve(np.convolve(means(STAGES - 1), difference), np.array([-1, 13, 13, -1]) / 24),
        np.convolve(means(STAGES - 2), np.convolve(difference, difference)),
    ]
    longest = max(len(kernel) for kernel in made)
    return [np.pad(kernel, (longest - len(kernel)) // 2) for kernel in made]


@dataclass(frozen=True)
class JointColumns:
    """What a joint's torque is linear in. lumps: places among the arm's; effects: sites, coefficients and columns"""

    lumps: tuple[int, ...]
    effects: tuple[tuple[Site, str, sp.Expr], ...]
    fixed: sp.Expr

    @property
    def size(self) -> int:
        """Number of columns, and the torque."""
        return len(self.lumps) + len(self.effects) + 1


@dataclass(frozen=True)
class ModelStatistics:
    """The statistics of an arm. frame: control periods; block: frames of a row; left_out: effects without columns"""

    model: ArmModel
    monitor: ArmMonitor
    control: Control
    joints: tuple[JointColumns, ...]
    left_out: tuple[str, ...]
    frame: int
    block: int

    @classmethod
    def of(cls, model: ArmModel, library: Mapping[str, Effect]) -> ModelStatistics | None:
        """The statistics that a model file asks for; None where it asks for none. library: all effects by name."""
        monitor, control = model.arm.monitor, model.arm.controller
        if monitor is None or control is None or not monitor.statistics:
            return None
        rows, p = model.function("regressor").outputs[0].expressions, len(model.lumps)
        joints, left_out = [], []
        for j, joint in enumerate(model.arm.joints):
            columns, fixed = [], sp.S.Zero
            for name, values in joint.effects.items():
                site = Site(declared(name, library), j + 1)
                found = _columns(site.effect, values)
                if found is None:
                    left_out.append(str(site))
                    continue
                fixed += found[0]
                columns += [(site, c.name, x) for c, x in zip(site.effect.coefficients, found[1], strict=True)]
            lumps = tuple(k for k in range(p) if rows[j * p + k] != 0)
            joints.append(JointColumns(lumps, tuple(columns), fixed))
        left_out += [*model.arm.effects, *(model.arm.contact.effects if model.arm.contact else ())]
        frame = max(1, round(control.rate * HALF_POWER / (STAGE * monitor.cutoff)))
        block = max(1, round(control.rate / (frame * ROWS_OVER_CUTOFF * monitor.cutoff)))
        return cls(model, monitor, control, tuple(joints), tuple(left_out), frame, block)

    def holes(self, precision: Precision) -> dict[str, object]:
        """The holes of header and source."""
        name, n, literal = self.model.arm.name, len(self.joints), precision.language.literal
        sizes = [joint.size for joint in self.joints]
        made = kernels(self.frame / self.control.rate)
        tasks = 2 * n + 1
        return {
            "name": name,
            "NAME": name.upper(),
            "n": n,
            "lumps": len(self.model.lumps),
            "guard": f"TENDON_{name.upper()}_STATISTICS_{precision.suffix.upper()}_H",
            "real": precision.kind,
            "suffix": precision.suffix,
            "taps": len(made[0]),
            "kernels": [[literal(Fraction(float(x))) for x in kernel] for kernel in made],
            "frame": self.frame,
            "mean": literal(Fraction(1, self.frame)),
            "block": self.block,
            "part": literal(Fraction(1, self.block)),
            "tasks": tasks,
            "budget": -(-(3 * n + 1) // self.frame),
            "most": max(sizes),
            "halves": literal(Fraction(4097 if precision.suffix == "f32" else 134217729)),
            "sizes": sizes,
            "firsts": [sum(sizes[:j]) for j in range(n)],
            "values": sum(sizes),
            "places": [sum(s * (s + 1) // 2 for s in sizes[:j]) for j in range(n)],
            "products": self.products,
            "near": len(made[0]) // 4,
            "slowest": [literal(Fraction(x.slowest * self.frame / self.control.rate)) for x in self.monitor.joints],
            "nought": literal(Fraction(0)),
            "columns": self._columns(precision),
        }

    @property
    def products(self) -> int:
        """Number of all joints' products, each of which stands once."""
        return sum(joint.size * (joint.size + 1) // 2 for joint in self.joints)

    def _columns(self, precision: Precision) -> str:
        """Statements for `row`: of every joint its columns, then its torque less what needs no coefficient."""
        n, p = len(self.joints), len(self.model.lumps)
        targets: list[str] = []
        expressions: list[sp.Expr] = []
        leaves = {sp.Symbol(f"{name}{j}", real=True): f"{name}[{j}]" for j in range(n) for name in _MOTION}
        for j, joint in enumerate(self.joints):
            own = {SIGNAL[name].symbol: sp.Symbol(f"{name}{j}", real=True) for name in _MOTION}
            given = [sp.Symbol(f"rigid{j * p + k}", real=True) for k in joint.lumps]
            leaves |= {symbol: f"rigid[{j * p + k}]" for symbol, k in zip(given, joint.lumps, strict=True)}
            torque = sp.Symbol(f"torque{j}", real=True)
            leaves[torque] = f"torque[{j}]"
            expressions += [*given, *(x.xreplace(own) for _, _, x in joint.effects), torque - joint.fixed.xreplace(own)]
        targets = [f"row[{i}]" for i in range(len(expressions))]
        tape = Tape.from_expressions(expressions, (), leaves, where="columns")
        taken = frozenset({*_MOTION, "rigid", "torque", "row"})
        lines, texts = Printer(precision.language, tape, leaves, taken).print()
        used = {node.value for node in tape.nodes if node.op == "leaf"}
        unread = [f"(void){x};" for x in _MOTION if not any(leaves[s].startswith(f"{x}[") for s in used if s in leaves)]
        return indent(unread + lines + assign(targets, texts), 1)

    def document(self) -> dict[str, object]:
        """Of controller.json: the layout of the products, and how rows are made."""
        names = [lump.name for lump in self.model.lumps]
        return {
            "frame": self.frame,
            "block": self.block,
            "products": self.products,
            "joints": [
                {
                    "lumps": [names[k] for k in joint.lumps],
                    "effects": [[site.effect.name, coefficient] for site, coefficient, _ in joint.effects],
                }
                for joint in self.joints
            ],
            "left_out": list(self.left_out),
        }


def _columns(effect: Effect, values: Mapping[str, float]) -> tuple[sp.Expr, Sequence[sp.Expr]] | None:
    """The part without coefficient and the columns of an effect with its file's shape, in the joint's own motion; None
    for an effect that remembers, reads more, or whose shape is unknown."""
    known = {p.symbol: sp.Float(values[p.name]) for p in effect.parameters if p.name in values}
    found = [sp.sympify(x).xreplace(known) for x in (effect.fixed, *effect.columns)]
    others = {s.symbol for s in SIGNAL.values()} - _READ | {p.symbol for p in effect.parameters}
    if effect.states or any(x.free_symbols & others for x in found):
        return None
    return found[0], found[1:]


def labels(statistics: ModelStatistics) -> Iterator[str]:
    """For people: what each joint's products are of."""
    for j, joint in enumerate(statistics.joints, 1):
        own = [statistics.model.lumps[k].name for k in joint.lumps]
        yield f"joint {j}: {', '.join([*own, *(f'{site.effect.name} {c}' for site, c, _ in joint.effects), 'torque'])}"
