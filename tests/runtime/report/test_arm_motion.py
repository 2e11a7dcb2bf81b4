"""The moving picture of an arm: its frames are forward kinematics, by another route; it is whole, small and safe."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from jinja2 import Environment, FileSystemLoader

from codegen import prepare
from runtime.model import loader
from runtime.model.loader import carried, joint_places, tip_place
from runtime.report.page import arm_motion
from runtime.report.page.arm_motion import ArmMotion, Course, JointMarks
from symbolic.model_file import reader
from tests import spatial_arms

HOSTILE = '</script><img src="https://evil.example/x" onerror=alert(1)>'
SLIDING = 'name = "sliding"\ngravity = [0.0, -9.81]\n' + "".join(
    f"""[[joint]]
type = "{kind}"
rotor_inertia = {rotor}
gear_ratio = 100
link = {{ length = {length}, mass = 1.0, com = [{com}, 0.0], inertia = 0.01 }}
"""
    for kind, rotor, length, com in (
        ("revolute", 0.1, 0.4, 0.2),
        ("prismatic", 2.0, 0.1, 0.0),
        ("revolute", 0.1, 0.25, 0.1),
    )
)


@pytest.fixture(scope="module")
def sliding(library: loader.Library, tmp_path_factory) -> loader.Model:
    path = tmp_path_factory.mktemp("arm") / "sliding.toml"
    path.write_text(SLIDING)
    return loader.Model(prepare.prepare_arm(reader.load(path)), library)


@pytest.fixture(scope="module")
def spatial(library: loader.Library):
    """An arm in space with a slide in it, and its file."""
    arm = spatial_arms.drawn("rrpr", 5)
    return arm, loader.Model(prepare.prepare_arm(arm), library)


def turned(q: float) -> np.ndarray:
    c, s = math.cos(q), math.sin(q)
    return np.array([[c, -s], [s, c]])


def test_places_of_a_planar_arm_are_those_of_its_links_one_after_the_other(sliding):
    q = np.random.default_rng(1).uniform(-1, 1, (3, 4))
    found, tip = joint_places(sliding, q), tip_place(sliding, q)
    for k in range(4):
        along = turned(q[0, k])[:, 0]
        second = 0.4 * along
        third = second + (0.1 + q[1, k]) * along
        end = third + 0.25 * turned(q[0, k] + q[2, k])[:, 0]
        for (base, moved), expected in zip(found, (np.zeros(2), second, third), strict=True):
            np.testing.assert_allclose(base[:2, k], expected, atol=1e-12)
            if base is not moved:
                np.testing.assert_allclose(moved[:2, k], second + q[1, k] * along, atol=1e-12)
        np.testing.assert_allclose(tip[:2, k], end, atol=1e-12)
        assert not tip[2].any()


def test_places_in_space_are_those_of_the_files_frames(spatial):
    arm, model = spatial
    q = np.random.default_rng(2).uniform(-2, 2, (4, 5))
    found, tip = joint_places(model, q), tip_place(model, q)
    for k in range(5):
        frames, end = spatial_arms.places(arm, q[:, k])
        carries = [np.eye(4), *frames[:-1]]
        for (base, moved), joint, carrier, T in zip(found, arm.joints, carries, frames, strict=True):
            np.testing.assert_allclose(base[:, k], (carrier @ [*joint.origin.xyz, 1.0])[:3], atol=1e-9)
            np.testing.assert_allclose(moved[:, k], T[:3, 3], atol=1e-9)
        np.testing.assert_allclose(tip[:, k], end[:3, 3], atol=1e-9)


def test_the_base_carries_nothing_away(spatial):
    _, model = spatial
    q = np.random.default_rng(3).uniform(-2, 2, (4, 3))
    np.testing.assert_allclose(carried(model, q, 0, (0.1, -0.2, 0.3)), [[0.1] * 3, [-0.2] * 3, [0.3] * 3], atol=1e-9)


def moving(model, q, **more) -> tuple[dict, dict]:
    """The page's part and its numbers."""
    t = np.linspace(0.0, 2.0, q.shape[1])
    page = arm_motion.picture(ArmMotion(model, t, (Course("measured", q),), **more), "what is shown, in words")
    return page, json.loads(str(page["data"]))


def test_frames_are_places_at_one_scale_the_y_axis_up(model):
    """A similarity without a turn takes the places, by angles that are added up, into the drawing."""
    q = np.random.default_rng(4).uniform(-0.6, 0.6, (4, 50))
    page, data = moving(model, q)
    angles = np.cumsum(q, axis=0)
    lengths = np.array([0.37, 0.123, 0.226, 0.158])
    steps = lengths[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    expected = np.concatenate([np.zeros((1, 2, 50)), np.zeros((1, 2, 50)), np.cumsum(steps, axis=0)])
    drawn = np.array(data["bodies"][0], dtype=float).reshape(50, -1, 2).transpose(1, 2, 0)
    span = expected.reshape(6, 2, -1)
    x, y = (drawn[:, k].ravel() - drawn[:, k].mean() for k in (0, 1))
    u, v = (span[:, k].ravel() - span[:, k].mean() for k in (0, 1))
    scale = (x @ u - y @ v) / (u @ u + v @ v)
    assert scale > 0
    assert np.abs(x - scale * u).max() < 1.0
    assert np.abs(y + scale * v).max() < 1.0
    assert data["joints"] == [1, 2, 3, 4]
    assert drawn.min() >= 0
    assert drawn[:, 0].max() <= page["width"]
    assert drawn[:, 1].max() <= page["height"]


def test_an_arm_in_space_is_seen_at_one_scale(spatial):
    """Drawn lengths are at most the true ones times the scale, and along z they are that times cos 24°."""
    arm, model = spatial
    q = np.random.default_rng(5).uniform(-2, 2, (4, 30))
    page, data = moving(model, q)
    drawn = np.array(data["bodies"][0], dtype=float).reshape(30, -1, 2)
    chains = [spatial_arms.places(arm, column) for column in q.T]
    tips = np.array([T[:3, 3] for _, T in chains])
    up = dict(page["axes"])["z"][1] - page["base"][1]
    reach = np.abs([T[:3, 3] for joints, _ in chains for T in joints]).max()
    whole = -up / (0.18 * max(reach, np.abs(tips).max())) / math.cos(math.radians(24.0))
    apart = np.linalg.norm(tips[:, None] - tips[None], axis=2)
    seen = np.linalg.norm(drawn[:, None, -1] - drawn[None, :, -1], axis=2)
    assert (seen <= 1.02 * whole * apart + 2.0).all()
    assert seen.max() > 0.5 * whole * apart.max()


def test_marks_say_what_they_are_given(sliding):
    ratio = np.array([[0.2, 1.6, np.nan], [1.4, 3.2, 0.0], [np.nan, np.nan, 1e9]])
    marks = (JointMarks("before", ratio), JointMarks("after", ratio))
    page, data = moving(sliding, np.zeros((3, 3)), marks=marks)
    assert data["levels"] == [["110", "230", "013"]] * 2
    assert data["marks"][0] == [[2, 14, -1], [16, 32, -1], [-1, 0, 10**6]]
    assert [j["slides"] for j in page["joints"]] == [False, True, False]


def test_a_link_without_length_is_seen_to_turn(library, tmp_path):
    path = tmp_path / "bare.toml"
    path.write_text(
        'name = "bare"\ngravity = [0.0, 0.0]\n[[joint]]\ntype = "revolute"\nrotor_inertia = 0.1\ngear_ratio = 50\n'
        "link = { length = 0.0, mass = 1.0, com = [0.1, 0.0], inertia = 0.1 }\n"
    )
    bare = loader.Model(prepare.prepare_arm(reader.load(path)), library)
    _, data = moving(bare, np.array([[0.0, math.pi / 2, math.pi]]))
    base, east = np.array(data["bodies"][0][0]).reshape(-1, 2)[[0, -1]]
    north, west = (np.array(row).reshape(-1, 2)[-1] for row in data["bodies"][0][1:])
    assert east[0] > base[0]
    assert north[1] < base[1]
    assert west[0] < base[0]
    assert east[1] == base[1] == west[1]


@pytest.mark.parametrize("count", [1, 2, 399, 400, 401, 12345])
def test_frames_are_few_and_evenly_spread(count):
    chosen = arm_motion.frames(count)
    assert 1 <= len(chosen) <= arm_motion.MOST_FRAMES
    assert chosen[0] == 0
    assert len(set(np.diff(chosen))) <= 1
    assert chosen[-1] < count


def drawn_page(page: dict) -> str:
    templates = Path(arm_motion.__file__).parent / "templates"
    environment = Environment(loader=FileSystemLoader(templates), autoescape=True, trim_blocks=True)
    macro = "{% from 'arm_motion.html.j2' import arm_motion %}{{ arm_motion(moving) }}"
    return environment.from_string(macro).render(moving=page)


def test_names_are_text_and_nothing_is_asked_from_outside(model):
    """A joint may be called anything."""
    named = SimpleNamespace(
        n=model.n,
        spatial=False,
        places=model.places,
        tip=model.tip,
        joints=[replace(joint, name=HOSTILE) for joint in model.joints],
    )
    q = np.zeros((4, 20))
    page, _ = moving(named, q, marks=(JointMarks(HOSTILE, np.ones((4, 20))),))
    html = drawn_page({**page, "what": HOSTILE})
    assert "<img" not in html
    assert html.count("</script>") == 1
    assert not re.search(r"(?:https?:)?//\w", html.replace("https://evil.example", ""))
    script = (Path(arm_motion.__file__).parent / "templates" / "arm_motion.js.j2").read_text()
    assert not re.search(r"//|import|fetch|XMLHttp|innerHTML|eval", script)
    assert "{{" not in script
    assert "{%" not in script


def test_it_can_be_played_by_keyboard_and_by_those_who_ask_for_less_motion(model):
    page, _ = moving(model, np.zeros((4, 20)))
    html = drawn_page(page)
    assert re.search(r'<button type="button"[^>]*>Play</button>', html)
    assert re.search(r'<input type="range"[^>]*aria-label="Time"', html)
    assert 'role="img" aria-label="what is shown, in words"' in html
    script = (Path(arm_motion.__file__).parent / "templates" / "arm_motion.js.j2").read_text()
    assert "prefers-reduced-motion" in script
    assert "aria-valuetext" in script
