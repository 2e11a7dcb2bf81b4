"use strict";
/* Input on a panel: a pointer selects or moves, two pointers or the wheel zoom, keys, and the sample under the pointer. */
Object.assign(globalThis.TendonSignals, (() => {
  const { number, place, frame, ZOOM } = globalThis.TendonSignals;
  const NEAR = 24;

  function listen(signals, panel) {
    const { canvas } = panel, pointers = new Map();
    const here = (event) => { const box = canvas.getBoundingClientRect(); return { x: event.clientX - box.left, y: event.clientY - box.top }; };
    const at = () => frame(panel, canvas.clientWidth, canvas.clientHeight);
    const part = (p) => { const { box } = at(); return [(p.x - box.x) / box.w, 1 - (p.y - box.y) / box.h]; };
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button > 1) return;
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, here(event));
      const moving = (signals.mode === "move") !== (event.shiftKey || event.button === 1) || panel.kind === "curves";
      signals.drag = pointers.size > 1 ? null : { panel, moving, from: here(event), range: null };
    });
    canvas.addEventListener("pointermove", (event) => {
      const now = here(event), was = pointers.get(event.pointerId);
      if (!was) { hover(signals, panel, at(), now); return; }
      if (pointers.size === 2) {
        const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
        const wide = (a) => Math.hypot(a.x - other.x, a.y - other.y) || 1;
        const [x, y] = part({ x: (now.x + other.x) / 2, y: (now.y + other.y) / 2 });
        signals.zoom(panel, wide(was) / wide(now), x, y);
      } else if (signals.drag?.moving) {
        const { box } = at();
        signals.move(panel, -(now.x - was.x) / box.w, (now.y - was.y) / box.h);
      } else if (signals.drag) {
        signals.drag.range = rectangle(panel, at(), signals.drag.from, now);
        signals.linked(panel).forEach((other) => signals.touch(other));
      }
      pointers.set(event.pointerId, now);
    });
    const up = (event) => {
      if (!pointers.delete(event.pointerId)) return;
      const { drag } = signals;
      signals.drag = null;
      if (drag?.range && event.type === "pointerup") { signals.select(signals.ranges(panel, drag.range), panel); signals.selection.range = drag.range; }
      else if (drag && !drag.moving && event.type === "pointerup") signals.select(null);
      signals.touch(panel);
    };
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, up);
    canvas.addEventListener("pointerleave", () => leave(signals));
    canvas.addEventListener("dblclick", () => { signals.setView(panel, panel.home); });
    canvas.addEventListener("wheel", (event) => {
      if (!(event.ctrlKey || event.metaKey || document.activeElement === canvas)) return;
      event.preventDefault();
      const [x, y] = part(here(event));
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) signals.move(panel, event.deltaX / at().box.w, 0);
      else signals.zoom(panel, ZOOM ** (event.deltaY / 100), x, y);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => key(signals, panel, event));
  }

  function rectangle(panel, at, from, to) {
    const { box } = at, inside = (p) => ({ x: Math.min(Math.max(p.x, box.x), box.x + box.w), y: Math.min(Math.max(p.y, box.y), box.y + box.h) });
    const [a, b] = [from, to].map(inside);
    if (Math.abs(a.x - b.x) < 3) return null;
    const x = [a.x, b.x].sort((p, q) => p - q).map(at.valueX);
    return panel.kind === "time" ? { x } : { x, y: [a.y, b.y].sort((p, q) => q - p).map(at.valueY) };
  }

  function key(signals, panel, event) {
    const { u0, u1, v0, v1 } = panel.view, acts = {
      ArrowLeft: () => signals.move(panel, -0.1, 0), ArrowRight: () => signals.move(panel, 0.1, 0),
      "+": () => signals.zoom(panel, 1 / ZOOM), "=": () => signals.zoom(panel, 1 / ZOOM), "-": () => signals.zoom(panel, ZOOM),
      0: () => signals.setView(panel, panel.home), Escape: () => signals.select(null),
    };
    if (panel.kind === "over") Object.assign(acts, { ArrowUp: () => signals.move(panel, 0, 0.1), ArrowDown: () => signals.move(panel, 0, -0.1) });
    if (panel.kind !== "curves") acts.s = acts.S = () => {
      const range = { x: [u0, u1].map(panel.xAxis.from), y: [v0, v1].map(panel.yAxis.from) };
      signals.select(signals.ranges(panel, range), panel);
    };
    if (!acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    acts[event.key]();
  }

  /* The sample under the pointer: its values appear in this panel, its mark in all panels. */
  function hover(signals, panel, at, p) {
    const { signals: values, count } = signals.rows, { box } = at;
    if (!count || panel.kind === "curves" || p.x < box.x || p.x > box.x + box.w) { leave(signals); return; }
    let k = -1;
    if (panel.kind === "time") {
      k = Math.min(place(values.time, at.valueX(p.x)), count - 1);
    } else {
      let least = NEAR ** 2;
      const [line] = panel.lines.filter((own) => !signals.off.has(own.name));
      for (let i = 0; line && i < count; i++) {
        const far = (at.x(values[panel.x][i]) - p.x) ** 2 + (at.y(values[line.line][i]) - p.y) ** 2;
        if (far < least) { least = far; k = i; }
      }
    }
    if (k < 0) { leave(signals); return; }
    signals.near = Object.fromEntries(Object.entries(values).map(([name, x]) => [name, x[k]]));
    const read = [`${number(signals.near.time, 5)} s`, ...(panel.kind === "over" ? [`${panel.x} ${number(signals.near[panel.x])}`] : []),
      ...panel.lines.filter((line) => !signals.off.has(line.name)).map((line) => `${line.name} ${number(signals.near[line.line])}`)];
    signals.panels.forEach((other) => { other.reading.textContent = other === panel ? read.join(", ") : ""; });
    signals.touch();
  }

  function leave(signals) {
    if (!signals.near) return;
    signals.near = null;
    signals.panels.forEach((panel) => { panel.reading.textContent = ""; });
    signals.touch();
  }

  return { listen };
})());
