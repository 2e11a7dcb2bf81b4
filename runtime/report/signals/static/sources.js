"use strict";
/* Signals as blocks over time and as a table of samples, statistics of a selection, and signals that are embedded in the
   page. */
Object.assign(globalThis.TendonSignals, (() => {
  /* Index of the first of ascending values that is not below x. */
  function place(values, x) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] < x) low = middle + 1; else high = middle;
    }
    return low;
  }

  /* Blocks of samples: the time of the first sample, and the smallest and largest value of each line. */
  function blocks(flat, lines) {
    const count = flat.length / (1 + 2 * lines);
    const row = (k) => flat.subarray(k * count, (k + 1) * count);
    const t = row(0);
    const steps = Array.from(t.subarray(1), (x, k) => x - t[k]).sort((a, b) => a - b);
    return {
      t,
      pitch: steps.length ? steps[steps.length >> 1] : 0,
      least: Array.from({ length: lines }, (_, k) => row(1 + 2 * k)),
      most: Array.from({ length: lines }, (_, k) => row(2 + 2 * k)),
    };
  }

  /* Samples as a table with a column for every signal, by name. */
  function table(flat, names) {
    const count = names.length ? flat.length / names.length : 0;
    const signals = Object.fromEntries(names.map((name, k) => [name, flat.subarray(k * count, (k + 1) * count)]));
    return { count, signals };
  }

  /* Decodes embedded numbers: 16-bit integers between a low and a high end. */
  function unpacked({ low, high, data }) {
    const bytes = Uint8Array.from(atob(data.slice(data.indexOf(",") + 1)), (letter) => letter.charCodeAt(0));
    return Float64Array.from(new Uint16Array(bytes.buffer), (k) => low + (high - low) * k / 65535);
  }

  class Embedded {
    constructor(document) {
      this.spec = document.spec;
      const flat = (rows) => {
        const parts = rows.map(unpacked), joined = new Float64Array(parts.length * (parts[0]?.length ?? 0));
        parts.forEach((part, k) => joined.set(part, k * part.length));
        return joined;
      };
      this.all = blocks(flat(document.columns), this.spec.lines.length);
      this.table = table(flat(document.rows), this.spec.signals);
    }

    async open() { return this.spec; }

    async columns() { return this.all; }

    async rows(ranges) {
      const { count, signals } = this.table, picked = [];
      const limits = Object.entries(ranges).map(([name, [low, high]]) => [signals[name], low, high]);
      for (let k = 0; k < count; k++) if (limits.every(([x, low, high]) => x[k] >= low && x[k] <= high)) picked.push(k);
      const inside = Object.fromEntries(Object.entries(signals).map(([name, x]) => [name, Float64Array.from(picked, (k) => x[k])]));
      const total = Math.round(this.spec.samples * picked.length / Math.max(count, 1));
      return { total, count: picked.length, signals: inside };
    }
  }

  /* Statistics of samples: count, times, and the mean, rms and share of the sum of squares of every line. Those of all
     samples stand in the spec: a table may hold a part of them. */
  function statistics(rows, all, spec) {
    const of = (x, what) => { let sum = 0; for (let k = 0; k < x.length; k++) sum += what(x[k]); return x.length ? sum / x.length : NaN; };
    const { time } = rows.signals;
    const residuals = spec.signals.filter((name) => name.startsWith("residual"));
    const names = residuals.length ? residuals : spec.lines;
    return {
      samples: rows.total,
      share: rows.total / Math.max(all.total, 1),
      estimated: rows !== all && rows.count < rows.total,
      from: time.length ? time[0] : NaN,
      to: time.length ? time[time.length - 1] : NaN,
      lines: names.map((name) => {
        const whole = spec.whole[name] ?? [NaN, NaN], own = rows.signals[name];
        const [mean, rms] = rows === all ? whole : [of(own, (x) => x), Math.sqrt(of(own, (x) => x * x))];
        return {
          name,
          mean,
          rms,
          floors: spec.floor ? rms / spec.floor : NaN,
          squares: whole[1] ? rms ** 2 * rows.total / (whole[1] ** 2 * all.total) : NaN,
        };
      }),
    };
  }

  return { place, blocks, table, Embedded, statistics };
})());
