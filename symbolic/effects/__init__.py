"""The library of physical effects: one declaration each, one file a family."""

from __future__ import annotations

import runpy
import stat
from pathlib import Path

from symbolic.effects import contact, drive, friction, loads, springs, transmission
from symbolic.effects.declaration import Effect, check, mistake

DECLARED: dict[str, Effect] = {
    effect.name: effect
    for family in (friction, springs, drive, transmission, loads, contact)
    for effect in family.EFFECTS
}
"""All effects by name, in the order of lists and generated code, as spatial arms have them."""

LIBRARY: dict[str, Effect] = {name: effect.in_plane() for name, effect in DECLARED.items()}
"""All effects by name, as planar arms have them."""


def shipped(space: bool) -> dict[str, Effect]:
    """The library for spatial or planar arms."""
    return DECLARED if space else LIBRARY


class EffectsError(ValueError):
    """A user's file of effects cannot be used; the message says why."""


def load_user_effects(path: Path, space: bool = True) -> tuple[Effect, ...]:
    """The checked `EFFECTS = (Effect(...), ...)` of a Python file, for spatial or planar arms.

    The file is executed; it is trusted because the user named it. Raises EffectsError if it cannot be read, fails, has
    no EFFECTS, contradicts itself or uses a name that exists.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise EffectsError(f"{path}: is not a file; expected Python that defines EFFECTS")
        found = runpy.run_path(str(path)).get("EFFECTS")
    except EffectsError:
        raise
    except OSError as error:
        raise EffectsError(f"{path}: cannot read the file of effects: {error.strerror}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a file may raise anything
        old = isinstance(error, ModuleNotFoundError) and error.name == "symbolic"
        hint = "; import from tendon.effects instead" if old else ""
        raise EffectsError(f"{path}: the file of effects failed: {said(error)}{hint}") from error
    if found is None:
        raise EffectsError(f"{path}: no EFFECTS in it; define EFFECTS = (Effect(...), ...)")
    if type(found) not in (tuple, list):
        raise EffectsError(f"{path}: EFFECTS is a {type(found).__name__}; make it a tuple of Effect(...)")
    seen, kept = set(DECLARED), []
    for position, effect in enumerate(found, 1):
        if type(effect) is not Effect:
            raise EffectsError(f"{path}: EFFECTS item {position} is a {type(effect).__name__}, not an Effect(...)")
        if wrong := mistake(effect):
            raise EffectsError(f"{path}: {wrong}")
        if effect.name in seen:
            raise EffectsError(f'{path}: the name "{effect.name}" is already in use; choose another')
        try:
            check(effect)
            kept.append(effect if space else effect.in_plane())
        except ValueError as error:
            raise EffectsError(f"{path}: {error}") from error
        except Exception as error:  # SymPy may raise anything for a law that it cannot differentiate
            raise EffectsError(f'{path}: effect "{effect.name}" cannot be used: {said(error)}') from error
        seen.add(effect.name)
    return tuple(kept)


def said(error: BaseException) -> str:
    """An error of a user's code in one line: type and message."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = ""
    return f"{type(error).__name__}: {text[:300] or 'no message'}"
