"""The verbs by group: what each does, and the module that declares it.

A module is imported when its verb is called: `tendon --help` needs none of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from runtime.cli import places


class Verb(NamedTuple):
    """A module of this room, and the sentence with which the help of the verb begins."""

    module: str
    summary: str


GROUPS: Mapping[str, Mapping[str, Verb]] = {
    "Model": {
        "init": Verb("init", "Make a model file for your own arm."),
        "import": Verb("exchange", "Make a model file from a URDF or MJCF."),
        "export": Verb("exchange", "Write an arm as URDF or MJCF, or a motion for other programs."),
        "effects": Verb("effects", "List the physical effects of the library."),
        "add": Verb("generate", "Add an effect to the model file and generate its code again."),
        "generate": Verb("generate", "Derive the equations and generate C and CasADi code."),
        "verify": Verb("generate", "Compare the generated code of an arm with SymPy."),
    },
    "Data and diagnosis": {
        "inspect": Verb("inspect_recording", "Show what is in a recording and what looks wrong with it."),
        "identify": Verb("identify", "Fit base inertial parameters and effects to recordings."),
        "compare": Verb("identify", "Show where the model fails."),
        "diagnose": Verb("diagnose", "Find the physical effects that the model lacks."),
        "improve": Verb("improve", "Add missing effects until none improves the model."),
        "replay": Verb("replay", "Let recorded torques drive the model and compare the motions."),
        "studio": Verb("studio", "Work on a model in the browser."),
        "simulate": Verb("simulate", "Simulate a recording of an arm."),
        "demo": Verb("improve", "Improve the model of a simulated drive with a hidden effect."),
    },
    "Motion": {
        "experiment": Verb("experiment", "Design a motion that separates rival effects."),
        "optimize": Verb("optimize", "Plan motion and springs together."),
        "sweep": Verb("sweep", "Optimize all combinations of the values of --over."),
    },
    "Controller": {
        "firmware": Verb("firmware", "Generate the firmware of the controller and compile it."),
        "execute": Verb("execute", "Execute a planned motion on a simulated or real arm."),
    },
    "More": {
        "report": Verb("report", "Make a report again from the JSON of a result."),
        "schema": Verb("schema", "Print the JSON schema of what --json writes."),
        "paper": Verb("paper", "Reproduce the tables and figures of the paper."),
    },
}
VERBS = {name: verb for group in GROUPS.values() for name, verb in group.items()}


@cache
def command(name: str) -> Any:
    """The command of a verb, which checks its files first (runtime/cli/places.py)."""
    verb = VERBS[name]
    made = _commands(verb.module)[name]
    made.help = " ".join(filter(None, (verb.summary, made.help)))
    return made


@cache
def _commands(module: str) -> Mapping[str, Any]:
    declared: typer.Typer = import_module(f"{__package__}.{module}").app
    declared.rich_markup_mode = None
    for one in declared.registered_commands:
        one.cls = VerbCommand
        if one.callback is not None:
            one.callback = places.guarded(one.callback)
    return typer.main.get_group(declared).commands


class VerbCommand(TyperCommand):
    """A verb."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """What follows the verb in the line of its usage: the names of its arguments say what may be left out."""
        return ["[OPTIONS]", *(str(p.metavar) for p in self.params if p.param_type_name == "argument")]


class Verbs(TyperGroup):
    """The verbs as commands, imported when they are called and listed by group."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """The names of the verbs."""
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """The command of a verb; None if there is no such verb."""
        return command(cmd_name) if cmd_name in VERBS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the verbs of each group with what they do."""
        widest = max(map(len, VERBS))
        for title, verbs in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(widest), verb.summary) for name, verb in verbs.items()])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is called. Its error names the nearest verb."""
        near = get_close_matches(args[0], VERBS, 1)
        if args[0] not in VERBS and near and not args[0].startswith("-"):
            ctx.fail(f"there is no verb {args[0]!r}; did you mean {near[0]}?")
        return super().resolve_command(ctx, args)
