"""Kept results: taken up again while nothing changes, and computed anew after any change they depend on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.diagnosis.stages import diagnose
from runtime.identification.fit import Fit
from runtime.identification.identify import fit_document, identify
from runtime.model.loader import Model
from tests import bank, kept, plants, sources
from tests.kept import key


@pytest.fixture
def drive() -> Model:
    return bank.model("drive")


@pytest.fixture
def anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of kept results, which forgets what is known of sources."""
    monkeypatch.setattr(kept, "FOLDER", tmp_path / "bank")
    monkeypatch.setattr(kept, "_code", kept._code.__wrapped__)
    return tmp_path / "bank"


def test_a_result_is_computed_once(anew: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = kept.kept(plants.recording, None, 21)
    (file,) = anew.iterdir()
    written = file.stat().st_ino
    monkeypatch.setattr(plants, "record", None)  # a second call would fail
    again = kept.kept(plants.recording, None, 21)
    assert again is not first
    np.testing.assert_array_equal(again.tau, first.tau)
    assert [path.stat().st_ino for path in anew.iterdir()] == [written]


def test_what_fails_is_not_kept(anew: Path) -> None:
    with pytest.raises(KeyError):
        kept.kept(plants.recording, "no effect", 1)
    assert list(anew.iterdir()) == []


@pytest.mark.parametrize("module", ["runtime.diagnosis.settings", "runtime.motion.band", "runtime.model.loader"])
def test_a_changed_source_gives_a_new_key(
    anew: Path, monkeypatch: pytest.MonkeyPatch, module: str, drive: Model
) -> None:
    del anew
    recording, code = bank.recording("clean"), sources.code
    before = key(diagnose, drive, [recording])
    assert module in sources.reached("runtime.diagnosis.stages")
    monkeypatch.setattr(sources, "code", lambda name: code(name) + " changed" * (name == module))
    assert key(diagnose, drive, [recording]) != before
    untouched = key(plants.recording, None, 21)
    monkeypatch.setattr(sources, "code", code)
    assert key(diagnose, drive, [recording]) == before
    assert key(plants.recording, None, 21) == untouched


def test_a_changed_entry_gives_new_keys(drive: Model) -> None:
    """Another seed or size, one sample, or a column more."""
    entry, recording = bank.ENTRIES["linear spring"], bank.recording("linear spring")
    keys = {key(entry.make, *entry.arguments), key(entry.make, "linear_spring", 4, None)}
    keys |= {key(entry.make, "linear_spring", 3, 1.0), key(entry.make, "lugre", 3, None)}
    other = recording.tau.copy()
    other[0, 5] += 1e-9
    changed = (recording, replace(recording, tau=other), replace(recording, qd=recording.q))
    keys |= {key(diagnose, drive, [r]) for r in changed} | {key(identify, drive, [recording])}
    keys |= {key(diagnose, drive, [recording], [recording])}
    assert len(keys) == 9
    elsewhere = replace(recording, path=Path("/elsewhere") / recording.path.name)
    assert key(diagnose, drive, [elsewhere]) in keys


def test_a_changed_arm_gives_a_new_key(drive: Model) -> None:
    recording, source = bank.recording("clean"), bank.source("drive")
    heavier = source.with_text(source.text.replace("mass = 2.0", "mass = 2.5")).compiled.model()
    assert heavier.name == drive.name
    assert key(diagnose, heavier, [recording]) != key(diagnose, drive, [recording])
    assert key(diagnose, source.compiled.model(), [recording]) == key(diagnose, bank.model("drive"), [recording])


def test_a_comment_or_a_docstring_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = 'LEAST = 3\n"""of something"""\ndef double(x):\n    """Twice."""\n    return 2 * x\n'
    codes = []
    for said in (text, text.replace("Twice", "The double"), "# why\n" + text, text.replace("2 *", "3 *")):
        (tmp_path / "own.py").write_text(said)
        monkeypatch.setattr(sources, "everything", lambda: {"tests.own": tmp_path / "own.py"})
        sources.tree.cache_clear()
        codes.append(sources.code.__wrapped__("tests.own"))
    sources.tree.cache_clear()
    assert codes[0] == codes[1] == codes[2] != codes[3]


def test_what_is_taken_up_again_works(drive: Model) -> None:
    """With its model, and what is computed on demand."""
    found: Fit = bank.identified("clean")
    assert found.model.library is found.problem.model.library
    fresh = identify(drive, [bank.recording("clean")])
    assert fit_document(found).to_json() == fit_document(fresh).to_json()


def test_the_oldest_goes_where_it_becomes_too_much(anew: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = kept.kept(plants.recording, None, 21)
    (file,) = anew.iterdir()
    monkeypatch.setattr(kept, "MOST", file.stat().st_size + 1000)
    kept.kept(plants.recording, None, 22)
    assert file not in list(anew.iterdir())
    assert len(list(anew.iterdir())) == 1
    np.testing.assert_array_equal(kept.kept(plants.recording, None, 21).q, one.q)
