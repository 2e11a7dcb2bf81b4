"""Rust computes what C computes, for arms in the plane and in space; the back end is one page."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import spatial_arms
from random_arms import MIXED

from codegen import prepare
from codegen.rust import rust_code
from runtime.cli import main, output
from runtime.model.loader import Library, Model
from runtime.workspace.source import Source
from symbolic.model import derive
from symbolic.model_file.arm import Arm, Drive

RUSTC = shutil.which("rustc")
SAMPLES = 20
DRIVE = Drive(law="position_servo", gains={"kp": 30.0, "kd": 2.0, "saturation": 5.0})


def run(command: list[str], where: Path) -> str:
    done = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]
    return done.stdout


def test_the_back_end_is_one_page() -> None:
    room = Path(rust_code.__file__).parent
    pages = [path.read_text(encoding="utf-8") for path in room.rglob("*") if path.suffix in (".py", ".j2")]
    assert sum(len(text.splitlines()) for text in pages) < 200


@pytest.mark.skipif(RUSTC is None, reason="needs rustc")
@pytest.mark.parametrize("name", ["vishard4", "driven", "spatial"])
def test_the_same_numbers_as_c(vishard4: Arm, name: str, tmp_path: Path) -> None:
    driven = replace(MIXED["rprrp"], joints=tuple(replace(joint, drive=DRIVE) for joint in MIXED["rprrp"].joints))
    arm = {"vishard4": vishard4, "driven": driven, "spatial": spatial_arms.drawn("rpr", 3)}[name]
    arm = replace(arm, name="arm")
    model = Model(prepare.prepare_arm(arm), Library(prepare.prepare_effects(space=arm.space)))
    rng = np.random.default_rng(2)
    lines, expected = [], {}
    for function, about in model.metadata["functions"].items():
        # Contact coordinates within reach, and elsewhere anything.
        size = {"w": 0.3, "elbow": 1.0}
        given = {a: size.get(a, 2.0) * rng.uniform(-1.0, 1.0, (*shape, SAMPLES)) for a, shape in about["inputs"]}
        expected[function] = model.call(function, given, model.lump_values).reshape(-1, SAMPLES).T
        for k in range(SAMPLES):
            texts = [f"&{x[:, k].tolist()}" if x.ndim > 1 else f"{float(x[k])!r}" for x in given.values()]
            lines.append(f'    for x in arm::{function}(&p, {", ".join(texts)}) {{ print!("{{:e}} ", x); }}')
            lines.append("    println!();")
    (tmp_path / "arm.rs").write_text(rust_code.rust_files(derive(arm))["arm.rs"], encoding="utf-8")
    program = "mod arm;\nfn main() {\n    let p = arm::Parameters::default();\n" + "\n".join(lines) + "\n}\n"
    (tmp_path / "main.rs").write_text(program)
    run(["rustc", "--edition", "2021", "-Dwarnings", "-Copt-level=0", "main.rs", "-o", "main"], tmp_path)
    rows = [np.array(row.split(), dtype=float) for row in run(["./main"], tmp_path).splitlines()]
    for i, (function, values) in enumerate(expected.items()):
        found = np.array(rows[i * SAMPLES : (i + 1) * SAMPLES])
        within_reach = np.isfinite(values).all(axis=1)
        assert within_reach.any()
        assert np.array_equal(within_reach, np.isfinite(found).all(axis=1)), function
        # Sines and cosines come from another library and differ in the last place.
        scale = np.abs(values[within_reach]).max(initial=0.0)
        assert np.allclose(found[within_reach], values[within_reach], rtol=1e-12, atol=1e-13 * scale), function
    assert ("drive_torque" in expected) == (name == "driven")


def test_generate_keeps_the_module_up_to_date_once_it_is_there(
    bench: Source, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def generate(*options: str) -> int:
        return output.run(main.app, ["generate", str(bench.path), "--out", str(tmp_path / "made"), *options])

    module = tmp_path / "made" / "bench.rs"
    assert generate() == 0
    assert not module.exists()
    assert generate("--rust") == 0
    text = module.read_text(encoding="utf-8")
    module.write_text(text + "\n", encoding="utf-8")
    capsys.readouterr()
    assert generate("--check") == 1
    assert f"{module}: out of date" in capsys.readouterr().out
    assert generate() == 0
    assert module.read_text(encoding="utf-8") == text
