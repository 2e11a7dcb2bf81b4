"""What a person should know before trusting a fit, in words: wrong data and what to type against them, joints that are
left out, effects and inertias at their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.identification.compare import driving_speed, has_proper_inertia
from runtime.identification.factors import CURRENT, MILLI, RATIO, TWICE, WHOLE
from runtime.identification.fit import Fit
from runtime.identification.fitting import fit_motion
from runtime.identification.readings import DEGREES, MOTOR, POSITION, TORQUE, turns
from runtime.identification.regressors import OF_MASSES, arm_functions_read
from runtime.identification.wrong_data import WrongData, doubtful_data, wrong_data
from runtime.model.terms import joints_of
from runtime.motion.motion import Motion
from runtime.recordings.columns import UNITS, normal_unit
from runtime.recordings.contents import map_option
from runtime.recordings.recording import TORQUE as TORQUE_MEANING
from runtime.wording import joints_said, number, quantity
from symbolic.model_file.arm import LINK_TORQUE, MOTOR_TORQUE, WEIGHTLESS


@dataclass(frozen=True)
class Suspicion:
    """Something about the data that must be put right first. joint: 1-based; kind: in a word; cure: what to type.

    maps   the options in the cure; they hold together with those of all other suspicions of the same data
    file   the recording of several in which it is; "" where it is in all
    """

    joint: int
    kind: str
    found: str
    cure: str
    maps: tuple[str, ...] = ()
    file: str = ""

    def __str__(self) -> str:
        return f"{self.file}{': ' * bool(self.file)}joint {self.joint}: {self.found}; {self.cure}"

    def only_in(self, file: str, last: bool) -> Suspicion:
        """The same of one recording among others, which its options would read wrong; said once, of the last."""
        others = "; --map holds for every recording, and others are right: put this file right, or give it alone"
        return replace(self, file=file, cure=self.cure + others * last, maps=())


def suspicions(
    fit: Fit, files: Sequence[str] = (), held_out: Motion | None = None, held_files: Sequence[str] = ()
) -> tuple[Suspicion, ...]:
    """What the model file's structure, fitted to each recording by itself, says is wrong with it; of all together where
    each looks right. Empty where nothing does.

    fit   of all that are fitted, from files     held_out   the motion of those that are not, from held_files
    """
    parts = [(fit.motion, name, k) for k, name in enumerate(files)]
    parts += [(held_out, name, k) for k, name in enumerate(held_files) if held_out is not None]
    if len(parts) < 2:
        return _Words(fit, wrong_data(fit)).all()
    found = {}
    for motion, name, k in parts:
        if any(p.recording == k for p in motion.pieces):
            own = fit if motion is fit.motion and len(files) == 1 else _alone(fit, motion.of_recording(k))
            found[name] = _Words(own, wrong_data(own)).all()
    if len({tuple((s.joint, s.kind) for s in own) for own in found.values()}) > 1:
        return tuple(s.only_in(name, last=s is own[-1]) for name, own in found.items() for s in own)
    return next(iter(found.values())) or _Words(fit, wrong_data(fit)).all()


def _alone(fit: Fit, motion: Motion) -> Fit:
    return fit_motion(fit.model, fit.on(motion), {t: dict(v) for t, v in fit.shapes.items()}, start=fit)


def doubts(fit: Fit) -> tuple[Suspicion, ...]:
    """What may be wrong with recordings in which `suspicions` finds nothing; no verdict follows from it."""
    return _Words(fit, doubtful_data(fit)).all()


class _Words:
    """A sentence for each mistake, and the options that put right all that is wrong with a signal. Joints are 0-based.

    alone   whether the reading puts right one kind of mistake only
    """

    def __init__(self, fit: Fit, wrong: WrongData) -> None:
        self.motion, self.joints, self.space = fit.motion, fit.model.joints, fit.model.spatial
        self.wrong, self.reading = wrong, wrong.reading
        self.degrees = {*wrong.reading.joints_in(DEGREES), *self._by_factor(DEGREES)}
        self.motors = {*wrong.reading.joints_in(MOTOR), *self._by_factor(MOTOR)}
        kinds = (MILLI, CURRENT, WHOLE)
        self.unit = {i: self._torque_unit(i) for i in {i for kind in kinds for i in self._by_factor(kind)}}
        read = min(self.reading.signs) < 0, self.reading.joints_in(DEGREES, MOTOR), self.reading.exchanges()
        self.alone = sum(map(bool, read)) == 1

    def all(self) -> tuple[Suspicion, ...]:
        return (
            *(self._sign(i) for i, sign in enumerate(self.reading.signs) if sign < 0),
            *(self._in_degrees(i) for i in sorted(self.degrees)),
            *(self._of_motor(i) for i in sorted(self.motors)),
            *(self._exchanged(*pair, what) for pair, what in self.reading.exchanges()),
            *(self._in_unit(i) for i in sorted(self.unit)),
            *(self._without_ratio(i) for i in self._by_factor(RATIO)),
            *(self._twice(i) for i in self._by_factor(TWICE)),
            *self._weightless(),
            *self._rotorless(),
        )

    def _by_factor(self, kind: str) -> list[int]:
        return [i for i, factor in sorted(self.wrong.factors.items()) if kind in factor.kinds]

    def _sign(self, joint: int) -> Suspicion:
        before, after = self._errors(joint)
        how = "turned round" if self.alone else "with all that is said here put right"
        said = f"its torque has the wrong sign: as recorded the best fit misses {before} % of it, {how} {after} %"
        cure = self._torque(joint)
        expected = f"expected positive where it drives towards positive positions: pass {cure}"
        return Suspicion(joint + 1, "sign", said, cure=expected, maps=(cure,))

    def _in_degrees(self, joint: int) -> Suspicion:
        cure = self._position(joint)
        also = "".join(f"; if {self._alternative(kind, joint)}" for kind in self._alternatives(joint, DEGREES))
        said = f"expected radians: if it is in degrees, pass {cure}{also}"
        return Suspicion(joint + 1, "degrees", self._many_turns(joint), cure=said, maps=(cure,))

    def _of_motor(self, joint: int) -> Suspicion:
        kinds = (MOTOR, *self._alternatives(joint, MOTOR))
        said = "; ".join(f"if {self._alternative(kind, joint)}" for kind in kinds)
        return Suspicion(joint + 1, "motor", self._many_turns(joint), f"expected the joint's position: {said}")

    def _exchanged(self, one: int, other: int, what: tuple[str, ...]) -> Suspicion:
        a, b = one + 1, other + 1
        columns = " and ".join(f"{name}{a}" for name in what)
        said = f"what is recorded as {columns} fits joint {b}, and that of joint {b} fits joint {a}"
        if len(what) == 1:
            said = f"tau{a} follows the motion of joint {b}, and tau{b} that of joint {a}"
        option_of = {POSITION: self._position, TORQUE: self._torque}
        maps = tuple(option_of[name](joint) for name in what for joint in (one, other))
        expected = "expected position and torque of a joint under its own number: pass"
        return Suspicion(a, "exchanged", said, cure=f"{expected} {' '.join(maps)}", maps=maps)

    def _in_unit(self, joint: int) -> Suspicion:
        cure, kinds = self._torque(joint), self.wrong.factors[joint].kinds
        kind = next(k for k in (MILLI, WHOLE, CURRENT) if k in kinds)
        unknown = self.unit[joint] == "mA" and self.joints[joint].torque_constant is None
        what = "torque" if "N" in self.unit[joint] else "motor's current, for the torque_constant to multiply,"
        state = " and state the joint's torque_constant in the model file" if unknown else ""
        others = "".join(f"; if it is {self._by_ratio(joint, k)}" for k in self._instead(joint) if k in (RATIO, TWICE))
        said = f"if its {what} is in {self.unit[joint]}, pass {cure}{state}{others}"
        return Suspicion(joint + 1, kind, self._apart(joint), cure=said, maps=(cure,))

    def _without_ratio(self, joint: int) -> Suspicion:
        return Suspicion(joint + 1, RATIO, self._apart(joint), f"expected {self._by_ratio(joint, RATIO)}")

    def _twice(self, joint: int) -> Suspicion:
        others = ""
        if MILLI in self._instead(joint):
            others = "; if it is in mN m, or a current in mA, state its unit with --map"
        return Suspicion(joint + 1, TWICE, self._apart(joint), f"expected {self._by_ratio(joint, TWICE)}{others}")

    def _by_ratio(self, joint: int, kind: str) -> str:
        """What to do about a gear ratio that a torque lacks, or has once too often."""
        known = self.joints[joint].gear_ratio > 1
        ratio = f"the gear ratio of {self.joints[joint].gear_ratio:g}" if known else "its gear ratio"
        stated = "" if known else f" (near {number(self._factor(joint), 2)}), and state it in the model file"
        do = "multiply" if kind == RATIO else "divide"
        once = "" if kind == RATIO else "once "
        what = f"{do} tau{joint + 1}, or the joint's torque_constant, by it"
        return f"the motor's torque {once}times {ratio}: {what}{stated}"

    def _rotorless(self) -> list[Suspicion]:
        """Torques that were measured behind the gear."""
        option = f"--map {TORQUE_MEANING}={LINK_TORQUE}"
        if not self.wrong.rotorless:
            return []
        joints = joints_said([i + 1 for i in self.wrong.rotorless])
        said = f"the torque at {joints} has neither friction nor the inertia of the rotors in the model file"
        cure = f'if it is measured at the link, pass {option}, or state torque = "{LINK_TORQUE}" in the model file'
        return [Suspicion(min(self.wrong.rotorless) + 1, "link", said, cure, maps=(option,))]

    def _weightless(self) -> list[Suspicion]:
        """Gravity that the torques lack, or have, against what is declared."""
        found = self.wrong.weightless
        if found is None:
            return []
        if found.declared:
            cure = f"--map {TORQUE_MEANING}={MOTOR_TORQUE}"
            weight = quantity(found.weight or 0.0, self.joints[found.joint].force_unit, 3)
            said = f"its torque is declared {WEIGHTLESS} and has the weight of the model file's masses, {weight} rms"
            return [Suspicion(found.joint + 1, "gravity", said, f"if nothing took it out, pass {cure}", maps=(cure,))]
        unit = self.joints[found.joint].force_unit
        said = "its torque has no gravity: the arm's inertia fits it far better without its weight"
        if found.weight is not None:
            weight = f"{quantity(found.weight, unit, 3)} rms"
            said = f"its torque has no gravity: the weight of the masses in the model file, {weight}, is missing"
        option = f"--map {TORQUE_MEANING}={WEIGHTLESS}"
        cure = f'if the driver takes gravity out of the torque, pass {option}, or state torque = "{WEIGHTLESS}" in the '
        horizontal = "" if self.space else "; if the arm moves in a horizontal plane, state gravity = [0.0, 0.0]"
        cure += f"model file{horizontal}{self._or_current(found.joint)}"
        return [Suspicion(found.joint + 1, "gravity", said, cure, maps=(option,))]

    def _or_current(self, joint: int) -> str:
        name = f"tau{joint + 1}"
        if self.joints[joint].torque_constant is None or self.motion.units.get(name):
            return ""
        return f"; if it is a current, pass {map_option(self.motion.cells, name, name, unit='A')}"

    def _position(self, joint: int) -> str:
        source = f"q{self.reading.positions[joint] + 1}"
        return map_option(self.motion.cells, f"q{joint + 1}", source, unit="deg" if joint in self.degrees else "")

    def _torque(self, joint: int) -> str:
        source, turned = f"tau{self.reading.torques[joint] + 1}", self.reading.signs[joint] < 0
        return map_option(self.motion.cells, f"tau{joint + 1}", source, self.unit.get(joint, ""), turned=turned)

    def _torque_unit(self, joint: int) -> str:
        """The unit with which a joint's torque would be right."""
        kinds, stated = self.wrong.factors[joint].kinds, self.motion.units.get(f"tau{self.reading.torques[joint] + 1}")
        milli = "m" if MILLI in kinds else ""
        if kinds == (WHOLE,) and not stated:
            milli = "k"
        if CURRENT in kinds or (stated and UNITS[normal_unit(stated)][0] == "current") or self._rather_current(joint):
            return f"{milli}A"
        return f"{milli}N m" if self.joints[joint].type == "revolute" else f"{milli}N"

    def _rather_current(self, joint: int) -> bool:
        """Whether a torque that is too large is a current in mA: where the motor is unknown, any factor but 1000."""
        if MILLI not in self.wrong.factors[joint].kinds or self.joints[joint].torque_constant is not None:
            return False
        sure = [i for i, factor in self.wrong.factors.items() if factor.of != "limit"] or [joint]
        return 2 * float(np.median([self._factor(i) for i in sure])) < 1 / UNITS["mA"][1]

    def _factor(self, joint: int) -> float:
        ratio = self.wrong.factors[joint].fitted / self.wrong.factors[joint].stated
        return max(ratio, 1 / ratio)

    def _instead(self, joint: int) -> tuple[str, ...]:
        """What explains a joint's torque as well."""
        return self.wrong.factors[joint].alternatives

    def _alternatives(self, joint: int, kind: str) -> tuple[str, ...]:
        if joint in self.wrong.alike:
            return (MOTOR,)
        factor = self.wrong.factors.get(joint)
        return factor.alternatives if factor is not None and factor.kinds[0] == kind else ()

    def _alternative(self, kind: str, joint: int) -> str:
        """A mistake that explains a joint's inertia, and its cure."""
        k, ratio = joint + 1, f"the gear ratio of {self.joints[joint].gear_ratio:g}"
        if kind == MOTOR:
            return f"it is the motor's, divide q{k}, and qd{k} if it is recorded, by {ratio}"
        if kind == RATIO:
            return f"only the torque is the motor's, multiply tau{k}, or the joint's torque_constant, by {ratio}"
        source = f"q{self.reading.positions[joint] + 1}"
        return f"it is in degrees, pass {map_option(self.motion.cells, f'q{k}', source, 'deg')}"

    def _many_turns(self, joint: int) -> str:
        """The range of a joint's position, and what a fit says of it."""
        if joint in self.wrong.factors:
            said = self._inertia(joint)
        else:
            before, after = self._errors(joint)
            how = "with positions put right" if self.alone else "with all that is said here put right"
            said = f"the best fit misses {before} % of its torque, {how} {after} %"
        return f"its position covers {turns(self.motion, self.reading.positions[joint]):.3g} turns, and {said}"

    def _inertia(self, joint: int) -> str:
        factor = self.wrong.factors[joint]
        stated = f"the {number(factor.stated, 3)} in the model file"
        return f"its inertia comes to {number(factor.fitted, 3)}, {self._times(joint)} {stated}"

    def _apart(self, joint: int) -> str:
        """What was found beside what the model file states."""
        factor, unit = self.wrong.factors[joint], self.joints[joint].force_unit
        match factor.of:
            case "inertia":
                return self._inertia(joint)
            case "limit":
                limit = f"{self._times(joint)} the limit of {quantity(factor.stated, unit, 3)} in the model file"
                return f"its torque reaches {number(factor.fitted, 3)}, {limit}"
            case of:
                what = "the masses and inertias" if of == "stated values" else "the rotor"
                values = f"{number(factor.fitted, 3)} for {quantity(factor.stated, unit, 3)} rms"
                return f"its torque moves {what} of the model file with {self._times(joint)} what they need, {values}"

    def _times(self, joint: int) -> str:
        factor = self.wrong.factors[joint]
        if factor.fitted > factor.stated:
            return f"{number(factor.fitted / factor.stated, 4)} times"
        return f"1/{number(factor.stated / factor.fitted, 3)} of"

    def _errors(self, joint: int) -> tuple[str, str]:
        assert self.wrong.errors is not None
        before, after = (f"{100 * errors[joint]:.3g}" for errors in self.wrong.errors)
        return before, after


# --- a fit to data that do not look wrong ---


def warnings(fit: Fit, wrong: Sequence[Suspicion] | None = None) -> list[str]:
    """All warnings about a fitted model; of wrong data only these, as whatever else is odd follows from them; None: it
    is not known yet whether they are."""
    if wrong := suspicions(fit) if wrong is None else wrong:
        return [f"the data look wrong: {suspicion}" for suspicion in wrong]
    return [
        *(f"the data may be wrong: {doubt}" for doubt in doubts(fit)),
        *_joints_left_out(fit),
        *_early_torques(fit),
        *_idle_terms(fit),
        *improper_inertia(fit),
        *_driving_friction(fit),
        *_unknown_masses(fit),
        *(
            f"{name}: its interval is as wide as the stated rotor_inertia may be wrong; measure that, or leave it out"
            for name in fit.uncertainty.by_rotors
        ),
    ]


def _joints_left_out(fit: Fit) -> list[str]:
    """Joints of which nothing is fitted, and why."""
    motion, found = fit.motion, []
    for i in np.flatnonzero(np.isinf(motion.standstill)):
        passive = all(float(np.ptp(p.tau[i])) == 0 for p in motion.pieces)
        why = f"tau{i + 1} is constant, as of a joint without a motor" if passive else "it is held"
        found.append(f"joint {i + 1}: left out of the fit: {why}")
    return found


def _early_torques(fit: Fit) -> list[str]:
    """Joints whose torque leads the motion by more than a hold explains, and that no effect of the structure delays."""
    model = fit.model
    if fit.ahead is None:
        return []
    shifting = (t for t in fit.shapes if "torque_rate" in model.library.needs[t.effect])
    delayed = {joint for t in shifting for joint in joints_of(model, t)}
    return [
        f"joint {joint}: the recorded torque is {quantity(abs(time), 's', 3)} {'ahead of' if time > 0 else 'behind'} "
        "its motion, beyond half a sample of a hold; that is left in the error: tendon diagnose says by which effect"
        for joint, time in enumerate(fit.ahead.times, start=1)
        if time and joint - 1 not in delayed
    ]


def _idle_terms(fit: Fit) -> list[str]:
    """Effects whose coefficients have all come to zero, at the bound of what is physical."""
    layout, solved = fit.problem.layout, fit.coefficients
    own = {str(term): solved[layout.slices[term]] for term in layout.terms}
    idle = [term for term, part in own.items() if len(part) and not part.any()]
    if not idle:
        return []
    has, it = ("has", "it") if len(idle) == 1 else ("have", "them")
    return [f"{', '.join(idle)} {has} come to 0: the other effects do without {it}; leave {it} out if you agree"]


def improper_inertia(fit: Fit) -> list[str]:
    """That the fit wants an inertia that no arm has, and stopped at the bound of what is physical."""
    if has_proper_inertia(fit):
        return []
    return [
        "the fitted inertia is at the bound of what is physical (a D that is hardly positive definite): the base model "
        "or the data is wrong"
    ]


def _driving_friction(fit: Fit) -> list[str]:
    """Speeds near those of the data from which a joint's identified friction would drive it."""
    found = []
    for i, joint in enumerate(fit.model.joints):
        fastest = max(float(np.abs(p.qd[i]).max()) for p in fit.motion.pieces_of(i))
        speed = driving_speed(fit, i, 4 * fastest)
        if speed is not None:
            found.append(
                f"joint {i + 1}: the friction found drives the joint from {speed:.3g} {joint.position_unit}/s on; "
                f"the data reach {fastest:.3g}: use the model within them only"
            )
    return found


def _unknown_masses(fit: Fit) -> list[str]:
    """Terms whose values depend on masses that the model file leaves out, and what was taken in their place."""
    model = fit.model
    if not any({"mass", "com"} & {*joint.unknown} for joint in model.joints):
        return []
    return [
        f"{term}: the model file leaves masses or centres of mass out: its values hold for 1 kg in the middle of each "
        "such link; state gravity in the model file in its place, and the moments of the links are identified"
        for term in fit.prediction.values
        if OF_MASSES in arm_functions_read(model, term)
    ]
