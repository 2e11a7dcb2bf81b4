"""What the README tells people to type and to open is there."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from codegen.toolchain import build
from runtime.cli import main
from runtime.hardware import can_bus
from runtime.hardware.link import LinkError
from runtime.planning import scenario_file
from symbolic.effects import load_user_effects
from symbolic.model_file import reader
from symbolic.model_file.checks import Place

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_its_example_of_an_effect_is_accepted(tmp_path: Path) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    path = tmp_path / "drag.py"
    path.write_text(block)
    assert [effect.name for effect in load_user_effects(path)] == ["drag"]


def test_its_links_and_pictures_are_there() -> None:
    targets = re.findall(r"\]\(([^)]+)\)", README) + re.findall(r'src="([^"]+)"', README)
    assert len(targets) > 5
    for target in targets:
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("verb", sorted(set(re.findall(r"^    tendon (\w+)", README, re.MULTILINE))))
def test_its_verbs_exist(verb: str) -> None:
    commands = main.app.registered_commands + [
        c for g in main.app.registered_groups for c in g.typer_instance.registered_commands
    ]
    assert verb in {c.name or c.callback.__name__ for c in commands}


@pytest.mark.parametrize("block", re.findall(r"```c\n(.*?)```", README, re.DOTALL))
def test_its_c_compiles(tmp_path: Path, block: str) -> None:
    (tmp_path / "block.c").write_text(block)
    folders = [f"-I{ROOT / 'generated' / name}" for name in ("vishard4", "effects")]
    command = [*build.compiler(), "-std=c99", "-Wall", "-Wextra", "-Werror", *folders, "-c", "block.c"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


TOML = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
BACK = """
[[phase]]
from = "pressed"
to = "touch"
kind = "contact"
part = 0.1
degree = 7
[[phase]]
from = "touch"
to = "apex"
part = 0.4
degree = 7
"""


def test_its_scenario_is_read() -> None:
    (block,) = (b for b in TOML if "[[phase]]" in b)
    scenario = scenario_file.parse(tomllib.loads(block + BACK), Place("README.md"))
    assert [phase.kind for phase in scenario.phases] == ["free", "contact", "contact", "free"]
    assert scenario.springs[0].catalogue


def test_its_keys_of_the_controller_are_read() -> None:
    (block,) = (b for b in TOML if "[[joint]]" in b)
    shared, joint = block.split("[[joint]]\n")
    text = (ROOT / "symbolic" / "arms" / "emps.toml").read_text(encoding="utf-8")
    arm = reader.parse(text.replace("[[joint]]", f"{shared}[[joint]]") + joint, "README.md")
    assert arm.controller is not None
    assert arm.joints[0].gains is not None
    assert arm.joints[0].drive is not None


def test_its_rates_on_a_can_bus_are_those_that_fit() -> None:
    (row,) = re.findall(r"^\| highest `rate`, Hz.*?\| (.*) \|$", README, re.MULTILINE)
    for drives, rate in enumerate(map(float, row.split("|")), 1):
        address = can_bus.Address("can0")
        can_bus.check_load(drives, rate, address)
        with pytest.raises(LinkError):
            can_bus.check_load(drives, rate + 10, address)
