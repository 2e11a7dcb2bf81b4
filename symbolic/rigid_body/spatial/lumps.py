"""Base inertial parameters in space as people see them, and the constants beside them."""

from __future__ import annotations

import math

from symbolic.model_file.arm import Arm
from symbolic.rigid_body.exact_rank import BaseParameters, Column
from symbolic.rigid_body.layout import LayoutConstant
from symbolic.rigid_body.lumps import Lump, overridden
from symbolic.rigid_body.spatial.base_parameters import ROTOR, Merging
from symbolic.rigid_body.spatial.geometry import Geometry, offset_symbol
from symbolic.straightline import Turn

NAMES = {"xx": "YY", "yy": "XX", "xy": "XY", "xz": "XZ", "yz": "YZ", "x": "MX", "y": "MY", "z": "MZ", "m": "M"}
"""The field's names. What lies along a link's z axis merges into the link before: of a body without it, ∫ y² dm is the
inertia about x, XX, ∫ x² dm that about y, YY, and ZZ = XX + YY."""


def named_lumps(arm: Arm, base: BaseParameters, merged: Merging) -> tuple[Lump, ...]:
    """In the order of the base parameters; values that an identification left in the file replace the bodies'.

    Raises ModelError for a value in the file whose name this arm does not have.
    """
    lumps = []
    for column, value in base.values.items():
        kind, i = column
        parts = base.merged[column]
        about_z = _only_about_z(column, merged)
        name = "I" if kind == ROTOR else "ZZ" if about_z else NAMES[kind]
        sliding = arm.joints[i].type == "prismatic"
        lumps.append(
            Lump(
                f"{name}{i + 1}",
                {"I": "kg" if sliding else "kg m^2", "M": "kg"}.get(name, "kg m" if name[0] == "M" else "kg m^2"),
                _meaning(name, i + 1) + (", with what merges into it" if len(parts) > 1 else ""),
                i + 1,
                None if value is None else float(value),
                tuple((j + 1, own, factor) for (own, j), factor in parts),
            )
        )
    return overridden(arm, lumps)


def _only_about_z(column: Column, merged: Merging) -> bool:
    """Of a link that turns about its joint's direction alone, whose XX and YY are felt as one, ZZ."""
    kind, i = column
    return kind == "xx" and merged.terms["yy", i] == {column: 1}


def _meaning(name: str, joint: int) -> str:
    if name == "I":
        return f"rotor inertia of joint {joint} at its output"
    if name == "ZZ":
        return f"inertia of link {joint} about its joint"
    if name == "M":
        return f"mass of link {joint}"
    if name[0] == "M":
        return f"first mass moment of link {joint} along {name[1].lower()} of its DH frame"
    return f"inertia {name} of link {joint} in its DH frame, of what lies across z"


def angles(g: Geometry) -> tuple[LayoutConstant, ...]:
    """Constants of the struct: joint angles beyond quarter turns between the model file's zero and the DH frames'."""
    return tuple(
        LayoutConstant(
            offset_symbol(j), "rad", f"of joint {j}'s DH frame where q{j} = 0", math.atan2(rest.sin, rest.cos)
        )
        for j, rest in enumerate(g.rests, 1)
        if isinstance(rest, Turn)
    )
