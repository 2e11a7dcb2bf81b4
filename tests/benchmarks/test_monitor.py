"""The monitor on the board: false alarms against the stated rate, and how soon changes are found and named.

Noise and louder noise go through the generated C of one joint; changes of a joint happen to a simulated arm of two
joints under the firmware's own machine and controller, with floors from a run of that arm.
"""

from __future__ import annotations

import numpy as np
from harness import show, sized

from runtime.workspace.source import Source
from tests.watched_noise import WatchedNoise
from tests.watched_run import CHANGES, Change, at_second_joint, friction, said_of, with_floors

HOURS, RUNS, SEEDS, CYCLES = sized((3000.0, 200, 4, 22), (50.0, 5, 1, 10))
"""Of noise; of each louder noise; of each change of an arm, each of so many cycles of 1.8 s."""


def test_false_alarms() -> None:
    rows = []
    for stated in (1.0, 10.0, 100.0, 1000.0):
        hours = min(HOURS, 30 * 1000.0 / stated * sized(10.0, 1.0))
        found = WatchedNoise(stated).alarms(hours, np.random.default_rng(0))
        rows.append((f"{stated:g}", f"{hours:.0f}", str(found), f"{1000 * found / hours:.3g}"))
        assert found <= 3 + 1.5 * stated * hours / 1000
    show("False alarms of a joint", ("stated in 1000 h", "hours", "alarms", "in 1000 h"), rows)


def test_louder_noise() -> None:
    watched, rng, rows = WatchedNoise(1.0), np.random.default_rng(1), []
    for ratio in (1.1, 1.2, 1.4, 2.0, 3.0, 5.0, 10.0):
        delays = watched.delays(ratio, RUNS, rng)
        found = delays[np.isfinite(delays)]
        late = ("–", "–") if not len(found) else (f"{np.median(found):.1f}", f"{np.quantile(found, 0.95):.1f}")
        rows.append((f"{ratio:g}", *late, f"{np.mean(np.isnan(delays)):.0%}"))
    show(
        "Time from a change of the residual's RMS to the alarm", ("floors", "median s", "95 % s", "not in 120 s"), rows
    )


def changes() -> dict[str, Change]:
    """What happens to the second joint, which needs 3 N m for its own motion; its Coulomb friction is 1.4 N m."""
    return {
        "nothing": friction(0.0),
        **{f"friction {more:+g} N m": friction(more) for more in (0.1, 0.2, 0.5, 1.0)},
        "friction -0.5 N m": friction(-0.5),
        "viscous +0.3 N m s/rad": lambda plant: at_second_joint(0.3 * float(plant.qd[1])),
        "spring 2 N m/rad": lambda plant: at_second_joint(2.0 * float(plant.q[1])),
        "offset 0.5 N m": lambda _: at_second_joint(0.5),
    }


def row(watched: Source, name: str, change: Change) -> tuple[str, ...]:
    """A change over some seeds: found, how soon, as what, and alarms before it or at the other joint."""
    every = [said_of(watched, change, CYCLES, seed) for seed in range(SEEDS)]
    second = [entries[1] for entries in every]
    # Trials begin a little before the drives are on.
    delays = [e.since - CHANGES for e in second if e.since is not None and e.since > CHANGES - 0.5]
    early = sum(e.since is not None and e.since <= CHANGES - 0.5 for e in second)
    other = sum(entries[0].verdict != "holds" for entries in every)
    said = "–" if not delays else f"{np.median(delays):.1f}"
    words = sorted({e.verdict for e in second}), sorted({e.signal for e in second if e.since is not None})
    return name, f"{len(delays)}/{SEEDS}", said, ", ".join(words[0]), ", ".join(words[1]) or "–", str(early + other)


def test_changes_of_an_arm() -> None:
    watched = with_floors()
    rows = [row(watched, name, change) for name, change in changes().items()]
    head = ("from 5 s on, at joint 2", "found", "after s", "verdict", "follows", "false")
    monitor = watched.arm().monitor
    assert monitor is not None
    floors = ", ".join(f"{joint.floor:g}" for joint in monitor.joints)
    show(
        "Changes of a simulated arm",
        head,
        rows,
        [f"Floors {floors} N m up to {monitor.cutoff:g} Hz; {CYCLES * 1.8:.0f} s."],
    )
    assert rows[0][1] == f"0/{SEEDS}"
    assert all(cells[5] == "0" for cells in rows)
