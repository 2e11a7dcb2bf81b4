"""Options of the command line, made of settings as runtime/setting.py declares them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, get_type_hints

import typer

from runtime.setting import Checked, Setting, declared, split


def with_settings(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb with options in place of its parameters that are settings.

    A parameter whose type is a dataclass of settings becomes an option for each of its fields, and the verb gets the
    dataclass; one of type Annotated[type, Setting(...)] becomes one option.
    """
    hints = get_type_hints(verb, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if isinstance(hint, type) and issubclass(hint, Checked)}

    @wraps(verb)
    def called(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{item.name: given.pop(item.name) for item in declared(group)})
        verb(**given)

    parameters = [option for p in signature(verb).parameters.values() for option in _options(p, hints[p.name])]
    # typer reads both.
    called.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in parameters}
    return called


def _options(parameter: Parameter, hint: Any) -> Iterator[Parameter]:
    if isinstance(hint, type) and issubclass(hint, Checked):
        for item in declared(hint):
            yield _option(item.name, item.type, item.default, item.setting)
        return
    kind, setting = split(hint)
    if setting is not None:
        yield _option(parameter.name, kind, parameter.default, setting)
    else:
        yield parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=hint)


def _option(name: str, kind: Any, default: Any, setting: Setting) -> Parameter:
    # A flag that is off by itself needs no option that says so.
    flag = [f"--{name.replace('_', '-')}"] if default is False else []
    option = typer.Option(
        *flag,
        min=setting.low,
        max=setting.high,
        help=setting.help,
        metavar=setting.metavar,
        show_default=not (default is None or default is False or default == ""),
    )
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option])
