"""Plans: open one, see its motion, springs, costs and limits, and its execution in simulation beside it."""

from __future__ import annotations

from functools import partial

from nicegui.events import GenericEventArguments

from runtime.studio.page import arm
from runtime.studio.page.parts import PageSection, button, folded, put
from runtime.studio.page.sweeps import SweepPart
from runtime.studio.page.view import PageView
from runtime.studio.plan_shown import ExecutedShown, PlanShown
from runtime.studio.shown import Row
from runtime.wording import sentence

SIMULATION = (
    "Trials on the simulated arm, driven by the controller of its firmware, with noise of its sensors; planned and "
    "executed are then shown beside each other."
)
SAME = 1e-3
"""Of a cost: two plans that differ by less are the same one, as far as a solver tells on another machine."""


def sections(view: PageView) -> list[PageSection]:
    """What is open, then the sweep, the plan and the joint that are looked at."""
    part = PlanPart(view)
    return [
        PageSection("section", "plans", part.key_of_all, part.all),
        PageSection("section", "sweep", part.sweep.key, part.sweep.draw),
        PageSection("section", "sweep-point", part.sweep.key_of_point, part.sweep.point),
        PageSection("section", "plan", part.key, part.draw),
        PageSection("section", "plan-joint", part.key_of_joint, part.joint),
    ]


class PlanPart:
    """The plans of a session as one tab sees them."""

    def __init__(self, view: PageView) -> None:
        self._view, self._shelf = view, view.studio.plans
        self._chosen: int | None = None
        self._joint: int | None = None
        self._seen = self._shelf.newest
        self.sweep = SweepPart(view, self._look_at)

    @property
    def chosen(self) -> int | None:
        """The plan that is looked at: what was opened last, until another one is chosen."""
        if self._shelf.newest != self._seen:
            self._seen = self._shelf.newest
            if self._seen is not None and self._seen[0] == "plans":
                self._chosen = self._seen[1]
        known = self._shelf.numbers("plans")
        if self._chosen not in known:
            self._chosen = known[0] if known else None
        return self._chosen

    def _look_at(self, plan: int) -> None:
        self._chosen = plan
        self._view.changed()

    def _press(self, joint: int) -> None:
        self._joint = joint
        self._view.changed()

    def _shown_joint(self, plan: PlanShown) -> int:
        return self._joint if self._joint in plan["joints"] else plan["joints"][0]

    # --- all that is open ---

    def key_of_all(self) -> object:
        """What the list shows."""
        shelf = self._shelf
        return self._view.busy, self.chosen, self.sweep.chosen, tuple(shelf.numbers("plans")), shelf.numbers("sweeps")

    def all(self) -> None:
        """The plans and sweeps that are open, and how to open one."""
        shelf = self._shelf
        put("h2", "Plans and sweeps")
        put(
            "file-drop",
            as_="plan",
            label="Drop a plan (JSON of tendon optimize --out), a scenario to plan (TOML) or the table of a sweep "
            "(CSV, Parquet)",
        )
        entries = [("plans", n, shelf.plan(n)["name"], self.chosen, self._look_at) for n in shelf.numbers("plans")]
        sweeps = [
            ("sweeps", n, shelf.sweep(n)["name"], self.sweep.chosen, self.sweep.look_at)
            for n in shelf.numbers("sweeps")
        ]
        with put("ul", classes="steps"):
            for kind, number, name, chosen, look in [*entries, *sweeps]:
                with put("li"):
                    here = "true" if number == chosen else None
                    mark = {"data_do": f"open-{kind}-{number}", "aria_current": here}
                    with button("", partial(look, number), "step", **mark):
                        put("span", "plan" if kind == "plans" else "sweep", "step-number")
                        put("span", name, "step-title")

    # --- a plan, and what became of it ---

    def key(self) -> object:
        """What the plan's part shows; None: there is none."""
        if self.chosen is None:
            return None
        return self.chosen, self._view.busy, repr(self._shelf.executed(self.chosen))

    def draw(self) -> None:
        """The plan, and its execution beside it."""
        number = self.chosen
        assert number is not None
        plan, executed = self._shelf.plan(number), self._shelf.executed(number)
        put("h2", f"Plan: {plan['name']}")
        with put("div", classes="beside plan-beside"):
            with put("div", data_plan=""):
                with put("div"):
                    put("h3", "Planned")
                    _planned(plan)
                self._arm(plan["arm"])
                phases = [{"name": f"phase {k}", "value": text} for k, text in enumerate(plan["phases"], 1)]
                _facts([*plan["facts"], *phases])
            with put("div", data_executed=""):
                with put("div"):
                    put("h3", "Executed in simulation")
                    self._run(number, executed)
                if executed is not None and executed["arm"] is not None:
                    self._arm(executed["arm"])
                    _facts(executed["facts"])
        _table("What the plan asks of every joint", plan["table"])
        if executed is not None:
            _table("What was executed", executed["table"])
        self._taken(number, plan)

    def _taken(self, number: int, plan: PlanShown) -> None:
        """What can be done with a plan elsewhere."""
        with put("div", classes="acts"):
            put("a", "Download the trajectory", "download", href=f"/download/trajectory?step={number}", download="")
            if self._shelf.file(number, "recording.csv.gz") is not None:
                href = f"/download/executed?step={number}"
                put("a", "Download the simulated recording", "download", href=href, download="")
            away = partial(self._view.act, partial(self._shelf.take_away, "plans", number))
            button("Take the plan away", away, disabled=self._view.busy, data_do="plan-away")
        with folded("In a terminal"):
            put("pre", plan["command"], data_plan_command="")

    def _run(self, number: int, executed: ExecutedShown | None) -> None:
        """The button, and what came of it."""
        if executed is not None:
            _came_of(executed)
        else:
            put("p", SIMULATION, "of")
        text, classes = ("Execute it in simulation", "first") if executed is None else ("Execute it again", "")
        run = partial(self._view.act, partial(self._shelf.execute, number))
        with put("div", classes="acts"):
            button(text, run, classes, disabled=self._view.busy, data_do="execute")

    def _arm(self, picture: Row) -> None:
        def pressed(event: GenericEventArguments) -> None:
            self._press(int(event.args["detail"]) + 1)

        arm.moving(picture).on("joint", pressed, ["detail"])

    # --- one joint of both ---

    def key_of_joint(self) -> object:
        """What the joint's part shows; None: there is no plan."""
        number = self.chosen
        if number is None:
            return None
        return number, self._joint, repr(self._shelf.executed(number))

    def joint(self) -> None:
        """A joint's signals, as planned and as executed."""
        number = self.chosen
        assert number is not None
        plan, executed = self._shelf.plan(number), self._shelf.executed(number)
        joint = self._shown_joint(plan)
        put("h3", f"Joint {plan['called'][joint - 1]}")
        with put("div", classes="acts", role="group", aria_label="Joint that is looked at"):
            for k in plan["joints"]:
                name, pressed = f"Joint {plan['called'][k - 1]}", "true" if k == joint else "false"
                button(name, partial(self._press, k), aria_pressed=pressed, data_do=f"plan-joint-{k}")
        both = executed is not None and executed["arm"] is not None
        with put("div", classes="beside" if both else ""):
            with put("div"):
                put("tendon-signals", src=f"/data/plan{number}-joint{joint}")
            if both:
                with put("div"):
                    mark = str(hash(repr(executed)))
                    put("tendon-signals", src=f"/data/plan{number}-executed{joint}", data_mark=mark)


def _planned(plan: PlanShown) -> None:
    """What a plan came to, in words."""
    put("p", f"{plan['headline']}.", role="status")
    for line in plan["springs"]:
        put("p", line)
    if plan["swept"] is not None:
        _compared(plan["swept"]["cost"], plan["swept"]["swept_cost"])
    for note in plan["notes"]:
        put("p", sentence(note), "warning")


def _came_of(executed: ExecutedShown) -> None:
    """What an execution came to, in words."""
    with put("p", role="status"):
        put("span", executed["tag"], f"tag {executed['kind']}")
        put("span", f" {executed['headline']}.")
    if executed["reason"]:
        put("p", sentence(executed["reason"]), "warning", role="alert")
    for note in executed["notes"]:
        put("p", note, "of")


def _compared(cost: float, swept: float) -> None:
    """Whether a point that is planned again is what the sweep found."""
    near = abs(cost - swept) <= SAME * abs(swept)
    text = (
        "It costs what the sweep found."
        if near
        else (f"It costs {cost:.4g}, and the sweep found {swept:.4g}: another scenario, model or number of starts.")
    )
    put("p", text, "of" if near else "warning")


def _facts(facts: list[Row]) -> None:
    with put("dl", classes="facts"):
        for fact in facts:
            with put("div"):
                put("dt", fact["name"])
                put("dd", fact["value"])


def _table(title: str, table: Row) -> None:
    """As the report has it: on a narrow screen a row is a card."""
    heads = table["heads"]
    if not table["rows"]:
        return
    put("h3", title)
    with put("div", classes="scroll"), put("table", classes="stack"):
        with put("thead"), put("tr"):
            for head in heads:
                put("th", head, scope="col")
        with put("tbody"):
            for first, *cells in table["rows"]:
                with put("tr"):
                    put("th", first, scope="row", data_is=heads[0])
                    for head, cell in zip(heads[1:], cells, strict=True):
                        put("td", cell, "n", data_is=head)
