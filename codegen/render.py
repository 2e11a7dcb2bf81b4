"""The generated files of an arm, a controller or a library as {relative path: text}: pure and deterministic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from codegen import effect_functions as ef
from codegen import metadata
from codegen.c import c_code, c_effects, c_lanes
from codegen.c.arm_effects import ArmEffects
from codegen.c.c_code import F32, F64, Precision, Routine, word
from codegen.c.controller import Controller
from codegen.c.monitor import ModelMonitor
from codegen.c.statistics import ModelStatistics, labels
from codegen.casadi import casadi_code
from codegen.pages import BANNER, page
from codegen.tape.tape import Tape, balanced
from symbolic.effects.declaration import Effect
from symbolic.functions import SymbolicFunction
from symbolic.model_file.checks import open_lines

if TYPE_CHECKING:
    from symbolic.model import ArmModel


def math_header(precision: Precision) -> str:
    """tendon_math_f32.h or tendon_math_f64.h: sine and cosine, exponential, logarithm, the switches."""
    f = "f" if precision is F32 else ""
    return page(
        "c/tendon_math.h.j2",
        banner=f"/* {BANNER} */",
        guard=f"TENDON_MATH_{precision.suffix.upper()}_H",
        real=precision.kind,
        suffix=precision.suffix,
        zero=f"0.0{f}",
        one=f"1.0{f}",
        sqrt=f"__builtin_sqrt{f}",
        abs=f"__builtin_fabs{f}",
        kernels=page(f"c/math_{precision.suffix}.h.j2").rstrip(),
    )


def _c_files(
    name: str,
    origin: Sequence[str],
    precision: Precision,
    types: Sequence[str],
    routines: Sequence[Routine],
    includes: Sequence[str] = (),
    inner: Sequence[Routine] = (),
    lanes: bool = False,
) -> dict[str, str]:
    """A source, its header and the mathematics.

    origin     lines of the banner       includes   of the header     inner   routines that the source alone sees
    lanes      some routines compute several samples at once
    """
    stem = f"{name}_{precision.suffix}"
    banner = c_code.comment(*origin)
    mathematics = f"tendon_{'lanes' if lanes else 'math'}_{precision.suffix}.h"
    return {
        f"{stem}.h": page(
            "c/header.h.j2",
            banner=banner,
            guard=f"TENDON_{stem.upper()}_H",
            includes=includes,
            types=types,
            routines=routines,
        ),
        f"{stem}.c": page(
            "c/source.c.j2", banner=banner, includes=[f"{stem}.h", mathematics], routines=[*inner, *routines]
        ),
        f"tendon_math_{precision.suffix}.h": math_header(precision),
    }


def arm_files(model: ArmModel) -> dict[str, str]:
    """C (float, double), the CasADi module and metadata.json of an arm.

    Processors with double precision execute several operations at once, so the long sums of spatial arms are ordered by
    the time at which their terms are available.
    """
    name = model.arm.name
    if not word(name):
        raise ValueError(f'the arm\'s name "{name}" cannot be used in C; use letters, digits and _')
    origin = (f"{BANNER} Arm {name}.", *open_lines(model.open))
    tapes = {f.name: Tape.of(f) for f in model.functions}
    wide = {n: balanced(t) for n, t in tapes.items()} if model.arm.space else tapes
    begun = {f.continues.function for f in model.functions if f.continues is not None}
    files: dict[str, str] = {}
    for precision in (F32, F64):
        routines = [c_code.defaults(name, model.struct, precision, [lump.name for lump in model.lumps if lump.lacks])]
        for function in model.functions:
            tape = tapes[function.name] if precision is F32 else wide[function.name]
            routines.append(c_code.call(name, function, tape, precision))
            if precision is F64:
                routines += _batches(name, function, tape, function.name in begun)
        types = [c_code.comment(c_code.HEAD), c_code.struct_type(name, model.struct, precision)]
        files |= _c_files(name, origin, precision, types=types, routines=routines, lanes=precision is F64)
    files["tendon_lanes_f64.h"] = page("c/lanes_f64.h.j2", banner=f"/* {BANNER} */")
    builders = [casadi_code.builder(function, tape=tapes[function.name]) for function in model.functions]
    files[f"{name}_casadi.py"] = page(
        "casadi/casadi.py.j2",
        banner="# " + "\n# ".join(origin),
        title=f"The arm {name}: its equations, and what the model file gives them.",
        tables=casadi_code.arm_tables(model),
        functions=builders,
    )
    files["metadata.json"] = metadata.text(metadata.arm(model, tapes))
    return dict(sorted(files.items()))


def _batches(name: str, function: SymbolicFunction, tape: Tape, begun: bool) -> list[Routine]:
    """The routines of many samples. begun: another function continues this one."""
    if function.continues is not None:
        return [c_code.continued_batch(name, function, function.continues)]
    if begun:
        return c_lanes.range_and_batch(name, function, tape)
    return [(c_lanes if c_lanes.in_lanes(tape) else c_code).batch(name, function, tape)]


def controller_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """The controller's step in C (float), its monitor and statistics if there are any, and controller.json.

    library   all effects by name; those that the model file activates are compensated
    """
    controller = Controller.of(model, library)
    stem = f"{model.arm.name}_controller_f32"
    contact = "controller_contact" if controller.has_contact_coordinates else "controller_no_contact"
    banner = c_code.comment(f"{BANNER} Controller of the arm {model.arm.name}.", *open_lines(model.open))
    holes = {"banner": banner, **controller.holes}
    return {
        f"{stem}.c": page("c/controller.c.j2", **holes, contact_phase=page(f"c/{contact}.c.j2", **holes).rstrip()),
        f"{stem}.h": page("c/controller.h.j2", **holes),
        "controller.json": metadata.text(controller.document()),
        **({} if controller.monitor is None else _monitor_files(model.arm.name, controller.monitor)),
        **statistics_files(model, library),
    }


def _monitor_files(name: str, monitor: ModelMonitor) -> dict[str, str]:
    holes = {"banner": f"/* {BANNER} Monitor of the arm {name}. */", **monitor.holes}
    return {f"{name}_monitor_f32.{kind}": page(f"c/monitor.{kind}.j2", **holes) for kind in ("c", "h")}


def arm_effect_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """C (float, double) of the effects of an arm's joints. library: all effects by name."""
    effects, name = ArmEffects.of(model, library), f"{model.arm.name}_effects"
    files: dict[str, str] = {}
    for precision in (F32, F64):
        files |= _c_files(
            name,
            (f"{BANNER} Effects of the arm {model.arm.name}.", *open_lines(model.open)),
            precision,
            types=effects.types(precision),
            routines=effects.routines(precision),
            includes=[f"{model.arm.name}_{precision.suffix}.h"],
            inner=effects.inner(precision),
        )
    return dict(sorted(files.items()))


def probe_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """The float C of an arm and of its controller with callable inner functions, for verification."""
    name = model.arm.name
    files = arm_files(model) | controller_files(model, library)
    chosen = {path: text for path, text in files.items() if path.endswith(("_f32.c", "_f32.h"))}
    chosen[f"{name}_controller_f32.inc"] = chosen.pop(f"{name}_controller_f32.c")
    return chosen | {f"{name}_probe_f32.c": Controller.of(model, library).probe()}


def statistics_files(model: ArmModel, library: Mapping[str, Effect], precision: Precision = F32) -> dict[str, str]:
    """The statistics of an arm's linear parameters in C; none where the model file asks for none."""
    found = ModelStatistics.of(model, library)
    if found is None:
        return {}
    name, banner = model.arm.name, f"/* {BANNER} Statistics of the arm {model.arm.name}. */"
    holes = {"banner": banner, "labels": [f" * {x}" for x in labels(found)], **found.holes(precision)}
    stem = f"{name}_statistics_{precision.suffix}"
    return {f"{stem}.{kind}": page(f"c/statistics.{kind}.j2", **holes) for kind in ("c", "h")}


def residual_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """The float C that gives the monitor's residual along a recording, and controller.json; the arm has a monitor."""
    name = model.arm.name
    files = probe_files(model, library)
    del files[f"{name}_probe_f32.c"]
    files[f"{name}_residuals_f32.c"] = page("c/residuals.c.j2", banner=f"/* {BANNER} Arm {name}. */", name=name)
    return files | {"controller.json": metadata.text(Controller.of(model, library).document())}


def effect_files(effects: Sequence[Effect]) -> dict[str, str]:
    """C (float, double, and double along samples), the CasADi module and effects.json of a library."""
    c_effects.check_names(effects)
    origin = (f"{BANNER} The library of effects.",)
    files: dict[str, str] = {}
    for precision in (F32, F64):
        routines = [routine for effect in effects for routine in c_effects.routines(effect, precision)]
        files |= _c_files("effects", origin, precision, types=c_effects.types(effects, precision), routines=routines)
    batches = [routine for effect in effects for routine in c_effects.batches(effect, F64)]
    types = [c_effects.signals_type(F64), c_effects.columns_type(F64)]
    files |= _c_files("effects_batch", origin, F64, types=types, routines=[*batches, *c_effects.filters()])
    builders = [
        casadi_code.builder(function, widths=True)
        for effect in effects
        for function in ([ef.torque(effect)] + ([ef.start(effect), ef.step(effect)] if effect.states else []))
    ]
    files["effects_casadi.py"] = page(
        "casadi/casadi.py.j2",
        banner=f"# {origin[0]}",
        title="The effects: what each adds to the motor torque of a joint, and their memories.",
        tables=casadi_code.effect_tables(effects),
        functions=builders,
    )
    files["effects.json"] = metadata.text(metadata.library(effects))
    return dict(sorted(files.items()))
