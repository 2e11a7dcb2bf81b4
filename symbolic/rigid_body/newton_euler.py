"""Inverse dynamics of a planar chain: a Newton-Euler recursion on lumped parameters, which is what is emitted.

The same code runs on SymPy symbols, fractions and residues modulo a prime (see functions.py). It is short because:

- Rates and angles are absolute, and all vectors are written in the frame of one chosen link, whose own angle is
  therefore 0. Without gravity, the arm's absolute orientation does not matter.
- The x components of acceleration and force have the opposite sign (b = −a_x, G = −F_x), so that, with
  (lc, ls) = l (cos, sin), b += al ls + w² lc, y += al lc − w² ls and a moment is lc F + ls G: nothing is negated.
- A link is a point mass mu at its distal point, a first moment (h, hy) without mass, and an inertia J. Those that are
  no base parameters (base_parameters.py) are 0 and vanish.

Source: Luh, Walker & Paul 1980 (recursive Newton-Euler); Khalil & Kleinfinger 1987 (base parameters).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from symbolic.functions import Notes, Turn


@dataclass(frozen=True)
class Gravity:
    """Gravity as a vector (x, y), 0 where exactly 0, and as magnitude `strength` and `angle` from the x axis."""

    x: Any
    y: Any
    strength: Any
    angle: Any


@dataclass(frozen=True)
class Chain:
    """Joint types and link lengths from the base outwards; lengths in any unit, gravity in that unit per s²."""

    revolute: tuple[bool, ...]
    lengths: tuple[Any, ...]
    gravity: Gravity | None

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.revolute)

    @property
    def frames(self) -> tuple[int, ...]:
        """The frame of each link: the number of the last revolute joint up to it; 0 is the base."""
        frames, last = [], 0
        for i, revolute in enumerate(self.revolute, 1):
            last = i if revolute else last
            frames.append(last)
        return tuple(frames)

    def over(self, number: Callable[[Any], Any]) -> Chain:
        """The same with numbers of another ring."""
        g = self.gravity
        if g is not None:
            angle = g.angle.over(number) if isinstance(g.angle, Turn) else number(g.angle)
            g = Gravity(number(g.x), number(g.y), number(g.strength), angle)
        return Chain(self.revolute, tuple(map(number, self.lengths)), g)


@dataclass(frozen=True)
class Lumps:
    """Inertial parameters of the links, (n,) each, 0 where a link has none.

    mu   point mass at the distal point
    h    first moment along the link, without mass, about the joint (revolute) or the distal point (prismatic)
    hy   the same, across the link
    J    inertia that turns with the link
    I    rotor inertia, which multiplies the joint's own acceleration only
    """

    mu: tuple[Any, ...]
    h: tuple[Any, ...]
    hy: tuple[Any, ...]
    J: tuple[Any, ...]
    I: tuple[Any, ...]


class LinkMotion(NamedTuple):
    """The kinematic quantities of one link, in the frame of the recursion.

    w2, al       square of the absolute rate; absolute acceleration
    direction    cosine and sine of its frame
    reach        from its proximal to its distal point
    start, end   accelerations (b, y) of these points
    """

    w2: Any
    al: Any
    direction: tuple[Any, Any]
    reach: tuple[Any, Any]
    start: tuple[Any, Any]
    end: tuple[Any, Any]


def notation(frame: int) -> dict[str, str]:
    """The meaning of names in the generated code; numbers are those of the links."""
    axes = f"link {frame}" if frame else "the base"
    return {
        "c, s": "cosine and sine; c23 of q2 + q3",
        "a": f"angle from {axes}",
        "w, al": "absolute rate and acceleration",
        "ww": "w squared",
        "r": "length of a slide",
        "lc, ls": f"length along x and y of {axes}",
        "u": "acceleration of a slide inwards",
        "v": "acceleration of a slide across",
        "b, y": f"acceleration of the end along -x and y of {axes}",
        "hc, hs": "first moment likewise",
        "G, F": f"force along -x and y of {axes}",
        "N": "moment",
    }


def inverse_dynamics(
    chain: Chain, lumps: Lumps, frame: int, q: list[Any], qd: list[Any], qdd: list[Any], notes: Notes
) -> list[Any]:
    """Joint torques or forces (n,); vectors are in the frame of revolute joint `frame` (0: the base)."""
    return torques(chain, lumps, motion(chain, frame, q, qd=qd, qdd=qdd, notes=notes), qdd=qdd, notes=notes)


def motion(chain: Chain, frame: int, q: list[Any], qd: list[Any], qdd: list[Any], notes: Notes) -> list[LinkMotion]:
    """Absolute rates and accelerations, from the base outwards; gravity is an acceleration of the base."""
    let = notes.let
    direction, orientation = _directions(chain, frame, q, notes)
    # The base is accelerated against gravity, in a frame rotated by `orientation` (an int: not rotated).
    start: tuple[Any, Any] = (0, 0)
    gravity = chain.gravity
    if gravity is not None and isinstance(orientation, int):
        start = gravity.x, -gravity.y
    elif gravity is not None:
        inclined = gravity.x != 0 and gravity.y != 0
        turned = let("a_gravity", orientation - gravity.angle) if inclined else orientation
        size, (c, s) = gravity.strength if inclined else gravity.x, notes.sincos(turned)
        if gravity.x == 0:
            size, (c, s) = gravity.y, (s, -c)
        start = let("b0", size * c), let("y0", size * s)
    found: list[LinkMotion] = []
    w: Any = 0
    al: Any = 0
    for i in range(chain.n):
        k, length, (c, s), (b, y) = i + 1, chain.lengths[i], direction[chain.frames[i]], start
        if chain.revolute[i]:
            w, al = let(f"w{k}", w + qd[i]), let(f"al{k}", al + qdd[i])
            w2 = let(f"ww{k}", w * w)
            lc, ls = let(f"lc{k}", length * c), let(f"ls{k}", length * s)
            end = let(f"b{k}", b + al * ls + w2 * lc), let(f"y{k}", y + al * lc - w2 * ls)
        else:
            w2, r = let(f"ww{k}", w * w), let(f"r{k}", length + q[i])
            lc, ls = let(f"lc{k}", r * c), let(f"ls{k}", r * s)
            inwards, across = let(f"u{k}", r * w2 - qdd[i]), let(f"v{k}", 2 * qd[i] * w + r * al)
            end = let(f"b{k}", b + inwards * c + across * s), let(f"y{k}", y + across * c - inwards * s)
        found.append(LinkMotion(w2, al, (c, s), (lc, ls), start=start, end=end))
        start = end
    return found


def torques(chain: Chain, lumps: Lumps, moving: Sequence[LinkMotion], qdd: list[Any], notes: Notes) -> list[Any]:
    """Forces and moments, from the tip inwards."""
    let = notes.let
    tau: list[Any] = [0] * chain.n
    F: Any = 0
    G: Any = 0
    N: Any = 0
    for i in reversed(range(chain.n)):
        k, mu, (w2, al, (c, s), (lc, ls), (b0, y0), (b, y)) = i + 1, lumps.mu[i], moving[i]
        hc = let(f"hc{k}", lumps.h[i] * c - lumps.hy[i] * s)
        hs = let(f"hs{k}", lumps.h[i] * s + lumps.hy[i] * c)
        if chain.revolute[i]:
            # The first moment acts at the joint, so it adds to the force after the moment of the distal force.
            G, F = let(f"G{k}", G + mu * b), let(f"F{k}", F + mu * y)
            N = let(f"N{k}", N + lumps.J[i] * al + lc * F + ls * G + hc * y0 + hs * b0)
            G, F = let(f"G{k}", G + al * hs + w2 * hc), let(f"F{k}", F + al * hc - w2 * hs)
            tau[i] = N + lumps.I[i] * qdd[i]
        else:
            G = let(f"G{k}", G + mu * b + al * hs + w2 * hc)
            F = let(f"F{k}", F + mu * y + al * hc - w2 * hs)
            N = let(f"N{k}", N + lumps.J[i] * al + lc * F + ls * G + hc * y + hs * b)
            tau[i] = s * F - c * G + lumps.I[i] * qdd[i]
    return tau


def _directions(chain: Chain, frame: int, q: list[Any], notes: Notes) -> tuple[dict[int, tuple[Any, Any]], Any]:
    """(cos, sin) of every frame relative to `frame`, and the absolute angle of `frame`."""
    revolute = [i for i, r in enumerate(chain.revolute, 1) if r]
    directions: dict[int, tuple[Any, Any]] = {frame: (1, 0)}
    angle: Any = 0
    for j in (j for j in revolute if j > frame):
        angle = notes.let(f"a{j}", angle + q[j - 1])
        directions[j] = notes.sincos(angle)
    angle, inner = 0, [0, *(j for j in revolute if j < frame)]
    for outer, j in zip([frame, *reversed(inner[1:])], reversed(inner), strict=True):
        if outer == 0:
            break
        # Frames further inwards have negative angles; the sign is put in front of the sine.
        angle = notes.let(f"a{j}", angle + q[outer - 1])
        c, s = notes.sincos(angle)
        directions[j] = (c, -s)
    return directions, angle
