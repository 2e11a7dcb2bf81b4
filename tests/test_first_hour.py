"""From nothing to the verdict on real recordings: the same from every format, with at most four commands."""

from __future__ import annotations

import json
import shlex
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from runtime.cli import main, output
from runtime.recordings.recording import Recording, read
from runtime.workspace.names import column_mapping
from runtime.workspace.source import Source
from tests.first_hour import FORMATS, MACHINES, REAL

SIGNALS = ("q", "qd", "tau", "q_link", "q_desired")
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="../shared/data/real is not there")


def typed(line: str) -> int:
    """The exit status of a command as it is typed."""
    return output.run(main.app, shlex.split(line))


def recorded(path: Path, options: str) -> Recording:
    """A recording as the verbs read it with these options."""
    arm = Source.read(Path("machine.toml"), None).recorded_arm()
    cells = shlex.split(options)
    maps = [cell for option, cell in pairwise(cells) if option == "--map"]
    return read(path, arm, column_mapping(maps), "--allow-gaps" in cells)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if n == "tx40" else ()) for n in MACHINES])
def test_every_format_holds_the_same_recording(tmp_path, monkeypatch, name):
    """Sample by sample, in SI, so that every verb says the same of it."""
    monkeypatch.chdir(tmp_path)
    machine = MACHINES[name]
    assert len(machine.commands(machine.fitted, machine.held_out, "")) <= 4
    assert typed(f"{machine.begun} --out machine.toml") == 0
    first: Recording | None = None
    for write in FORMATS.values():
        r = recorded(*write(machine.fitted, tmp_path, machine))
        first = first or r
        assert r.segments == first.segments
        for part in r.segments:
            np.testing.assert_allclose(np.diff(r.t[part]), np.diff(first.t[part]), atol=2e-9)
        for signal in SIGNALS:
            found, expected = getattr(r, signal), getattr(first, signal)
            assert (found is None) == (expected is None)
            if found is not None:
                np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aliengo, hip", "kuka, axis 3"])
def test_every_format_gives_the_same_effects(tmp_path, monkeypatch, name):
    machine, found = MACHINES[name], {}
    for kind, write in FORMATS.items():
        folder = tmp_path / kind
        folder.mkdir()
        monkeypatch.chdir(folder)
        fitted, options = write(machine.fitted, folder, machine)
        held_out = write(machine.held_out, folder, machine)[0] if machine.held_out else None
        for line in machine.commands(fitted, held_out, options):
            assert typed(line) in (0, 1)
        assert (folder / "report" / "report.html").is_file()
        found[kind] = json.loads((folder / "found.json").read_text())
    first = found["CSV"]
    for other in found.values():
        assert other["verdict"] == first["verdict"]
        assert [step["added"] for step in other["history"]] == [step["added"] for step in first["history"]]
        for step, expected in zip(other["history"], first["history"], strict=True):
            assert step["relative"] == pytest.approx(expected["relative"], rel=1e-3)
