"""Rust of an arm's functions in double precision, without allocation."""

from __future__ import annotations

from codegen.c.c_code import description, indent
from codegen.pages import BANNER, page
from codegen.tape.printers import Language, Printer, float64
from codegen.tape.tape import Tape
from symbolic.functions import Argument, SymbolicFunction
from symbolic.model import ArmModel
from symbolic.model_file.checks import open_lines

_WORDS = (
    "abstract as async await become box break const continue crate do dyn else enum extern f64 false final fn for if "
    "impl in let loop macro match math mod move mut override priv pub ref return self Self static struct super trait "
    "true try type typeof unsafe unsized use virtual where while yield"
)


def _pair(sine: str | None, cosine: str | None, angle: str) -> list[str]:
    return [f"let ({sine or '_'}, {cosine or '_'}) = math::sin_cos({angle});"]


RUST = Language(
    literal=float64,
    call=lambda operation, arguments: f"math::{operation}({', '.join(arguments)})",
    pair=_pair,
    assign=lambda name, text: f"let {name} = {text};",
    reserved=frozenset(_WORDS.split()),
)


def rust_files(model: ArmModel) -> dict[str, str]:
    """NAME.rs, a module of the arm's functions: {path: text}."""
    name, struct = model.arm.name, model.struct
    fields = [
        {"name": s.name, "meaning": f"{unit}: {meaning}", "value": "f64::NAN" if value is None else repr(float(value))}
        for s, unit, meaning, value in zip(struct.symbols, struct.units, struct.meanings, struct.defaults, strict=True)
    ]
    functions = [_holes(function) for function in model.functions]
    banner = "\n// ".join((BANNER, *open_lines(model.open)))
    return {f"{name}.rs": page("rust/rust.rs.j2", banner=banner, name=name, fields=fields, functions=functions)}


def _holes(function: SymbolicFunction) -> dict[str, object]:
    tape, (output,) = Tape.of(function), function.outputs
    leaves = {s: f"parameters.{s.name}" for s in function.struct.symbols} if function.struct else {}
    for a in function.inputs:
        leaves |= {s: f"{a.name}[{i}]" if a.shape else a.name for i, s in enumerate(a.symbols)}
    taken = frozenset({"parameters", *(a.name for a in function.inputs)})
    lines, texts = Printer(RUST, tape, leaves, taken).print()
    return {
        "name": function.name,
        "comment": description(function, function.inputs, tape),
        "arguments": ", ".join(["parameters: &Parameters", *(f"{a.name}: {_type(a)}" for a in function.inputs)]),
        "result": f"[f64; {len(output.expressions)}]",
        "body": indent([*lines, f"[{', '.join(texts)}]"], 1),
    }


def _type(value: Argument) -> str:
    return f"&[f64; {len(value.symbols)}]" if value.shape else "f64"
