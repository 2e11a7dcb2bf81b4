"""What a recorded torque is: declared or found out, and nothing written where it looks wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from runtime.recordings.recording import write
from tests import torque_mistakes as t

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_nothing_is_written_from_a_torque_that_looks_wrong(tendon: Run, here: Path) -> None:
    """The torque before the gear, and a link that the model file leaves open: the fit itself is perfect."""
    text = t.users_text("drive", "masses").replace("gravity = [0.0, -9.81]", "gravity = [0.0, 0.0]")
    text = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("inertia"))
    model = here / "open.toml"
    model.write_text(text, encoding="utf-8")
    r = t.without_gravity("drive", t.sound("drive"))
    write(here / "run.csv", replace(r, tau=r.tau / 100))
    for verb, *options in (["improve", "--out", "better.toml"], ["improve", "--write"], ["identify", "--write"]):
        status, out, _ = tendon(verb, model, "run.csv", *options)
        assert status == 1
        assert "the gear ratio of 100" in out
        assert "Nothing written" in out
        assert model.read_text(encoding="utf-8") == text
        assert not (here / "better.toml").exists()
