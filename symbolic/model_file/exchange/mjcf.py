"""MJCF read with the package `mujoco`, which knows its defaults, includes and inertias from shapes.

Shapes that are only drawn, and mesh files, are left out. The size that includes and repetitions expand to is checked
before MuJoCo expands them. Source: the XML reference at mujoco.readthedocs.io.
"""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import LARGEST, ModelError, printable, quote
from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.tree import NOTHING, StatedBody, Tree, TreeJoint, TreeLink, packed, shortened
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import Rotation, Vector, about, angles, composed, product, scaled, transposed

MAX_UNFOLDED = 10_000
"""Elements with all their repetitions; MuJoCo takes a second for them, and squares it for more. The largest models of
robots that are published for it have a few thousand."""
MAX_NUMBERS = 100_000_000
"""Of a grid of heights or colours, of which nothing is read."""
REPEATED = ("replicate", "composite", "flexcomp")
"""Elements that stand for `count` times, in each of up to three directions, what is in them."""
GRIDS = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
"""Elements that fill memory by numbers."""
INCLUDED, ATTACHED = "include", "attach"
OTHER_FILES = (INCLUDED, "model")
"""Elements whose `file` is MJCF that MuJoCo reads, too."""


def check_unfolded(root: XmlNode, path: Path) -> None:
    """Nothing in the file, nor in those that it names, becomes more than MAX_UNFOLDED elements.

    Raises ModelError, at the line where it does.
    """
    _Unfolding(path.parent, {path.resolve()}).add(root)


@dataclass
class _Unfolding:
    """The elements of a file and of what it includes, added up.

    seen: files that were read; largest: elements of the largest of the models that it may attach; attached: how often
    it attaches one, each taken to be the largest
    """

    folder: Path
    seen: set[Path]
    count: int = 0
    largest: int = 0
    attached: float = 0.0

    def add(self, root: XmlNode) -> None:
        """A file's own, and those of the files that it names."""
        todo = [(root, 1.0)]
        while todo:
            node, times = todo.pop()
            if node.tag in REPEATED:
                times *= math.prod(_counts(node, "count"))
            if math.prod(max(_counts(node, key)) for key in GRIDS.get(node.tag, ())) > MAX_NUMBERS:
                node.fail(f"<{node.tag}> has more numbers than a robot needs; make it smaller, or leave it out")
            self.count += round(min(times, 1.0 + MAX_UNFOLDED))
            if node.tag == ATTACHED:
                self.attached += min(times, 1.0 + MAX_UNFOLDED)
            if node.tag in OTHER_FILES and node.attributes.get("file"):
                self._other(node.tag, self.folder / node.attributes["file"])
            if self.count + self.attached * self.largest > MAX_UNFOLDED:
                node.fail(f"unfolds into more than {MAX_UNFOLDED:,} elements; expected the description of a robot")
            todo += [(child, times) for child in node.children]

    def _other(self, tag: str, path: Path) -> None:
        """With a file that is named; of one that is not there, or was there before, MuJoCo says so itself."""
        if not path.is_file() or path.resolve() in self.seen:
            return
        self.seen.add(path.resolve())
        root = xml_file.read(path)
        if tag == INCLUDED:
            self.add(root)
            return
        model = _Unfolding(self.folder, self.seen)
        model.add(root)
        size = model.count + round(model.attached * model.largest)
        self.count, self.largest = self.count + size, max(self.largest, size)


def _counts(node: XmlNode, key: str) -> list[float]:
    """The numbers of an attribute that are above 1; what is none, MuJoCo says itself."""
    found = [1.0]
    for word in node.attributes.get(key, "").split():
        try:
            found.append(max(1.0, float(word)))
        except ValueError:
            continue
    return found


UNSEEN = ("keys", "sensors", "pairs", "excludes", "skins", "flexes", "equalities", "tendons")
"""Parts of a description that say nothing of a single arm, but may refer to shapes that are not read."""
NUMBERS = (
    *("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia", "site_pos", "site_quat"),
    *("jnt_pos", "jnt_axis", "jnt_stiffness", "qpos0", "qpos_spring", "dof_damping", "dof_frictionloss"),
    *("dof_armature", "actuator_gear", "actuator_armature", "actuator_damping"),
)
"""What is taken of the compiled model, where this MuJoCo knows it; MuJoCo lets some of it be no number."""
SUFFIX = ".xml"
"""By which MuJoCo knows a description."""
RESERVED = ("memory", "njmax", "nconmax", "nstack")
RESERVED_BY_USERS = ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")
"""Room that a description asks for, and numbers of users beside its parts: MuJoCo knows itself what an arm needs."""


@dataclass(frozen=True)
class CompiledMjcf:
    """model: MuJoCo's; unknown: names of bodies whose inertia the file does not state, in which the model has some;
    gravity in m/s²; notes: what of the file is not part of an arm, a line each."""

    model: Any
    name: str
    unknown: frozenset[str]
    gravity: Vector
    notes: tuple[str, ...]


def compiled(path: Path, root: XmlNode) -> CompiledMjcf:
    """The file as MuJoCo understands it.

    root   of the file, by which it is judged before MuJoCo unfolds it
    Raises ModelError: `mujoco` is not installed or too old, refuses the file, or finds what is no number.
    """
    file = printable(str(path))
    mujoco = _package(file)
    check_unfolded(root, path)
    try:
        with _heard(mujoco) as warned:
            spec = _spec(mujoco, path, root)
            _check_numbers(root, warned)
            notes = list(_no_part_of_an_arm(spec))
            _without_room(spec)
            unknown = _without_shapes(mujoco, spec)
            model = spec.compile()
    except ModelError:
        raise
    except (ValueError, OSError, RuntimeError, MemoryError) as error:
        raise ModelError(f"{file}: MuJoCo says: {printable(' '.join(str(error).split()))}") from None
    x, y, z = (float(g) for g in model.opt.gravity)
    known = ((name, getattr(model, name).flat) for name in NUMBERS if hasattr(model, name))
    for what, values in (("gravity", (x, y, z)), *known):
        for value in values:
            if not abs(value) <= LARGEST:
                raise ModelError(f"{file}: MuJoCo's {what} is {value:g}; expected magnitudes up to {LARGEST:g}")
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        notes.append("gravity is switched off by a flag of the file: taken as 0")
        x, y, z = 0.0, 0.0, 0.0
    said = (f"MuJoCo warns: {printable(' '.join(text.split()))}" for text in warned)
    return CompiledMjcf(model, spec.modelname, frozenset(unknown), (x, y, z), (*said, *notes))


def _package(file: str) -> Any:
    """mujoco. Raises ModelError where it is not installed, or too old."""
    try:
        mujoco = importlib.import_module("mujoco")
    except ImportError:
        raise ModelError(
            f"{file}: MJCF is read by the package mujoco, which is not installed: pip install mujoco (the extra `mjcf`)"
        ) from None
    if not hasattr(getattr(mujoco, "MjSpec", None), "delete"):
        raise ModelError(
            f"{file}: MJCF needs a newer mujoco than {printable(str(mujoco.__version__))}: pip install --upgrade "
            "mujoco (the extra `mjcf`)"
        )
    return mujoco


def _spec(mujoco: Any, path: Path, root: XmlNode) -> Any:
    """What MuJoCo makes of a file; it goes by the name, and finds others by the place of a file alone."""
    if path.suffix.lower() == SUFFIX:
        return mujoco.MjSpec.from_file(str(path))
    others = next((node for node in root.everything() if node.tag in OTHER_FILES), None)
    if others is not None:
        others.fail(f"<{others.tag}> of another file is read of a file that ends in {SUFFIX} alone; rename this one")
    return mujoco.MjSpec.from_string(path.read_bytes().decode())


def _check_numbers(root: XmlNode, warned: list[str]) -> None:
    """MuJoCo warns of a NaN, and takes it for a number that was left out. Raises ModelError, at its line."""
    if not any("nan" in text.lower() for text in warned):
        return
    for node in (root, *root.everything()):
        for key, value in node.attributes.items():
            if key != "name" and any(word.lstrip("+-").startswith("nan") for word in value.lower().split()):
                node.fail(f"<{node.tag}> {key} is {quote(value)}; expected numbers that are finite")
    root.fail("a file that it includes has a NaN; expected numbers that are finite")


@contextmanager
def _heard(mujoco: Any) -> Iterator[list[str]]:
    """What MuJoCo warns of meanwhile, which it would write to the screen and to a file in the user's folder."""
    texts: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(texts.append)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield texts
    finally:
        mujoco.set_mju_user_warning(before)


def _no_part_of_an_arm(spec: Any) -> Iterator[str]:
    """What has torques in MuJoCo and none in an arm's equations."""
    if len(spec.equalities) + len(spec.tendons):
        yield "equality constraints and tendons are not part of an arm: left out"
    if any(body.gravcomp != 0 for body in spec.bodies):
        yield "gravcomp, which takes bodies' weight away, is not part of an arm: left out"
    if spec.option.density or spec.option.viscosity:
        yield "the drag of air or water (density, viscosity) is not part of an arm: left out"


def _without_room(spec: Any) -> None:
    """Take away what fills memory by a single number and says nothing of an arm."""
    spec.nuserdata = spec.nkey = 0
    for name in (*RESERVED, *(f"nuser_{part}" for part in RESERVED_BY_USERS)):
        setattr(spec, name, -1)
    for actuator in spec.actuators:
        actuator.actdim = -1


def _without_shapes(mujoco: Any, spec: Any) -> set[str]:
    """Take away what is only drawn, and what needs a file of a mesh: the names of bodies whose inertia that leaves
    unknown, which get some to be compiled."""
    for kind in UNSEEN:
        for item in list(getattr(spec, kind, ())):
            spec.delete(item)
    for actuator in list(spec.actuators):
        if actuator.trntype not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            spec.delete(actuator)
    bodies, unknown = list(spec.bodies), set()
    for k, body in enumerate(bodies):
        if not body.name:
            body.name = f"body{k}"
        geoms = list(body.geoms)
        stored = [geom for geom in geoms if geom.meshname or geom.hfieldname]
        if k > 0 and any(_weighs(mujoco, spec, body, geom) for geom in stored):
            unknown.add(body.name)
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
        for geom in stored:
            # To take it out of the list takes a time that grows with the square of the list.
            geom.type, geom.size, geom.mass = mujoco.mjtGeom.mjGEOM_SPHERE, [1.0, 1.0, 1.0], float(body.name in unknown)
            geom.meshname = geom.hfieldname = ""
        for drawn in [*geoms, *body.sites]:
            drawn.material = ""
    for asset in [*spec.meshes, *spec.hfields, *spec.materials, *spec.textures]:
        spec.delete(asset)
    if unknown and spec.compiler.settotalmass > 0:
        # The masses that are stated are scaled to a sum in which those of meshes are.
        unknown = {body.name for body in bodies}
    return unknown


def _weighs(mujoco: Any, spec: Any, body: Any, geom: Any) -> bool:
    """Whether a body has inertia from this shape."""
    source, rules = spec.compiler.inertiafromgeom, mujoco.mjtInertiaFromGeom
    if source == rules.mjINERTIAFROMGEOM_FALSE or (source == rules.mjINERTIAFROMGEOM_AUTO and body.explicitinertial):
        return False
    first, last = spec.compiler.inertiagrouprange
    return bool(geom.mass != 0 and geom.density != 0 and first <= geom.group <= last)


KINDS = ("free", "ball", "prismatic", "revolute")
"""By MuJoCo's number."""
PLAIN = (0, 0)
"""Of an actuator's gain and bias: its control is its force, as a motor's is."""


def mjcf_tree(path: Path, root: XmlNode) -> Tree:
    """The bodies and joints that an MJCF file describes; its sites are links without a body.

    root   of the file, as XML
    Raises ModelError: what CompiledMjcf cannot be made of.
    """
    made = compiled(path, root)
    found = _Bodies(made.model, made.unknown)
    links, joints = found.tree()
    notes = [*made.notes, *_bent(made.model)]
    return Tree(printable(str(path)), "MJCF", made.name, links, joints, made.gravity, tuple(notes))


def _bent(model: Any) -> Iterator[str]:
    """What of damping and springs is no straight line, of a MuJoCo that knows such."""
    for what, name in (("damping", "dof_dampingpoly"), ("stiffness", "jnt_stiffnesspoly")):
        if hasattr(model, name) and getattr(model, name).any():
            yield f"{what} of more than one number: what grows with the first power is taken, the rest is left out"


class _Bodies:
    """MuJoCo's arrays as links and joints; a body with several joints gets a frame for each."""

    def __init__(self, model: Any, unknown: Set[str]) -> None:
        self.model, self.unknown = model, unknown
        self.frames: dict[int, tuple[str, Frame]] = {0: (model.body(0).name, Frame())}
        """Of every body, the link that it is, and where its own frame stands in the link's."""

    def tree(self) -> tuple[dict[str, TreeLink], dict[str, TreeJoint]]:
        links = {self.frames[0][0]: TreeLink(self.frames[0][0], None, True)}
        joints: dict[str, TreeJoint] = {}
        for body in range(1, self.model.nbody):
            for joint in self.joints(body):
                joints[joint.name] = joint
                links[joint.child] = TreeLink(joint.child, NOTHING, False)
            name, frame = self.frames[body]
            links[name] = TreeLink(name, self.body(body, frame.xyz), True)
        for k in range(self.model.nsite):
            site = self.model.site(k).name
            if site and site not in links:
                parent, frame = self.frames[int(self.model.site_bodyid[k])]
                at = composed(frame, _frame(self.model.site_pos[k], self.model.site_quat[k]))
                links[site] = TreeLink(site, None, False)
                joints[f"site {site}"] = TreeJoint(f"site {site}", "fixed", parent, site, at)
        return links, joints

    def joints(self, body: int) -> Iterator[TreeJoint]:
        """From the parent's link to the body's, one by one."""
        model = self.model
        name, first, count = model.body(body).name, int(model.body_jntadr[body]), int(model.body_jntnum[body])
        parent, before = self.frames[int(model.body_parentid[body])]
        origin = composed(before, _frame(model.body_pos[body], model.body_quat[body]))
        if count == 0:
            self.frames[body] = (name, Frame())
            yield TreeJoint(f"weld {name}", "fixed", parent, name, origin)
        at: Vector = (0.0, 0.0, 0.0)
        for k in range(first, first + count):
            child = name if k == first + count - 1 else f"{name} before joint {k + 1 - first}"
            place = _vector(model.jnt_pos[k])
            origin = composed(origin, Frame(_less(place, at)))
            yield self.joint(k, parent, child, origin)
            parent, origin, at = child, Frame(), place
        if count:
            self.frames[body] = (name, Frame(scaled(-1.0, at)))

    def joint(self, k: int, parent: str, child: str, origin: Frame) -> TreeJoint:
        model, dof = self.model, int(self.model.jnt_dofadr[k])
        kind, axis = KINDS[int(model.jnt_type[k])], _vector(model.jnt_axis[k])
        name = model.joint(k).name or f"joint{k + 1}"
        if kind in ("free", "ball"):
            return TreeJoint(name, kind, parent, child, origin)
        at = int(model.jnt_qposadr[k])
        zero = -float(model.qpos0[at])
        shift = Frame(scaled(zero, axis)) if kind == "prismatic" else Frame(rpy=angles(about(axis, zero)))
        low, high = (float(end) for end in model.jnt_range[k])
        drive = _drive(model, k)
        stated = {
            "damping": float(model.dof_damping[dof]) + drive.damping,
            "friction": float(model.dof_frictionloss[dof]),
            "stiffness": float(model.jnt_stiffness[k]),
            "rest": float(model.qpos_spring[at]),
        }
        return TreeJoint(
            name,
            kind,
            parent,
            child,
            composed(origin, shift) if zero else origin,
            axis,
            (low, high) if model.jnt_limited[k] and low < high and max(-low, high) < LARGEST else None,
            None,
            drive.torque,
            {word: value for word, value in stated.items() if value},
            float(model.dof_armature[dof]) + drive.rotor or None,
            drive.gears,
        )

    def body(self, k: int, shift: Vector) -> StatedBody | None:
        """Of a body in its link's frame, which stands off its own by a shift."""
        model = self.model
        if model.body(k).name in self.unknown:
            return None
        R = _rotation(model.body_iquat[k])
        principal = [float(moment) for moment in model.body_inertia[k]]
        diagonal: Rotation = ((principal[0], 0.0, 0.0), (0.0, principal[1], 0.0), (0.0, 0.0, principal[2]))
        com = _less(_vector(model.body_ipos[k]), scaled(-1.0, shift))
        return StatedBody(float(model.body_mass[k]), com, packed(product(product(R, diagonal), transposed(R))))


@dataclass(frozen=True)
class _Drive:
    """What the actuators of a joint say, at the joint: the gears of those that move it, by whom; the largest torque,
    None without any; the inertia and the damping that stand on their side of the gear, of a MuJoCo that knows such."""

    gears: tuple[tuple[str, float], ...]
    torque: float | None
    rotor: float
    damping: float


def _drive(model: Any, k: int) -> _Drive:
    at_joint = [a for a in range(model.nu) if int(model.actuator_trnid[a][0]) == k]
    gears = {a: ratio for a in at_joint if (ratio := abs(float(model.actuator_gear[a][0])))}
    # The forces of actuators at one joint add up, and so does what moves with them.
    forces = [ratio * min(_largest(_forces(model, a)), default=math.inf) for a, ratio in gears.items()]
    own = _largest([model.jnt_actfrcrange[k]] if model.jnt_actfrclimited[k] else [])
    torque = min([*own, *([sum(forces)] if forces else [])], default=math.inf)
    sums = [
        sum(ratio**2 * float(getattr(model, what)[a]) for a, ratio in gears.items() if hasattr(model, what))
        for what in ("actuator_armature", "actuator_damping")
    ]
    by = tuple((f"actuator {shortened(model.actuator(a).name) or a + 1}", ratio) for a, ratio in gears.items())
    return _Drive(by, torque if torque < LARGEST else None, *sums)


def _largest(ranges: Iterable[Sequence[Any]]) -> list[float]:
    """What each range allows in both directions, of those that do."""
    both = (min(-float(low), float(high)) for low, high in ranges)
    return [value for value in both if 0 < value < LARGEST]


def _forces(model: Any, a: int) -> Iterator[Sequence[float]]:
    """Ranges of an actuator's force, before its gear."""
    if model.actuator_forcelimited[a]:
        yield model.actuator_forcerange[a]
    if model.actuator_ctrllimited[a] and (model.actuator_gaintype[a], model.actuator_biastype[a]) == PLAIN:
        yield abs(float(model.actuator_gainprm[a][0])) * model.actuator_ctrlrange[a]


def _vector(values: Sequence[Any]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _less(left: Vector, right: Vector) -> Vector:
    x, y, z = (a - b for a, b in zip(left, right, strict=True))
    return x, y, z


def _frame(position: Sequence[Any], quaternion: Sequence[Any]) -> Frame:
    return Frame(_vector(position), angles(_rotation(quaternion)))


def _rotation(quaternion: Sequence[Any]) -> Rotation:
    """Of w, x, y, z."""
    w, x, y, z = (float(value) for value in quaternion)
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
