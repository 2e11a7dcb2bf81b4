"""Distances of a URDF's collision shapes, with coal: the last check of a finished motion.

A mesh is taken as its convex hull, which holds it; where hulls of links come close, their triangles decide. coal is an
extra of the package, `collision`.
Source: Pan, Chitta & Manocha 2012 (FCL); coal-library/coal.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.experiments.margins import (
    KeptDistances,
    Nearest,
    body_name,
    check_place,
    joints_unchecked,
    least_of,
    nearest_of,
    sampled_poses,
    surroundings_unchecked,
    upward,
)
from runtime.experiments.scene import Scene
from runtime.model.kinematics import body_frames, pose
from symbolic.model_file.arm import Arm, CollisionShape, Frame
from symbolic.model_file.checks import ModelError
from symbolic.model_file.frames import composed


@dataclass(frozen=True)
class _Solid:
    """A geometry of coal.

    body    that carries it, 0 for the base and what is at rest     frame   in that body's frame
    hull    convex     triangles   of a mesh; None of a shape that is its own hull
    """

    name: str
    body: int
    frame: Frame
    hull: Any
    triangles: Any = None


@dataclass(frozen=True)
class MeshClearance:
    """The distances of an arm's collision shapes in a scene.

    pairs    of numbers of solids     judged   what they keep, and what is not checked, in words
    lacking  shapes that are not there, a sentence each
    """

    arm: Arm
    scene: Scene
    solids: tuple[_Solid, ...]
    pairs: tuple[tuple[int, int], ...]
    lacking: tuple[str, ...]
    judged: KeptDistances

    @classmethod
    def of(cls, arm: Arm, scene: Scene, shapes: Sequence[CollisionShape], lacking: Sequence[str] = ()) -> MeshClearance:
        """Of what `collision_shapes` reads. Raises ModelError: coal is not installed, or the arm stands in a box."""
        coal = _coal()
        check_place(arm, scene)
        solids: list[_Solid] = []
        absent = list(lacking)
        for shape in shapes:
            made = _solid(coal, shape)
            if isinstance(made, str):
                absent.append(f"Link {shape.link} is not checked whole: {made}.")
            else:
                solids.append(made)
        solids += _tool(coal, arm, scene)
        around = _surroundings(coal, arm, scene)
        moving = [k for k, solid in enumerate(solids) if solid.body > 0]
        links = [
            (a, b)
            for a, one in enumerate(solids)
            for b, other in enumerate(solids)
            if arm.space and other.body - one.body > 1
        ]
        pairs = (*links, *((a, b) for b in range(len(solids), len(solids) + len(around)) for a in moving))
        whole = cls(arm, scene, (*solids, *around), pairs, tuple(absent), KeptDistances.none(len(pairs)))
        sampled = whole.distances(sampled_poses(arm))
        margins = np.repeat([scene.link_margin, scene.margin], [len(links), len(pairs) - len(links)])
        nothing = np.zeros(len(pairs))
        judged = KeptDistances.of(whole.names, sampled, nothing, margins, apart=nothing.astype(np.int64))
        kept = tuple(pair for pair, checked in zip(pairs, judged.checked, strict=True) if checked)
        return replace(whole, pairs=kept, judged=judged.of_these(judged.checked))

    def least(self, q: Array) -> Array:
        """(N,) m at q (n, N): the smallest distance less its margin; negative: too close."""
        return least_of(self.distances(q))

    def worst(self, q: Array) -> Nearest:
        """Where q (n, N) comes closest."""
        return nearest_of(self.distances(q), self.names)

    def distances(self, q: Array) -> Array:
        """(T, N) m at q (n, N), of every pair in the order of `names`, less margins; some 5 µs each, and a millisecond
        where links are close."""
        coal = _coal()
        R, p = body_frames(self.arm, q)
        out = np.empty((len(self.pairs), q.shape[1]))
        own, near = [pose(solid.frame) for solid in self.solids], 2 * self.scene.link_margin
        for sample in range(q.shape[1]):
            placed = []
            for solid, (turned, origin) in zip(self.solids, own, strict=True):
                of_body = R[solid.body, :, :, sample]
                place = p[solid.body, :, sample] + of_body @ origin
                placed.append(coal.Transform3s(of_body @ turned, place))
            for row, (a, b) in enumerate(self.pairs):
                out[row, sample] = _distance(coal, self.solids[a], placed[a], self.solids[b], placed[b], near)
        return out - self.judged.kept[:, None]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(T,) what each distance is between, in words."""
        return tuple(f"{self.solids[a].name} and {self.solids[b].name}" for a, b in self.pairs)

    @cached_property
    def unchecked(self) -> tuple[str, ...]:
        """What nobody looks at, a sentence each."""
        return (
            *self.lacking,
            *surroundings_unchecked(self.scene),
            *joints_unchecked(self.arm),
            *self.judged.unchecked,
        )


def _coal() -> Any:
    """The package. Raises ModelError if it is not installed."""
    try:
        return importlib.import_module("coal")
    except ImportError:
        raise ModelError(
            "collision shapes are judged by the package coal, which is not installed: pip install coal (the extra "
            "`collision`)"
        ) from None


def _distance(coal: Any, one: _Solid, at: Any, other: _Solid, other_at: Any, near: float) -> float:
    """m; negative where the two overlap. Of hulls nearer than `near` m, the larger one of their triangles."""
    request = coal.DistanceRequest()
    found = float(coal.distance(one.hull, at, other.hull, other_at, request, coal.DistanceResult()))
    if found >= near or not (one.triangles or other.triangles):
        return found
    first, second = one.triangles or one.hull, other.triangles or other.hull
    return max(found, float(coal.distance(first, at, second, other_at, request, coal.DistanceResult())))


def _solid(coal: Any, shape: CollisionShape) -> _Solid | str:
    """The shape for coal, or why there is none."""
    name = body_name(shape.body)
    if shape.mesh is None:
        made = {"box": coal.Box, "sphere": coal.Sphere, "cylinder": coal.Cylinder, "capsule": coal.Capsule}
        return _Solid(name, shape.body, shape.frame, made[shape.kind](*shape.size))
    try:
        mesh = coal.MeshLoader().load(str(shape.mesh), np.array(shape.size))
        mesh.buildConvexHull(True, "Qt")
    except (ValueError, RuntimeError) as error:
        said = next((line for line in str(error).splitlines() if line.startswith("message: ")), "")
        return f"its mesh {shape.mesh.name} is no mesh with a volume ({said.removeprefix('message: ') or 'no hull'})"
    return _Solid(name, shape.body, shape.frame, mesh.convex, mesh)


def _tool(coal: Any, arm: Arm, scene: Scene) -> list[_Solid]:
    """The scene's tool, if there is one: coal's capsules lie along z about their middle."""
    if scene.tool is None:
        return []
    start, end = np.array(scene.tool.start), np.array(scene.tool.end)
    x, y, z = end - start
    frame = Frame(tuple((start + end) / 2), (0.0, float(np.arctan2(np.hypot(x, y), z)), float(np.arctan2(y, x))))
    capsule = coal.Capsule(scene.tool.radius, float(np.linalg.norm(end - start)))
    return [_Solid("the tool", len(arm.joints), composed(arm.tip, frame), capsule)]


def _surroundings(coal: Any, arm: Arm, scene: Scene) -> list[_Solid]:
    found = [_Solid(box.name, 0, box.frame, coal.Box(*box.size)) for box in scene.boxes]
    if scene.floor is not None:
        found.append(_Solid("the floor", 0, Frame(), coal.Halfspace(upward(arm), scene.floor)))
    return found
