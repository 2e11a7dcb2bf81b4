"""Clearance: distances by two ways, gradients by differences, and what a user's arm and scene are told."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import random_arms
import spatial_arms
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.experiments.capsules import Capsules
from runtime.experiments.clearance import Clearance
from runtime.experiments.nearest import box_distance, nearest_points, nearest_to_box
from runtime.experiments.scene import Scene, SceneTool, parse_box, read_scene, scene_file_rows
from runtime.experiments.solids import MeshClearance
from runtime.model.kinematics import body_frames
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, CollisionShape, Frame
from symbolic.model_file.checks import ModelError
from symbolic.model_file.exchange.shapes import collision_shapes

Array = np.ndarray
ARMS = Path(reader.__file__).resolve().parents[1] / "arms"
UR10, PANDA = (reader.load(ARMS / f"{name}.toml") for name in ("ur10", "panda"))
PI = math.pi
HOME = {"ur10": [0, -PI / 2, PI / 2, -PI / 2, -PI / 2, 0], "panda": [0, -PI / 4, 0, -3 * PI / 4, 0, PI / 2, PI / 4]}
SEEDS = st.integers(0, 10_000)


def posture(*q: float) -> Array:
    return np.array(q, dtype=float)[:, None]


def segments(rng: np.random.Generator, count: int) -> Array:
    """(2, 3, count): ordinary ones, points, parallel ones and ones that touch."""
    found = rng.uniform(-1, 1, (2, 3, count))
    found[1, :, ::5] = found[0, :, ::5]
    return found


def along(segment: Array, steps: int) -> Array:
    """(steps, 3, count) points of segments."""
    t = np.linspace(0, 1, steps)[:, None, None]
    return segment[0] * (1 - t) + segment[1] * t


# --- distances ---


@given(SEEDS)
@settings(max_examples=30)
def test_nearest_points_of_segments_are_nearer_than_any_others(seed: int) -> None:
    rng, count, steps = np.random.default_rng(seed), 20, 60
    one, other = segments(rng, count), segments(rng, count)
    other[1, :, ::3] = other[0, :, ::3] + rng.uniform(-2, 2) * (one[1] - one[0])[:, ::3]
    first, second = nearest_points(one[0], one[1], other[0], other[1])
    found = np.linalg.norm(first - second, axis=0)
    sampled = np.linalg.norm(along(one, steps)[:, None] - along(other, steps)[None], axis=2).min(axis=(0, 1))
    lengths = np.linalg.norm(one[1] - one[0], axis=0) + np.linalg.norm(other[1] - other[0], axis=0)
    assert (found <= sampled + 1e-9).all()
    assert (sampled <= found + lengths / (steps - 1)).all()
    for point, segment in ((first, one), (second, other)):
        on = np.linalg.norm(point - segment[0], axis=0) + np.linalg.norm(segment[1] - point, axis=0)
        assert np.allclose(on, np.linalg.norm(segment[1] - segment[0], axis=0))


@given(SEEDS)
@settings(max_examples=30)
def test_no_point_of_a_segment_is_nearer_to_a_box(seed: int) -> None:
    rng, steps = np.random.default_rng(seed), 200
    segment, half = segments(rng, 20), rng.uniform(0.05, 0.6, 3)
    point, found, _ = nearest_to_box(*segment, half)
    sampled, _ = box_distance(np.moveaxis(along(segment, steps), 0, 2), half)
    assert (found <= sampled.min(axis=1) + 1e-7).all()
    assert (sampled.min(axis=1) <= found + np.linalg.norm(segment[1] - segment[0], axis=0) / (steps - 1)).all()
    assert np.allclose(found, box_distance(point, half)[0])


@given(SEEDS)
@settings(max_examples=30)
def test_a_shifted_segment_is_as_much_nearer_as_the_gradient_says(seed: int) -> None:
    """Outside, and where it runs through the box."""
    rng, step = np.random.default_rng(seed), 1e-6
    segment, half = rng.uniform(-1, 1, (2, 3, 20)), rng.uniform(0.1, 0.6, 3)
    _, _, gradient = nearest_to_box(*segment, half)
    shift = rng.uniform(-step, step, (3, 20))
    (_, less, _), (_, more, _) = (nearest_to_box(*(segment + sign * shift), half) for sign in (-1, 1))
    assert np.allclose((more - less) / 2, (gradient * shift).sum(axis=0), atol=1e-3 * step)


def test_distance_to_a_box_is_that_to_its_points() -> None:
    rng, half = np.random.default_rng(3), np.array([0.2, 0.3, 0.4])
    points = rng.uniform(-1, 1, (3, 300))
    nearest = np.clip(points, -half[:, None], half[:, None])
    outside = np.linalg.norm(points - nearest, axis=0)
    inside = (half[:, None] - np.abs(points)).min(axis=0)
    found, _ = box_distance(points, half)
    assert np.allclose(found, np.where(outside > 0, outside, -inside))


def as_shapes(capsules: Capsules) -> list[CollisionShape]:
    """The same capsules as a URDF states them."""
    found = []
    for body, (start, end), radius in zip(capsules.body, capsules.ends, capsules.radius, strict=True):
        x, y, z = end - start
        turned = (0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x))
        size = (radius, float(np.linalg.norm(end - start)))
        found.append(CollisionShape(int(body), "link", Frame(tuple((start + end) / 2), turned), "capsule", size))
    return found


@pytest.mark.parametrize("arm", [UR10, PANDA], ids=lambda arm: arm.name)
def test_coal_finds_the_same_distances(arm: Arm) -> None:
    pytest.importorskip("coal")
    scene = Scene.of(-0.4, ["x=0.6:0.9,y=-0.5:0.1,z=0.2:0.5", "y=0.9:"])
    slim = dict.fromkeys(range(8), 0.02) if arm is PANDA else dict.fromkeys(range(7), 0.02)
    scene = replace(scene, tool=SceneTool((0.0, 0.0, 0.0), (0.1, 0.0, 0.1), 0.03), radii=slim)
    own = Clearance.of(arm, scene)
    bare = replace(own.capsules, tool=np.zeros_like(own.capsules.tool))
    others = MeshClearance.of(arm, scene, as_shapes(bare)[:-1])
    q = posture(*HOME[arm.name]) + np.random.default_rng(0).uniform(-1, 1, (len(arm.joints), 60))
    by_pair = others.distances(q)
    # Own distances leave out what no pose changes.
    least, reference = own.least(q), by_pair[np.ptp(by_pair, axis=1) > 1e-4].min(axis=0)
    # Where capsules overlap, coal states the depth of another separation.
    free = (least > 0) | (reference > 0)
    assert free.sum() > 10
    assert np.allclose(least[free], reference[free], atol=2e-4)
    assert ((least > 0) == (reference > 0)).all()


# --- frames and gradients ---


@pytest.mark.parametrize("name", ["ur10e", "iiwa"])
def test_frames_are_those_of_the_table(name: str) -> None:
    """Modified Denavit-Hartenberg matrices, multiplied."""
    arm, q = spatial_arms.known(name), np.linspace(-1, 1, len(spatial_arms.TABLES[name]))
    T = np.eye(4)
    R, p = body_frames(arm, q[:, None])
    for k, (quarters, a, d) in enumerate(spatial_arms.TABLES[name]):
        alpha = quarters * PI / 2
        (ca, sa), (c, s) = ((math.cos(x), math.sin(x)) for x in (alpha, q[k]))
        row = [[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca], [0, 0, 0, 1]]
        T = T @ np.array(row)
        assert np.allclose(R[k + 1, :, :, 0], T[:3, :3])
        assert np.allclose(p[k + 1, :, 0], T[:3, 3])


def mixed(seed: int) -> tuple[Arm, Scene]:
    """An arm in space of joints of both kinds with slanted axes, in a crowded room."""
    rng = np.random.default_rng(seed)
    joints = []
    for k, joint in enumerate(PANDA.joints):
        frame = Frame(tuple(rng.uniform(-0.3, 0.3, 3)), tuple(rng.uniform(-PI, PI, 3)))
        kind = "prismatic" if k % 3 == seed % 3 else "revolute"
        joints.append(replace(joint, type=kind, axis=tuple(rng.uniform(-1, 1, 3)), origin=frame))
    scene = Scene.of(-2.0, ["x=0.5:0.8,y=-0.5:0.5,z=0.4:0.9", "y=0.7:"])
    tool = SceneTool((0.0, 0.0, 0.0), (0.0, 0.0, 0.2), 0.02)
    return replace(PANDA, joints=tuple(joints), gravity=tuple(rng.uniform(-5, 5, 3))), replace(scene, tool=tool)


@given(SEEDS)
@settings(max_examples=20)
def test_the_gradient_is_that_of_the_penalty(seed: int) -> None:
    arm, scene = mixed(seed)
    clearance, soft, step = Clearance.of(arm, scene), 0.3, 1e-5
    q = np.random.default_rng(seed).uniform(-1, 1, (7, 5))
    value, gradient = clearance.penalty(q, soft)

    def each(q: Array) -> Array:
        return ((np.maximum(soft - clearance.distances(q), 0) / soft) ** 2).sum(axis=0)

    assert value == pytest.approx(each(q).sum(), rel=1e-9)
    shifts = step * np.repeat(np.eye(7), 5, axis=1)
    more, less = (each(np.tile(q, 7) + sign * shifts).reshape(7, 5) for sign in (1, -1))
    wrong = ~np.isclose((more - less) / (2 * step), gradient, rtol=1e-4, atol=1e-4)
    # Where two segments cross, or change the side of a box, the nearest points jump.
    assert wrong.sum() <= 1


def test_a_motion_far_from_everything_has_no_penalty() -> None:
    value, gradient = Clearance.of(UR10, Scene()).penalty(posture(*HOME["ur10"]), 0.05)
    assert value == 0
    assert not gradient.any()


# --- arms ---


@pytest.mark.parametrize("arm", [UR10, PANDA], ids=lambda arm: arm.name)
def test_ordinary_poses_are_free(arm: Arm) -> None:
    clearance = Clearance.of(arm, Scene.of(0.0))
    assert clearance.least(posture(*HOME[arm.name]))[0] > 0.03


def test_an_arm_folded_onto_itself_is_seen() -> None:
    worst = Clearance.of(UR10, Scene()).worst(np.hstack([posture(*HOME["ur10"]), posture(0, -PI / 2, 3.1, 0, 0, 0)]))
    assert worst.distance < -0.05
    assert worst.sample == 1
    assert worst.between == "link 1 and link 5"


@pytest.mark.parametrize(
    ("said", "q", "between"),
    [
        ({"floor": 0.0}, (0, 0.5, 0, 0, 0, 0), "link 6 and the floor"),
        ({"boxes": ["x=0.3:0.5,y=-0.4:0.4,z=0.5:0.7"]}, (0, -PI / 4, 0, 0, 0, 0), "x=0.3:0.5,y=-0.4:0.4,z=0.5:0.7"),
    ],
)
def test_floor_and_box_are_seen(said: dict, q: tuple[float, ...], between: str) -> None:
    free = Clearance.of(UR10, Scene()).least(posture(*q))
    worst = Clearance.of(UR10, Scene.of(**said)).worst(posture(*q))
    assert free[0] > 0
    assert worst.distance < 0
    assert worst.between.endswith(between)


def test_the_floor_is_below_an_arm_that_hangs() -> None:
    """Heights are against gravity: turned upside down, UR10 stretched upwards reaches down to a floor at -1.2 m."""
    hanging = replace(UR10, gravity=(0.0, 0.0, 9.81))
    down = posture(0, -PI / 2, 0, 0, 0, 0)

    def over_floor(arm: Arm, floor: float) -> float:
        clearance = Clearance.of(arm, Scene.of(floor))
        of = zip(clearance.names, clearance.distances(down)[:, 0], strict=True)
        return min(distance for name, distance in of if name.endswith("the floor"))

    lowest = -0.1273 - 0.612 - 0.5723 - 0.075 - 0.05
    assert over_floor(hanging, -1.2) == pytest.approx(lowest + 1.2, abs=1e-3)
    assert over_floor(hanging, -2.0) == pytest.approx(lowest + 2.0, abs=1e-3)
    # Up to the shoulder, heights never change and are not looked at again.
    assert over_floor(UR10, -1.2) == pytest.approx(1.2 + 0.1273 + 0.612 - 0.075 - 0.05, abs=1e-3)


def test_parts_of_one_housing_are_no_alarm_and_said() -> None:
    """UR10's file makes its wrist as thick as its arm: the flange is checked against the forearm with less."""
    clearance = Clearance.of(UR10, Scene())
    assert clearance.judged.left_out == ("link 3 and link 5", "link 4 and link 6")
    assert clearance.judged.thinner == ("link 3 and link 6 0.082 m",)
    # The wrist folds the flange onto the forearm.
    assert clearance.worst(posture(0, -PI / 2, 0, PI / 2, -PI / 2, 0)).distance > 0
    folded = [clearance.worst(posture(0, -PI / 2, 0, turn, PI / 2 * side, 0)) for turn in (0, PI) for side in (-1, 1)]
    folded += [
        clearance.worst(posture(0, -PI / 2, 0, turn, straight, 0)) for turn in (PI / 2, PI) for straight in (0, PI)
    ]
    assert any(worst.distance < 0 and worst.between == "link 3 and link 6" for worst in folded)
    slim = Clearance.of(UR10, Scene(radii={3: 0.06, 4: 0.045, 5: 0.045, 6: 0.045}))
    assert slim.judged.thinner == ()
    assert "link 3 and link 6" in slim.names


def test_a_link_runs_along_the_axes_past_its_centre_of_mass() -> None:
    """UR10's upper arm goes up along its tube and then aside to the elbow; Panda's forearm first aside, then up."""
    capsules = Capsules.of(UR10, Scene())
    assert np.allclose(capsules.ends[capsules.body == 2][0], [[0, 0, 0], [0, 0, 0.612]])
    assert capsules.radius[capsules.body == 2] == pytest.approx(0.075, abs=1e-3)
    ends = Capsules.of(PANDA, Scene()).ends[Capsules.of(PANDA, Scene()).body == 4]
    assert np.allclose(ends[1], [[-0.0825, 0, 0], [-0.0825, 0.384, 0]])


def test_a_low_shoulder_is_no_alarm_and_a_low_elbow_is() -> None:
    """An arm whose first links are closer to the floor than their radius: their height never changes."""
    low = replace(UR10, joints=(replace(UR10.joints[0], origin=Frame((0.0, 0.0, 0.06))), *UR10.joints[1:]))
    clearance = Clearance.of(low, Scene.of(0.0))
    assert clearance.least(posture(*HOME["ur10"]))[0] > 0.03
    assert clearance.worst(posture(0, 0.1, 0, 0, 0, 0)).between.endswith("the floor")
    assert clearance.worst(posture(0, 0.1, 0, 0, 0, 0)).distance < 0


def test_a_tool_reaches_further() -> None:
    q = posture(0, -0.2, 0.4, 0, 0, 0)
    scene = Scene.of(0.0)
    bare = Clearance.of(UR10, scene)
    long = Clearance.of(UR10, replace(scene, tool=SceneTool((0, 0, 0), (0, 0, 0.5), 0.05)))
    assert long.least(q)[0] <= bare.least(q)[0]
    assert any("the tool" in name for name in long.names)
    assert any("No tool is stated" in line for line in bare.unchecked)
    assert not any("No tool is stated" in line for line in long.unchecked)


def test_what_is_not_checked_is_said() -> None:
    said = " ".join(Clearance.of(UR10, Scene()).unchecked)
    for part in ("People, cables", "No floor", "No boxes", "No tool", "0.05 m", "0.082 m", "link 3 0.075 m"):
        assert part in said
    assert "link 4 and link 6" in said


@pytest.mark.parametrize("name", sorted(random_arms.MIXED))
def test_planar_arms_have_boxes_and_a_floor_where_gravity_is(name: str) -> None:
    arm = random_arms.MIXED[name]
    q = np.zeros((len(arm.joints), 2))
    reach = sum(arm.lengths)
    clearance = Clearance.of(arm, Scene.of(None, [f"x={reach + 0.2}:{reach + 0.4}"]))
    radius = clearance.capsules.radius[-1]
    assert clearance.least(q) == pytest.approx(0.15 - radius, abs=1e-6)
    assert any("planar" in line for line in clearance.unchecked)
    if any(arm.gravity):
        assert Clearance.of(arm, Scene.of(-1.0)).least(q)[0] < 1.0
    else:
        with pytest.raises(ModelError, match="horizontal plane"):
            Clearance.of(arm, Scene.of(-1.0))


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (Scene(floor=0.5), "the scene: the floor at 0.5 m is above joint 1 of ur10, at 0.1273 m"),
        (Scene.of(None, ["z=0:0.3"]), "the scene: the box z=0:0.3 holds joint 1 of ur10"),
        (Scene(radii={9: 0.1}), "the scene: link: there is no joint 9; ur10 has 6"),
    ],
)
def test_a_scene_that_does_not_fit_the_arm_is_refused(scene: Scene, said: str) -> None:
    with pytest.raises(ModelError) as caught:
        Clearance.of(UR10, scene)
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)


# --- scenes ---

WHOLE = """
floor = -0.3
margin = 0.03
link_margin = 0.01
[[box]]
name = "table"
centre = [0.8, 0.0, 0.2]
size = [0.4, 1.0, 0.4]
rpy = [0.0, 0.0, 0.3]
[[box]]
centre = [0.0, 2.0, 0.0]
size = [1.0, 1.0, 1.0]
[tool]
size = [0.05, 0.3, 0.1]
[[link]]
joint = 2
radius = 0.09
"""


def test_a_scene_file_is_read_and_options_add_to_it(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(WHOLE, encoding="utf-8")
    scene = Scene.of(-0.1, ["x=-1.5:-1,z=0:0.5"], path)
    assert (scene.floor, scene.margin, scene.link_margin) == (-0.1, 0.03, 0.01)
    assert read_scene(path).floor == -0.3
    assert [box.name for box in scene.boxes] == ["table", "box 2", "the box x=-1.5:-1,z=0:0.5"]
    assert scene.boxes[2].frame.xyz == (-1.25, 0.0, 0.25)
    assert scene.boxes[2].size == (0.5, 20.0, 0.5)
    clearance = Clearance.of(UR10, scene)
    assert set(clearance.capsules.radius[clearance.capsules.body == 2]) == {0.09}
    # A box as a tool is held by its capsule.
    corners = np.array([[x, y, z] for x in (-0.025, 0.025) for y in (-0.15, 0.15) for z in (0.0, 0.1)])
    assert scene.tool is not None
    inside = np.clip(corners, *sorted((scene.tool.start, scene.tool.end)))
    assert (np.linalg.norm(corners - inside, axis=1) <= scene.tool.radius + 1e-12).all()


def test_every_key_of_a_scene_has_a_meaning() -> None:
    keys = {row.key for row in scene_file_rows()}
    assert keys >= {"floor", "margin", "link_margin", "box.centre", "box.size", "tool.length", "link.radius"}
    assert all(row.meaning for row in scene_file_rows())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("floor = [", "line 1: not valid TOML"),
        ("flor = 0.0", 'unknown key "flor"; did you mean "floor"?'),
        ("floor = nan", "floor is nan; expected a number in m that is finite"),
        ("margin = -0.1", "margin is -0.1; expected a number in m >= 0"),
        ("[[box]]\nsize = [1, 1, 1]", 'box 1: missing key "centre"'),
        ("[[box]]\ncenter = [0, 0, 0]\nsize = [1, 1, 1]", 'box 1: unknown key "center"; did you mean "centre"?'),
        ("[[box]]\ncentre = [0, 0]\nsize = [1, 1, 1]", "box 1: centre is a list of 2; expected a list of 3 numbers"),
        ("[[box]]\ncentre = [0, 0, 0]\nsize = [1, 0, 1]", "box 1: size has the edge 0; expected three whole edges"),
        ("[tool]\nlength = 0.1", "tool: expected length and radius of a capsule, or size of a box"),
        ("[tool]\nlength = 0.1\nradius = 0.1\nsize = [1, 1, 1]", "tool: expected length and radius of a capsule"),
        ("[[link]]\njoint = -1\nradius = 0.1", "link 1: joint is -1; expected a number >= 0"),
        ("[[link]]\njoint = 1\nradius = 0.1\n[[link]]\njoint = 1\nradius = 0.2", "two [[link]] tables for one joint"),
        ("floor = \"__import__('os')\"", "floor is the text"),
    ],
)
def test_what_is_wrong_with_a_scene_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelError) as caught:
        read_scene(path)
    assert str(caught.value).startswith(str(path))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_scene_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no such file; expected a scene in TOML"):
        Scene.of(path=tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0.3 0 0 1 1 1", "expected AXIS=LOW:HIGH of x, y and z in m"),
        ("x=0.3", "expected AXIS=LOW:HIGH"),
        ("w=0:1", "expected AXIS=LOW:HIGH"),
        ("x=0:1,x=2:3", "x is there twice"),
        ("x=1:0", "x goes from 1 to 0; expected the smaller end first"),
        ("x=a:1", '"a" is no number'),
        ("x=nan:1", "nan is beyond 10 m"),
        ("x=0:1e9", "1e9 is beyond 10 m; leave that end out"),
        ("", "expected AXIS=LOW:HIGH"),
    ],
)
def test_what_is_wrong_with_a_box_is_one_line(text: str, said: str) -> None:
    with pytest.raises(ModelError) as caught:
        parse_box(text)
    assert str(caught.value).startswith(f"--box {text}: ")
    assert said in str(caught.value)


# --- collision shapes of a URDF ---


def cuboid(half: float) -> str:
    """An STL file of a cube."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    facets = [corners[[side[0], *side[k : k + 2]]] for side in sides for k in (1, 2)]
    lines = ["solid cube"]
    for facet in facets:
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in facet)]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid cube", ""])


def urdf(mesh: str) -> str:
    """A base on a pedestal, and three links of a sphere, a mesh and a cylinder with a finger that slides."""

    def shaped(name: str, shape: str, place: str = "0 0 0") -> str:
        origin = f'<origin xyz="{place}"/>'
        return f'<link name="{name}"><collision>{origin}<geometry>{shape}</geometry></collision></link>'

    def jointed(name: str, kind: str, parent: str, child: str, place: str) -> str:
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
        return f'<joint name="{name}" type="{kind}">{ends}<axis xyz="0 1 0"/></joint>'

    parts = [
        '<link name="world"/>',
        shaped("base", '<box size="0.2 0.2 0.2"/>'),
        shaped("one", '<sphere radius="0.05"/>'),
        shaped("two", f'<mesh filename="{mesh}" scale="2 1 1"/>', "0 0 0.2"),
        shaped("three", '<cylinder radius="0.05" length="0.3"/>', "0 0 0.15"),
        shaped("finger", '<box size="0.02 0.02 0.1"/>'),
        jointed("stand", "fixed", "world", "base", "0 0 1"),
        jointed("a", "revolute", "base", "one", "0 0 0.3"),
        jointed("b", "revolute", "one", "two", "0 0 0.3"),
        jointed("c", "revolute", "two", "three", "0 0 0.5"),
        jointed("slide", "prismatic", "three", "finger", "0 0 0.35"),
    ]
    return '<robot name="toy">' + "".join(parts) + "</robot>"


@pytest.fixture
def toy(tmp_path: Path) -> tuple[Path, Arm]:
    """The URDF with its package, and the arm from the base on."""
    folder = tmp_path / "toy_description"
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    (folder / "meshes" / "cube.stl").write_text(cuboid(0.05), encoding="utf-8")
    path = folder / "urdf" / "toy.urdf"
    path.write_text(urdf("package://toy_description/meshes/cube.stl"), encoding="utf-8")
    heights = (("a", 0.3), ("b", 0.3), ("c", 0.5))
    joints = [replace(UR10.joints[1], name=name, axis=(0.0, 1.0, 0.0), origin=Frame((0, 0, z))) for name, z in heights]
    return path, replace(UR10, name="toy", joints=tuple(joints), tip=Frame((0.0, 0.0, 0.3)))


def test_shapes_stand_in_the_frames_of_their_joints(toy: tuple[Path, Arm]) -> None:
    path, arm = toy
    shapes, lacking = collision_shapes(path, arm)
    found = {shape.link: (shape.body, shape.kind, tuple(round(x, 9) for x in shape.frame.xyz)) for shape in shapes}
    assert found == {
        "base": (0, "box", (0, 0, 0)),
        "one": (1, "sphere", (0, 0, 0)),
        "two": (2, "mesh", (0, 0, 0.2)),
        "three": (3, "cylinder", (0, 0, 0.15)),
        "finger": (3, "box", (0, 0, 0.35)),
    }
    assert lacking == ["Shapes behind slide, which the arm does not move, are checked with these joints at 0."]


def test_a_motion_is_checked_with_the_shapes(toy: tuple[Path, Arm]) -> None:
    pytest.importorskip("coal")
    path, arm = toy
    clearance = MeshClearance.of(arm, Scene.of(-1.0, ["x=0.4:0.6,z=0.6:1"]), *collision_shapes(path, arm))
    straight = clearance.distances(posture(0, 0, 0))[:, 0]
    by_name = dict(zip(clearance.names, straight, strict=True))
    # The cube, twice as long along x, ends at 0.1; the finger's top is not the lowest point of link 3.
    assert by_name["link 2 and the box x=0.4:0.6,z=0.6:1"] == pytest.approx(0.4 - 0.1 - 0.05, abs=1e-6)
    assert by_name["link 1 and the floor"] == pytest.approx(1.3 - 0.05 - 0.05, abs=1e-6)
    assert clearance.least(posture(0, 0, 0))[0] > 0
    folded = clearance.worst(posture(0, PI, 0))
    assert folded.between == "the base and link 3"
    assert folded.distance < -0.1
    assert clearance.worst(posture(0, PI / 2, 0)).between == "link 3 and the box x=0.4:0.6,z=0.6:1"


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        ("package://elsewhere/cube.stl", "package://elsewhere/cube.stl was not"),
        ("../meshes/broken.stl", "broken.stl is no mesh with a volume"),
        ("../meshes/flat.stl", "flat.stl is no mesh with a volume"),
    ],
)
def test_a_mesh_that_is_not_there_is_said(toy: tuple[Path, Arm], mesh: str, said: str) -> None:
    pytest.importorskip("coal")
    path, arm = toy
    folder = path.parent.parent / "meshes"
    (folder / "broken.stl").write_text("solid nothing\n garbage", encoding="utf-8")
    (folder / "flat.stl").write_text(cuboid(0.0), encoding="utf-8")
    path.write_text(urdf(mesh), encoding="utf-8")
    clearance = MeshClearance.of(arm, Scene(), *collision_shapes(path, arm))
    start = f"Link two is not checked whole: its mesh {said}"
    assert [line for line in clearance.unchecked if line.startswith(start)]
    assert clearance.least(posture(0, 0, 0))[0] > 0


def test_packages_are_found_where_ros_keeps_them(toy: tuple[Path, Arm], monkeypatch: pytest.MonkeyPatch) -> None:
    path, arm = toy
    elsewhere = path.parents[2] / "else" / "share" / "kept"
    elsewhere.mkdir(parents=True)
    (elsewhere / "cube.stl").write_text(cuboid(0.05), encoding="utf-8")
    path.write_text(urdf("package://kept/cube.stl"), encoding="utf-8")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(path.parents[2] / "else"))
    assert {shape.mesh for shape in collision_shapes(path, arm)[0]} == {None, elsewhere / "cube.stl"}
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(elsewhere.parent))
    assert {shape.mesh for shape in collision_shapes(path, arm)[0]} == {None, elsewhere / "cube.stl"}


def test_another_robots_urdf_is_refused(toy: tuple[Path, Arm]) -> None:
    path, _ = toy
    with pytest.raises(ModelError, match=r'toy\.urdf: joint 1 of ur10 is "shoulder_pan_joint"; expected the name of'):
        collision_shapes(path, UR10)
