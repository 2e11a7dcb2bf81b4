"""What a diagnosis says of further sensors, in sentences that terminal and page share."""

from __future__ import annotations

from runtime.documents.diagnosis import DiagnosisBase
from runtime.documents.fits import CompareDocument
from runtime.wording import milliseconds


def sentences(document: CompareDocument | DiagnosisBase) -> list[str]:
    """By how long the link-side encoders are read later than the motors', and what further sensors were worth.

    document   as `tendon diagnose --json` or `tendon improve --json`
    """
    if isinstance(document, CompareDocument):
        return []
    found = []
    for e in document.encoder_skew:
        text = f"Joint {e.joint}: the link-side encoder is read {milliseconds(e.value)} ms later than the motor's"
        if e.interval is not None:
            text += f", 95 % in [{milliseconds(e.interval[0])}, {milliseconds(e.interval[1])}] ms"
        found.append(f"{text}.")
    return [*found, *(f"Contribution of the sensors: {sensor.said}." for sensor in document.sensors)]
