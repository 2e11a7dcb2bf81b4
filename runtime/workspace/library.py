"""The library of effects as a command sees it: what comes with Tendon, and the user's own (--effects)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symbolic.described import AnyEffect
    from symbolic.effects.declaration import Effect


def effects_library(effects_file: Path | None, space: bool) -> dict[str, Effect]:
    """The effects by name, with their equations; space: as a spatial arm has them. Raises EffectsError."""
    from symbolic.effects import shipped

    own = _own_effects(effects_file, space) if effects_file else ()
    return {**shipped(space), **{effect.name: effect for effect in own}}


def effects_described(effects_file: Path | None, space: bool) -> Mapping[str, AnyEffect]:
    """The effects by name, without equations unless the user has own effects: SymPy is not imported for it."""
    if effects_file is not None:
        return effects_library(effects_file, space)
    from codegen.descriptions import described
    from runtime.model.catalogue import effects_of

    return effects_of(described(space))


def _own_effects(path: Path, space: bool) -> tuple[Effect, ...]:
    """The effects of a user's file. Code is generated from each at once, so that one that cannot be is refused before
    any other work. Raises EffectsError."""
    from codegen.render import effect_files
    from symbolic.effects import EffectsError, load_user_effects, said

    effects = load_user_effects(path, space)
    for effect in effects:
        try:
            effect_files((effect,))
        except ValueError as error:
            raise EffectsError(f"{path}: {error}") from error
        except Exception as error:
            raise EffectsError(f'{path}: effect "{effect.name}" cannot be generated: {said(error)}') from error
    return effects
