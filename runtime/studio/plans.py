"""Plans, their executions and sweeps in a session: what was opened stays in its folder until it is taken away.

    plans/1/    trajectory.json as given or planned, model.toml of its arm, scenario.toml where it was planned here,
                plan.json, joint1.npz ...; once it is executed executed.json, executed1.npz ..., recording.csv.gz
    sweeps/1/   sweep.json

A plan has its arm's model beside it, so that it can be executed whatever else the session works on.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast

from runtime.studio.plan_shown import ExecutedShown, PlanShown, SweepShown
from runtime.studio.session import GivenFile, SessionError, StudioSession
from runtime.studio.settings import MOST_MODEL, MOST_PLANS, MOST_TABLE
from runtime.studio.work import Work, WorkError, WorkState
from runtime.workspace import SCENARIOS
from symbolic.model_file.checks import quote

Shelf = Literal["plans", "sweeps"]
OPENED: Mapping[str, int] = {".json": MOST_MODEL, ".toml": MOST_MODEL, ".csv": MOST_TABLE, ".parquet": MOST_TABLE}
"""Endings of what can be opened, and bytes of such a file."""


def most_bytes(name: str) -> int:
    """Of a file that is to be opened. Raises SessionError for one of another kind."""
    most = OPENED.get(Path(name).suffix.lower())
    if most is None:
        raise SessionError(
            f"{quote(name)}: expected a trajectory (.json of tendon optimize --out), a scenario (.toml) or the table "
            "of a sweep (.csv, .parquet)"
        )
    return most


class PlanShelf:
    """The plans and sweeps of a session, by number from 1."""

    def __init__(self, session: StudioSession, work: Work) -> None:
        self._session, self._work = session, work
        self._opening: tuple[GivenFile, ...] = ()
        self.newest: tuple[Shelf, int] | None = None
        """What was opened last."""

    # --- what is there; raises SessionError where the folder is not as it was written ---

    def numbers(self, shelf: Shelf) -> list[int]:
        """Of what is open, in order."""
        home = self._session.folder / shelf
        return sorted(int(p.name) for p in home.iterdir() if p.name.isdecimal()) if home.is_dir() else []

    def folder(self, shelf: Shelf, number: int) -> Path:
        """Where something lies."""
        return self._session.folder / shelf / str(int(number))

    def home(self, number: int) -> Path:
        """Where a plan lies."""
        return self.folder("plans", number)

    def plan(self, number: int) -> PlanShown:
        """A plan."""
        return cast(PlanShown, self._document("plans", number, "plan.json"))

    def sweep(self, number: int) -> SweepShown:
        """A sweep."""
        return cast(SweepShown, self._document("sweeps", number, "sweep.json"))

    def executed(self, number: int) -> ExecutedShown | None:
        """What a plan's execution came to; None before it."""
        return cast(ExecutedShown | None, self._session.document(self.home(number) / "executed.json"))

    def plans_of(self, sweep: int) -> dict[int, int]:
        """The plans of a sweep's points, by point from 0."""
        found = {number: self.plan(number)["swept"] for number in self.numbers("plans")}
        return {swept["point"]: n for n, swept in found.items() if swept is not None and swept["sweep"] == sweep}

    def scenarios(self) -> dict[str, str]:
        """Of what a sweep may have been: those of the toolkit by name, then those planned here, as `plan_point` takes
        them, and what they are called."""
        own = {str(n): self.plan(n)["name"] for n in self.numbers("plans") if self._has_scenario(n)}
        return {path.stem: path.stem for path in sorted(SCENARIOS.glob("*.toml"))} | own

    def file(self, number: int, name: Literal["trajectory.json", "recording.csv.gz"]) -> Path | None:
        """A file of a plan, to be downloaded; None where it is not there."""
        path = self.home(number) / name
        return path if path.is_file() else None

    # --- work; raises WorkError while other work is under way ---

    def open(self, given: Sequence[GivenFile]) -> None:
        """Open files in `given/`, which then leave it. Raises SessionError."""
        try:
            self._open(given)
        except (SessionError, WorkError):
            self._away(given)
            raise

    def plan_point(self, sweep: int, point: int, scenario: str) -> None:
        """Plan a sweep's point, as the sweep has: a scenario of `scenarios`."""
        told = {"sweep": sweep, "point": point, "scenario": scenario}
        self._work.begin("plan_point", "planning a point of the sweep", told)

    def execute(self, number: int) -> None:
        """Execute a plan on the simulated arm."""
        self._work.begin(
            "execute_plan", f"executing {self.plan(number)['name']} on the simulated arm", {"plan": number}
        )

    def take_away(self, shelf: Shelf, number: int) -> None:
        """Do without a plan or a sweep. Raises SessionError while something is worked on."""
        if self._work.busy:
            raise SessionError("something is being worked on; wait for it, or cancel it")
        shutil.rmtree(self.folder(shelf, number), ignore_errors=True)

    def finished(self, work: WorkState) -> None:
        """Take what a process found into the session."""
        if work.task == "open_plans":
            self._away(self._opening)
            self._opening = ()
        if work.state != "done" or work.result is None:
            return
        for entry in work.result.get("opened", ()):
            self._take(entry["shelf"], self._session.scratch / entry["made"])
        if "executed" in work.result:
            home = self.home(work.result["executed"])
            for path in (self._session.scratch / "executed").iterdir():
                path.replace(home / path.name)

    # --- behind it ---

    def _open(self, given: Sequence[GivenFile]) -> None:
        shelves: tuple[Shelf, Shelf] = ("plans", "sweeps")
        for shelf in shelves:
            if len(self.numbers(shelf)) + len(given) > MOST_PLANS:
                raise SessionError(f"a session has at most {MOST_PLANS} {shelf}; take some away")
        names = ", ".join(file.name for file in given)
        told = [{"file": file.file, "name": file.name} for file in given]
        self._opening = tuple(given)
        self._work.begin("open_plans", f"opening {names}", {"files": told})

    def _away(self, given: Sequence[GivenFile]) -> None:
        for file in given:
            self._session.given(file).unlink(missing_ok=True)

    def _take(self, shelf: Shelf, made: Path) -> None:
        number = max([*self.numbers(shelf), *self._named(shelf)], default=0) + 1
        target = self.folder(shelf, number)
        target.parent.mkdir(exist_ok=True)
        made.rename(target)
        self.newest = (shelf, number)

    def _named(self, shelf: Shelf) -> list[int]:
        """Of sweeps, those that plans name, whether they are still there or not."""
        swept = [self.plan(number)["swept"] for number in self.numbers("plans")] if shelf == "sweeps" else []
        return [one["sweep"] for one in swept if one is not None]

    def _has_scenario(self, number: int) -> bool:
        return (self.home(number) / "scenario.toml").is_file()

    def _document(self, shelf: Shelf, number: int, name: str) -> Any:
        path = self.folder(shelf, number) / name
        document = self._session.document(path)
        if document is None:
            raise SessionError(f"{path}: is missing")
        return document
