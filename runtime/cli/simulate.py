"""The verb that simulates a recording: simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli import completion
from runtime.cli.inputs import check_hidden, made_from, opened
from runtime.cli.options import EffectsFile, Json, ModelFile, with_settings
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.documents.recordings import AssumedNumber, SimulatedDrive, SimulatedEffect, SimulateDocument
from runtime.simulation.options import SimulationSettings

app = typer.Typer()


@app.command(epilog="Example: tendon simulate drive.toml --out run.csv.gz --hide stribeck@1:torque=0.6,speed=0.15")
@with_settings
def simulate(
    model: ModelFile,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Recording to write; compressed if the name ends in .gz."), WRITTEN
    ],
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT@JOINT[:KEY=VALUE,...]",
            help="Simulate an effect that the model file lacks.",
            autocompletion=completion.effects_at_joints,
        ),
    ] = None,
    motion: Annotated[Path | None, typer.Option(metavar="FILE", help="Motion to follow, CSV: t,q1,..."), READ] = None,
    settings: SimulationSettings = SimulationSettings(),
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """With effects that the model file lacks, to try a diagnosis."""
    from runtime.report import recordings, terminal

    source = opened(model, effects)
    check_hidden(source, "--hide", hide or ())
    provenance = made_from("simulate", model, source, further=[motion] if motion else [], effects=effects)
    with terminal.working("deriving and compiling the model"):
        arm, assumed = source.compiled.with_likely_numbers()
        loaded = arm.model()
    from runtime.model.terms import structure
    from runtime.recordings import recording
    from runtime.simulation import simulate as simulation
    from runtime.simulation.commands import commanded
    from runtime.simulation.motion_file import read_motion

    hidden = [simulation.parse_hidden(text, loaded) for text in hide or ()]
    path = None if motion is None else read_motion(motion, loaded.n)
    with terminal.working("simulating"):
        made, values = simulation.simulate(loaded, hidden, settings, path, source.arm().torque)
    made = commanded(made, loaded.joints)
    recording.write(out, made)
    known = structure(loaded)
    present = [
        SimulatedEffect(
            effect=term.effect,
            joint=term.joint,
            hidden=term not in known,
            values=dict(v),
            assumed=[name for name in v if name not in known.get(term, v)],
        )
        for term, v in values.items()
    ]
    samples = len(made.t)
    document = SimulateDocument(
        out=str(out),
        samples=samples,
        seconds=samples * made.dt,
        seed=settings.seed,
        effects=present,
        drives=[
            SimulatedDrive(joint=i, law=d.law.name, command=d.law.command) for i, d in enumerate(made.driven, 1) if d
        ],
        assumed=[AssumedNumber(**vars(number)) for number in assumed],
        provenance=provenance,
    )
    emit(json, document, terminal.printer(recordings.simulation))
