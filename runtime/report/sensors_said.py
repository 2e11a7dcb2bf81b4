"""What a diagnosis says of further sensors, in sentences that terminal and page share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def sentences(document: Mapping[str, Any]) -> list[str]:
    """By how long the link-side encoders are read later than the motors', and what further sensors were worth.

    document   as `tendon diagnose --json` or `tendon improve --json`
    """
    found = []
    for e in document["encoder_skew"]:
        low, value, high = (f"{1e3 * x:.3g}" for x in (e["interval"][0], e["value"], e["interval"][1]))
        later = f"the link-side encoder is read {value} ms later than the motor's"
        found.append(f"Joint {e['joint']}: {later}, 95 % in [{low}, {high}] ms.")
    return [*found, *(f"What the sensors were worth: {sensor['said']}." for sensor in document["sensors"])]
