"""The model file of one joint on a bench, for tests that need no more of an arm."""

from __future__ import annotations

INERTIA = 0.10 + 0.0565 + 2.0 * 0.20**2
"""kg m^2 at the joint's output: rotor, link, and the link's mass at its centre."""


def model_text(tables: str, name: str = "drive1") -> str:
    """The file as a person writes it, comment and blank line included. tables: of the joint, behind its link."""
    return f"""\
name = "{name}"          # the bench
gravity = [0.0, 0.0]

[[joint]]
type = "revolute"
rotor_inertia = 0.10
gear_ratio = 100
[joint.link]
length = 0.30
mass = 2.0
com = [0.20, 0.0]
inertia = 0.0565
{tables}"""
