"use strict";
/* Signals from a server, which reduces them; the same interface as `Embedded`. */
Object.assign(globalThis.TendonSignals, (() => {
  const { blocks, table } = globalThis.TendonSignals;

  class Served {
    constructor(address) { this.address = address; }

    async ask(what, query) {
      const text = new URLSearchParams(query).toString();
      const answer = await fetch(`${this.address}/${what}${text ? `?${text}` : ""}`, { credentials: "same-origin" });
      if (!answer.ok) throw new Error(`the signals could not be read (${answer.status})`);
      return answer;
    }

    async numbers(what, query) {
      return new Float64Array(await (await this.ask(what, query)).arrayBuffer());
    }

    async open() {
      this.spec = await (await this.ask("spec", {})).json();
      return this.spec;
    }

    async columns(begin, end, columns) {
      return blocks(await this.numbers("columns", { begin, end, columns }), this.spec.lines.length);
    }

    async rows(ranges) {
      const query = Object.fromEntries(Object.entries(ranges).map(([name, [low, high]]) => [name, `${low},${high}`]));
      const numbers = await this.numbers("rows", query);
      return { total: numbers[0], ...table(numbers.subarray(1), this.spec.signals) };
    }
  }

  return { Served };
})());
