"""Under which conditions real recordings are made: each differs from the judge's plain one in what its name says."""

from __future__ import annotations

from .bench import Setting
from .recorder import Logger

SITUATIONS: dict[str, Setting] = {
    "plain": Setting(),
    "jittering": Setting(jitter=0.3),
    "two_steps": Setting(logger=Logger(every=10, stamps="two_steps")),
    "rounded": Setting(jitter=0.15, logger=Logger(every=2, stamps="rounded")),
    "lost": Setting(logger=Logger(every=2, stamps="lost")),
    "hz500": Setting(logger=Logger(every=2)),
    "hz250": Setting(logger=Logger(every=4)),
    "hz100": Setting(logger=Logger(every=10)),
    "quantised": Setting(level=0.1, logger=Logger(resolution=0.4)),
    "low_noise": Setting(level=0.03),
    "rate_clean": Setting(coarse=10.0, logger=Logger(rates="clean")),
    "rate_filtered": Setting(coarse=10.0, logger=Logger(rates="filtered")),
    "rate_difference": Setting(logger=Logger(every=2, rates="difference")),
    "link_late": Setting(logger=Logger(link_late=2.5e-3)),
    "upright": Setting(gravity=(0.0, -9.81)),
    "hanging": Setting(gravity=(9.81, 0.0)),
    "bus": Setting(level=0.1, logger=Logger(every=5, resolution=0.3, rates="filtered")),
}
"""bus: a drive that is asked over a bus, as most low-priced ones are: 200 Hz, steps of the current, a filtered rate."""
