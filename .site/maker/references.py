"""Pages of reference that are made from the code when the site is built: verbs, library of effects, Python.

`python .site/maker/references.py` writes the table of verbs in runtime/guides/agents.md anew.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from docstrings import as_markdown
from gather import ROOT

from runtime.cli import places
from runtime.cli.verbs import GROUPS, VERBS, command
from runtime.documents.verbs import BY_VERB, table
from runtime.workspace.source import effects_library

KEYS = "../runtime/documents/KEYS.md"
DOCUMENTS = re.findall(r"^## (\w+)$", (ROOT / "reference" / KEYS).resolve().read_text(encoding="utf-8"), re.MULTILINE)
AGENTS = ROOT / "runtime" / "guides" / "agents.md"
GALLERY = "../runtime/guides/gallery.md"


def cell(text: str) -> str:
    """Text of a table's cell: no lines, and no tags of its own."""
    return text.replace("<", "&lt;").replace("\n", " ")


@dataclass(frozen=True)
class VerbPage:
    """What is said of a verb."""

    name: str

    @property
    def made(self) -> Any:
        """Its command."""
        return command(self.name)

    @property
    def example(self) -> str:
        """A command line."""
        return str(self.made.epilog).removeprefix("Example: ")

    @property
    def usage(self) -> str:
        """The line of its usage."""
        return f"tendon {self.name} {' '.join(self.made.collect_usage_pieces(None))}"

    @property
    def written(self) -> list[str]:
        """The options whose files it writes, but for --json, which every verb has."""
        known = places.roles(self.made.callback)
        writes = {name for name, role in known.items() if role.writes} - {"json"}
        return [option for p, (option, _, _) in self._options() if p.name in writes]

    def _options(self) -> list[tuple[Any, tuple[str, str, str]]]:
        """Each option with its row: how it is typed, its default or bounds, its meaning."""
        context = self.made.make_context(self.name, [], resilient_parsing=True)
        records = [(p, p.get_help_record(context)) for p in self.made.params if p.param_type_name == "option"]
        return [(p, _row(*record)) for p, record in records if record is not None]

    def lines(self) -> Iterator[str]:
        """Its section."""
        yield from ("", f"### tendon {self.name}", "", _prose(self.made.help), "")
        yield from ("```text", self.usage, "```", "", "```sh", self.example, "```")
        arguments = [p for p in self.made.params if p.param_type_name == "argument"]
        if arguments:
            yield from table(("argument", "meaning"), [(f"`{p.metavar}`", cell(p.help or "")) for p in arguments])
        rows = [(f"`{option}`", cell(meaning), default) for _, (option, default, meaning) in self._options()]
        head = ("option", "meaning", "default")
        some = any(default for *_, default in rows)
        yield from table(head, rows) if some else table(head[:2], [row[:2] for row in rows])
        if self.name in BY_VERB:
            document = BY_VERB[self.name].__name__
            yield from ("", f"Keys of `--json`: [{document}]({KEYS}#{document.lower()}).")


def _row(option: str, told: str) -> tuple[str, str, str]:
    """Of a line of help: the option, its default and bounds, its meaning."""
    meaning, _, default = told.partition("  [")
    return option, default.removesuffix("]").removeprefix("default: "), meaning


def _prose(text: str) -> str:
    """Help as Markdown."""
    return re.sub(r"[ \n]+", " ", text.replace("<", "&lt;")).strip()


def verbs() -> str:
    """Every verb with its arguments and options."""
    lines = [
        "# Verbs",
        "",
        "What `tendon VERB --help` prints. Every verb but `studio` has `--json FILE`. Exit status: 0 done; 1 the "
        "answer is no; 2 bad input, one line on standard error, nothing written.",
    ]
    for title, names in GROUPS.items():
        lines += ["", f"## {title}"]
        for name in names:
            lines += VerbPage(name).lines()
    return "\n".join(lines) + "\n"


def agent_rows() -> list[tuple[str, str, str]]:
    """Verb, an example, and the options whose files it writes: the table of runtime/guides/agents.md."""
    found = [VerbPage(name) for names in GROUPS.values() for name in names]
    return [(f"`{v.name}`", f"`{v.example}`", ", ".join(f"`{o}`" for o in v.written)) for v in found]


def effects() -> str:
    """Every effect of the library: law, parameters, trace, motion that brings it out, source."""
    families: dict[str, list[Any]] = {}
    for effect in effects_library(None, space=True).values():
        families.setdefault(effect.family, []).append(effect)
    lines = [
        "# Library of effects",
        "",
        "What `tendon effects NAME` prints. All torques stand on the motor's side: τ_m = D q̈ + C q̇ + g + the effects'. "
        "[Effects in a model file, and effects of your own](../symbolic/README.md#the-effects).",
    ]
    seen = _in_gallery()
    for family, members in families.items():
        lines += ["", f"## {family.capitalize()}"]
        for effect in members:
            lines += _effect(effect)
            if effect.name in seen:
                lines.append(f"- Seen in the gallery: [{seen[effect.name]}]({GALLERY}#{_anchor(seen[effect.name])})")
    return "\n".join(lines) + "\n"


def _in_gallery() -> dict[str, str]:
    """Effect -> heading of the section of the gallery that shows it."""
    text = (ROOT / "reference" / GALLERY).resolve().read_text(encoding="utf-8")
    return {name: heading for heading, name in re.findall(r"^## (.+)\n\n!.*/(\w+)\.svg\)$", text, re.MULTILINE)}


def _anchor(heading: str) -> str:
    """Where a link to a heading leads."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def _effect(effect: Any) -> Iterator[str]:
    yield from ("", f"### {effect.name}", "", effect.summary, "", f"Torque: `{effect.equation}`")
    rows = [(f"`{p.name}`", _units(p.unit), p.role, _bounds(p.bounds), cell(p.meaning)) for p in effect.parameters]
    yield from table(("parameter", "unit", "role", "bounds", "meaning"), rows)
    yield from ("", f"- Scope: {effect.scope}", f"- Trace in a residual: {effect.trace}")
    yield from (f"- Motion that brings it out: {effect.experiment}", f"- Source: {effect.source}")


def _units(unit: Any) -> str:
    """The units at a revolute and at a prismatic joint."""
    return " or ".join(dict.fromkeys(unit.text(kind) for kind in ("revolute", "prismatic")))


def _bounds(bounds: tuple[float, float]) -> str:
    return " … ".join(f"{bound:g}".replace("inf", "∞").replace("-", "−") for bound in bounds)


TITLES = {"Arms and recordings": ("load", "recording", "LoadedArm", "Recording")}
"""Heading -> public names that stand there; the others are sorted by what they are."""


def python() -> str:
    """The public names of the package tendon with their docstrings, which mkdocstrings puts in."""
    lines = ["# Python", "", "The public names of the package `tendon`.", "", "```python", _usage(), "```"]
    for title, names in public().items():
        lines += ["", f"## {title}"]
        for name, home in names:
            lines += ["", f"::: {home}", "    options:", f"      heading: tendon.{name}", f"      toc_label: {name}"]
    return "\n".join(lines) + "\n"


def python_as_text() -> str:
    """The same as Markdown alone: signatures and docstrings, for those who read the pages' sources."""
    lines = ["# Python", "", "The public names of the package `tendon`.", "", "```python", _usage(), "```"]
    for title, names in public().items():
        lines += ["", f"## {title}"]
        for name, home in names:
            module, _, own = home.rpartition(".")
            found = getattr(import_module(module), own)
            lines += ["", f"### tendon.{name}", "", *_described(own, found)]
            if inspect.isclass(found):
                members = [(n, m) for n, m in inspect.getmembers(found) if n[0] != "_" and inspect.getdoc(m)]
                for member, value in members:
                    lines += ["", f"#### {member}", "", *_described(member, value)]
    return "\n".join(lines) + "\n"


def _described(name: str, found: Any) -> list[str]:
    """Signature of a function, and the docstring."""
    call = [f"`{name}{inspect.signature(found)}`", ""] if inspect.isfunction(found) else []
    return [*call, as_markdown(inspect.getdoc(found) or "")]


def _usage() -> str:
    """The example in the docstring of the package."""
    text = import_module("tendon").__doc__ or ""
    return "\n".join(line.removeprefix("    ") for line in text.splitlines() if line.startswith("    "))


def public() -> dict[str, list[tuple[str, str]]]:
    """Heading -> public names of the package tendon, each with the place where it is defined."""
    stub = ROOT / "runtime" / "import_name" / "tendon" / "__init__.pyi"
    found = [node for node in ast.parse(stub.read_text(encoding="utf-8")).body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: f"{node.module}.{alias.name}" for node in found for alias in node.names}
    public: dict[str, list[tuple[str, str]]] = {title: [] for title in (*TITLES, "Verbs", "Results", "Errors")}
    for name, home in homes.items():
        listed = next((title for title, names in TITLES.items() if name in names), None)
        kind = "Errors" if home.endswith(("Error", "Infeasible")) else "Results" if name[0].isupper() else "Verbs"
        public[listed or kind].append((name, home))
    public["Verbs"].sort(key=lambda entry: list(VERBS).index(entry[0].split("_")[0]))
    return public


PAGES: Mapping[str, Callable[[], str]] = {
    "reference/effects.md": effects,
    "reference/verbs.md": verbs,
    "reference/python.md": python,
}
"""Page that stands in no file -> what makes it."""
SOURCES = {"reference/python.md": python_as_text}
"""Page whose source is of use to the builder alone -> what makes one for readers."""


def with_table(agents: str) -> str:
    """The page for agents with the table of the verbs as they are."""
    made = "\n".join(table(("verb", "example", "writes"), agent_rows())[1:]) + "\n"
    return re.sub(r"^\| verb \|.*\n(?:\|.*\n)+", lambda _: made, agents, flags=re.MULTILINE)


if __name__ == "__main__":
    AGENTS.write_text(with_table(AGENTS.read_text(encoding="utf-8")), encoding="utf-8")
