"""How a base stands, in words: turned about a known axis, by an equation apart from the library's."""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
import pytest

from runtime.report.mounting import said

DOWN = (0.0, 0.0, -9.81)


def turned(axis: str, degrees: float) -> np.ndarray:
    """Gravity in the axes of a base that was turned by so much about its own axis (Rodrigues)."""
    k = np.eye(3)["xyz".index(axis)]
    c, s = cos(radians(degrees)), sin(radians(degrees))
    down = np.array(DOWN)
    # The base turns, so that gravity turns back in its axes.
    return down * c - np.cross(k, down) * s + k * (k @ down) * (1 - c)


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("degrees", [12, -12, 40])
def test_a_tilted_base_is_said_with_its_angle_and_axis(axis: str, degrees: float) -> None:
    text = said(DOWN, turned(axis, degrees) - DOWN)
    sign = "−" if degrees < 0 else ""
    assert text.startswith(f"the base is tilted by {abs(degrees)}° about {sign}{axis}; state gravity = [")


def test_a_base_on_a_wall_or_the_ceiling() -> None:
    wall = said(DOWN, np.array([9.7, 0.1, 0.05]) - DOWN)
    assert wall.startswith("the base is mounted on a wall: gravity points along x; state gravity = [9.7, 0.1, 0.05]")
    assert "on a wall: gravity points along −y" in said(DOWN, np.array([0.0, -9.81, 0.0]) - DOWN)
    assert said(DOWN, (0.0, 0.0, 19.5)).startswith("the base is mounted on the ceiling: gravity points along z;")


def test_gravity_that_the_file_lacks_and_gravity_that_the_recording_lacks() -> None:
    assert said((0.0, 0.0), (0.1, -9.7)).startswith("gravity is not in the file: it points along −y; state gravity =")
    assert "taken out of the recorded torque" in said(DOWN, (0.01, 0.0, 9.83))
    flat = said((0.0, -9.81), (0.0, 9.8))
    assert "horizontal plane" in flat
    assert "gravity_compensated" in flat


def test_a_planar_arm_turns_about_z() -> None:
    c, s = cos(radians(20)), sin(radians(20))
    # A base turned by 20° sees gravity turned by −20°.
    whole = np.array([[c, s], [-s, c]]) @ np.array([0.0, -9.81])
    assert said((0.0, -9.81), whole - np.array([0.0, -9.81])).startswith("the base is tilted by 20° about z;")


def test_more_of_the_same_gravity_is_no_tilt() -> None:
    assert "the file's direction" in said(DOWN, (0.0, 0.0, -1.0))
