"""Nothing that a verb reads is overwritten by what it writes, by whatever name; a report costs only itself."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from runtime.cli import places, verbs
from runtime.report import page
from runtime.workspace.names import UsageError, shipped_or_given
from tests import one_joint

COMMANDS: dict[str, Any] = {name: verbs.command(name) for name in verbs.VERBS}
NEEDED = {
    "effect": "stribeck",
    "between": "gravity",
    "on": "simulation",
    "over": "seed=0:1",
    "to": "urdf",
    "target": "host",
}
"""What else a verb asks for, beside files."""
DRIVE = one_joint.model_text("[joint.effects.coulomb]\n[joint.effects.viscous]\n")


def collisions() -> Iterator[tuple[str, str, str]]:
    """Every verb with each of the options that it writes to and each of those that it reads."""
    for verb, command in COMMANDS.items():
        known = places.roles(command.callback)
        for target, role in known.items():
            if role.writes and (role.names is None or role.names):
                yield from ((verb, target, source) for source, other in known.items() if not other.writes)


def call(verb: str, files: dict[str, str]) -> list[str]:
    """A call of a verb with these files, and whatever else it cannot do without."""
    arguments = [verb]
    for parameter in COMMANDS[verb].params:
        value = files.get(parameter.name, NEEDED.get(parameter.name))
        if value is None and parameter.required:
            value = f"any-{parameter.name}"
        if value is not None:
            arguments += [value] if parameter.param_type_name == "argument" else [parameter.opts[0], value]
    return arguments


def test_every_file_of_every_verb_has_a_role():
    for verb, command in COMMANDS.items():
        callback = command.callback
        hints = get_type_hints(callback)
        files = {name for name, hint in hints.items() if "Path" in str(hint)} | {"json"} & hints.keys()
        assert files == places.roles(callback).keys(), verb


@pytest.mark.parametrize("way", ["itself", "relative", "absolute", "symlink", "hard link"])
@pytest.mark.parametrize(("verb", "target", "source"), list(collisions()))
def test_no_verb_writes_to_what_it_reads(tmp_path, refused, verb, target, source, way):
    inside = places.roles(COMMANDS[verb].callback)[target].names or ()
    written = next(iter(inside), "M.toml")
    Path(written).write_text("as it was")
    Path("other").write_text("another")
    named = {
        "itself": written,
        "relative": f"../{tmp_path.name}/{written}",
        "absolute": str(tmp_path / written),
        "symlink": "linked",
        "hard link": "linked",
    }[way]
    if way == "symlink":
        Path("linked").symlink_to(written)
    elif way == "hard link":
        os.link(written, "linked")
    said = refused(*call(verb, {source: named, target: "." if inside else written}))
    assert said == f"{written}: is read here; choose another name to write to\n"
    assert Path(written).read_text() == "as it was"


def test_an_arm_of_tendon_is_not_overwritten_under_its_path():
    from runtime.workspace.names import ARMS

    with pytest.raises(UsageError, match="is read here"):
        places.keep([Path("drive")], [ARMS / "drive.toml"])


def test_two_results_do_not_go_to_one_file(tmp_path, refused):
    Path("drive.toml").write_text(DRIVE)
    assert refused("simulate", "drive.toml", "--out", "run.csv", "--json", "./run.csv") in (
        "run.csv: is written twice; choose two names\n",
        "./run.csv: is written twice; choose two names\n",
    )
    assert sorted(p.name for p in tmp_path.iterdir()) == ["drive.toml"]
    places.keep([Path("/dev/null")], [Path("/dev/null"), Path("/dev/null")])  # nothing is lost there


def test_the_model_of_a_scenario_is_not_overwritten(tmp_path, refused):
    from runtime.workspace.names import SCENARIOS

    scenario = (SCENARIOS / "scenario1.toml").read_text().replace('model = "vishard4"', 'model = "arm.toml"')
    Path("scenario.toml").write_text(scenario)
    Path("arm.toml").write_text(shipped_or_given(Path("vishard4")).read_text())
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    for arguments in (
        ["optimize", "scenario.toml", "--out", "./arm.toml"],
        ["optimize", "scenario.toml", "--json", "arm.toml"],
        ["sweep", "scenario.toml", "--over", "seed=0:1", "--table", "t.csv", "--json", "arm.toml"],
    ):
        assert "arm.toml: is read here" in refused(*arguments)
        assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_generated_files_replace_no_file_that_is_read(refused):
    Path("made").mkdir()
    Path("drive.toml").write_text(DRIVE)
    own = "from symbolic.effects import LIBRARY\nEFFECTS = ()\n"
    Path("made/drive1_casadi.py").write_text(own)
    for arguments in (["generate", "drive.toml"], ["add", "drive.toml", "stribeck", "--joint", "1"]):
        said = refused(*arguments, "--out", "made", "--effects", "made/drive1_casadi.py")
        assert "made/drive1_casadi.py: is read here" in said
    assert Path("made/drive1_casadi.py").read_text() == own
    assert Path("drive.toml").read_text() == DRIVE


def test_a_report_that_cannot_be_written_costs_only_the_report(tendon):
    """Its place is taken by a directory; verdict, JSON and exit status are those without a report."""
    Path("drive.toml").write_text(DRIVE)
    assert tendon("simulate", "drive.toml", "--out", "run.csv", "--seconds", "12")[0] == 0
    Path("report", page.NAME).mkdir(parents=True)
    for verb in ("compare", "diagnose"):
        bare, said, _ = tendon(verb, "drive.toml", "run.csv", "--json", "bare.json")
        status, out, err = tendon(verb, "drive.toml", "run.csv", "--json", "drawn.json", "--report", "report")
        assert (status, out) == (bare, said)
        assert "the report could not be written: " in err
        assert "Is a directory" in err
        assert json.loads(Path("drawn.json").read_text()).keys() == json.loads(Path("bare.json").read_text()).keys()


def test_a_verdict_is_said_before_its_report_is_drawn(tendon, monkeypatch, capsys):
    Path("drive.toml").write_text(DRIVE)
    assert tendon("simulate", "drive.toml", "--out", "run.csv", "--seconds", "12")[0] == 0

    def drawn(*_: object) -> Path:
        assert "noise floor" in capsys.readouterr().out
        assert Path("said.json").exists()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("runtime.report.page.reports.write_report", drawn)
    status, _, err = tendon("compare", "drive.toml", "run.csv", "--report", "report", "--json", "said.json")
    assert status == 0
    assert err.endswith("the report could not be written: No space left on device\n")


def test_a_directory_that_cannot_be_made_is_refused_before_the_work(tmp_path, refused):
    Path("drive.toml").write_text(DRIVE)
    Path("run.csv").write_text("t,q1,tau1\n")
    assert refused("compare", "drive.toml", "run.csv", "--report", "drive.toml/report") == (
        f"drive.toml/report: cannot be made, as {tmp_path / 'drive.toml'} is a file; choose another directory\n"
    )


@pytest.mark.parametrize(
    ("verb", "option", "given"), [("optimize", "plot", "scenario1"), ("inspect", "picture", "run.csv")]
)
def test_a_picture_of_no_format_is_refused_before_any_work(tmp_path, refused, verb, option, given):
    said = refused(verb, given, f"--{option}", "drawn.txt")
    assert said == "drawn.txt: expected a name that ends in .png, .svg or .pdf\n"
    assert not list(tmp_path.iterdir())
