"""Edits of the model file: what was asked for, and not a byte more."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from symbolic.effects import LIBRARY
from symbolic.model_file import reader
from symbolic.model_file.editor import ModelText
from symbolic.model_file.reader import ModelError
from tests.one_joint import joint_text

FRICTION = """\
[joint.effects.coulomb_asymmetric]   # values unknown
[joint.effects.viscous]
coefficient = 1.14   # from the data sheet
"""
WARM = "[joint.effects.viscous]\n# measured warm\n"
TEXT = f"""\
# my arm
name = "arm2"            # as on the drawing
gravity = [0.0, 0.0]

{joint_text(FRICTION)}
# the elbow
{joint_text(WARM, rotor=0.06)}"""


def edited(text: str) -> ModelText:
    return ModelText(Path("arm.toml"), text, LIBRARY)


def add(text: str, effect: str, joint: int | None = None, **values: float) -> str:
    return edited(text).add(effect, joint, values).text


def put(text: str, effects=None, inertial=None) -> str:
    return edited(text).set_values(effects or {}, inertial).text


def test_an_effect_goes_behind_its_siblings_and_before_the_next_joints_comment():
    expected = TEXT.replace("\n# the elbow", "[joint.effects.stribeck]\ntorque = 0.6\n\n# the elbow")
    assert add(TEXT, "stribeck", 1, torque=0.6) == expected


def test_an_empty_table_says_that_the_values_are_unknown():
    assert add(TEXT, "stribeck", 2) == TEXT + "[joint.effects.stribeck]\n"


def test_effects_of_the_arm_get_a_table_of_their_own():
    once = add(TEXT, "gravity", None, gx=0.5)
    assert once == TEXT + "\n[effects.gravity]\ngx = 0.5\n"
    assert add(once, "payload").endswith("gx = 0.5\n[effects.payload]\n")


def test_effects_of_the_contact():
    text = TEXT + "\n[contact]\nx = 0.4  # plate\n"
    assert add(text, "plate") == text + "\n[contact.effects.plate]\n"


def test_a_generalisation_takes_the_place_of_what_it_generalises():
    changed = add(TEXT, "viscous_asymmetric", 1, positive=1.0, negative=2.0)
    old = "[joint.effects.viscous]\ncoefficient = 1.14   # from the data sheet\n"
    assert changed == TEXT.replace(old, "[joint.effects.viscous_asymmetric]\npositive = 1.0\nnegative = 2.0\n")


def test_values_replace_values_and_keep_comments():
    changed = put(
        TEXT, {("viscous", 1): {"coefficient": 2.5}, ("coulomb_asymmetric", 1): {"positive": 1, "negative": 2}}
    )
    expected = TEXT.replace("coefficient = 1.14 ", "coefficient = 2.5 ").replace(
        "# values unknown\n", "# values unknown\npositive = 1.0\nnegative = 2.0\n"
    )
    assert changed == expected


def test_inertial_parameters_are_added_once_and_then_replaced():
    once = put(TEXT, inertial={"J1": 0.25, "J2": 0.031})
    assert once.startswith(TEXT + "\n[inertial]\n#")
    assert once.endswith("J1 = 0.25\nJ2 = 0.031\n")
    assert put(once, inertial={"J1": 0.26}) == once.replace("J1 = 0.25", "J1 = 0.26")


def test_an_edit_that_changes_nothing_gives_the_same_bytes():
    assert put(TEXT) == TEXT
    same = TEXT.replace("1.14", "1.140")
    assert put(same, {("viscous", 1): {"coefficient": 1.14}}) == same


def test_values_are_written_to_seven_digits():
    assert "coefficient = 1.234568 " in put(TEXT, {("viscous", 1): {"coefficient": 1.23456789}})
    assert "coefficient = 0.0 " in put(TEXT, {("viscous", 1): {"coefficient": 1e-27}})


@pytest.mark.parametrize(
    "restyle",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "\ufeff" + text,
        lambda text: text.rstrip("\n"),
        lambda text: text.replace("[joint.", "  [ joint . "),
        lambda text: text.replace("mass = 2.0", "mass=2_0e-1#kg"),
    ],
)
def test_the_layout_of_every_other_line_stays(restyle):
    text = restyle(TEXT)
    changed = add(text, "stribeck", 2, torque=0.5)
    lines, before = changed.splitlines(), text.splitlines()
    assert [line for line in lines if line in before] == before
    assert len(lines) == len(before) + 2
    assert ("\r\n" in changed) == ("\r\n" in text)
    assert "\r\r" not in changed
    assert changed.count("\n") == changed.count("\r\n") or "\r" not in changed
    assert reader.parse(changed, "arm.toml").joints[1].effects["stribeck"] == {"torque": 0.5}


@pytest.mark.parametrize(
    "text",
    [
        TEXT.replace("[joint.effects.viscous]\n# measured warm", "effects.viscous = {}  # warm"),
        TEXT.replace("[joint.effects.viscous]\n# measured warm", "[joint.effects]\nviscous = {}  # warm"),
        TEXT.replace("[joint.effects.viscous]\n# measured warm", "effects = {viscous = {}} # warm"),
    ],
)
def test_inline_tables_and_dotted_keys_are_edited_too(text: str):
    if "[joint.effects]" not in text.rpartition("# the elbow")[2]:  # these lines belong to the joint, not to its link
        *lines, last = text.splitlines(keepends=True)
        at = len(lines) - lines[::-1].index("[joint.link]\n") - 1
        text = "".join([*lines[:at], last, *lines[at:]])
    for effect, joint in (("stribeck", 2), ("viscous_asymmetric", 2), ("gravity", None)):
        changed = add(text, effect, joint)
        assert "# warm" in changed or effect == "viscous_asymmetric"
        assert "# as on the drawing" in changed
        arm = reader.parse(changed, "arm.toml")
        active = arm.joints[1].effects if joint else arm.effects
        assert effect in active
        assert ("viscous" in arm.joints[1].effects) == (effect != "viscous_asymmetric")
    changed = put(text, {("viscous", 2): {"coefficient": 3.0}})
    assert "# warm" in changed
    assert reader.parse(changed, "arm.toml").joints[1].effects["viscous"] == {"coefficient": 3.0}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("{}", "{positive = 1.5, negative = 1.0}"),
        ("{ }", "{ positive = 1.5, negative = 1.0 }"),
        ("{ negative = 2 }", "{ negative = 1.0, positive = 1.5 }"),
        ("{negative=2}", "{negative=1.0, positive = 1.5}"),
    ],
)
def test_new_keys_of_an_inline_table_stand_apart(before: str, after: str):
    above, joint, below = TEXT.replace("[joint.effects.viscous]\n# measured warm", "").rpartition("[[joint]]\n")
    text = f"{above}{joint}effects.coulomb_asymmetric = {before}\n{below}"
    changed = put(text, {("coulomb_asymmetric", 2): {"positive": 1.5, "negative": 1.0}})
    assert f"effects.coulomb_asymmetric = {after}\n" in changed


def test_of_an_effect_of_which_a_joint_may_have_several_another_is_added():
    once = add(TEXT, "torque_ripple", 1, order=72.0, amplitude=0.2, phase=0.1)
    twice = add(once, "torque_ripple", 1, order=18.0, amplitude=0.1, phase=0.0)
    lines = "[joint.effects.torque_ripple]\norder = 72.0\namplitude = 0.2\nphase = 0.1\n"
    more = "[joint.effects.torque_ripple_2]\norder = 18.0\namplitude = 0.1\nphase = 0.0\n"
    assert twice == TEXT.replace("\n# the elbow", f"{lines}{more}\n# the elbow")
    assert list(reader.parse(twice, "arm.toml").joints[0].effects)[2:] == ["torque_ripple", "torque_ripple_2"]
    changed = put(twice, {("torque_ripple_2", 1): {"amplitude": 0.3}})
    assert reader.parse(changed, "arm.toml").joints[0].effects["torque_ripple_2"]["amplitude"] == 0.3
    assert edited(twice).remove("torque_ripple_2", 1).text == once
    with pytest.raises(ModelError, match='unknown parameter "ordr"; did you mean "order"'):
        reader.parse(twice.replace("order = 18.0", "ordr = 18.0"), "arm.toml")
    with pytest.raises(ModelError, match='unknown effect "viscous_2"; did you mean "viscous"'):
        reader.parse(twice.replace("torque_ripple_2", "viscous_2"), "arm.toml")


@pytest.mark.parametrize(
    ("effect", "joint", "values", "expected"),
    [
        ("viscous", 1, {}, 'arm.toml: effect "viscous" is already there at joint 1; nothing to add'),
        ("stribek", 1, {}, 'arm.toml: joint 1: unknown effect "stribek"; did you mean "stribeck"?'),
        ("stribek", None, {}, 'arm.toml: unknown effect "stribek"; did you mean "stribeck"?'),
        ("stribeck", None, {}, 'arm.toml: effect "stribeck" acts on a joint; say which with --joint 1 to 2'),
        ("stribeck", 3, {}, "arm.toml: there is no joint 3; the arm has 2, counted from 1"),
        ("stribeck", 0, {}, "arm.toml: there is no joint 0; the arm has 2, counted from 1"),
        ("gravity", 1, {}, 'arm.toml: effect "gravity" acts on the whole arm; drop --joint'),
        ("plate", None, {}, 'arm.toml: effect "plate" acts at a contact, and the file has none; add [contact]'),
        ("coupled_friction", 2, {}, 'arm.toml: joint 2: effect "coupled_friction" names the first of two joints'),
        ("stribeck", 1, {"torque": -1.0}, "arm.toml: joint 1: stribeck: torque is -1; expected"),
        ("stribeck", 1, {"torque": float("nan")}, "arm.toml: joint 1: stribeck: torque is nan; expected"),
        ("stribeck", 1, {"force": 1.0}, 'arm.toml: joint 1: stribeck: unknown parameter "force"'),
        ('x"]\nname = "y', 1, {}, "unknown effect"),
    ],
)
def test_what_cannot_be_added(effect, joint, values, expected):
    with pytest.raises(ModelError) as caught:
        add(TEXT, effect, joint, **values)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_arm_in_space_has_no_contact():
    text = 'name = "a"\ngravity = [0.0, 0.0, -9.81]\n[[joint]]\ntype = "revolute"\ngear_ratio = 1\n'
    with pytest.raises(ModelError, match=r'effect "plate" acts at a contact, which belongs to planar arms'):
        add(text, "plate")


def test_values_of_an_effect_that_is_not_there():
    with pytest.raises(ModelError, match="is not in the file; add it first"):
        put(TEXT, {("stribeck", 1): {"torque": 1.0}})
    with pytest.raises(ModelError, match='key "J 1" is no C identifier'):
        put(TEXT, inertial={"J 1": 1.0})


JOINT_EFFECTS = sorted(name for name, effect in LIBRARY.items() if effect.scope == "joint")


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from(JOINT_EFFECTS), st.integers(1, 2)), max_size=6, unique=True),
    st.sampled_from(["\n", "\r\n"]),
)
def test_any_series_of_edits_says_what_was_asked_for(edits, end):
    text = TEXT.replace("\n", end)
    asked = {1: {"coulomb_asymmetric", "viscous"}, 2: {"viscous"}}
    for effect, joint in edits:
        if effect in asked[joint]:
            continue
        text = add(text, effect, joint)
        asked[joint] = asked[joint] - set(LIBRARY[effect].generalises) | {effect}
    tables = tomllib.loads(text)["joint"]
    assert {i: set(table["effects"]) for i, table in enumerate(tables, 1)} == asked
    for comment in ("# my arm", "# as on the drawing", "# the elbow"):
        assert comment in text


# --- effects taken out ---


def test_removing_an_effect_leaves_every_other_byte():
    with_spring = add(TEXT, "linear_spring", 1, stiffness=2.0, rest=0.1)
    assert edited(with_spring).remove("linear_spring", 1).text == TEXT


def test_the_only_effect_leaves_no_empty_table():
    text = TEXT + "\n[contact]\nx = 0.4  # plate\n"
    with_plate = add(text, "plate", None, stiffness=600.0)
    without = edited(with_plate).remove("plate").text
    assert without == text
    assert "effects" not in tomllib.loads(without)["contact"]


def test_an_inline_effect_is_removed_too():
    text = TEXT.replace("[joint.effects.viscous]\n# measured warm\n", "")
    text = text.replace("rotor_inertia = 0.06\n", "rotor_inertia = 0.06\neffects = { viscous = {}, coulomb = {} }\n")
    removed = edited(text).remove("viscous", 2).text
    assert tomllib.loads(removed)["joint"][1]["effects"] == {"coulomb": {}}


def test_removing_what_is_not_there_is_an_error():
    with pytest.raises(ModelError, match='effect "stribeck" is not there at joint 2; nothing to remove'):
        edited(TEXT).remove("stribeck", 2)


def test_an_effect_is_placed_whatever_was_there_before():
    values = {"stiffness": 5100.0, "radius": 0.06, "offset": -0.9, "pretension": 0.0}
    once = edited(TEXT).place("parallel_spring", 2, values).text
    assert reader.parse(once, "arm.toml").joints[1].effects["parallel_spring"] == values
    softer = edited(once).place("parallel_spring", 2, values | {"stiffness": 1300.0}).text
    assert softer == once.replace("5100.0", "1300.0")
    assert edited(softer).place("parallel_spring", 2, None).text == TEXT
    assert edited(TEXT).place("parallel_spring", 2, None).text == TEXT
