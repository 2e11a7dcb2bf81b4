"""A case as files, to look at by hand: the user's model file, two recordings, and what is true."""

from __future__ import annotations

import json
import re
from pathlib import Path

from . import cases as judging
from .cases import Case, Made
from .scoring import tag


def folder(case: Case) -> str:
    """A name for the case's folder."""
    words = [case.label, f"{case.setting.joints}R", f"{case.size:g}", str(case.seed), *str(case.setting).split()]
    return re.sub(r"[^\w+.-]", "_", "_".join(words))


def save(case: Case, directory: Path) -> Path:
    """Writes model.toml, fit.csv.gz, held.csv.gz and truth.json into a folder of the case's. Raises RanAwayError."""
    made = judging.make(case)
    path = directory / folder(case)
    path.mkdir(parents=True, exist_ok=True)
    (path / "model.toml").write_text(made.model, encoding="utf-8")
    made.recording.save(path / "fit.csv.gz")
    made.held_out.save(path / "held.csv.gz")
    (path / "truth.json").write_text(json.dumps(_truth(made), indent=2) + "\n", encoding="utf-8")
    return path


def _truth(made: Made) -> dict[str, object]:
    hidden = [tag(h.truth or name, j) for h, name, j in zip(made.hidden, made.case.names, made.joints, strict=True)]
    return {
        "case": made.case.label,
        "setting": str(made.case.setting),
        "seed": made.case.seed,
        "hidden": hidden,
        "sizes in noise floors": made.sizes,
        "sizes together, beyond a delay": made.beyond_delay,
        "amounts": made.amounts,
        "plant": made.plant,
        "arm": made.arm,
    }
