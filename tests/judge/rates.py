"""Rates out of the judge's table, with 95 % intervals (Clopper & Pearson 1934) and what is wanted of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from .coverage import FAMILIES, Covered, from_text
from .drives import FORMS
from .line import Line
from .others import MEMORY

LARGE, SMALL, BELOW = 0.45, 0.27, 0.15
"""Sizes in units of the noise floor."""
FIRST = {1: 0.97, 2: 0.95, 4: 0.95}
EXACT = 0.90
"""What is asked of one effect of a large size, by the number of joints: its name first, and no other name."""
TRANSMISSION = ("elasticity", "backlash")
ERROR = {"static": 1.1, "transmission": 1.5}
_REMAINS = 1.15
COVERAGE = (0.90, 0.98)
"""The share of 95 % intervals that hold the true value, at least and at most."""


@dataclass(frozen=True)
class Rate:
    """How often something was so. wanted: the share that is asked for, if one is."""

    name: str
    hits: int
    total: int
    wanted: float | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """95 %, exact for a binomial count."""
        low = stats.beta.ppf(0.025, self.hits, self.total - self.hits + 1) if self.hits else 0.0
        high = stats.beta.ppf(0.975, self.hits + 1, self.total - self.hits) if self.hits < self.total else 1.0
        return float(low), float(high)


def _rate(name: str, lines: Iterable[Line], hit: Callable[[Line], bool], wanted: float | None = None) -> Rate:
    counted = [hit(x) for x in lines]
    return Rate(name, sum(counted), len(counted), wanted)


def band(x: Line) -> str:
    """Which of the three sizes a row's is; "" for one in between."""
    size = min(x.sizes, default=0.0)
    if size >= LARGE:
        return "large"
    if size >= SMALL:
        return "small"
    return "below" if size < BELOW else ""


def rates(lines: Sequence[Line]) -> list[Rate]:
    """All rates for which there are rows."""
    done = [x for x in lines if x.outcome != "failed"]
    found = [*_single(done), *_silent(done), *_inside(done), *_forms(done), *_pairs(done), *_errors(done)]
    found.append(_rate("the judge itself failed", lines, lambda x: x.outcome == "failed", None))
    return [r for r in found if r.total]


def _single(lines: Sequence[Line]) -> Iterator[Rate]:
    single = [x for x in lines if x.kind == "single"]
    for size, text in (("large", f">= {LARGE}"), ("small", f"{SMALL} to {LARGE}")):
        rows = [x for x in single if band(x) == size]
        for n in sorted({x.joints for x in rows}):
            of_n, wanted = [x for x in rows if x.joints == n], FIRST.get(n) if size == "large" else 0.90
            yield _rate(f"one effect of size {text}, {n}R: named first", of_n, lambda x: x.outcome == "right", wanted)
            if size == "large":
                yield _rate(f"one effect of size {text}, {n}R: exactly", of_n, lambda x: x.exact, EXACT)
        yield _rate(f"one effect of size {text}: named first, or its rival is", rows, _right_or_rival)
        yield _rate(f"one effect of size {text}: among findings and rivals", rows, lambda x: x.among, 0.99)
    lines = [x for x in single if x.lines and band(x) == "large"]
    yield _rate("a ripple's lines: all found", lines, lambda x: len(set(x.lines.split("/"))) == 1)
    small = [x for x in single if band(x) == "below"]
    yield _rate("one effect of size < 0.15: nothing named", small, lambda x: not x.named, 1.0)


def _right_or_rival(x: Line) -> bool:
    return x.outcome in ("right", "rival")


def _silent(lines: Sequence[Line]) -> Iterator[Rate]:
    clean = [x for x in lines if x.kind == "clean"]
    yield _rate("nothing hidden: nothing named", clean, lambda x: not x.named, 0.99)
    yield _rate("nothing hidden: the right verdict", clean, lambda x: x.outcome == "right", 0.99)
    limits = [x for x in lines if x.kind == "limits" and x.outcome != "no limit"]
    yield _rate("half as large again as its detection limit: not clean", limits, lambda x: x.verdict != "clean")
    yield _rate("  ... and among findings and rivals", limits, lambda x: x.among)
    unknown = [x for x in lines if x.kind == "unknown"]
    outside = [x for x in unknown if x.case.startswith("outside")]
    yield _rate("a disturbance from outside: unexplained", outside, lambda x: x.outcome == "right", 0.95)
    physics = [x for x in unknown if x not in outside]
    yield _rate("physics that the library lacks: unexplained", physics, lambda x: x.outcome == "right", 0.95)
    yield _rate("  ... or explained to the floor by another effect", physics, lambda x: x.outcome in ("right", "mimic"))


def _inside(lines: Sequence[Line]) -> Iterator[Rate]:
    inside = [x for x in lines if x.kind == "inside"]
    yield _rate("inside the model's span: nothing named", inside, lambda x: not x.named, 0.99)
    yield _rate("inside the model's span: all parameters as the truth", inside, lambda x: x.outcome == "right", 0.95)
    yield Rate(
        "  true parameters in their 95 % intervals", sum(x.inside for x in inside), sum(x.of for x in inside), 0.95
    )


def _forms(lines: Sequence[Line]) -> Iterator[Rate]:
    forms = [x for x in lines if x.kind == "forms"]
    yield _rate("another form: the class named first", forms, lambda x: x.outcome == "right", 0.85)
    yield _rate("another form: one name, right or a rival", forms, lambda x: _right_or_rival(x) and not x.extra)
    left = [x for x in forms if x.outcome == "right" and x.after > _REMAINS * x.floor]
    yield _rate("  ... and the remainder said where one is left", left, lambda x: x.remainder)
    slip = [x for x in forms if x.case == "lugre_maxwell"]
    yield _rate("lugre as Maxwell slip: named, or a rival of what is", slip, lambda x: x.among, 0.95)
    alike = [x for x in lines if x.kind == "single" and x.outcome == "right"]
    yield _rate("the library's own form: never said to be another", alike, lambda x: not x.other_form, 1.0)
    yield _rate("the library's own form: no remainder claimed", alike, lambda x: not x.remainder)


def _pairs(lines: Sequence[Line]) -> Iterator[Rate]:
    pairs = [x for x in lines if x.kind == "pairs"]
    yield _rate("two effects: both found", pairs, lambda x: x.outcome == "right", 0.90)
    yield _rate("  ... or their rivals", pairs, _right_or_rival)
    yield _rate("two effects: both and no third", pairs, lambda x: x.outcome == "right" and not x.extra, 0.85)


def _errors(lines: Sequence[Line]) -> Iterator[Rate]:
    """Error over floor on the recording that was not fitted, where an effect was named."""
    named = [x for x in lines if x.kind == "single" and x.named and band(x) in ("large", "small")]
    moving = [x for x in named if x.case in TRANSMISSION]
    static = [x for x in named if x.case not in TRANSMISSION]
    for what, rows in (("static", static), ("transmission", moving)):
        most = ERROR[what]
        yield _rate(f"{what}: held-out error within {most} of the floor", rows, _within(most), 1.0)
    clean = [x for x in lines if x.case == "clean" and not x.named]
    yield _rate("nothing hidden: held-out error within 1.1 of the floor", clean, lambda x: x.ratio <= ERROR["static"])


def _within(most: float) -> Callable[[Line], bool]:
    return lambda x: x.ratio <= most


def rates_table(lines: Sequence[Line]) -> list[str]:
    """The rates as text."""
    found = rates(lines)
    width = max(len(r.name) for r in found)
    out = [f"{'rate':{width}s}   hits    of    share   95 % interval    wanted"]
    for r in found:
        low, high = r.interval
        wanted = "" if r.wanted is None else f"{100 * r.wanted:5.0f} %"
        mark = " " if r.wanted is None else "!" if high < r.wanted else "?" if r.hits < r.wanted * r.total else " "
        out.append(
            f"{r.name:{width}s}  {r.hits:5d} {r.total:5d}  {100 * r.hits / r.total:5.1f} %  "
            f"{100 * low:5.1f} to {100 * high:5.1f}  {wanted:>8s} {mark}"
        )
    out.append("? below what is wanted, as far as this many cases can tell; ! surely below it")
    return out


def coverage_table(lines: Sequence[Line]) -> list[str]:
    """How many reported 95 % intervals hold the true value, by family and by parameter; empty without any."""
    found = [c for x in lines for c in from_text(x.covered)]
    groups: dict[str, list[Covered]] = {}
    for family in FAMILIES:
        of_family = [c for c in found if c.family == family]
        groups[family] = of_family
        for name in sorted({c.parameter for c in of_family}):
            groups[f"  {name}"] = [c for c in of_family if c.parameter == name]
    out = [f"{'parameter':40s}  hold    of    share   95 % interval    median half-width / error"]
    for name, group in groups.items():
        if not group:
            continue
        r = Rate(name, sum(c.holds for c in group), len(group))
        low, high = r.interval
        aside = "" if name.startswith(" ") or (low <= COVERAGE[1] and high >= COVERAGE[0]) else "  !"
        ratio = np.median([0.5 * (c.high - c.low) / max(abs(c.true - 0.5 * (c.low + c.high)), 1e-12) for c in group])
        out.append(
            f"{name:40s} {r.hits:5d} {r.total:5d}  {100 * r.hits / r.total:5.1f} %  "
            f"{100 * low:5.1f} to {100 * high:5.1f}    {ratio:5.2f}{aside}"
        )
    out.append(f"wanted in each family: {100 * COVERAGE[0]:.0f} to {100 * COVERAGE[1]:.0f} %; ! surely not so")
    return out if len(out) > 2 else []


def errors_table(lines: Sequence[Line]) -> list[str]:
    """Median and 95 % quantile of error over floor on the recordings that were not fitted, and the seconds taken."""
    out = [f"{'':28s}    n   held-out error / floor    CPU s a recording"]
    groups = {
        "nothing hidden nor named": [x for x in lines if x.case == "clean" and not x.named],
        "the same, hard to read": [x for x in lines if x.kind == "clean" and x.case != "clean" and not x.named],
        "static, named right": [x for x in lines if _named(x) and x.case not in TRANSMISSION],
        "transmission, named right": [x for x in lines if _named(x) and x.case in TRANSMISSION],
        "pairs, named right": [x for x in lines if x.kind == "pairs" and x.outcome == "right"],
    }
    groups |= {f"all, {n}R": [x for x in lines if x.joints == n] for n in sorted({x.joints for x in lines})}
    for name, rows in groups.items():
        ratio = np.array([x.ratio for x in rows if np.isfinite(x.ratio)])
        seconds = np.array([x.seconds for x in rows if np.isfinite(x.seconds)])
        if len(ratio) and len(seconds):
            out.append(
                f"{name:28s} {len(rows):4d}   median {np.median(ratio):.3f}  95 % {np.quantile(ratio, 0.95):.3f}"
                f"    median {np.median(seconds):.1f}  most {seconds.max():.1f}"
            )
    return out


def drives_table(lines: Sequence[Line]) -> list[str]:
    """What becomes of the same recordings where drives' commands stand in the torque's place; empty without any."""
    groups = {form: [x for x in lines if x.drive == form] for form in ("", *FORMS)}
    if not any(rows for form, rows in groups.items() if form):
        return []
    out = [f"{'in place of a torque':22s} effects  named first  at its joint   false names (of which nothing hidden)"]
    for form, rows in groups.items():
        hidden, clean = ([x for x in rows if bool(x.truth) == there] for there in (True, False))
        first, joint = (sum(hit(x) for x in hidden) for hit in (lambda x: x.outcome == "right", _at_joint))
        of_clean = sum(len(x.named.split()) for x in clean)
        false = of_clean + sum(x.extra + (x.outcome == "wrong") for x in hidden)
        if rows:
            out.append(f"{form or 'the torque':22s} {len(hidden):7d}  {first:11d}  {joint:12d}   {false} ({of_clean})")
    return out


def _at_joint(x: Line) -> bool:
    """Whether what was named first is at the joint of what is hidden, or of the arm as that is."""
    first, truth = ((word.split() or [""])[0].partition("@")[2] for word in (x.named, x.truth))
    return bool(x.named) and first == truth


def _named(x: Line) -> bool:
    return x.kind == "single" and x.outcome == "right"


def comparison(lines: Sequence[Line]) -> list[str]:
    """Tendon beside pysindy and sysidentpy on the same recordings; none without them."""
    both = [x for x in lines if x.pysindy and x.sysidentpy]
    if not both:
        return []
    static = [x for x in both if x.kind == "single" and x.case not in MEMORY]
    memory = [x for x in both if x.kind == "single" and x.case in MEMORY]
    groups = {
        f"static effect, size >= {LARGE}": [x for x in static if band(x) == "large"],
        f"static effect, size {SMALL} to {LARGE}": [x for x in static if band(x) == "small"],
        "static effect, size < 0.15: silent": [x for x in static if band(x) == "below"],
        "clean: silent": [x for x in both if x.kind == "clean" and x.case == "clean"],
        "clean, but hard to read: silent": [x for x in both if x.kind == "clean" and x.case != "clean"],
        "inside the model's span: silent": [x for x in both if x.kind == "inside"],
        "another form, static": [x for x in both if x.kind == "forms" and _static(x)],
        "unknown or outside: silent": [x for x in both if x.kind == "unknown"],
        "memory, gain or delay: no column": [x for x in memory if band(x) in ("large", "small")],
    }
    out = [f"{'right, of n (largest term is the truth)':40s}    n   Tendon  pysindy  sysidentpy    terms too many"]
    for name, rows in groups.items():
        if rows:
            silent = name.endswith("silent")
            counts = [
                sum(not names if silent else outcome == "right" for outcome, names in pairs) for pairs in _answers(rows)
            ]
            more = " ".join(f"{np.mean([_surplus(o, n) for o, n in pairs]):5.1f}" for pairs in _answers(rows))
            out.append(f"{name:40s} {len(rows):4d}   {counts[0]:6d}  {counts[1]:7d}  {counts[2]:10d}   {more}")
    seconds = [np.mean([getattr(x, f) for x in both]) for f in ("seconds", "pysindy_seconds", "sysidentpy_seconds")]
    out.append(f"{'CPU s a recording':40s} {len(both):4d}   {seconds[0]:6.1f}  {seconds[1]:7.1f}  {seconds[2]:10.1f}")
    return out


def _static(x: Line) -> bool:
    return not any(effect in x.truth for effect in MEMORY)


def _answers(rows: Sequence[Line]) -> list[list[tuple[str, str]]]:
    """Outcome and names of each method, a row each."""
    return [
        [(x.outcome, x.named) for x in rows],
        [(x.pysindy, x.pysindy_named) for x in rows],
        [(x.sysidentpy, x.sysidentpy_named) for x in rows],
    ]


def _surplus(outcome: str, names: str) -> int:
    """Names beyond the right one."""
    return max(0, len(names.split()) - (outcome == "right"))
