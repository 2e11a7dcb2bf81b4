"""What the shell proposes for an unfinished word: models, scenarios and effects. No user's file is run for it."""

from __future__ import annotations

from collections.abc import Mapping
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from runtime.workspace.names import ARMS, SCENARIOS
from runtime.workspace.source import Source, effects_described

if TYPE_CHECKING:
    from symbolic.described import AnyEffect


def models(incomplete: str) -> list[str]:
    """Arms that come with Tendon, and model files."""
    return _shipped_and_files(ARMS, incomplete)


def scenarios(incomplete: str) -> list[str]:
    """Scenarios that come with Tendon, and files."""
    return _shipped_and_files(SCENARIOS, incomplete)


def effects(incomplete: str) -> list[tuple[str, str]]:
    """Effects of the library with what they are."""
    return [(e.name, e.summary) for e in effects_described(None, space=True).values() if e.name.startswith(incomplete)]


def effects_at_joints(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Effects as --hide and --between take them: `stribeck@1` for every joint of the model that was typed before."""
    # An option without its value leaves the arguments before it unread.
    places = _joints(ctx.params.get("model") or next(iter(ctx.args), None))
    known: Mapping[str, AnyEffect] = effects_described(None, space=True)
    proposed = [
        (f"{e.name}{at}", e.summary)
        for e in known.values()
        for at in (places if e.scope in ("joint", "joints") else [""])
    ]
    return [one for one in proposed if one[0].startswith(incomplete)]


def _joints(model: object) -> list[str]:
    try:
        arm = Source.read(Path(str(model)), None).arm()
    except (OSError, ValueError):
        return [""]
    return [f"@{k}" for k in range(1, len(arm.joints) + 1)]


def _shipped_and_files(folder: Path, incomplete: str) -> list[str]:
    names = sorted(path.stem for path in folder.glob("*.toml"))
    head, slash, tail = incomplete.rpartition("/")
    files = sorted(path.name for path in Path(head or slash or ".").glob(f"{escape(tail)}*.toml"))
    return [*(name for name in names if name.startswith(incomplete)), *(f"{head}{slash}{name}" for name in files)]
