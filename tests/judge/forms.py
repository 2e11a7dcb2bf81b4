"""Effects of the library in other forms than the library's: the class is right, the formula is not.

Every effect with a law that could be another has one here. Without: coulomb, coulomb_asymmetric and offset (a number
has no shape), viscous (bent, it is viscous_cubic or viscous_power), linear_spring (bent, it is a cable), torque_scale
(bent, it is a saturation or a load friction), torque_delay (another phase is a torque_lag's), gravity (a uniform field
has one form) and coupled_gear (its frictions are those of a joint, on another rate). quadratic_drag is viscous_power at
another exponent, the library's own.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from . import library
from .hidden import POSITION, Hidden, Setup, at, entry, same


@entry("viscous_asymmetric_soft", "forms")
def _(s: Setup) -> Hidden:
    """Slopes that pass into each other around standstill instead of in a corner there."""
    put = at(s.joint, UNEVEN=same, UNEVEN_SPEED=s.rng.uniform(0.3, 0.8))
    return Hidden("viscous_asymmetric", 0.2, (0.001, 1.1), put)


@entry("viscous_thinning", "forms")
def _(s: Setup) -> Hidden:
    """A lubricant that thins with shear (Eyring): asinh over the speed, of which the cube is the first term."""
    put = at(s.joint, THIN=same, THIN_SPEED=s.rng.uniform(1.0, 2.5))
    believed = ("coulomb_asymmetric", "viscous")
    return Hidden("viscous_cubic", 0.1, (0.001, 1.0), put, accept=("viscous_power",), believed=believed)


@entry("viscous_logarithm", "forms")
def _(s: Setup) -> Hidden:
    """Steep at low and flat at high speed by a logarithm (Dieterich), not by a power."""
    put = at(s.joint, POWER=same, POWER_FORM=1.0, POWER_SPEED=s.rng.uniform(0.05, 0.2))
    return Hidden("viscous_power", 0.3, (0.005, 12.0), put)


entry("stribeck_lorentz", "forms")(partial(library.stribeck, form=1.0))
entry("stribeck_exponential", "forms")(partial(library.stribeck, form=2.0))


@entry("load_friction_square", "forms")
def _(s: Setup) -> Hidden:
    return Hidden("load_friction", 0.006, (1e-5, 0.08), at(s.joint, LOAD_SQUARE=same))


entry("friction_patch_soft", "forms")(partial(library.patch, edge=0.2))
entry("lugre_maxwell", "forms")(partial(library.bristle, form=1.0))
entry("thermal_exponential", "forms")(partial(library.thermal, exponential=True))


@entry("coupled_friction_creep", "forms", least_joints=2, not_last=True)
def _(s: Setup) -> Hidden:
    """Half as much again where the two rates nearly cancel."""
    return library.coupled(s, 0.5)


@entry("parallel_spring_soft", "forms")
def _(s: Setup) -> Hidden:
    """A cable that comes taut little by little."""
    return library.one_sided(s, 0.06)


@entry("cable_sine", "forms")
def _(s: Setup) -> Hidden:
    square = s.rng.choice([-1, 1]) * s.rng.uniform(0.5, 1.0)
    put = at(s.joint, CABLE_SINE=same, CABLE_PHASE=s.rng.uniform(-1, 1), CABLE_SQUARE=lambda a: a * square)
    return Hidden("cable", 0.3, (0.005, 20.0), put, rivals=POSITION)


@entry("cable_pack", "forms")
def _(s: Setup) -> Hidden:
    """A dress pack with a tensioner: a spring between a point of the link and a post, slack over a part of the way."""
    radius, post = s.rng.uniform(0.08, 0.15), s.rng.uniform(0.2, 0.35)
    angle = s.within(0.2, 0.8)
    slack = np.sqrt(radius**2 + post**2 - 2 * radius * post * np.cos(s.rng.uniform(0.05, 0.35)))
    put = at(s.joint, PACK=same, PACK_RADIUS=radius, PACK_POST=post, PACK_FREE=slack, PACK_AT=angle)
    return Hidden("cable", 20.0, (0.1, 3e3), put, rivals=POSITION)


@entry("cable_hose", "forms")
def _(s: Setup) -> Hidden:
    """A bundle of hoses that stiffens as it bends away from where it was laid."""
    wide = (s.reach[1] - s.reach[0]) * s.rng.uniform(0.12, 0.25)
    put = at(s.joint, HOSE=same, HOSE_WIDTH=wide, HOSE_AT=s.within(0.3, 0.7))
    return Hidden("cable", 0.1, (1e-4, 5.0), put, rivals=POSITION)


entry("end_stop_hertz", "forms")(partial(library.stop, exponent=1.5))
entry("spring_hysteresis_wen", "forms")(partial(library.hysteresis, form=1.0))
entry("torque_ripple_second", "forms")(partial(library.ripple, second=0.5))
entry("torque_saturation_tanh", "forms")(partial(library.limit, form=1.0))
entry("torque_saturation_algebraic", "forms")(partial(library.limit, form=2.0))
entry("torque_saturation_hard", "forms")(partial(library.limit, form=3.0))


@entry("torque_lag", "forms")
def _(s: Setup) -> Hidden:
    """Exact, this is the library's own; at frequencies far below 1/LAG it is a delay."""
    put = at(s.joint, LAG=same)
    return Hidden("torque_lag", 1e-3, (5e-5, 2e-2), put, accept=("torque_delay",), rivals=("elasticity",))


entry("elasticity_hardening", "forms")(partial(library.spring, hardening=1.0))


@entry("backlash_hertz", "forms")
def _(s: Setup) -> Hidden:
    """Round flanks, which stiffen with depth and lose energy in proportion to it."""
    return library.gap(s, 1.5)


@entry("payload_extended", "forms", least_joints=2)
def _(s: Setup) -> Hidden:
    """A body with its centre ahead of the end-effector and an inertia of its own; to one joint it is a point."""
    return library.carried(s, 0.08, 0.06)
