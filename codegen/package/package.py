"""The folder of an arm as {relative path: text}: its C, and what lets other programs use it: a C++17 header, a CMake
package, and a Python module that needs NumPy alone."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Mapping
from math import prod

from codegen import render
from codegen.c import c_code, misra
from codegen.c.arm_effects import ArmEffects
from codegen.pages import BANNER, page
from codegen.toolchain import build
from symbolic.effects.declaration import Effect
from symbolic.functions import Argument, Output, Struct, SymbolicFunction
from symbolic.model import ArmModel
from symbolic.model_file.checks import open_lines

_PEOPLES = {"inertia": "mass_matrix", "tip_jacobian": "jacobian"}
"""Functions that have another name for people than in C; the package `tendon` has the same."""


def package_files(model: ArmModel, library: Mapping[str, Effect]) -> dict[str, str]:
    """All files of an arm. library: all effects by name."""
    name, effects = model.arm.name, ArmEffects.of(model, library)
    made = render.arm_files(model) | render.controller_files(model, library)
    made |= render.arm_effect_files(model, library)
    sources = sorted(path for path in made if path.endswith(".c"))
    headers = [f"tendon_{name}.hpp", *(source.replace(".c", ".h") for source in sources)]
    labels = [joint.name or f"joint{i}" for i, joint in enumerate(model.arm.joints, 1)]
    functions = [_holes(f) for f in model.functions]
    left_out = [f"{site} reads {reads} and is left out." for site, reads in effects.left_out]
    holes = {
        "banner": c_code.comment(f"{BANNER} Arm {name}.", *open_lines(model.open)),
        "banner_text": f"{BANNER} Arm {name}.",
        "title": f"The equations of the arm {name}.",
        "open": open_lines(model.open),
        "name": name,
        "NAME": name.upper(),
        "n": len(labels),
        "functions": functions,
        "included": " ".join(["Friction has the sign of the rate.", *left_out]),
        "flags": " ".join([build.STRAIGHT, *(flag for flag in build.FLAGS if flag not in ("-fPIC", "-shared"))]),
    }
    cpp = {
        "joint_names": [json.dumps(label) for label in labels],
        "open_parameters": [json.dumps(lump.name) for lump in model.lumps if lump.lacks],
        "open_values": [json.dumps(name) for name in effects.open_values],
    }
    python = {
        "joints": [json.dumps(label) for label in labels],
        "parameters": _values(model.struct),
        "values": _values(effects.values),
        "remembers": effects.remembers,
        "memory": effects.memory_size,
        "most": max(
            len(x) for f in model.functions for x in (f.outputs[0].expressions, *(a.symbols for a in f.inputs))
        ),
    }
    checked = misra.checked()
    rules = {
        "checker": misra.CHECKER,
        "count": len(checked),
        "checked": textwrap.wrap(", ".join(checked), 120),
        "rows": misra.rows(name, made),
    }
    pages = {
        "MISRA.md": page("package/MISRA.md.j2", **holes, **rules),
        "misra.txt": page("c/misra.txt.j2", banner_text=holes["banner_text"], lines=misra.suppressions(name, made)),
        f"tendon_{name}.hpp": page("package/arm.hpp.j2", **holes, **cpp),
        "CMakeLists.txt": page("package/CMakeLists.txt.j2", **holes, sources=sources, headers=headers),
        "pyproject.toml": page("package/pyproject.toml.j2", **holes),
        "setup.py": page("package/setup.py.j2", **holes),
        f"tendon_{name}/__init__.py": page("package/init.py.j2", **holes, **python),
        f"tendon_{name}/_core.c": page("package/core.c.j2", **holes, **python),
        f"tendon_{name}/_core.pyi": page("package/core.pyi.j2", **holes),
        f"tendon_{name}/py.typed": "",
    }
    return dict(sorted({**made, **pages}.items()))


def _holes(function: SymbolicFunction) -> dict[str, object]:
    """The holes of one function in C++, in the extension and in Python."""
    inputs, (output,) = function.inputs, function.outputs
    lines = [*map(_line, inputs), _line(output)]
    return {
        "name": _PEOPLES.get(function.name, function.name),
        "c": function.name,
        "doc": function.doc,
        "lines": lines,
        "comment": [function.doc, *lines],
        "output": output.name,
        "size": prod(output.shape),
        "shape": output.shape,
        "sizes": [*(prod(a.shape) for a in inputs), prod(output.shape)],
        "cpp_inputs": ", ".join(f"Input<{prod(a.shape)}> {a.name}" if a.shape else f"double {a.name}" for a in inputs),
        "cpp_passed": ", ".join(f"{a.name}.data()" if a.shape else a.name for a in inputs),
        "elements": ", ".join(f"a[{i}]" for i in range(1, len(inputs) + 2)),
        "py_inputs": ", ".join(f"{a.name}: ArrayLike" for a in inputs),
        "py_passed": ", ".join(f"{a.name}=({a.name}, {prod(a.shape) if a.shape else 0})" for a in inputs),
    }


def _line(value: Argument | Output) -> str:
    shape = f" ({', '.join(map(str, value.shape))})" if value.shape else ""
    return f"{value.name}{shape} {value.unit}: {value.meaning}".replace("\\", "/")


def _values(struct: Struct) -> dict[str, str]:
    return {s.name: repr(x) for s, x in zip(struct.symbols, struct.defaults, strict=True)}
