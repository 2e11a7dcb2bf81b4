"use strict";
/* <tendon-signals src="…"> or around a script of data: panels that zoom each on their own and are lit together. */
(() => {
  const { number, plain, logarithmic, stretched, colours, place, Served, Embedded, statistics, draw, frame } = globalThis.TendonSignals;
  const MARGIN = 1, OVERVIEW = 2048, NEAR = 24, ZOOM = 1.25, MOST_ZOOM = 1e6, FRAMES = 600;
  const HELP = "Arrow keys move the view, plus and minus zoom, 0 shows all, S selects what is in view, Escape clears the selection.";

  const make = (name, attributes = {}, ...inside) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...inside);
    return made;
  };

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

    /* --- what there is --- */

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
      this.replaceChildren(...(data ? [data] : []), this.bar(), this.said, this.group, help);
      this.readColours();
      this.tell();
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
      this.listen(panel);
      return panel;
    }

    extent(spec) {
      if (spec.kind === "time") return [this.spec.begin, this.spec.end];
      const values = spec.kind === "over" ? this.rows.signals[spec.x] : spec.curves.flatMap((curve) => curve.x.filter((x) => x !== null));
      let low = Infinity, high = -Infinity;
      for (const x of values) { if (x < low) low = x; if (x > high) high = x; }
      return low <= high ? [low, high] : [0, 1];
    }

    /* --- the bar above the panels --- */

    bar() {
      const button = (text, what, act) => {
        const made = make("button", { type: "button", "aria-label": what, title: what }, text);
        made.addEventListener("click", act);
        return made;
      };
      const modes = ["select", "move"].map((mode) => {
        const made = button(mode === "select" ? "Select" : "Move", mode === "select" ? "Drag to select samples" : "Drag to move the view", () => this.setMode(mode));
        made.dataset.mode = mode;
        return made;
      });
      this.mode = "select";
      this.modes = modes;
      modes.forEach((made) => made.setAttribute("aria-pressed", String(made.dataset.mode === this.mode)));
      const time = () => this.panels.find((panel) => panel.kind === "time") ?? this.panels[0];
      return make("div", { class: "signals-bar", role: "toolbar", "aria-label": `View of ${this.spec.title}` },
        make("span", { class: "signals-group" }, ...modes),
        make("span", { class: "signals-group" },
          button("−", "Zoom out in time", () => this.zoom(time(), ZOOM ** 3)),
          button("+", "Zoom in in time", () => this.zoom(time(), ZOOM ** -3)),
          button("All", "Show all of every panel", () => { this.panels.forEach((panel) => { panel.view = { ...panel.home }; }); this.touch(); })),
        button("Clear selection", "Clear the selection", () => this.select(null)),
        make("span", { class: "signals-legend" }, ...this.legend()));
    }

    legend() {
      const found = new Map();
      for (const panel of this.spec.panels) for (const line of [...panel.lines, ...panel.curves]) if (!found.has(line.name)) found.set(line.name, line);
      if (found.size < 2) return [];
      return [...found.values()].map((line) => {
        const made = make("button", { type: "button", "aria-pressed": "true", "data-colour": line.colour, title: `Show or hide ${line.name}` },
          make("span", { class: line.dashed ? "swatch dashed" : "swatch" }), line.name);
        made.addEventListener("click", () => {
          const hide = !this.off.has(line.name);
          if (hide) this.off.add(line.name); else this.off.delete(line.name);
          made.setAttribute("aria-pressed", String(!hide));
          this.touch();
        });
        return made;
      });
    }

    setMode(mode) {
      this.mode = mode;
      this.modes.forEach((made) => made.setAttribute("aria-pressed", String(made.dataset.mode === mode)));
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

    /* By a factor about a place of the panel (0 to 1 from its left and bottom). */
    zoom(panel, factor, x = 0.5, y = 0.5) {
      const { u0, u1, v0, v1 } = panel.view, upright = panel.kind === "over";
      const along = (a, b, at) => [a + (b - a) * at * (1 - factor), b - (b - a) * (1 - at) * (1 - factor)];
      const [a, b] = along(u0, u1, x), [c, d] = upright ? along(v0, v1, y) : [v0, v1];
      this.setView(panel, { u0: a, u1: b, v0: c, v1: d });
    }

    /* By parts of its width and height. */
    move(panel, x, y) {
      const { u0, u1, v0, v1 } = panel.view, a = x * (u1 - u0), b = panel.kind === "over" ? y * (v1 - v0) : 0;
      this.setView(panel, { u0: u0 + a, u1: u1 + a, v0: v0 + b, v1: v1 + b });
    }

    /* More of the lines than is seen, once a view has left what is there or looks closer than it. */
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
      } catch { /* the overview stays: coarser, and true */ } finally { this.asking = false; }
      if (this.again) { const next = this.again; this.again = null; this.ask(next); }
    }

    /* Which blocks draw which stretch of a panel's time. */
    stretches(panel) {
      const { u0, u1 } = panel.view, fine = this.detail;
      if (!fine || fine.end <= u0 || fine.begin >= u1 || (u1 - u0) > 4 * (fine.end - fine.begin)) return [[this.overview, u0, u1]];
      const found = [[fine, Math.max(u0, fine.begin), Math.min(u1, fine.end)]];
      if (fine.begin > u0) found.push([this.overview, u0, fine.begin]);
      if (fine.end < u1) found.push([this.overview, fine.end, u1]);
      return found;
    }

    /* --- selection --- */

    /* Samples within ranges of signals; null: none. The last one asked for counts. */
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
      this.tell();
      this.dispatchEvent(new CustomEvent("selected", { bubbles: true, detail: ranges }));
    }

    brushed(panel) {
      const range = this.drag?.panel === panel ? this.drag.range : this.selection?.panel === panel ? this.selection.range : null;
      if (range) return range;
      const time = this.selection?.ranges.time;
      return panel.kind === "time" && time ? { x: time } : null;
    }

    /* A rectangle of a panel as ranges of its signals. */
    ranges(panel, range) {
      if (panel.kind === "time") return { time: range.x };
      const line = panel.lines.find((own) => !this.off.has(own.name)) ?? panel.lines[0];
      return { [panel.x]: range.x, [line.line]: range.y };
    }

    tell() {
      const { spec } = this, some = this.lit ?? this.rows, found = statistics(some, this.rows, spec);
      const percent = (x) => `${number(100 * x)}\u00a0%`;
      const facts = [
        [this.lit ? "selected" : "all samples", `${found.samples.toLocaleString("en")} ${this.lit ? `(${percent(found.share)})` : ""}`],
        ["time", found.samples ? `${number(found.from, 4)} … ${number(found.to, 4)} s` : "–"],
        ...found.lines.filter((line) => !this.off.has(line.name)).flatMap((line) => [
          [`${line.name}, mean`, `${number(line.mean)} ${spec.units[line.name] ?? spec.unit}`],
          [`${line.name}, rms`, `${number(line.rms)} ${spec.units[line.name] ?? spec.unit}${spec.floor ? ` = ${number(line.floors)} × floor` : ""}`],
          ...(this.lit && spec.floor ? [[`of all squares of ${line.name}`, percent(line.squares)]] : []),
        ]),
      ];
      const list = make("dl", {}, ...facts.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
      this.said.toggleAttribute("data-lit", Boolean(this.lit));
      this.said.replaceChildren(list, ...(found.estimated ? [make("p", {}, `Mean and rms of ${some.count.toLocaleString("en")} of them, picked at random.`)] : []));
    }

    /* --- pointer and keys --- */

    listen(panel) {
      const { canvas } = panel, pointers = new Map();
      const here = (event) => { const box = canvas.getBoundingClientRect(); return { x: event.clientX - box.left, y: event.clientY - box.top }; };
      const at = () => frame(panel, canvas.clientWidth, canvas.clientHeight);
      const part = (p) => { const { box } = at(); return [(p.x - box.x) / box.w, 1 - (p.y - box.y) / box.h]; };
      canvas.addEventListener("pointerdown", (event) => {
        if (event.button > 1) return;
        canvas.focus({ preventScroll: true });
        canvas.setPointerCapture(event.pointerId);
        pointers.set(event.pointerId, here(event));
        const moving = (this.mode === "move") !== (event.shiftKey || event.button === 1) || panel.kind === "curves";
        this.drag = pointers.size > 1 ? null : { panel, moving, from: here(event), range: null };
      });
      canvas.addEventListener("pointermove", (event) => {
        const now = here(event), was = pointers.get(event.pointerId);
        if (!was) { this.hover(panel, at(), now); return; }
        if (pointers.size === 2) {
          const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
          const wide = (a) => Math.hypot(a.x - other.x, a.y - other.y) || 1;
          const [x, y] = part({ x: (now.x + other.x) / 2, y: (now.y + other.y) / 2 });
          this.zoom(panel, wide(was) / wide(now), x, y);
        } else if (this.drag?.moving) {
          const { box } = at();
          this.move(panel, -(now.x - was.x) / box.w, (now.y - was.y) / box.h);
        } else if (this.drag) {
          this.drag.range = this.rectangle(panel, at(), this.drag.from, now);
          this.linked(panel).forEach((other) => this.touch(other));
        }
        pointers.set(event.pointerId, now);
      });
      const up = (event) => {
        if (!pointers.delete(event.pointerId)) return;
        const { drag } = this;
        this.drag = null;
        if (drag?.range && event.type === "pointerup") { this.select(this.ranges(panel, drag.range), panel); this.selection.range = drag.range; }
        else if (drag && !drag.moving && event.type === "pointerup") this.select(null);
        this.touch(panel);
      };
      for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, up);
      canvas.addEventListener("pointerleave", () => this.leave());
      canvas.addEventListener("dblclick", () => { this.setView(panel, panel.home); });
      canvas.addEventListener("wheel", (event) => {
        if (!(event.ctrlKey || event.metaKey || document.activeElement === canvas)) return;
        event.preventDefault();
        const [x, y] = part(here(event));
        if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.move(panel, event.deltaX / at().box.w, 0);
        else this.zoom(panel, ZOOM ** (event.deltaY / 100), x, y);
      }, { passive: false });
      canvas.addEventListener("keydown", (event) => this.key(panel, event));
    }

    rectangle(panel, at, from, to) {
      const { box } = at, inside = (p) => ({ x: Math.min(Math.max(p.x, box.x), box.x + box.w), y: Math.min(Math.max(p.y, box.y), box.y + box.h) });
      const [a, b] = [from, to].map(inside);
      if (Math.abs(a.x - b.x) < 3) return null;
      const x = [a.x, b.x].sort((p, q) => p - q).map(at.valueX);
      return panel.kind === "time" ? { x } : { x, y: [a.y, b.y].sort((p, q) => q - p).map(at.valueY) };
    }

    key(panel, event) {
      const { u0, u1, v0, v1 } = panel.view, acts = {
        ArrowLeft: () => this.move(panel, -0.1, 0), ArrowRight: () => this.move(panel, 0.1, 0),
        "+": () => this.zoom(panel, 1 / ZOOM), "=": () => this.zoom(panel, 1 / ZOOM), "-": () => this.zoom(panel, ZOOM),
        0: () => this.setView(panel, panel.home), Escape: () => this.select(null),
      };
      if (panel.kind === "over") Object.assign(acts, { ArrowUp: () => this.move(panel, 0, 0.1), ArrowDown: () => this.move(panel, 0, -0.1) });
      if (panel.kind !== "curves") acts.s = acts.S = () => {
        const range = { x: [u0, u1].map(panel.xAxis.from), y: [v0, v1].map(panel.yAxis.from) };
        this.select(this.ranges(panel, range), panel);
      };
      if (!acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      acts[event.key]();
    }

    /* The sample under the pointer: read in its panel, and shown in all. */
    hover(panel, at, p) {
      const { signals, count } = this.rows, { box } = at;
      if (!count || panel.kind === "curves" || p.x < box.x || p.x > box.x + box.w) { this.leave(); return; }
      let k = -1;
      if (panel.kind === "time") {
        k = Math.min(place(signals.time, at.valueX(p.x)), count - 1);
      } else {
        let least = NEAR ** 2;
        const [line] = panel.lines.filter((own) => !this.off.has(own.name));
        for (let i = 0; line && i < count; i++) {
          const far = (at.x(signals[panel.x][i]) - p.x) ** 2 + (at.y(signals[line.line][i]) - p.y) ** 2;
          if (far < least) { least = far; k = i; }
        }
      }
      if (k < 0) { this.leave(); return; }
      this.near = Object.fromEntries(Object.entries(signals).map(([name, x]) => [name, x[k]]));
      const read = [`${number(this.near.time, 5)} s`, ...(panel.kind === "over" ? [`${panel.x} ${number(this.near[panel.x])}`] : []),
        ...panel.lines.filter((line) => !this.off.has(line.name)).map((line) => `${line.name} ${number(this.near[line.line])}`)];
      this.panels.forEach((other) => { other.reading.textContent = other === panel ? read.join(", ") : ""; });
      this.touch();
    }

    leave() {
      if (!this.near) return;
      this.near = null;
      this.panels.forEach((panel) => { panel.reading.textContent = ""; });
      this.touch();
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
