"""Errors that the model's own parameters can take: nothing may be named, and the fit must come out as the truth."""

from __future__ import annotations

from .bodies import in_space
from .hidden import Hidden, Rows, Setup, at, entry, more, same
from .space import tip


@entry("inside_offset", "inside")
def _(s: Setup) -> Hidden:
    """An offset is half a difference of two dry frictions."""
    sign = s.rng.choice([-1.0, 1.0])
    return Hidden("", s.rng.uniform(0.1, 0.45), (0.0, 1.0), at(s.joint, OFFSET=lambda a: a * sign))


@entry("inside_coulomb", "inside")
def _(s: Setup) -> Hidden:
    return Hidden("", s.rng.uniform(0.1, 0.6), (0.0, 1.0), more(s.joint, DRY_POSITIVE=1.0, DRY_NEGATIVE=1.0))


@entry("inside_scale", "inside")
def _(s: Setup) -> Hidden:
    """All joints' torques wrong by one factor: a heavier arm with more friction."""

    def put(rows: Rows, _arm: dict[str, float], amount: float) -> None:
        for row in rows:
            row["GAIN"] = amount

    return Hidden(
        "", float(s.rng.choice([s.rng.uniform(0.75, 0.9), s.rng.uniform(1.1, 1.3)])), (0.0, 2.0), put, of_arm=True
    )


def at_tip(s: Setup) -> dict[str, float]:
    """Where a payload is held, m, in base axes where q = 0; nothing in the plane."""
    if not in_space(s.bodies):
        return {}
    return dict(zip(("PAYLOAD_X", "PAYLOAD_Y", "PAYLOAD_Z"), tip(s.bodies).tolist(), strict=True))


@entry("inside_payload", "inside")
def _(s: Setup) -> Hidden:
    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm.update(PAYLOAD=amount, PAYLOAD_TIME=0.0, **at_tip(s))

    return Hidden("", s.rng.uniform(0.2, 0.8), (0.0, 2.0), put, of_arm=True)


@entry("inside_inertia", "inside")
def _(s: Setup) -> Hidden:
    """A wrong number in the model file, the commonest error of all."""
    right = s.bodies[s.joint].inertia
    factor = float(s.rng.choice([s.rng.uniform(0.3, 0.7), s.rng.uniform(1.5, 2.5)]))
    return Hidden("", factor * right, (0.0, 1.0), at(s.joint, INERTIA=same))
