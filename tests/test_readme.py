"""What the README tells people to type and to open is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from runtime import cli
from symbolic.effects import load_user_effects

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
    commands = cli.app.registered_commands + [
        c for g in cli.app.registered_groups for c in g.typer_instance.registered_commands
    ]
    assert verb in {c.name or c.callback.__name__ for c in commands}


def test_its_c_calls_what_is_generated() -> None:
    (block,) = re.findall(r"```c\n(.*?)```", README, re.DOTALL)
    headers = [p.read_text(encoding="utf-8") for p in sorted((ROOT / "generated").glob("*/*_f32.h"))]
    for name in re.findall(r"\b((?:vishard4|tendon)_\w+_f32)\b", block):
        assert any(name in header for header in headers), name
