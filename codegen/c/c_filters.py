"""C99 of the filter that takes an effect's torque and regressors into the band, for NumPy."""

from __future__ import annotations

from codegen.c.c_code import Precision, Routine, comment, declaration, indent
from codegen.c.c_effects import LANES, arguments_of

_OUTPUTS = 4
"""Outputs that one reading of the samples serves; their sums fill the registers of four doubles."""


def columns_type(precision: Precision) -> str:
    """What `columns` of every effect are called as."""
    note = comment("Columns along `count` samples at `joints` joints, of one choice of parameters or of several.")
    arguments = ", ".join(arguments_of(precision)).replace("restrict ", "")
    return f"{note}\ntypedef void tendon_columns_{precision.suffix}({arguments});"


def decimation(precision: Precision) -> Routine:
    """The filter that takes torque and regressors into the band: only the outputs that are kept are computed."""
    kind = precision.kind
    body = f"""for (size_t k = 0; k < count; ++k) {{
    const {kind} *restrict window = x + k * factor;
    {kind} lane[8] = {{0}};
    {kind} rest = 0;
    size_t i = 0;
    for (; i + 8 <= taps; i += 8) {{
        for (size_t j = 0; j < 8; ++j) {{
            lane[j] += window[i + j] * kernel[i + j];
        }}
    }}
    for (; i < taps; ++i) {{
        rest += window[i] * kernel[i];
    }}
    out[k] = ((lane[0] + lane[4]) + (lane[1] + lane[5])) + ((lane[2] + lane[6]) + (lane[3] + lane[7])) + rest;
}}"""
    arguments = ["size_t count", "size_t factor", "size_t taps", f"const {kind} *restrict kernel"]
    return Routine(
        comment(
            "FIR filter with decimation: out[k] = sum over i < taps of kernel[i] x[k factor + i], for k < count.",
            "Eight lanes, so that the sum has one order whatever the width of the processor's vectors.",
        ),
        declaration(
            f"void tendon_decimate_{precision.suffix}",
            [*arguments, f"const {kind} *restrict x", f"{kind} *restrict out"],
        ),
        indent(body.splitlines(), 1),
    )


def decimation_at_once(precision: Precision) -> Routine:
    """The filter of `decimation` along LANES columns that stand beside each other, to the last bit.

    _OUTPUTS neighbours are computed from one reading of what they share: by one at a time, memory would be waited for.
    Each of the eight passes reads samples eight apart, which are one of the eight sums of every output.
    """
    kind, each = precision.kind, f"for (size_t j = 0; j < {LANES}; ++j)"
    lanes = [f"lane{m}" for m in range(_OUTPUTS)]

    def add(m: int) -> str:
        at = f"i - {m} * factor" if m else "i"
        return f"{each} {{ {lanes[m]}[j] += sample[j] * kernel[{at}]; }}"

    last = _OUTPUTS - 1
    sample = f"const {kind} *restrict sample = window + {LANES} * i;"
    begun = "\n            ".join([add(0), *(f"if (i >= {m} * factor) {add(m)}" for m in range(1, last))])
    ended = "\n            ".join([*(f"if (i < whole + {m} * factor) {add(m)}" for m in range(1, last)), add(last)])
    among = "\n            ".join(add(m) for m in range(_OUTPUTS))
    kept = "\n            ".join(
        f"sum[{m}][(part + {7 * m} * factor) % 8][j] = {lanes[m]}[j];" for m in range(_OUTPUTS)
    )
    body = f"""const size_t whole = taps - taps % 8;
size_t near = 0;
for (size_t k = 0; k < count; k += near) {{
    const {kind} *restrict window = x + {LANES} * factor * k;
    {kind} sum[{_OUTPUTS}][8][{LANES}] = {{{{{{0}}}}}};
    near = (whole > {last} * factor && k + {_OUTPUTS} <= count) ? {_OUTPUTS} : 1;
    for (size_t i = 0; near == 1 && i < whole; ++i) {{
        {each} {{ sum[0][i % 8][j] += window[{LANES} * i + j] * kernel[i]; }}
    }}
    for (size_t part = 0; near > 1 && part < 8; ++part) {{
        {kind} {", ".join(f"{lane}[{LANES}] = {{0}}" for lane in lanes)};
        size_t i = part;
        for (; i < {last} * factor; i += 8) {{
            {sample}
            {begun}
        }}
        for (; i < whole; i += 8) {{
            {sample}
            {among}
        }}
        for (; i < whole + {last} * factor; i += 8) {{
            {sample}
            {ended}
        }}
        {each} {{
            {kept}
        }}
    }}
    for (size_t m = 0; m < near; ++m) {{
        {kind} rest[{LANES}] = {{0}};
        for (size_t i = whole; i < taps; ++i) {{
            {each} {{ rest[j] += window[{LANES} * (i + m * factor) + j] * kernel[i]; }}
        }}
        for (size_t j = 0; j < filled; ++j) {{
            out[j * apart + k + m] = ((sum[m][0][j] + sum[m][4][j]) + (sum[m][1][j] + sum[m][5][j])) +
                ((sum[m][2][j] + sum[m][6][j]) + (sum[m][3][j] + sum[m][7][j])) + rest[j];
        }}
    }}
}}"""
    arguments = ["size_t count", "size_t filled", "size_t apart", "size_t factor", "size_t taps"]
    return Routine(
        comment(
            f"The same of the first `filled` of {LANES} columns, x (..., {LANES}), each into a row of `out`; the rows "
            "begin `apart` from each other."
        ),
        declaration(
            f"void tendon_decimate_at_once_{precision.suffix}",
            [*arguments, f"const {kind} *restrict kernel", f"const {kind} *restrict x", f"{kind} *restrict out"],
        ),
        indent(body.splitlines(), 1),
    )


def in_band(precision: Precision) -> Routine:
    """The columns of many choices of parameters through that filter, a few at a time."""
    kind, suffix = precision.kind, precision.suffix
    body = """const size_t kept = (count < taps) ? 0U : (count - taps) / factor + 1U;
for (size_t first = 0; first < choices; first += lanes) {
    const size_t filled = (choices - first < lanes) ? choices - first : lanes;
    columns(count, joints, s, dt, p + first * width, scratch);
    for (size_t i = 0; i < rows; ++i) {
        const KIND *x = scratch + i * count * lanes;
        KIND *target = out + (first * rows + i) * kept;
        size_t k = 0;
        while (k < count * lanes && x[k] == 0) {
            ++k;
        }
        if (k == count * lanes) {
            for (k = 0; k < filled * kept; ++k) {
                target[k / kept * rows * kept + k % kept] = 0;
            }
        } else if (lanes == 1U) {
            tendon_decimate_SUFFIX(kept, factor, taps, kernel, x, target);
        } else {
            tendon_decimate_at_once_SUFFIX(kept, filled, rows * kept, factor, taps, kernel, x, target);
        }
    }
}"""
    body = body.replace("KIND", kind).replace("SUFFIX", suffix)
    return Routine(
        comment(
            "Columns of `choices` choices of `width` parameters, p (choices, width) filled up to whole lanes, filtered "
            "and decimated: out (choices, rows, kept).",
            "lanes: choices that `columns` takes at once; rows: of all joints; scratch (rows, count, lanes).",
        ),
        declaration(
            f"void tendon_in_band_{suffix}",
            [
                *(f"tendon_columns_{suffix} *columns", "size_t lanes", "size_t rows", "size_t width"),
                *("size_t choices", "size_t count", "size_t joints", f"const tendon_signals_{suffix} *s", f"{kind} dt"),
                *(f"const {kind} *restrict p", "size_t factor", "size_t taps", f"const {kind} *restrict kernel"),
                *(f"{kind} *restrict scratch", f"{kind} *restrict out"),
            ],
        ),
        indent(body.splitlines(), 1),
    )
