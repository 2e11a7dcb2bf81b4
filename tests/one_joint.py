"""Joints on a bench as a person writes them into a model file, for tests that need no more of an arm."""

from __future__ import annotations

import pytest

from symbolic.model_file import reader

ROTOR, LINK = 0.10, 0.0565 + 2.0 * 0.20**2
"""kg m^2 at the joint's output, and of the link about the joint."""
INERTIA = ROTOR + LINK


def joint_text(tables: str = "", rotor: float = ROTOR) -> str:
    """A joint; tables: of it, behind its link."""
    return f"""\
[[joint]]
type = "revolute"
rotor_inertia = {rotor:.2f}
gear_ratio = 100
[joint.link]
length = 0.30
mass = 2.0
com = [0.20, 0.0]
inertia = 0.0565
{tables}"""


def model_text(tables: str, name: str = "drive1", gravity: float = 0.0, controller: str = "") -> str:
    """The file, comment and blank line included. tables: as of `joint_text`; gravity: m/s^2 along y."""
    return f"""\
name = "{name}"          # the bench
gravity = [0.0, {gravity}]
{controller}
{joint_text(tables)}"""


def refusal(text: str) -> str:
    """The one line that a person reads about a model file that is refused."""
    with pytest.raises(reader.ModelError) as caught:
        reader.parse(text, "arm.toml")
    message = str(caught.value)
    assert "\n" not in message
    assert message.isprintable()
    return message
