"use strict";
/* <tendon-signals src="…">, or with a script of data inside: panels that zoom one by one and share a selection. */
(() => {
  const { plain, logarithmic, stretched, colours, Served, Embedded, draw, make, bar, showStatistics, listen } = globalThis.TendonSignals;
  const MARGIN = 1, OVERVIEW = 2048, MOST_ZOOM = 1e6, FRAMES = 600;
  const HELP = "Arrow keys move the view, plus and minus zoom, 0 shows all, S selects what is in view, Escape clears the selection.";

  class Signals extends HTMLElement {
    static get observedAttributes() { return ["src"]; }

    connectedCallback() {
      this.frames = [];
      this.scheme = [matchMedia("(prefers-color-scheme: dark)"), matchMedia("print")];
      this.repaint = () => { this.readColours(); this.touch(); this.paint(); };
      this.scheme.forEach((query) => query.addEventListener("change", this.repaint));
      this.themes = new MutationObserver(this.repaint);
      for (const root of [document.documentElement, document.body]) this.themes.observe(root, { attributes: true, attributeFilter: ["data-theme", "class"] });
      this.sizes = new ResizeObserver(() => this.fit());
      this.load();
    }

    disconnectedCallback() {
      this.scheme.forEach((query) => query.removeEventListener("change", this.repaint));
      this.themes.disconnect();
      this.sizes.disconnect();
      cancelAnimationFrame(this.waiting);
    }

    attributeChangedCallback(_name, before, after) {
      if (before !== null && before !== after && this.isConnected) this.load();
    }

    /* --- loading --- */

    async load() {
      const data = this.querySelector("script[type='application/json']"), address = this.getAttribute("src");
      this.source = data ? new Embedded(JSON.parse(data.textContent)) : new Served(address);
      this.setAttribute("aria-busy", "true");
      const asked = this.source;
      try {
        const spec = await asked.open();
        const [overview, rows] = await Promise.all([asked.columns(spec.begin, spec.end, OVERVIEW), asked.rows({})]);
        if (asked !== this.source) return;
        Object.assign(this, { spec, overview, rows, detail: null, lit: null, selection: null, near: null, off: new Set() });
        this.build(data);
        this.setAttribute("data-ready", "");
      } catch (error) {
        this.replaceChildren(make("p", { class: "signals-wrong", role: "alert" }, error.message));
      }
      this.removeAttribute("aria-busy");
    }

    build(data) {
      const { spec } = this;
      this.panels = spec.panels.map((panel) => this.panel(panel));
      this.group = make("div", { class: "signals-panels" }, ...this.panels.map((panel) => panel.figure));
      this.said = make("div", { class: "signals-said", role: "status" });
      const help = make("p", { class: "signals-help", id: `help-${Math.random().toString(36).slice(2)}` }, HELP);
      this.panels.forEach((panel) => panel.canvas.setAttribute("aria-describedby", help.id));
      this.replaceChildren(...(data ? [data] : []), bar(this), this.said, this.group, help);
      this.readColours();
      showStatistics(this);
      this.panels.forEach((panel) => this.sizes.observe(panel.canvas));
      this.fit();
    }

    panel(spec) {
      const canvas = make("canvas", { tabindex: "0", role: "img", "aria-label": `${this.spec.title}: ${spec.title}. ${spec.note}` });
      const reading = make("span", { class: "signals-reading" });
      const caption = make("figcaption", {}, make("b", {}, spec.title), reading);
      const figure = make("figure", { class: "signals-panel", "data-kind": spec.kind }, caption, canvas);
      if (spec.note) figure.append(make("p", { class: "signals-note" }, spec.note));
      const panel = { ...spec, canvas, figure, reading, pen: canvas.getContext("2d", { alpha: false }) };
      panel.xAxis = spec.stretch > 0 ? stretched(spec.stretch) : plain;
      panel.yAxis = spec.log ? logarithmic : plain;
      panel.low0 = spec.log ? spec.low : -spec.band;
      const [low, high] = this.extent(spec), margin = 0.01 * (panel.xAxis.to(high) - panel.xAxis.to(low)) || 0.5;
      panel.home = { u0: panel.xAxis.to(low) - margin, u1: panel.xAxis.to(high) + margin, v0: panel.yAxis.to(spec.low), v1: panel.yAxis.to(spec.high) };
      panel.view = { ...panel.home };
      listen(this, panel);
      return panel;
    }

    extent(spec) {
      if (spec.kind === "time") return [this.spec.begin, this.spec.end];
      const values = spec.kind === "over" ? this.rows.signals[spec.x] : spec.curves.flatMap((curve) => curve.x.filter((x) => x !== null));
      let low = Infinity, high = -Infinity;
      for (const x of values) { if (x < low) low = x; if (x > high) high = x; }
      return low <= high ? [low, high] : [0, 1];
    }

    /* --- views --- */

    linked(panel) { return panel.kind === "time" ? this.panels.filter((other) => other.kind === "time") : [panel]; }

    setView(panel, view) {
      for (const other of this.linked(panel)) {
        const { home } = other, own = { ...other.view, u0: view.u0, u1: view.u1 };
        if (other === panel) Object.assign(own, { v0: view.v0, v1: view.v1 });
        for (const [a, b] of [["u0", "u1"], ["v0", "v1"]]) {
          const whole = home[b] - home[a], span = Math.min(Math.max(own[b] - own[a], whole / MOST_ZOOM), whole);
          const start = Math.min(Math.max(own[a], home[a]), home[b] - span);
          own[a] = start;
          own[b] = start + span;
        }
        other.view = own;
        this.touch(other);
      }
      if (panel.kind === "time") this.ask(panel);
    }

    /* Zooms by a factor about a point of the panel (0 to 1 from its left and bottom). */
    zoom(panel, factor, x = 0.5, y = 0.5) {
      const { u0, u1, v0, v1 } = panel.view, upright = panel.kind === "over";
      const along = (a, b, at) => [a + (b - a) * at * (1 - factor), b - (b - a) * (1 - at) * (1 - factor)];
      const [a, b] = along(u0, u1, x), [c, d] = upright ? along(v0, v1, y) : [v0, v1];
      this.setView(panel, { u0: a, u1: b, v0: c, v1: d });
    }

    /* Moves the view by parts of its width and height. */
    move(panel, x, y) {
      const { u0, u1, v0, v1 } = panel.view, a = x * (u1 - u0), b = panel.kind === "over" ? y * (v1 - v0) : 0;
      this.setView(panel, { u0: u0 + a, u1: u1 + a, v0: v0 + b, v1: v1 + b });
    }

    /* Asks for finer or further blocks when the view has left the loaded ones or is finer than they are. */
    async ask(panel) {
      const { u0, u1 } = panel.view, columns = Math.max(panel.canvas.width, 1);
      const has = this.detail, finest = has && (has.raw || (u1 - u0) / columns >= has.pitch * 0.9);
      if (has && has.begin <= u0 && has.end >= u1 && finest) return;
      if (this.asking) { this.again = panel; return; }
      const coarse = (u1 - u0) / columns >= (this.spec.end - this.spec.begin) / OVERVIEW;
      if (coarse) { this.detail = null; return; }
      this.asking = true;
      const source = this.source, span = u1 - u0, begin = u0 - MARGIN * span, end = u1 + MARGIN * span;
      try {
        const found = await source.columns(begin, end, columns * (1 + 2 * MARGIN));
        if (source === this.source) {
          this.detail = { ...found, begin, end, raw: found.pitch <= 1.5 * this.spec.step };
          this.linked(panel).forEach((other) => this.touch(other));
        }
      } catch { /* the overview stays, which is coarser */ } finally { this.asking = false; }
      if (this.again) { const next = this.again; this.again = null; this.ask(next); }
    }

    /* The blocks that draw each interval of a panel's time. */
    stretches(panel) {
      const { u0, u1 } = panel.view, fine = this.detail;
      if (!fine || fine.end <= u0 || fine.begin >= u1 || (u1 - u0) > 4 * (fine.end - fine.begin)) return [[this.overview, u0, u1]];
      const found = [[fine, Math.max(u0, fine.begin), Math.min(u1, fine.end)]];
      if (fine.begin > u0) found.push([this.overview, u0, fine.begin]);
      if (fine.end < u1) found.push([this.overview, fine.end, u1]);
      return found;
    }

    /* --- selection --- */

    /* Selects the samples within ranges of signals; null clears the selection. A later call overrides an earlier one. */
    async select(ranges, panel = null) {
      const asked = this.selection = ranges && { ranges, panel };
      if (!ranges) this.lit = null;
      this.touch();
      if (ranges) {
        const rows = await this.source.rows(ranges).catch(() => null);
        if (this.selection !== asked) return;
        this.lit = rows;
        this.touch();
      }
      showStatistics(this);
      this.dispatchEvent(new CustomEvent("selected", { bubbles: true, detail: ranges }));
    }

    brushed(panel) {
      const range = this.drag?.panel === panel ? this.drag.range : this.selection?.panel === panel ? this.selection.range : null;
      if (range) return range;
      const time = this.selection?.ranges.time;
      return panel.kind === "time" && time ? { x: time } : null;
    }

    /* The rectangle of a panel as ranges of its signals. */
    ranges(panel, range) {
      if (panel.kind === "time") return { time: range.x };
      const line = panel.lines.find((own) => !this.off.has(own.name)) ?? panel.lines[0];
      return { [panel.x]: range.x, [line.line]: range.y };
    }

    /* --- drawing --- */

    readColours() { if (this.panels?.length) this.colours = colours(this, this.panels[0].pen); }

    fit() {
      const scale = Math.min(globalThis.devicePixelRatio || 1, 2);
      for (const panel of this.panels ?? []) {
        const { canvas } = panel, wide = Math.round(canvas.clientWidth * scale), tall = Math.round(canvas.clientHeight * scale);
        if (wide && (canvas.width !== wide || canvas.height !== tall)) { canvas.width = wide; canvas.height = tall; this.touch(panel); }
      }
      this.paint();
    }

    touch(panel = null) {
      (panel ? [panel] : this.panels ?? []).forEach((one) => { one.stale = true; });
      this.waiting ||= requestAnimationFrame(() => this.paint());
    }

    paint() {
      cancelAnimationFrame(this.waiting);
      this.waiting = 0;
      if (!this.panels || !this.colours) return;
      const began = performance.now();
      const scene = {
        colours: this.colours, rows: this.rows, lit: this.lit, near: this.near,
        shown: (name) => !this.off.has(name), stretches: (panel) => this.stretches(panel),
        lineNumber: (name) => this.spec.lines.indexOf(name), brushed: (panel) => this.brushed(panel),
      };
      for (const panel of this.panels) if (panel.stale && panel.canvas.clientWidth) { panel.stale = false; draw(panel, scene); }
      this.frames.push(performance.now() - began);
      if (this.frames.length > FRAMES) this.frames.shift();
    }
  }

  customElements.define("tendon-signals", Signals);
})();
