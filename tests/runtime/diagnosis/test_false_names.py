"""No name for what the library lacks, and one law for what one law nearly explains; hidden by the judge's own plant."""

from __future__ import annotations

import re

import pytest

from runtime.diagnosis.stages import diagnose
from runtime.loop.improve import improve
from runtime.workspace.source import Source
from tests import bank, wrist
from tests.judge.cases import Case, Setting, make
from tests.judge.line import Line
from tests.judge.situations import SITUATIONS
from tests.kept import kept
from tests.variants import slow


def row(name: str, seed: int, size: float, setting: Setting) -> Line:
    return kept(bank.judged, Case(name, "unknown", (name,), setting, size, seed, ("unexplained",)))


@pytest.mark.parametrize("seed", [3400, slow(3401)])
def test_a_stop_that_resists_and_does_not_push_back_is_none(seed: int) -> None:
    """Drag that grows towards the ends of the range, as a cable's or a seal's."""
    assert row("drag_at_angle", seed, 0.7, Setting(joints=1)).named == ""


@pytest.mark.parametrize("name", ["friction_wave", slow("swinging_inertia")])
def test_what_leaves_as_much_that_follows_the_motion_is_no_evidence(name: str) -> None:
    found = row(name, 3401, 0.7, Setting(joints=1))
    assert (found.verdict, found.named) == ("unexplained", "")
    assert "friction_patch@1 comes nearest" in found.reason or name != "friction_wave"


def test_what_lowered_the_error_of_held_out_recordings_is_kept() -> None:
    """Resistance that no effect of the library has: the patch that comes nearest helps, and what is left is said."""
    made = make(Case("friction_wave", "unknown", ("friction_wave",), Setting(joints=1), 1.0, 902, ("unexplained",)))
    shown: list[str] = []
    result = improve(Source.shipped("drive").with_text(made.model), [made.recording], [made.held_out], shown.append)
    first, *later = (float(re.findall(r"held out ([\d.]+) %", line)[0]) for line in shown)
    end = 100 * result.steps[-1].held_out.relative[0]
    assert end < min(later) + 0.01 < 0.95 * first
    assert result.left.verdict == "unexplained"


@pytest.mark.parametrize("situation", ["low_noise", slow("plain")])
def test_two_springs_are_not_named_beside_a_cable_that_nearly_does_it(situation: str) -> None:
    """A dress pack, whose law is another than the library's, four noise floors large."""
    assert row("cable_pack", 3421, 4.0, SITUATIONS[situation]).named == "cable@1"


def test_drag_of_a_fluid_has_no_name_where_no_motion_is_repeated() -> None:
    recording = kept(wrist.record, bank.NONE, 4, wrist.Resistance(40.0))
    assert not kept(diagnose, bank.model("wrist"), [recording]).findings
