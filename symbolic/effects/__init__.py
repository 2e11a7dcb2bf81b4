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
"""All effects by name, in the order in which they are listed and emitted, as an arm in space has them."""

LIBRARY: dict[str, Effect] = {name: effect.in_plane() for name, effect in DECLARED.items()}
"""The same as a planar arm has them."""


def shipped(space: bool) -> dict[str, Effect]:
    """The library as an arm in space has it, or a planar one."""
    return DECLARED if space else LIBRARY


class EffectsError(ValueError):
    """A user's file of effects cannot be used; the message says why."""


def load_user_effects(path: Path, space: bool = True) -> tuple[Effect, ...]:
    """The `EFFECTS = (Effect(...), ...)` of a Python file, checked; `space`: as they are declared, for an arm in space,
    else as a planar arm has them.

    The file is run: it is trusted because the user named it. Raises EffectsError where it cannot be read,
    fails, has no EFFECTS, contradicts itself or takes a name that is already in use.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise EffectsError(f"{path}: is no file; expected Python that defines EFFECTS")
        found = runpy.run_path(str(path)).get("EFFECTS")
    except EffectsError:
        raise
    except OSError as error:
        raise EffectsError(f"{path}: cannot read the file of effects: {error.strerror}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever it is that a file raises
        raise EffectsError(f"{path}: the file of effects failed: {said(error)}") from error
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
        except Exception as error:  # SymPy meets a law that it cannot differentiate with whatever its parts raise
            raise EffectsError(f'{path}: effect "{effect.name}" cannot be used: {said(error)}') from error
        seen.add(effect.name)
    return tuple(kept)


def said(error: BaseException) -> str:
    """An error of a user's own code in one line: its kind, and what it says as far as it can say something."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = ""
    return f"{type(error).__name__}: {text[:300] or 'no message'}"
