"""C of an arm's effects: their values as a struct, their memories as another, and what they add to the torque.

The file has the functions of the effects that the model file names, so it needs no library beside it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import sympy as sp

from codegen import effect_functions as ef
from codegen.c import c_code, c_effects
from codegen.c.c_code import Precision, Routine, comment, declaration, indent
from codegen.open_numbers import open_values
from codegen.tape.tape import Tape
from symbolic.controller_law import Site, active
from symbolic.effects.declaration import DT, SIGNALS, Effect
from symbolic.effects.signals import ArmOutput, Coordinate, Given, JointConstant, Signal
from symbolic.functions import Coordinates, Struct, SymbolicFunction
from symbolic.model import ArmModel
from symbolic.rigid_body.base_parameters import exact

_MOTION = ("q", "qd", "qdd")
_COMPUTED = ("t", "elapsed", "load", "level", "warmth", "unmeasured", "has_next")
"""Signals without a source that the generated code knows; without a thermometer, warmth is 0 K."""
VALUES, MEMORY = "effect_values", "memory"
"""Arguments of the functions, and ends of the names of their structs."""


@dataclass(frozen=True)
class ArmEffects:
    """The effects of an arm in its generated code.

    sites   in the order of the model file     left_out   with the signals that only the whole torque or another run has
    """

    model: ArmModel
    library: Mapping[str, Effect]
    sites: tuple[Site, ...]
    left_out: tuple[tuple[Site, str], ...]
    values: Struct

    @classmethod
    def of(cls, model: ArmModel, library: Mapping[str, Effect]) -> ArmEffects:
        """The effects of an arm. library: all effects by name."""
        stated = list(active(model, library))
        lacks = {site: ", ".join(s.name for s in site.effect.signals if not _known(s)) for site, _ in stated}
        kept = [(site, values) for site, values in stated if not lacks[site]]
        return cls(
            model,
            library,
            tuple(site for site, _ in kept),
            tuple((site, reads) for site, reads in lacks.items() if reads),
            _struct(model, kept),
        )

    @property
    def remembers(self) -> bool:
        """Whether what an effect adds depends on the samples before."""
        return any(e.states or {"t", "elapsed"} & {s.name for s in e.signals} for e in self._effects)

    @property
    def memory_size(self) -> int:
        """Numbers in the memory: the time, and the states of every effect."""
        return 1 + sum(len(site.effect.states) for site in self.sites)

    @property
    def open_values(self) -> list[str]:
        """The values that the model file leaves open."""
        return [s.symbol(p).name for s, p in open_values(self.model, self.library) if s in self.sites]

    @property
    def _effects(self) -> list[Effect]:
        return list({site.effect.name: site.effect for site in self.sites}.values())

    def types(self, precision: Precision) -> list[str]:
        """Comment and structs of the header."""
        kept = c_effects.types(self._effects, precision)[1:]
        states = [
            f"    {c_effects.state_type(site.effect, precision)} {_place(site)};"
            for site in self.sites
            if site.effect.states
        ]
        time = f"    {precision.kind} time; {comment('s: since the start')}"
        memory = [comment("What the effects keep from one sample to the next."), "typedef struct {", time, *states]
        return [
            comment(*self._said()),
            c_code.struct_type(self.model.arm.name, self.values, precision),
            *kept,
            "\n".join([*memory, f"}} {self._type(MEMORY, precision)};"]),
        ]

    def _said(self) -> Iterable[str]:
        yield "Included: " + (", ".join(map(str, self.sites)) or "no effect") + "."
        yield from (f"Not included: {site} (reads {reads})." for site, reads in self.left_out)

    def _type(self, what: str, precision: Precision) -> str:
        return f"{self.model.arm.name}_{what}_{precision.suffix}"

    def inner(self, precision: Precision) -> list[Routine]:
        """The functions of the effects themselves."""
        found = (routine for effect in self._effects for routine in c_effects.routines(effect, precision))
        return [replace(routine, attribute="static inline ") for routine in found]

    def routines(self, precision: Precision) -> list[Routine]:
        """Values of the model file, start, what the effects add, and step."""
        return [
            c_code.defaults(self.model.arm.name, self.values, precision, self.open_values),
            self._start(precision),
            self._add(precision),
            self._step(precision),
        ]

    def _start(self, precision: Precision) -> Routine:
        body = _Body(self, precision)
        body.lines.append(f"{MEMORY}->time = {precision.language.literal(Fraction(0))};")
        for site in self._with_states():
            body.lines.append(f"{body.call(site, ef.start(site.effect), self._own(site))};")
        return self._routine("effects_start", "The memory before the first sample.", body, [f"*{MEMORY}"])

    def _step(self, precision: Precision) -> Routine:
        body = _Body(self, precision)
        for site in self._with_states():
            body.lines.append(f"{body.call(site, ef.step(site.effect), self._own(site))};")
        body.lines.append(f"{MEMORY}->time += dt;")
        text = f"The memory a sample later, dt s; called after {self.model.arm.name}_effects_add."
        return self._routine("effects_step", text, body, ["dt", f"*{MEMORY}"])

    def _add(self, precision: Precision) -> Routine:
        body = _Body(self, precision)
        for site in self.sites:
            for joint in range(len(self.model.arm.joints)):
                if site.acts_on(joint + 1):
                    body.lines.append(f"tau[{joint}] += {body.call(site, ef.torque(site.effect), joint)};")
                    body.count.update(add=1, arithmetic=1)
        text = "Adds to tau, such as that of inverse_dynamics, what the effects add to the motors' torques."
        n = len(self.model.arm.joints)
        return self._routine("effects_add", text, body, [f"const *{MEMORY}", f"tau[{n}]"])

    def _with_states(self) -> list[Site]:
        return [site for site in self.sites if site.effect.states]

    def _own(self, site: Site) -> int:
        # Effects with a memory that read the arm's inertia between two joints are left out; all others have a joint.
        return (site.joint or 1) - 1

    def _routine(self, name: str, text: str, body: _Body, further: Sequence[str]) -> Routine:
        """A function of parameters, values and the motion, and of what comes further."""
        precision, arm = body.precision, self.model.arm.name
        arguments = [f"const {arm}_parameters_{precision.suffix} *parameters"]
        arguments += [f"const {self._type(VALUES, precision)} *{VALUES}"]
        arguments += [f"const {precision.kind} {row}[{len(self.model.arm.joints)}]" for row in _MOTION]
        for one in further:
            kind = self._type(MEMORY, precision) if MEMORY in one else precision.kind
            arguments.append(f"const {kind} {one.removeprefix('const ')}" if "const" in one else f"{kind} {one}")
        lines = body.complete()
        used = "\n".join(lines)
        names = ["parameters", VALUES, *_MOTION, *(one.split("*")[-1].split("[")[0] for one in further)]
        lines = [*(f"(void){n};" for n in names if not re.search(rf"\b{n}\b", used)), *lines]
        head = f"void {arm}_{name}_{precision.suffix}"
        of = Coordinates(tuple(joint.type for joint in self.model.arm.joints))
        said = [f"in   {c_code.quantity(of.argument(row))}" for row in _MOTION]
        n = len(self.model.arm.joints)
        said += [f"out  tau ({n}) [{of.force}]: what stood there, and the effects"] if "tau" in names[-1] else []
        note = comment(f"{name}: {text}", *said, f"Operations: {c_code.operations(body.count)}")
        return Routine(note, declaration(head, arguments), indent(lines, 1))


def _known(signal: Signal) -> bool:
    return signal.name in _COMPUTED or (signal.source is not None and not signal.between)


def _place(site: Site) -> str:
    return f"{site.effect.scope if site.joint is None else f'joint{site.joint}'}_{site.effect.name}"


def _struct(model: ArmModel, sites: Sequence[tuple[Site, Mapping[str, float]]]) -> Struct:
    fields = [
        (
            site.symbol(p),
            p.unit.text("revolute" if site.joint is None else model.arm.joints[site.joint - 1].type),
            p.meaning,
            values.get(p.name, 0.0 if p.role == "linear" else p.default),
        )
        for site, values in sites
        for p in site.effect.parameters
    ]
    # C has no empty structs.
    fields = fields or [(sp.Symbol("none"), "1", "there is no effect", 0.0)]
    symbols, units, meanings, defaults = zip(*fields, strict=True)
    return Struct(VALUES, symbols, units, meanings=meanings, defaults=defaults)


@dataclass
class _Body:
    """The statements of a function, and before them those that make the signals they read."""

    of: ArmEffects
    precision: Precision
    ahead: dict[str, list[str]] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    count: Counter[str] = field(default_factory=lambda: Counter(arithmetic=0))

    def complete(self) -> list[str]:
        """All statements in order."""
        return [line for lines in self.ahead.values() for line in lines] + self.lines

    def call(self, site: Site, function: SymbolicFunction, joint: int) -> str:
        """The call of an effect's function for its torque at a joint (0-based)."""
        tape = Tape.of(function)
        self.count.update(tape.count())
        takes = c_effects.signature(site.effect, function, tape)
        own = {p.symbol: f"{VALUES}->{site.symbol(p).name}" for p in site.effect.parameters} | {DT: "dt"}
        known = {s.symbol: s for s in SIGNALS}
        texts = [own.get(a.symbols[0]) or self._signal(known[a.symbols[0]], site, joint) for a in takes.inputs]
        if takes.reads_state or takes.writes_state:
            texts.append(f"&{MEMORY}->{_place(site)}")
        return f"tendon_{function.name}_{self.precision.suffix}({', '.join(texts)})"

    def _literal(self, number: float) -> str:
        return self.precision.language.literal(Fraction(number))

    def _signal(self, signal: Signal, site: Site, joint: int) -> str:
        """A signal as an effect at `site` reads it for its torque at a joint (0-based)."""
        joints, source = self.of.model.arm.joints, signal.source
        match source:
            case Coordinate(name, step):
                there = joint + step
                return f"{name}[{there}]" if 0 <= there < len(joints) else self._literal(0)
            case JointConstant(name):
                return self.precision.language.literal(exact(getattr(joints[joint], name)))
            case Given(absent):
                given = [s.symbol(p).name for s in self.of.sites for p in s.effect.parameters if p.gives == signal.name]
                return f"{VALUES}->{given[0]}" if given else self._literal(absent)
            case ArmOutput(function, index):
                return f"{self._output(function)}[{self._index(function, index, joint)}]"
        match signal.name:
            case "t" | "elapsed":
                return f"{MEMORY}->time"
            case "warmth" | "unmeasured" | "has_next":
                return self._literal({"warmth": 0, "unmeasured": 1}.get(signal.name, joint + 1 == site.joint))
            case "load":
                return f"{self._load()}[{joint}]"
        return self._level(joint)

    def _index(self, function: str, index: Sequence[object], joint: int) -> int:
        place = 0
        for length, i in zip(self.of.model.function(function).outputs[0].shape, index, strict=False):
            place = place * length + (i if isinstance(i, int) else joint)
        return place

    def _output(self, name: str) -> str:
        """The array with the output of one of the arm's functions, which is computed first."""
        function = self.of.model.function(name)
        if name not in self.ahead:
            self.count.update(Tape.of(function).count())
        passed = ", ".join(["parameters", *(a.name for a in function.inputs), name])
        self.ahead[name] = [
            f"{self.precision.kind} {name}[{len(function.outputs[0].expressions)}];",
            f"{self.of.model.arm.name}_{name}_{self.precision.suffix}({passed});",
        ]
        return name

    def _load(self) -> str:
        """The array with the torques on the links: of the links, and of what else the transmissions carry."""
        if "load" not in self.ahead:
            joints, links = range(len(self.of.model.arm.joints)), self._output("link_load")
            borne = [site for site in self.of.sites if site.effect.carried]
            lines = [f"{self.precision.kind} load[{len(joints)}];"]
            for joint in joints:
                here = [self.call(s, ef.torque(s.effect), joint) for s in borne if s.acts_on(joint + 1)]
                added = f" + ({' + '.join(here)})" if here else ""
                lines.append(f"load[{joint}] = {links}[{joint}]{added};")
            self.ahead["load"] = lines
        return "load"

    def _level(self, joint: int) -> str:
        dry = [s for s in self.of.sites if s.joint == joint + 1 and s.effect.dry]
        total = " + ".join(self.call(s, ef.torque(s.effect), joint) for s in dry) or self._literal(0)
        return f"tendon_abs_{self.precision.suffix}({total})"
