"""Modified DH frames stand where the model file's origins and axes say, whatever the joints do."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pytest
import spatial_arms
from numpy.testing import assert_allclose

from symbolic.functions import Turn
from symbolic.model_file.frames import rotation
from symbolic.rigid_body.spatial.base_parameters import merging
from symbolic.rigid_body.spatial.geometry import Geometry, Placement, exact_rotation, exact_turn, geometry

Array = spatial_arms.Array
TYPES = ("r", "p", "rr", "pr", "rp", "rrr", "prp", "rrrrrr", "rrprrpr", "pprrrr")


def turned(rpy: Sequence[float]) -> Array:
    return np.array(rotation(rpy))


def floats(placement: Placement) -> tuple[Array, Array]:
    return np.array(placement.turn, dtype=float), np.array(placement.at, dtype=float)


def by_dh(g: Geometry, q: Array) -> list[tuple[Array, Array]]:
    R, p = floats(g.base)
    frames = []
    for link, x in zip(g.links, q, strict=True):
        p = p + R @ np.array([float(link.across(0 if link.revolute else x)), 0, 0])
        R = R @ turned((float(np.arctan2(float(link.twist.sin), float(link.twist.cos))), 0, 0))
        rest = Turn(Fraction(1), Fraction(0)) if link.rest == 0 else link.rest
        theta = sum(float(np.arctan2(float(t.sin), float(t.cos))) for t in (link.offset, rest))
        R = R @ turned((0, 0, theta + (link.sign * x if link.revolute else 0)))
        p = p + R @ np.array([0, 0, float(link.reach(0 if link.revolute else x))])
        turn, at = floats(link.body)
        frames.append((R @ turn, p + R @ at))
    turn, at = floats(g.tip)
    return [*frames, (R @ turn, p + R @ at)]


@pytest.mark.parametrize("types", TYPES)
def test_frames_are_those_of_the_file(types: str) -> None:
    for seed in range(8):
        arm = spatial_arms.drawn(types, seed)
        q = np.random.default_rng(seed).uniform(-2, 2, len(types))
        joints, tip = spatial_arms.places(arm, q)
        for T, (R, p) in zip([*joints, tip], by_dh(geometry(arm), q), strict=True):
            assert_allclose(T[:3, :3], R, atol=1e-11)
            assert_allclose(T[:3, 3], p, atol=1e-11)


@pytest.mark.parametrize("name", spatial_arms.TABLES)
def test_tables_of_the_literature_come_back(name: str) -> None:
    """Twists, lengths and offsets along the axes up to the signs of the x axes; what lies before joint 2 vanishes."""
    links = geometry(spatial_arms.known(name)).links
    for link, (quarters, a, _) in zip(links, spatial_arms.TABLES[name], strict=True):
        assert abs(link.twist.sin) == abs(quarters)
        assert abs(link.a) == Fraction(str(abs(a)))
        assert link.rest == 0
    assert all(isinstance(x, Fraction) and x.denominator < 10**6 for link in links for x in (link.a, link.d))
    assert (links[0].a, links[0].d, links[0].twist) == (0, 0, Turn(1, 0))


def test_parallel_axes_point_the_same_way() -> None:
    for seed in range(20):
        links = geometry(spatial_arms.drawn("rrrr", seed, general=0.0)).links
        assert all(link.twist.cos != -1 for link in links)


def test_rotations_are_orthogonal_to_the_last_digit() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        R = exact_rotation(rotation([float(x) for x in rng.uniform(-3, 3, 3)]))
        for i, u in enumerate(R):
            for j, v in enumerate(R):
                assert sum(a * b for a, b in zip(u, v, strict=True)) == (i == j)
        angle = rng.uniform(-4, 4)
        turn = exact_turn(float(np.cos(angle)), float(np.sin(angle)))
        assert turn.cos**2 + turn.sin**2 == 1


@pytest.mark.parametrize(("types", "seed"), [("rpp", 47), ("rrp", 3), ("ppp", 8), ("rrrrrrr", 9)])
def test_general_angles_merge_exactly(types: str, seed: int) -> None:
    """Coefficients of many digits are recovered; what merges is not kept."""
    found = merging(geometry(spatial_arms.drawn(types, seed, general=1.0)))
    assert all(set(parts) <= set(found.kept) for parts in found.terms.values())
    assert all(found.terms[column] == {column: 1} for column in found.kept)
