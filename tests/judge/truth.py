"""What a fit must find where the model's own parameters can take all that is hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from .bodies import Body
from .hidden import Rows


@dataclass(frozen=True)
class Parameters:
    """bodies: as the recorded torque shows them; friction: (effect, joint, parameter) -> value."""

    bodies: tuple[Body, ...]
    friction: dict[tuple[str, int, str], float]


def true_parameters(
    rows: Rows, arm: Mapping[str, float], bodies: Sequence[Body], believed: Sequence[str]
) -> Parameters:
    """Bodies and frictions as the recorded torque shows them: divided by the drives' common gain, with the payload."""
    gains = {row.get("GAIN", 1.0) for row in rows}
    if len(gains) != 1:
        raise ValueError("gains that differ from joint to joint are in no model's span")
    gain = gains.pop()
    seen = [
        replace(
            body,
            rotor=row["ROTOR"] / gain,
            mass=row["MASS"] / gain,
            com=(row["COM_X"], row["COM_Y"]),
            inertia=row["INERTIA"] / gain,
        )
        for body, row in zip(bodies, rows, strict=True)
    ]
    if arm.get("PAYLOAD"):
        seen[-1] = _carrying(seen[-1], arm["PAYLOAD"] / gain)
    friction = {}
    for joint, row in enumerate(rows, 1):
        for effect in believed:
            for name, value in _friction(effect, row).items():
                friction[effect, joint, name] = value / gain
    return Parameters(tuple(seen), friction)


def _friction(effect: str, row: Mapping[str, float]) -> dict[str, float]:
    if effect == "coulomb_asymmetric":
        offset = row.get("OFFSET", 0.0)
        return {"positive": row["DRY_POSITIVE"] + offset, "negative": row["DRY_NEGATIVE"] - offset}
    if effect == "viscous":
        return {"coefficient": row["VISCOUS_POSITIVE"]}
    if effect == "viscous_cubic":
        return {"coefficient": row["CUBIC"]}
    raise ValueError(f"no true value for {effect}")


def _carrying(body: Body, mass: float) -> Body:
    """A body with a point mass at the far end of its link."""
    total = body.mass + mass
    along = (body.mass * body.com[0] + mass * body.length) / total
    across = body.mass * body.com[1] / total
    about = body.inertia + body.mass * ((body.com[0] - along) ** 2 + (body.com[1] - across) ** 2)
    about += mass * ((body.length - along) ** 2 + across**2)
    return replace(body, mass=total, com=(along, across), inertia=about)
