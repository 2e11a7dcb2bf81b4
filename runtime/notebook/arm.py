"""An arm and its recordings, as a notebook holds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from runtime import files
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.notebook.dynamics import ArmFunctions
from runtime.recordings import in_memory
from runtime.recordings.recording import Recording, checked, read
from runtime.workspace.source import Source

PathOrText = str | PathLike[str]
Recorded = Recording | PathOrText
"""A recording, or the file in which one stands."""


@dataclass(frozen=True)
class LoadedArm(ArmFunctions):
    """A model file, its equations derived and compiled; `text` is what would be written.

    source   the file as read, and the library of effects
    told     what was said of it when it was made
    """

    source: Source
    told: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The model file, with everything that was added or identified here."""
        return self.source.text

    @cached_property
    def model(self) -> Model:
        """The generated functions on NumPy arrays, samples last: `arm.model.inverse_dynamics(q, qd, qdd)`."""
        return self.source.compiled.model()

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know of the file beside errors, a line each."""
        return (*self.told, *self.source.arm().notes)

    def with_text(self, text: str) -> LoadedArm:
        """The same arm with another model file's text; nothing is written."""
        return LoadedArm(self.source.with_text(text))

    def with_rotors(self, inertia: float | Sequence[float]) -> LoadedArm:
        """The arm with these rotor inertias at the joints' output, kg m² or kg: one for all joints, or (n,).

        A URDF states none; 0 leaves them out, as simulators do. Raises ModelError.
        """
        values = np.broadcast_to(np.asarray(inertia, dtype=np.float64), (self.n,))
        return self.with_text(self.source.edits.set_values({}, rotors=dict(enumerate(values.tolist(), 1))).text)

    def recordings(
        self, given: Recorded | Sequence[Recorded], columns: Mapping[str, str] | None = None, allow_gaps: bool = False
    ) -> list[Recording]:
        """One or several recordings or files, read and checked against this arm."""
        one = isinstance(given, Recording | str | PathLike)
        entries: list[Recorded] = [given] if one else list(given)  # type: ignore[arg-type,list-item]
        return [
            entry if isinstance(entry, Recording) else self.source.recordings([Path(entry)], columns, allow_gaps)[0]
            for entry in entries
        ]

    def save(self, path: PathOrText) -> None:
        """Write the model file. Raises OSError."""
        files.replace(Path(path), self.text.encode())

    def __repr__(self) -> str:
        model = self.model
        effects = ", ".join(map(str, structure(model))) or "no effects"
        kinds = ", ".join(joint.type for joint in model.joints)
        return f"{model.name}: {model.n} joint{'s' if model.n > 1 else ''} ({kinds})\n{effects}"

    def _repr_html_(self) -> str:
        from runtime.notebook import html
        from runtime.report import models

        return html.shown(repr(self).splitlines(), models.arm(self.model, self.text))


def load(model: PathOrText, effects: PathOrText | None = None) -> LoadedArm:
    """The arm of a model file, or by its name one that ships with Tendon: "drive", "vishard4", "emps", "ur10", "panda".

    effects   a Python file with effects of your own (`--effects`); it is run, so trust it
    Derived and compiled when it is first needed; later calls find it in the cache. Raises ValueError, OSError.
    """
    own = None if effects is None else Path(effects)
    return LoadedArm(Source.read(Path(model), own))


def recording(
    source: PathOrText | Mapping[str, ArrayLike] | Any = None,
    arm: LoadedArm | PathOrText | None = None,
    columns: Mapping[str, str] | None = None,
    allow_gaps: bool = False,
    *,
    t: ArrayLike | None = None,
    q: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    qd: ArrayLike | None = None,
    q_desired: ArrayLike | None = None,
    q_link: ArrayLike | None = None,
    tau_link: ArrayLike | None = None,
    tau_rigid: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    force: ArrayLike | None = None,
    run: ArrayLike | None = None,
    units: Mapping[str, str] | None = None,
    name: str = "recording",
) -> Recording:
    """A recording in SI, checked: from a file, from a data frame, or from arrays, `recording(t=t, q=q, tau=tau)`.

    source      a file (runtime/README.md lists the formats), a data frame of pandas or polars, or a dict of columns
    arm         whose joints' types and torque constants the units follow; None: revolute joints
    columns     signal -> column, for other names: {"q1": "Position1 [deg]", "tau": "current [mA]"} (`--map`)
    allow_gaps  split at gaps and drop samples with a NaN, instead of refusing them
    t, run      (N,)        q … temperature   (N, n), a row for each sample      force   (N, 2) or (N, 6)
    units       signal -> unit, for arrays that are not in SI: {"q": "deg", "tau": "mA"}
    name        of arrays and data frames in messages and reports
    A data frame without a column t may have the time as its index. Raises ValueError with the place and the signal.
    """
    arrays = {
        "t": t,
        "q": q,
        "tau": tau,
        "qd": qd,
        "q_desired": q_desired,
        "q_link": q_link,
        "tau_link": tau_link,
        "tau_rigid": tau_rigid,
        "temperature": temperature,
        "force": force,
        "run": run,
    }
    given = {signal: values for signal, values in arrays.items() if values is not None}
    whose = arm if isinstance(arm, LoadedArm) or arm is None else load(arm)
    joints = None if whose is None else whose.source.recorded_arm()
    refuse = in_memory.RefusedArrays(name)
    if source is None and given:
        contents = in_memory.of_arrays(given, units or {}, refuse)
    elif given or units:
        refuse(f"has both a source and {', '.join(given) or 'units'}; expected one of them")
    elif isinstance(source, str | PathLike):
        path = Path(source)
        return (
            read(path, None, columns, allow_gaps) if whose is None else whose.recordings(path, columns, allow_gaps)[0]
        )
    else:
        contents = in_memory.of_frame(source, columns or {}, refuse)
    return checked(contents, Path(name), joints, columns, allow_gaps=allow_gaps, refuse=refuse)
