"""The generated CasADi functions of an arm and of effects, with smoothed switches, for optimization and simulation."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca

from runtime.model.loader import Model

WIDTHS = ("rate", "position", "force", "time")
"""The order in which generated functions take the widths of their smoothed switches."""


@cache
def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path}: not a generated module; generate the arm again")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def _function(path: Path, name: str) -> ca.Function:
    return getattr(_module(path), name)()


def arm_function(model: Model, name: str) -> ca.Function:
    """A function of the arm; its first input is the struct of parameters."""
    return _function(model.directory / f"{model.name}_casadi.py", name)


def effect_function(model: Model, effect: str, what: str = "torque") -> ca.Function:
    """`torque`, and for effects with states `start` and `step`; inputs: signals, (dt,) parameters, states, width."""
    return _function(model.library.directory / "effects_casadi.py", f"{effect}_{what}")


def evaluate(model: Model, name: str, struct: Any, coordinate: Callable[[str], Any]) -> Any:
    """A function of the arm; its inputs besides the struct of parameters are read by name."""
    inputs = model.metadata["functions"][name]["inputs"]
    return arm_function(model, name)(struct, *(coordinate(argument) for argument, _ in inputs))


@cache
def _slope(path: Path, arm: str, name: str, by: str) -> ca.Function:
    function = _function(path / f"{arm}_casadi.py", name)
    inputs = [ca.SX.sym(function.name_in(k), function.size_in(k)) for k in range(function.n_in())]
    place = function.name_in().index(by)
    return ca.Function("slope", inputs, [ca.jacobian(function(*inputs), inputs[place])])


def slope(model: Model, name: str, by: str, struct: Any, coordinate: Callable[[str], Any]) -> Any:
    """The derivative of a function of the arm by its input `by`, one column per entry; see `evaluate`."""
    inputs = model.metadata["functions"][name]["inputs"]
    return _slope(model.directory, model.name, name, by)(struct, *(coordinate(argument) for argument, _ in inputs))


def effect_torque(
    model: Model, effect: str, read: Callable[[str], Any], values: Any, width: Any, states: Any = None
) -> Any:
    """The torque of an effect; its signals are read by name. values: its parameters in declared order."""
    info = model.library[effect]
    signals = [read(name) for name in info.signals]
    return effect_function(model, effect)(*signals, values, ca.SX(0, 1) if states is None else states, width)


def ordered(model: Model, effect: str, values: Mapping[str, Any]) -> list[Any]:
    """Parameter values of an effect in declared order, with defaults; numbers or expressions."""
    return [values.get(p.name, p.default or 0.0) for p in model.library[effect].parameters]
