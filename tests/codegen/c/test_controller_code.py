"""The controller's generated C: clean under strict compilers, float alone, and clear about its limits."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp
from random_arms import MIXED, loaded

from codegen import prepare, render
from codegen.firmware.source_tree import firmware_files
from codegen.toolchain import build
from symbolic.controller_law import compensation
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import SIGNAL, Effect
from symbolic.model import derive
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, Contact, Joint
from tests.watched_arm import MONITOR, watched_text


def sources(arm: Arm, library: dict[str, Effect] = LIBRARY) -> dict[str, str]:
    """All float C of an arm."""
    model = derive(arm)
    files = render.arm_files(model) | render.controller_files(model, library)
    return {path: text for path, text in files.items() if path.endswith(("_f32.c", "_f32.h"))}


@pytest.mark.parametrize("name", ["r", "rp", "rprrp"])
@pytest.mark.parametrize("level", ["-O0", "-O2"])
def test_no_warnings(tmp_path: Path, name: str, level: str) -> None:
    compile_all(tmp_path, sources(loaded(MIXED[name])), level, *build.WARNINGS)


def test_no_warnings_for_the_arm_of_the_paper(tmp_path: Path, vishard4: Arm) -> None:
    """-Wfloat-equal besides: nothing hangs on two floats being the same."""
    compile_all(tmp_path, sources(vishard4), "-O2", *build.WARNINGS, "-Wcast-qual", "-Wswitch-default", "-pedantic")


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_no_name_is_one_of_gccs(tmp_path: Path) -> None:
    """-std=gnu11, as Arduino and PlatformIO have it, knows more functions by name; everything that is generated."""
    model = derive(reader.parse(watched_text(2, monitor=MONITOR + "statistics = true\n"), "arm.toml"))
    host = render.effect_files([*LIBRARY.values()]) | render.arm_files(model) | render.arm_effect_files(model, LIBRARY)
    files = firmware_files(model, LIBRARY) | {f"src/{path}": text for path, text in host.items()}
    for path, text in files.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    units = sorted(path for path in files if path.endswith(".c"))
    command = ["gcc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-Isrc", *units]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert len(units) > 20
    assert result.returncode == 0, result.stderr[:3000]


def compile_all(directory: Path, files: dict[str, str], *flags: str) -> None:
    for path, text in files.items():
        (directory / path).write_text(text)
    units = sorted(path for path in files if path.endswith(".c"))
    command = [*build.compiler(), "-std=c99", "-ffp-contract=off", *flags, "-c", *units]
    result = subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[:3000]
    assert not result.stderr


@pytest.mark.skipif(not shutil.which("objdump"), reason="needs objdump")
def test_no_double_in_the_machine_code(tmp_path: Path) -> None:
    compile_all(tmp_path, sources(loaded(MIXED["rprrp"])), "-O2")
    objects = sorted(str(path) for path in tmp_path.glob("*.o"))
    text = subprocess.run(["objdump", "-d", *objects], capture_output=True, text=True, check=True).stdout
    assert "mulss" in text
    assert not re.findall(r"cvtss2sd|cvtsd2ss|cvtsi2sd|addsd|mulsd|divsd", text)


def test_the_stack_is_small(tmp_path: Path, vishard4: Arm) -> None:
    """Every function has a fixed frame, and all frames together stay below a kilobyte."""
    compile_all(tmp_path, sources(vishard4), "-O2", "-fstack-usage")
    lines = [line.split("\t") for path in tmp_path.glob("*.su") for line in path.read_text().splitlines()]
    if not lines:
        pytest.skip("this compiler does not report the stack")
    assert {kind for *_, kind in lines} == {"static"}
    used = {place.split(":")[-1]: int(size) for place, size, _ in lines}
    step = used["vishard4_controller_step_f32"]
    assert step + max(size for name, size in used.items() if "controller" not in name) < 1024


def test_nothing_is_allocated_or_kept(vishard4: Arm) -> None:
    for path, text in sources(vishard4).items():
        code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        assert "double" not in code, path
        assert not re.search(r"malloc|free\(|printf|math\.h|string\.h", code), path
        assert not re.search(r"^(static )?(float|int32_t|uint32_t) \w+( =|;|\[)", code, re.MULTILINE), path


def test_what_is_not_compensated_is_said(vishard4: Arm) -> None:
    found = compensation(derive(loaded(MIXED["rprrp"])), LIBRARY)
    assert {str(site) for site in found.uncompensated} >= {
        *("lugre@1", "load_friction@1", "thermal_friction@1", "spring_hysteresis@1", "elasticity@1", "backlash@1"),
        *("torque_saturation@1", "torque_scale@1", "torque_delay@1", "payload"),
    }
    text = render.controller_files(derive(loaded(MIXED["rprrp"])), LIBRARY)["arm_rprrp_controller_f32.h"]
    assert "Not compensated: lugre@1 (has a memory)." in text
    assert "Not compensated: payload (reads elapsed, tip_load)." in text
    assert "Not compensated" not in sources(vishard4)["vishard4_controller_f32.h"]


def test_friction_is_scaled_and_nothing_else() -> None:
    """c_u = 0 leaves exactly what is no friction."""
    found = compensation(derive(loaded(MIXED["rp"])), LIBRARY)
    torques = found.functions[0].outputs[0].expressions
    scale = next(s for s in found.effects.symbols if s.name == "friction_scale")
    names = {s.name for s in torques[0].subs(scale, 0).free_symbols}
    assert not any("coulomb" in name or "viscous" in name or "stribeck" in name for name in names)
    assert {"joint1_offset_torque", "joint1_cable_c1", "arm_gravity_gx", "joint1_torque_ripple_order"} <= names


def test_friction_between_two_links_is_felt_by_both() -> None:
    found = compensation(derive(loaded(MIXED["rp"])), LIBRARY)
    first, second = found.functions[0].outputs[0].expressions
    for torque in (first, second):
        assert "joint1_coupled_friction_torque" in {s.name for s in torque.free_symbols}
        inner = next(e for e in sp.preorder_traversal(torque) if str(e.func) == "sgn" and len(e.free_symbols) == 3)
        assert inner.args[0] == sp.Symbol("qd1", real=True) + sp.Symbol("qd2", real=True)


def test_an_effect_of_ones_own(vishard4: Arm) -> None:
    """A declaration that is not in the library is compensated by its own equation."""
    own = replace(LIBRARY["offset"], name="own", torque=LIBRARY["offset"].torque * SIGNAL["q"].symbol ** 5)
    joint = replace(vishard4.joints[0], effects={"own": {"torque": 2.0}})
    arm = replace(vishard4, joints=(joint, *vishard4.joints[1:]))
    text = sources(arm, {**LIBRARY, "own": own})["vishard4_controller_f32.c"]
    assert "joint1_own_torque" in text


def test_the_contact_s_own_effects_are_with_the_plate(vishard4: Arm) -> None:
    own = replace(LIBRARY["plate_damping"], name="own")
    contact = Contact(0.0, {"own": {"coefficient": 3.0}})
    found = compensation(derive(replace(vishard4, contact=contact)), {**LIBRARY, "own": own})
    by_name = {f.name: {s.name for e in f.outputs[0].expressions for s in e.free_symbols} for f in found.functions}
    assert "contact_own_coefficient" in by_name["contact_compensation"]
    assert "contact_own_coefficient" not in by_name["joint_compensation"]


def test_a_prepared_controller_is_prepared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = MIXED["rp"]
    first = prepare.prepare_firmware(arm, LIBRARY)
    monkeypatch.setattr(build, "compile_shared", lambda *_: pytest.fail("compiled again"))
    assert prepare.prepare_firmware(arm, LIBRARY) == first
    other: Joint = replace(arm.joints[0], torque_constant=0.7)
    second = prepare.prepare_firmware(replace(arm, joints=(other, arm.joints[1])), LIBRARY)
    assert second != first
    assert (second / "lib.so").read_bytes() == (first / "lib.so").read_bytes()
    ctypes.CDLL(str(first / "lib.so")).arm_rp_controller_step_f32  # noqa: B018


@pytest.mark.skipif(not shutil.which("c++"), reason="needs a C++ compiler")
def test_the_price_of_a_step_is_what_the_header_says(tmp_path: Path, vishard4: Arm) -> None:
    """The same C, run with floats that count."""
    files = sources(vishard4)
    for path, text in files.items():
        (tmp_path / path).write_text(text)
    counting = Path(__file__).with_name("counted.cpp")
    command = ["c++", "-w", "-fpermissive", f"-I{tmp_path}", str(counting), "-o", "counted"]
    subprocess.run(command, cwd=tmp_path, check=True)
    printed = subprocess.run(["./counted"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    said = re.search(r"free phase of degree M: (\d+) \+ (\d+) M", files["vishard4_controller_f32.h"])
    assert said is not None
    fixed, each = map(int, said.groups())
    counts = [tuple(map(int, line.split())) for line in printed.splitlines()]
    assert len(counts) == 26
    assert all(count == fixed + each * degree for degree, count in counts)


SANITIZED = """
#include <stddef.h>
#include <stdio.h>
#include "vishard4_controller_f32.h"

int main(void)
{
    static vishard4_config_f32 config;
    static vishard4_state_f32 state;
    static float points[4 * 30];
    vishard4_contact_f32 contact = {686.0f, 24.0f, 2.0f, 1.0f, 3.0f};
    vishard4_phase_f32 phases[2] = {
        {0U, 29U, 0.02f, points, NULL, 0.0f, 0.0f, 0.0f}, {1U, 7U, 0.02f, points, &contact, 0.0f, 0.0f, 0.0f}};
    vishard4_trajectory_f32 trajectory = {2U, 1U, 1.0f, {{0}}, phases};
    vishard4_output_f32 output;
    int32_t counts[4] = {INT32_MAX, INT32_MIN, -1, 0};
    config.rate = 1000.0f;
    vishard4_default_parameters_f32(&config.parameters);
    for (int j = 0; j < 4; ++j) {
        config.position_per_count[j] = 3e-5f;
        config.torque_limit[j] = 10.0f;
        config.zero[j] = INT32_MIN;
    }
    vishard4_controller_prepare_f32(&config);
    vishard4_controller_prepare_phase_f32(&phases[1]);
    vishard4_controller_reset_f32(&state, counts);
    for (uint32_t k = 0; k < 4000; ++k) {
        for (uint32_t j = 0; j < 4; ++j) {
            counts[j] = (int32_t)((k + 1U) * 2654435761U * (j + 1U));
        }
        phases[0].degree = k % 40U;
        vishard4_controller_prepare_phase_f32(&phases[0]);
        trajectory.count = (k % 97U == 0U) ? 0U : 2U;
        trajectory.periodic = k % 2U;
        vishard4_controller_step_f32(&config, &trajectory, &state, counts, &output);
        for (int j = 0; j < 4; ++j) {
            if (!(output.torque[j] >= -10.0f && output.torque[j] <= 10.0f)) {
                return 1;
            }
        }
    }
    puts("done");
    return 0;
}
"""


def test_no_undefined_behaviour_whatever_comes_in(vishard4: Arm) -> None:
    """Counters that overflow, degrees out of range, no trajectory, postures out of reach: under the sanitizers."""
    files = sources(vishard4) | {"main.c": SANITIZED}
    units = sorted(path for path in files if path.endswith(".c"))
    command = [*build.compiler(), "-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

    def fill(directory: Path) -> None:
        for path, text in files.items():
            (directory / path).write_text(text)
        made = subprocess.run(
            [*command, *units, "-o", "a.out", "-lm"], cwd=directory, capture_output=True, text=True, check=False
        )
        if made.returncode and "asan" in made.stderr:
            pytest.skip("this compiler has no sanitizers")
        assert made.returncode == 0, made.stderr[:2000]
        environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
        run = subprocess.run(["./a.out"], cwd=directory, capture_output=True, text=True, check=False, env=environment)
        (directory / "printed").write_text(run.stdout)
        assert (run.returncode, run.stdout) == (0, "done\n"), run.stderr[:2000]

    key = build.key(*command, *(part for item in sorted(files.items()) for part in item))
    assert (build.entry(f"sanitized-{key}", fill) / "printed").read_text() == "done\n"
