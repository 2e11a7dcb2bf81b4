"""What is asked of an experiment, as it is typed: rivals, joints, ranges, a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.simulation.simulate import Hidden, SimulationError, parse_hidden
from symbolic.model_file.checks import joint_number, known_joints


class ExperimentError(ValueError):
    """What was asked is no experiment; the message says why and what to do."""


def rival_texts(text: str) -> list[str]:
    """Of `EFFECT@JOINT[:KEY=VALUE,...]`, several separated by commas, each."""
    parts: list[str] = []
    for cell in text.split(","):
        continues = "=" in cell.partition(":")[0] and parts
        if continues:
            parts[-1] += f",{cell}"
        else:
            parts.append(cell.strip())
    return parts


def parse_rivals(text: str, model: Model) -> list[Hidden]:
    """The effects that are to be told apart. Raises ExperimentError."""
    try:
        rivals = [parse_hidden(part, model, "--between") for part in rival_texts(text)]
    except SimulationError as error:
        raise ExperimentError(str(error)) from error
    for rival in rivals:
        if sum(rival.term == other.term for other in rivals) > 1:
            raise ExperimentError(f"--between {text}: {rival.term} is named twice; name different rivals")
        if rival.term in structure(model):
            raise ExperimentError(
                f"--between {text}: {model.name} has {rival.term} already; name effects that it lacks, or take it out"
            )
    return rivals


def parse_joints(text: str, model: Model, rivals: Sequence[Hidden]) -> list[int]:
    """The joints (0-based) that move, of numbers or names separated by commas. Raises ExperimentError."""
    found = sorted({_joint(part.strip(), model, f"--joints {text}") for part in text.split(",")})
    for rival in rivals:
        at = rival.term.joint
        if at is not None and at - 1 not in found:
            raise ExperimentError(f"--joints {text}: {rival.term} shows at joint {at} only, which would rest; add it")
    return found


def parse_ranges(texts: Sequence[str], model: Model) -> dict[int, tuple[float, float]]:
    """Ranges of positions, (low, high) in rad or m by joint (0-based), of texts q2=LOW:HIGH, with the joint's number or
    name. Raises ExperimentError."""
    found: dict[int, tuple[float, float]] = {}
    for text in texts:
        said, _, ends = text.partition("=")
        low, _, high = ends.partition(":")
        try:
            least, most = float(low), float(high)
        except ValueError as error:
            raise ExperimentError(f"--range {text}: expected JOINT=LOW:HIGH in rad or m, as q2=-1:0.5") from error
        i = _joint(said.removeprefix("q"), model, f"--range {text}")
        limits, unit = model.joints[i].position_limits, model.joints[i].position_unit
        lowest, highest = limits or (-np.inf, np.inf)
        if not (lowest <= least < most <= highest and np.isfinite([least, most]).all()):
            of_file = f" within the limits of the file, {lowest:g} to {highest:g} {unit}" if limits else ""
            raise ExperimentError(f"--range {text}: expected LOW below HIGH{of_file}")
        found[i] = least, most
    return found


def _joint(said: str, model: Model, where: str) -> int:
    names = [joint.name for joint in model.joints]
    number = joint_number(said, names)
    if number is None:
        raise ExperimentError(f"{where}: {said!r} is no joint of {model.name}; it has {known_joints(names)}")
    return number - 1


def parse_pose(text: str) -> Array:
    """Positions (n,), rad or m, of a text Q1,Q2,... Raises ExperimentError."""
    try:
        pose = np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise ExperimentError(f"--start {text}: expected numbers separated by commas, rad or m") from error
    if not np.isfinite(pose).all():
        raise ExperimentError(f"--start {text}: expected finite numbers")
    return pose
