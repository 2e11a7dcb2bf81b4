"""A model file that leaves out what nobody knows: which base parameters it still tells, and what is made of it."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen import render
from codegen.firmware.source_tree import firmware_files
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, Joint
from symbolic.model_file.checks import ModelError, check_stated
from symbolic.rigid_body.base_parameters import base_parameters
from tests.exact import random_arm
from tests.symbolic.model_file.test_model_file import GOOD

KEYS = ("mass", "com", "inertia", "rotor_inertia")


def changed(arm: Arm, place: tuple[int, str], out: bool) -> Arm:
    """The arm without a number, or with another one in its place."""
    i, key = place
    joint = arm.joints[i % len(arm.joints)]
    owner: object = joint if key == "rotor_inertia" else joint.link
    value = getattr(owner, key)
    other = None
    if not out:
        moved = {"com": lambda v: (v[0] + 0.013, 1.7 * v[1], 0.0), "inertia": lambda v: (*v[:5], v[5] + 0.37)}
        other = moved.get(key, lambda v: v + 0.37)(value)
    if key == "rotor_inertia":
        made: Joint = replace(joint, rotor_inertia=other)
    else:
        made = replace(joint, link=replace(joint.link, **{key: other}))
    return replace(arm, joints=tuple(made if j is joint else j for j in arm.joints))


def off_their_lines() -> list[tuple[int, int]]:
    """Arms by (joints, seed) whose centres of mass lie off their links' lines and ends: there, moments would be left
    out that an unknown one may have."""
    every = ((n, seed) for n in (1, 2, 3) for seed in range(41))
    arms = {key: random_arm(*key) for key in every}
    return [
        key
        for key, arm in arms.items()
        if all(j.link.com[1] and j.link.com[0] != x for j, x in zip(arm.joints, arm.lengths, strict=True))
    ]


@settings(max_examples=25, deadline=None)
@given(
    which=st.sampled_from(off_their_lines()),
    left_out=st.sets(st.tuples(st.integers(0, 2), st.sampled_from(KEYS)), max_size=4),
)
def test_a_base_parameter_is_known_where_no_number_behind_it_is_left_out(
    which: tuple[int, int], left_out: set[tuple[int, str]]
) -> None:
    arm = random_arm(*which)
    whole = base_parameters(arm).values
    bare = arm
    for place in left_out:
        bare = changed(bare, place, out=True)
    hanging = {
        column
        for place in left_out
        for column, value in base_parameters(changed(arm, place, out=False)).values.items()
        if value != whole[column]
    }
    assert base_parameters(bare).values == {c: None if c in hanging else value for c, value in whole.items()}


@pytest.mark.parametrize("key", KEYS)
def test_each_key_may_be_left_out_by_itself(key: str) -> None:
    text = "".join(line for line in GOOD.splitlines(keepends=True) if not line.startswith(f"{key} "))
    arm = reader.parse(text, "arm.toml")
    assert [joint.unknown for joint in arm.joints] == [(key,), (key,)]
    found = json.loads(render.arm_files(derive(arm))["metadata.json"])
    assert any(lump["value"] is None for lump in found["lumps"])
    assert [joint["unknown"] for joint in found["joints"]] == [[key], [key]]


def test_a_full_file_says_nothing_of_unknown_numbers() -> None:
    arm = reader.parse(GOOD, "arm.toml")
    files = render.arm_files(derive(arm))
    assert "unknown" not in files["metadata.json"]
    assert "to be set" not in files["arm2_f32.c"]


def test_identified_parameters_make_an_arm_known() -> None:
    text = "".join(line for line in GOOD.splitlines(keepends=True) if line.split(" ")[0] not in KEYS)
    names = [lump.name for lump in derive(reader.parse(text, "arm.toml")).lumps]
    told = text + "[inertial]\n" + "".join(f"{name} = 0.5\n" for name in names)
    assert {lump.value for lump in derive(reader.parse(told, "arm.toml")).lumps} == {0.5}


def test_a_controller_is_not_made_of_numbers_that_nobody_knows() -> None:
    text = "".join(line for line in GOOD.splitlines(keepends=True) if not line.startswith("mass "))
    with pytest.raises(ModelError, match=r"^arm2: .*\(joints 1, 2: mass\).*tendon identify") as caught:
        firmware_files(derive(reader.parse(text, "arm.toml")), LIBRARY)
    assert "\n" not in str(caught.value)


def test_joints_that_lack_the_same_are_named_together() -> None:
    with pytest.raises(ModelError) as caught:
        check_stated("arm", ["J1"], [("rotor_inertia",), ("mass", "com"), (), ("rotor_inertia",)])
    assert (
        "leaves out (joints 1, 4: rotor_inertia; joint 2: mass, com); base parameters that depend on them: J1"
        in str(caught.value)
    )
