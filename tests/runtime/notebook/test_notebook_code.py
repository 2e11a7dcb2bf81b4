"""Code from a notebook: verified, compiled and listed as by the command line; arms and recordings show themselves."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from codegen.toolchain.build import BuildError
from runtime.notebook.arm import load, recording
from runtime.notebook.generated import effects, firmware, verify
from tests.runtime.conftest import Run
from tests.watched_run import PLAIN, there_and_back

OWN = """
from tendon.effects import Effect, Parameter, SIGNAL, parameter, units
EFFECTS = [Effect(name="mine", scope="joint", family="friction", summary="Of my own.", equation="tau = c qd",
    torque=parameter("coefficient") * SIGNAL["qd"].symbol, source="me", trace="a trace", experiment="any",
    parameters=(Parameter("coefficient", units.VISCOUS, "torque per rate"),))]
"""


def test_verification_is_that_of_the_command_line(tendon: Run) -> None:
    result = verify(load("drive"), samples=3, seed=2)
    assert result.equal
    assert result.to_dict() == json.loads(tendon("verify", "drive", "--samples", "3", "--seed", "2", "--json", "-")[1])
    assert max(case.ratio for case in result.cases if case.ratio is not None) <= 1.0
    assert repr(result).startswith("Equal: ")


def test_firmware_is_that_of_the_command_line(tendon: Run) -> None:
    result = firmware(load("drive"), target="host")
    assert result.fits
    assert result.directory == Path("generated/drive/firmware")
    assert all(Path(path).is_file() for path in result.build.outputs)
    assert result.to_dict() == json.loads(tendon("firmware", "drive", "--target", "host", "--json", "-")[1])
    assert tendon("firmware", "drive", "--check")[0] == 0
    with pytest.raises(BuildError, match="cortex-m9"):
        firmware(load("drive"), target="cortex-m9")


def test_a_watched_model_is_that_of_the_command_line(tendon: Run) -> None:
    """The file on disk stays; the arm of the result has the floors that --monitor writes into it."""
    Path("arm.toml").write_text(PLAIN)
    there_and_back().write(Path("plan.json"))
    run = ["execute", "arm.toml", "plan.json", "--on", "simulation", "--cycles", "8", "--trials", "1"]
    assert tendon(*run, "--out", "run.csv", "--hide", "coulomb@2:torque=0.4")[0] == 0
    result = firmware(load("arm.toml"), target="host", monitor="run.csv")
    assert Path("arm.toml").read_text() == PLAIN
    assert "joint 2: the model file's values leave" in str(result)
    said = tendon("firmware", "arm.toml", "--monitor", "run.csv", "--target", "host", "--json", "-")[1]
    assert result.to_dict() == json.loads(said)
    assert result.arm.text == Path("arm.toml").read_text()


def test_the_library_is_that_of_the_command_line(tendon: Run, tmp_path: Path) -> None:
    assert effects().to_dict() == json.loads(tendon("effects", "--json", "-")[1])
    one = effects("stribeck")
    assert one.to_dict() == json.loads(tendon("effects", "stribeck", "--json", "-")[1])
    assert [p.name for p in one.parameters] == ["torque", "speed"]
    assert repr(one).startswith("stribeck: ")
    assert "lugre" in list(effects())
    with pytest.raises(ValueError, match='did you mean "stribeck"'):
        effects("stribek")
    (tmp_path / "own.py").write_text(OWN)
    assert effects("mine", own=tmp_path / "own.py").made.summary == "Of my own."


def test_the_verb_and_the_module_of_the_same_name_are_one() -> None:
    import tendon
    import tendon.effects as module

    assert module.Effect.__name__ == "Effect"
    for verb in (module, tendon.effects):
        assert verb("coulomb").made.name == "coulomb"


def test_arms_and_recordings_show_themselves(tmp_path: Path) -> None:
    arm = load("ur10")
    html = arm._repr_html_()
    assert "<b>ur10: 6 joints" in html
    assert "2 shoulder_lift_joint" in html
    assert "rotor_inertia" in html
    path = tmp_path / "<i>run.csv"
    path.write_text("t,q1,tau1\n" + "".join(f"{k / 100},{k / 1000},{(-1) ** k}\n" for k in range(200)))
    shown = recording(path)._repr_html_()
    assert "&lt;i&gt;run.csv: 1 joint, 200 samples" in shown
    assert "<td>0.199 rad</td>" in shown
    assert "<td>1 N m</td>" in shown
