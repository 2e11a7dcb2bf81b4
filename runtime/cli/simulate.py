"""The verb that records a model itself: simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.options import EffectsFile, Json, ModelFile, check_writable
from runtime.cli.output import emit
from runtime.workspace import Source

app = typer.Typer()


@app.command(epilog="Example: tendon simulate drive.toml --out run.csv.gz --hide stribeck@1:torque=0.6,speed=0.15")
def simulate(
    model: ModelFile,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Recording to write; compressed if it ends in .gz.")],
    hide: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT@JOINT[:KEY=VALUE,...]", help="An effect that the model file does not have."),
    ] = None,
    motion: Annotated[Path | None, typer.Option(metavar="FILE", help="CSV with t,q1,... to follow.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another motion and other noise.")] = 0,
    seconds: Annotated[float, typer.Option(min=2.0, max=3600.0, help="Length of the motion.")] = 40.0,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="Equal parts that it consists of.")] = 2,
    noise: Annotated[float, typer.Option(min=0.0, max=10.0, help="Torque noise, part of the torque's rms.")] = 0.03,
    signals: Annotated[
        str, typer.Option(metavar="NAME,...", help="Also record these: q_link, tau_link, temperature.")
    ] = "",
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Record the model itself. With a hidden effect if wanted, to try a diagnosis on."""
    from runtime.report.terminal import pages

    check_writable(json, out)
    source = Source.read(model, effects)
    source.arm()
    with pages.working("deriving and compiling the model"):
        loaded = source.model()
    from runtime.recordings import recording
    from runtime.simulation import simulate as simulation

    extra = simulation.parse_extra(signals)
    hidden = [simulation.parse_hidden(text, loaded) for text in hide or ()]
    path = None if motion is None else simulation.read_motion(motion, loaded.n)
    with pages.working("simulating"):
        made, values = simulation.simulate(loaded, hidden, seed, path, seconds, repeats, noise, extra)
    recording.write(out, made)
    secret = {h.term for h in hidden}
    present = [
        {"effect": term.effect, "joint": term.joint, "hidden": term in secret, "values": dict(v)}
        for term, v in values.items()
    ]
    document = {"out": str(out), "samples": len(made.t), "seconds": len(made.t) * made.dt, "seed": seed}
    emit(json, {**document, "effects": present}, pages.simulation)
