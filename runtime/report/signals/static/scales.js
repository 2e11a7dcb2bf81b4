"use strict";
/* Formats of numbers, axes with their ticks, and the colours of the page. */
globalThis.TendonSignals = (() => {
  const RAISED = "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079";
  const minus = (text) => text.replace("-", "\u2212");

  /* A number with a few significant digits, with a power of ten only if it is very small or large. */
  function number(value, digits = 3) {
    if (!Number.isFinite(value)) return "\u2013";
    if (value === 0) return "0";
    const size = Math.floor(Math.log10(Math.abs(value)));
    if (size < -4 || size > 5) {
      const power = String(size).replace(/./g, (letter) => RAISED["-0123456789".indexOf(letter)]);
      return `${minus((value / 10 ** size).toFixed(digits - 1).replace(/\.?0+$/, ""))}\u00b710${power}`;
    }
    const text = value.toFixed(Math.max(0, digits - 1 - size));
    return minus(text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  }

  /* Axes: `to` maps a value to its position, `from` is the inverse. */
  const plain = { to: (x) => x, from: (u) => u };
  const logarithmic = { to: (x) => Math.log10(Math.max(x, 1e-300)), from: (u) => 10 ** u };
  const stretched = (width) => ({ to: (x) => Math.asinh(x / width), from: (u) => width * Math.sinh(u), width });

  /* About the given number of round values from low to high. */
  function evenly(low, high, about) {
    const span = high - low;
    if (!(span > 0) || !Number.isFinite(span)) return [];
    const raw = span / Math.max(about, 1), power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= 0.7 * raw);
    const first = Math.ceil(low / step), last = Math.floor(high / step);
    const found = [];
    for (let k = first; k <= last && found.length < 50; k++) found.push(k * step);
    return found;
  }

  /* Ticks of a logarithmic axis: powers of ten; over a short range twos and fives too. */
  function decades(low, high) {
    const found = [], wide = Math.log10(high / low) > 2.5;
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e++)
      for (const m of wide ? [1] : [1, 2, 5]) if (m * 10 ** e >= low && m * 10 ** e <= high) found.push(m * 10 ** e);
    return found;
  }

  /* Ticks of an axis that is stretched about 0: 0 and round rates on either side, with a least distance. */
  function creeping(axis, u0, u1, about) {
    const gap = (u1 - u0) / Math.max(about, 2), rates = [];
    for (let e = 6; e >= -9; e--) for (const m of [3, 1]) rates.push(m * 10 ** e);
    const found = u0 <= 0 && u1 >= 0 ? [0] : [];
    for (const sign of [1, -1]) {
      let last = Infinity;
      for (const rate of rates) {
        const u = axis.to(sign * rate);
        if (u < u0 || u > u1 || Math.abs(u) < gap || Math.abs(u - last) < gap) continue;
        found.push(sign * rate);
        last = u;
      }
    }
    const inside = axis.from(u1) - axis.from(u0);
    return found.length > 1 ? found.sort((a, b) => a - b) : evenly(axis.from(u0), axis.from(u0) + inside, about);
  }

  function ticks(axis, u0, u1, about) {
    if (axis === logarithmic) return decades(axis.from(u0), axis.from(u1));
    return axis.width ? creeping(axis, u0, u1, about) : evenly(u0, u1, about);
  }

  /* Text of a tick, with as many decimals as distinguish it from its neighbours. */
  function tick(value, all) {
    const steps = all.slice(1).map((x, k) => Math.abs(x - all[k])).filter((x) => x > 0);
    const least = Math.min(...steps, Math.abs(value) || Infinity);
    if (!Number.isFinite(least)) return number(value);
    const size = Math.floor(Math.log10(least) + 1e-9);
    if (size < -5 || Math.abs(value) >= 1e6) return number(value);
    return minus(value.toFixed(Math.max(0, -size)).replace(/^-(0(\.0*)?)$/, "$1"));
  }

  const NAMES = ["paper", "raised", "rule", "ink", "faint", "before", "after"];

  /* Colours of the page's style at an element, as CSS texts and as [red, green, blue]. */
  function colours(element, pen) {
    const style = getComputedStyle(element), found = { font: style.fontFamily, rgb: {} };
    for (const name of NAMES) {
      pen.fillStyle = "#808080";
      pen.fillStyle = style.getPropertyValue(`--${name}`).trim() || "#808080";
      found[name] = pen.fillStyle;
      found.rgb[name] = [1, 3, 5].map((k) => parseInt(pen.fillStyle.slice(k, k + 2), 16));
    }
    return found;
  }

  return { number, plain, logarithmic, stretched, ticks, tick, colours };
})();
