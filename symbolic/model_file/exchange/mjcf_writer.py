"""An arm written as MJCF: its effects as joints, springs, tendons and passive motors that MuJoCo 4 plays.

The first n actuators are the motors, in the joints' order; a motor's control times its gear is the joint's torque.
Source: MuJoCo 4.0, XML reference; Computation, section Polynomial forces.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

from symbolic import elements as e
from symbolic.model_file.arm import Frame
from symbolic.model_file.exchange.exporting import TIP, ExportedArm, ExportedJoint, about, number, numbers, unit_axis

Attributes = dict[str, str | float | None]
"""Of an XML element; those that are None are left out."""

STEP = 2e-4
"""s; the file's step: at it, implicitfast is stable for all that is written here."""
FINEST_STEP = 2e-5
"""s; a motor's history holds its delay at steps as short as this."""
FAR = 1e6
"""rad, m, N m or N, beyond all of an arm: the end of a dead band or of a range that has none."""
EDGE = 1e-3
"""rad or m over which a one-sided torque rises: at STEP, steeper is not stable."""
BRISTLE = 1e-6
"""rad or m by which bristles bend that stand for friction that depends on the rate alone."""
RATIO = 0.01
"""Damping ratio of such bristles with the joint's inertia; with more, friction lags behind the rate."""
LEAST = 0.01
"""part of the other; the lower one of sliding and static friction, which bristles divide by."""
KNOTS = 8
"""pieces of a spline between 0 and the further end of the range."""
RANGE = {"revolute": math.pi, "prismatic": 1.0}
"""rad, m to either side; of a joint without limits."""
SPEED = {"revolute": 3.0, "prismatic": 1.0}
"""rad/s, m/s; of a joint without a limit of speed."""
SHARP: Attributes = {"solreffriction": "0.0001 1", "solimpfriction": "0.9999 0.9999 0.001"}
"""Dry friction nearly without creep: a rate below it dies out within 0.1 ms, or two of MuJoCo's steps."""
SOFT = 1e-4
"""The impedance of a limit that is a spring with a damper: so little of other torques' acceleration does it take."""
DEFLECTION = "_deflection"
"""End of the name of the second joint of an elastic joint: the link's position less the motor's."""


def mjcf_text(made: ExportedArm) -> str:
    """The text of an MJCF."""
    parts = [_Parts(joint) for joint in made.joints]
    for k, drive in made.of(e.CoupledDrive):
        parts[(k or 1) - 1].couple(parts[k or 1], drive)
    tendons = [line for part in parts for line in part.tendons]
    lines = [*about(made), f"<mujoco model={quoteattr(made.arm.name)}>"]
    lines += ['  <compiler angle="radian" eulerseq="XYZ" autolimits="true"/>']
    lines += [f'  <option gravity="{numbers(made.arm.gravity)}" timestep="{STEP:g}" integrator="implicitfast"/>']
    lines += ["  <worldbody>"]
    for depth, part in enumerate(parts):
        lines += [f"{'  ' * (depth + 2)}{line}" for line in part.body]
    indent = "  " * (len(parts) + 2)
    lines += [f"{indent}{line}" for line in _tip(made)]
    lines += [f"{'  ' * (depth + 2)}</body>" for depth in reversed(range(len(parts)))]
    lines += ["  </worldbody>"]
    if tendons:
        lines += ["  <tendon>", *(f"    {line}" for line in tendons), "  </tendon>"]
    lines += ["  <actuator>", *(f"    {part.motor}" for part in parts)]
    lines += [f"    {line}" for part in parts for line in part.passive]
    return "\n".join([*lines, "  </actuator>", "</mujoco>"]) + "\n"


def _tag(tag: str, /, **attributes: str | float | None) -> str:
    """An empty element; attributes that are None are left out."""
    stated = {key: value for key, value in attributes.items() if value is not None}
    texts = {key: value if isinstance(value, str) else number(value) for key, value in stated.items()}
    return f"<{tag} {' '.join(f'{key}={quoteattr(value)}' for key, value in texts.items())}/>"


def _pose(frame: Frame) -> str:
    return f'pos="{numbers(frame.xyz)}" euler="{numbers(frame.rpy)}"'


def _tip(made: ExportedArm) -> Iterator[str]:
    """The tip's place and the point masses there."""
    yield f'<site name="{TIP}" {_pose(made.arm.tip)}/>'
    for k, (_, mass) in enumerate(made.of(e.TipMass), 1):
        yield f'<body name="payload{k}" {_pose(made.arm.tip)}>'
        place = numbers((mass.x, mass.y, mass.z))
        yield f"  {_tag('inertial', pos=place, mass=mass.mass, diaginertia='0 0 0')}"
        yield "</body>"


@dataclass
class _Parts:
    """What a joint becomes. body: lines of its beginning; motor; tendons; passive: further actuators."""

    joint: ExportedJoint
    body: list[str] = field(default_factory=list)
    motor: str = ""
    tendons: list[str] = field(default_factory=list)
    passive: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.name = self.joint.name
        self.elastic = bool(self.joint.of(e.Compliance, e.Gap))
        self.constant = float(sum(element.torque for element in self.joint.of(e.ConstantTorque)))
        self.linear, self.quadratic, self.cubic = self.joint.damping, 0.0, 0.0
        self._dampers()
        self._springs()
        friction = self._friction()
        self._waves()
        self._joints(friction)
        self._motor()

    # --- velocity ---

    def _dampers(self) -> None:
        """The damping polynomial, and brakes for one direction."""
        self.cubic += sum(element.coefficient for element in self.joint.of(e.CubicDamper))
        speed = self.joint.joint.limits.speed or SPEED[self.joint.joint.type]
        for element in self.joint.of(e.PowerDamper):
            first, second, third = power_fit(element.exponent, speed)
            self.linear += element.torque * first
            self.quadratic += element.torque * second
            self.cubic += element.torque * third
        if difference := float(sum(element.coefficient for element in self.joint.of(e.AbsoluteDamper))):
            # The smaller coefficient in both directions, and the rest where it is larger.
            self.linear -= abs(difference)
            ends = (-FAR, 0.0) if difference > 0 else (0.0, FAR)
            self._clipped("brake", (0.0, 0.0, -2 * abs(difference)), ends)

    def _clipped(self, what: str, bias: tuple[float, float, float], ends: tuple[float, float], on: str = "") -> None:
        place = {"tendon": on} if on else {"joint": self.name}
        name = f"{self.name}_{what}{len(self.passive) + 1}"
        law = {"gainprm": "0", "biastype": "affine", "biasprm": numbers(bias), "forcerange": numbers(ends)}
        self.passive.append(_tag("general", name=name, **place, **law))

    def _friction(self) -> float | None:
        """The joint's own dry friction; bristles have what changes with the rate, or all of it if it is theirs."""
        sliding, creeping = self.joint.friction, self.joint.of(e.CreepFriction)
        excess = sum(element.torque for element in creeping)
        speed = creeping[0].speed if creeping else 1.0
        if bristles := self.joint.of(e.Bristles):
            if sliding + max(excess, 0.0) > 0:
                self._bristled(sliding, sliding + excess, speed, bristles[0].stiffness, bristles[0].damping)
            return None
        if excess:
            # What rises with the rate is less at rest than the friction that it is part of.
            own = max(-excess, 0.0)
            inertia = self.joint.rotor if self.elastic else 1 / self.joint.mobility
            stiffness = min(abs(excess) / BRISTLE, inertia / STEP**2)
            damping = 2 * RATIO * math.sqrt(stiffness * inertia)
            self._bristled(own, own + excess, speed, stiffness, damping)
            sliding -= own
        return sliding or None

    def _bristled(self, sliding: float, static: float, speed: float, stiffness: float, damping: float) -> None:
        least = LEAST * max(sliding, static)
        levels = (max(sliding, least), max(static, least))
        self._passive_motor("friction", lugre=numbers((stiffness, damping, *levels, speed)))

    def _passive_motor(self, what: str, **attributes: str) -> None:
        name = f"{self.name}_{what}{len(self.passive) + 1}"
        plain = {"input": "none", "motorconst": "0 0", "resistance": "1"}
        self.passive.append(_tag("dcmotor", name=name, joint=self.name, **plain, **attributes))

    # --- position ---

    def _waves(self) -> None:
        for wave in self.joint.of(e.Wave):
            order = wave.order * self.joint.joint.gear_ratio
            # The motor's torque is against the cogging, and a cosine is a sine a quarter turn on.
            self._passive_motor("ripple", cogging=numbers((wave.amplitude, order, wave.phase - math.pi / 2)))

    def _springs(self) -> None:
        spring = self.joint.spring
        if self.elastic and spring is not None:
            self.link("spring", stiffness=spring.stiffness, springlength=_one(spring.rest))
        for curved in self.joint.of(e.CurvedSpring):
            self._curved(curved)
        damped = {(d.side, d.place): d.coefficient for d in self.joint.of(e.OneSidedDamper)}
        for side in self.joint.of(e.OneSidedSpring):
            band = _beyond(side.side, side.place)
            if damping := damped.get((side.side, side.place), 0.0):
                soft = _soft(side.stiffness, damping, self.joint.mobility)
                self.link("stop", range=band, solreflimit=soft[0], solimplimit=soft[1])
            else:
                self.link("spring", stiffness=side.stiffness, springlength=band)
        for torque in self.joint.of(e.OneSidedTorque):
            if torque.torque:
                steep = torque.torque / EDGE
                line = (steep * (torque.place - torque.side * EDGE / 2), -steep, 0.0)
                low, high = sorted((0.0, -torque.side * torque.torque))
                self._clipped("pull", line, (low, high), on=self.link("pull") if self.elastic else "")
        for slider in self.joint.of(e.YieldingSpring):
            self.tendons += self.tendon(
                "slider", {self.name: 1.0}, stiffness=slider.stiffness, springyield=slider.limit, springlength="0"
            )

    def _curved(self, spring: e.CurvedSpring) -> None:
        """A cubic about 0, and for the fourth power a cubic beyond each knot of a spline of evenly spaced ones.

        It differs from the fourth power by h^4/32 at most, h the distance of the knots: its error is the fourth
        Bernoulli polynomial. Source: Schoenberg 1973, Cardinal Spline Interpolation.
        """
        limits, c4 = self.joint.joint.limits.position, spring.fourth
        reach = RANGE[self.joint.joint.type] if limits is None else max(map(abs, limits))
        h = reach / KNOTS
        middle = (spring.first, spring.second - c4 * h**2, spring.third + 2 * h * c4)
        self.link("spring", stiffness=numbers(middle), springlength="0")
        if c4:
            self.constant += c4 * h**4 / 32
            for k in range(1, KNOTS):
                self.link("spring", stiffness=numbers((0.0, 0.0, 4 * h * c4)), springlength=_beyond(1, k * h))
            for k in range(KNOTS):
                self.link("spring", stiffness=numbers((0.0, 0.0, -4 * h * c4)), springlength=_beyond(-1, -k * h))

    def link(self, what: str, **attributes: str | float | None) -> str:
        """A tendon whose length is the link's position; its name."""
        parts = {self.name: 1.0}
        if self.elastic:
            parts[self.name + DEFLECTION] = 1.0
        self.tendons += self.tendon(what, parts, **attributes)
        return self._last

    def tendon(self, what: str, parts: dict[str, float], **attributes: str | float | None) -> list[str]:
        """The lines of a tendon whose length is the sum of joints' positions times their parts."""
        self._last = f"{self.name}_{what}{len(self.tendons) // 2 + 1}"
        opening = _tag("fixed", name=self._last, **attributes).removesuffix("/>") + ">"
        inside = "".join(_tag("joint", joint=joint, coef=part) for joint, part in parts.items())
        return [opening, f"  {inside}</fixed>"]

    def couple(self, second: _Parts, drive: e.CoupledDrive) -> None:
        """A tendon whose length grows with both joints' motors."""
        sizes = {"frictionloss": drive.friction, "damping": drive.damping, "armature": drive.inertia}
        stated: Attributes = {word: size for word, size in sizes.items() if size}
        self.tendons += self.tendon("coupled", {self.name: 1.0, second.name: drive.ratio}, **stated, **SHARP)

    # --- joint and motor ---

    def _joints(self, friction: float | None) -> None:
        joint, spring = self.joint.joint, None if self.elastic else self.joint.spring
        limits = joint.limits
        polynomial = [self.linear, self.quadratic, self.cubic]
        place: Attributes = {
            "type": "hinge" if joint.type == "revolute" else "slide",
            "axis": numbers(unit_axis(self.joint)),
        }
        own = _tag(
            "joint",
            name=self.name,
            **place,
            armature=self.joint.rotor,
            damping=numbers(polynomial if any(polynomial[1:]) else polynomial[:1]),
            frictionloss=friction,
            **(SHARP if friction else {}),
            stiffness=None if spring is None else spring.stiffness,
            springref=None if spring is None else spring.rest,
            range=None if limits.position is None else numbers(limits.position),
        )
        xx, xy, xz, yy, yz, zz = self.joint.body.inertia
        self.body = [f"<body name={quoteattr(f'{self.name}_link')} {_pose(joint.origin)}>", f"  {own}"]
        for element in self.joint.of(e.Compliance):
            behind: Attributes = {"stiffness": element.stiffness, "damping": element.damping}
            self.body.append(f"  {_tag('joint', name=self.name + DEFLECTION, **place, **behind)}")
        for gap in self.joint.of(e.Gap):
            soft = _soft(gap.stiffness, gap.damping, self.joint.mobility + 1 / self.joint.rotor)
            flanks = {"range": numbers((-gap.width / 2, gap.width / 2)), "solreflimit": soft[0], "solimplimit": soft[1]}
            self.body.append(f"  {_tag('joint', name=self.name + DEFLECTION, **place, **flanks)}")
        com, inertia = numbers(self.joint.body.com), numbers((xx, yy, zz, xy, xz, yz))
        self.body.append(f"  {_tag('inertial', pos=com, mass=self.joint.body.mass, fullinertia=inertia)}")

    def _motor(self) -> None:
        gear, limit = self.joint.joint.gear_ratio, self.joint.joint.limits.torque
        gain = math.prod(1 / element.factor for element in self.joint.of(e.Gain))
        lag, delay = (float(sum(element.time for element in self.joint.of(kind))) for kind in (e.Lag, e.Delay))
        attributes: Attributes = {"name": self.name, "joint": self.name, "gear": gear}
        if delay:
            samples = math.ceil(delay / FINEST_STEP) + 1
            attributes |= {"delay": delay, "nsample": str(samples), "interp": "linear"}
        plain = dict(attributes)
        if lag:
            attributes |= {"dyntype": "filterexact", "dynprm": lag}
        if gain != 1:
            attributes |= {"gainprm": gain}
        if self.constant:
            attributes |= {"biastype": "affine", "biasprm": numbers((-self.constant / gear, 0.0, 0.0))}
        ends = None if limit is None else numbers((-limit / gear, limit / gear))
        self.motor = _tag("motor" if attributes == plain else "general", **attributes, forcerange=ends)


def _one(place: float) -> str:
    return numbers((place, math.nextafter(place, math.inf) if place == -1 else place))


def _beyond(side: float, place: float) -> str:
    return numbers((-FAR, place) if side > 0 else (place, FAR))


def _soft(stiffness: float, damping: float, mobility: float) -> tuple[str, str]:
    """solref and solimp of a limit whose force is max(0, k depth + d rate).

    At a small impedance MuJoCo's force is the acceleration that solref asks for, over the limit's mobility at q = 0.
    """
    return numbers((-stiffness * mobility, -damping * mobility)), numbers((SOFT, SOFT, 1e-3))


def power_fit(exponent: float, speed: float) -> tuple[float, float, float]:
    """The coefficients a, b, c with the least squares of v^p - (a v + b v^2 + c v^3) for 0 < v < speed.

    Its equations have the Hilbert matrix of 1/(i + j + 1), i, j = 1..3, whose inverse is known.
    """
    right = [1 / (exponent + i + 1) for i in (1, 2, 3)]
    inverse = ((300.0, -900.0, 630.0), (-900.0, 2880.0, -2100.0), (630.0, -2100.0, 1575.0))
    a, b, c = (sum(x * y for x, y in zip(row, right, strict=True)) for row in inverse)
    return a * speed ** (exponent - 1), b * speed ** (exponent - 2), c * speed ** (exponent - 3)
