"""Generated files: the same bytes everywhere, clean under a strict compiler, and their way to the disk."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp
from random_arms import MIXED, loaded

from codegen import disk, render
from codegen.c import c_code
from codegen.pages import BANNER
from codegen.tape.tape import Tape
from codegen.toolchain import build
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import SIGNAL, State, state
from symbolic.functions import Argument, Output, SymbolicFunction
from symbolic.model import derive
from symbolic.model_file.arm import Arm
from tests.variants import slow

ROOT = Path(__file__).resolve().parents[2]
DIGEST = """
import hashlib
from codegen.pages import BANNER
from codegen import disk, render
from symbolic.effects import LIBRARY
from symbolic.model import derive
from random_arms import MIXED, loaded
files = render.effect_files(tuple(LIBRARY.values())) | render.arm_files(derive(MIXED["rprrp"]))
print(hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest())
"""


@pytest.fixture(scope="module")
def effects() -> dict[str, str]:
    return render.effect_files(tuple(LIBRARY.values()))


@pytest.fixture(scope="module")
def paper(vishard4: Arm) -> dict[str, str]:
    return render.arm_files(derive(vishard4))


@pytest.mark.parametrize("seed", ["1", slow("4711")])
def test_the_same_bytes_whatever_the_hash_seed(effects: dict[str, str], seed: str) -> None:
    here = effects | render.arm_files(derive(MIXED["rprrp"]))
    expected = hashlib.sha256(repr(sorted(here.items())).encode()).hexdigest()
    environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    run = subprocess.run([sys.executable, "-c", DIGEST], env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == expected


def test_names_of_the_files(paper: dict[str, str], effects: dict[str, str]) -> None:
    maths = {"tendon_math_f32.h", "tendon_math_f64.h"}
    lanes = {"tendon_lanes_f64.h"}
    c = {f"_{s}.{ext}" for s in ("f32", "f64") for ext in ("h", "c")}
    assert set(paper) == maths | lanes | {f"vishard4{end}" for end in c} | {"vishard4_casadi.py", "metadata.json"}
    batch = {"effects_batch_f64.c", "effects_batch_f64.h"}
    assert set(effects) == maths | batch | {f"effects{end}" for end in c} | {"effects_casadi.py", "effects.json"}


def test_no_warnings(paper: dict[str, str], effects: dict[str, str]) -> None:
    """All the flags that embedded developers compile with, as errors, for both precisions; kept by hash."""
    busy = derive(loaded(MIXED["rprrp"]))
    files = paper | effects | render.arm_files(busy) | render.arm_effect_files(busy, LIBRARY)
    sources = [path for path in files if path.endswith(".c")]
    command = [*build.compiler(), "-std=c99", "-O1", "-ffp-contract=off", *build.WARNINGS, "-c", *sources]

    def fill(directory: Path) -> None:
        for path, text in files.items():
            (directory / path).write_text(text)
        result = subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr[:2000]
        assert not result.stderr

    key = build.key(*command, *(part for item in sorted(files.items()) for part in item))
    assert len(list(build.entry(f"objects-{key}", fill).glob("*.o"))) == len(sources)


def code(text: str) -> str:
    """C without its comments."""
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


def test_no_double_in_float_code(paper: dict[str, str], effects: dict[str, str]) -> None:
    for path, text in (paper | effects).items():
        if path.endswith(("_f32.c", "_f32.h")):
            assert "double" not in code(text)
            without_hex = re.sub(r"0x[0-9a-f]+U", "", code(text))
            literals = re.findall(r"(?<![\w.])(?:\d+\.\d*|\.\d+|\d+e[+-]?\d+)(?:e[+-]?\d+)?(\w*)", without_hex)
            assert set(literals) <= {"f"}, path


def test_the_code_allocates_nothing_and_keeps_nothing(paper: dict[str, str], effects: dict[str, str]) -> None:
    for path, text in (paper | effects).items():
        if path.endswith((".c", ".h")):
            assert not re.search(r"malloc|free\(|printf|\bpow\(|math\.h", code(text)), path
            # At the left margin there are functions and types, no variables.
            assert not re.search(r"^(static )?(const )?(double|float|int) \w+( =|;|\[)", code(text), re.MULTILINE), path


def test_comments_tell_price_and_source(paper: dict[str, str], vishard4: Arm) -> None:
    text = paper["vishard4_f32.c"]
    for function in derive(vishard4).functions:
        comment = re.search(rf"/\* {function.name}: .*?\*/", text, re.DOTALL)
        assert comment is not None
        assert "Source: " in comment.group()
        assert "Operations: " in comment.group()
    assert "20" + "26" not in text.split("*/")[0]


def body(text: str, function: str) -> str:
    """What stands between the braces of a C function, without its comments."""
    return code(text).split(f"{function}(", 1)[1].split("{", 1)[1].split("\n}\n", 1)[0]


@pytest.mark.parametrize("suffix", ["f32", "f64"])
def test_the_c_is_the_recursion_by_name_and_by_count(paper: dict[str, str], suffix: str) -> None:
    """73 operations and 3 pairs of sine and cosine, as its text has them, and F3, hc4 and c34 under their names."""
    text = body(paper[f"vishard4_{suffix}.c"], f"vishard4_inverse_dynamics_{suffix}")
    assert len(re.findall(r" [-+*/] ", text)) == 73
    pairs = {"f32": "tendon_sincos_f32(", "f64": "tendon_sincos_each_f64(3, "}[suffix]
    assert text.count(pairs) == {"f32": 3, "f64": 1}[suffix]
    given = re.findall(r"^    (?:const )?\w+ (\w+)(?: =|;)", text, re.MULTILINE)
    assert {"c2", "c3", "c34", "w2", "al4", "b3", "y3", "hc4", "hs4", "F2", "F3", "F4", "G3", "N3", "N4"} <= set(given)
    assert not [name for name in given if re.fullmatch(r"t\d+", name)]
    function = json.loads(paper["metadata.json"])["functions"]["inverse_dynamics"]
    assert function["operations"] == {"arithmetic": 73, "sincos": 3, "add": 30, "sub": 4, "mul": 39}


def test_a_name_is_no_word_of_c_and_hides_no_argument() -> None:
    x, y = sp.symbols("x y", real=True)
    given = [sp.Symbol(name, real=True) for name in ("double", "count", "q", "fine", "k")]
    function = SymbolicFunction(
        "f",
        (Argument("q", (x, y), (2,), "", ""),),
        (Output("out", tuple(symbol * x for symbol in given), (5,), "", ""),),
        "",
        "",
        tuple((symbol, (x + i) * y) for i, symbol in enumerate(given, 1)),
    )
    for text in (
        c_code.call("arm", function, Tape.of(function), c_code.F64).body,
        c_code.batch("arm", function, Tape.of(function), c_code.F64).body,
    ):
        names = re.findall(r"const double (\w+) =", text)
        assert "fine" in names
        assert not {"double", "count", "q", "k", "out"} & set(names)


def test_text_cannot_leave_its_comment() -> None:
    effect = replace(LIBRARY["coulomb"], summary='Ends */ #error here /* and """ there.')
    files = render.effect_files([effect])
    assert "#error" not in code(files["effects_f64.c"])
    compile(files["effects_casadi.py"], "effects_casadi.py", "exec")


def test_a_name_that_c_cannot_have() -> None:
    with pytest.raises(ValueError, match='the effect name "a;b" cannot be used in C'):
        render.effect_files([replace(LIBRARY["coulomb"], name="a;b")])
    with pytest.raises(ValueError, match='the arm\'s name "double" cannot be used in C'):
        render.arm_files(derive(replace(MIXED["r"], name="double")))


def test_states_step_together() -> None:
    """Two states that exchange their values: neither may read the other's new one."""
    swap = replace(
        LIBRARY["offset"],
        name="swap",
        torque=state("a") - state("b"),
        parameters=(),
        states=tuple(
            State(name, LIBRARY["offset"].parameters[0].unit, "", step=state(other), initial=sp.Integer(first))
            for name, other, first in (("a", "b", 1), ("b", "a", 2))
        ),
    )
    step = body(render.effect_files([swap])["effects_f64.c"], "tendon_swap_step_f64")
    assert step.index("next_b = state->a") < step.index("state->a = next_a")


@pytest.mark.parametrize("suffix", ["f32", "f64"])
def test_effects_take_what_they_read_by_name(effects: dict[str, str], suffix: str) -> None:
    """Signals, step and parameters as scalars, the memory as a struct of its own; each argument stands in the body."""
    text, real = code(effects[f"effects_{suffix}.c"]), {"f32": "float", "f64": "double"}[suffix]
    functions = re.findall(rf"^(?:{real}|void) tendon_(\w+)_{suffix}\(([^)]*)\)\n\{{\n(.*?)^\}}", text, re.M | re.S)
    assert len(functions) == len(LIBRARY) + 2 * sum(bool(effect.states) for effect in LIBRARY.values())
    for name, arguments, lines in functions:
        effect = LIBRARY[name.rpartition("_")[0]]
        known = [*(s.name for s in effect.signals), "dt", *(p.name for p in effect.parameters), "state"]
        names = [argument.split()[-1].lstrip("*") for argument in arguments.split(",")]
        assert names == [n for n in known if n in names], name
        assert all(re.search(rf"\b{n}\b", lines) for n in names), name
    assert "(void)" not in text
    header = effects[f"effects_{suffix}.h"]
    assert f"\n{real} tendon_stribeck_torque_{suffix}({real} qd, {real} torque, {real} speed);" in header
    comment = header[header.index("/* stribeck_torque:") :].split("*/")[0]
    assert "torque [N m]: " in comment
    assert "speed [rad/s]: " in comment


def test_a_parameter_called_as_a_signal() -> None:
    """Both are arguments; which is which is told by the parameter's name."""
    parameter_q = replace(LIBRARY["offset"].parameters[0], name="q")
    pull = replace(
        LIBRARY["offset"], name="pull", parameters=(parameter_q,), torque=parameter_q.symbol * SIGNAL["q"].symbol
    )
    text = render.effect_files([pull])["effects_f64.h"]
    assert "double tendon_pull_torque_f64(double q, double q_parameter);" in text


def test_write_replaces_and_removes(tmp_path: Path) -> None:
    old = {"a.c": f"/* {BANNER} */\n", "b.py": f"# {BANNER}\n"}
    disk.write(old, tmp_path)
    (tmp_path / "own.c").write_text("/* by hand */\n")
    new = {"a.c": f"/* {BANNER} */\nint x;\n"}
    assert disk.stale(new, tmp_path) == [
        f"{tmp_path / 'a.c'}: out of date",
        f"{tmp_path / 'b.py'}: no longer generated",
    ]
    disk.write(new, tmp_path)
    assert disk.stale(new, tmp_path) == []
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.c", "own.c"]
    assert (tmp_path / "own.c").read_text() == "/* by hand */\n"


def test_stale_names_what_is_missing(tmp_path: Path) -> None:
    assert disk.stale({"a.c": ""}, tmp_path / "nowhere") == [f"{tmp_path / 'nowhere' / 'a.c'}: missing"]


def test_unchanged_files_are_left_alone(tmp_path: Path) -> None:
    files = {"a.c": "int x;\n"}
    disk.write(files, tmp_path)
    before = (tmp_path / "a.c").stat().st_mtime_ns
    disk.write(files, tmp_path)
    assert (tmp_path / "a.c").stat().st_mtime_ns == before
