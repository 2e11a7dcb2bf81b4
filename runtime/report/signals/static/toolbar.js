"use strict";
/* Above the panels: the toolbar, the legend, and statistics of the selection. */
Object.assign(globalThis.TendonSignals, (() => {
  const { number, statistics } = globalThis.TendonSignals;
  const ZOOM = 1.25;

  const make = (name, attributes = {}, ...inside) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...inside);
    return made;
  };

  function bar(signals) {
    const button = (text, what, act) => {
      const made = make("button", { type: "button", "aria-label": what, title: what }, text);
      made.addEventListener("click", act);
      return made;
    };
    const modes = ["select", "move"].map((mode) => {
      const made = button(mode === "select" ? "Select" : "Move", mode === "select" ? "Drag to select samples" : "Drag to move the view", () => setMode(signals, mode));
      made.dataset.mode = mode;
      return made;
    });
    signals.mode = "select";
    signals.modes = modes;
    modes.forEach((made) => made.setAttribute("aria-pressed", String(made.dataset.mode === signals.mode)));
    const time = () => signals.panels.find((panel) => panel.kind === "time") ?? signals.panels[0];
    return make("div", { class: "signals-bar", role: "toolbar", "aria-label": `View of ${signals.spec.title}` },
      make("span", { class: "signals-group" }, ...modes),
      make("span", { class: "signals-group" },
        button("−", "Zoom out in time", () => signals.zoom(time(), ZOOM ** 3)),
        button("+", "Zoom in in time", () => signals.zoom(time(), ZOOM ** -3)),
        button("All", "Show all of every panel", () => { signals.panels.forEach((panel) => { panel.view = { ...panel.home }; }); signals.touch(); })),
      button("Clear selection", "Clear the selection", () => signals.select(null)),
      make("span", { class: "signals-legend" }, ...legend(signals)));
  }

  function legend(signals) {
    const found = new Map();
    for (const panel of signals.spec.panels) for (const line of [...panel.lines, ...panel.curves]) if (!found.has(line.name)) found.set(line.name, line);
    if (found.size < 2) return [];
    return [...found.values()].map((line) => {
      const made = make("button", { type: "button", "aria-pressed": "true", "data-colour": line.colour, title: `Show or hide ${line.name}` },
        make("span", { class: line.dashed ? "swatch dashed" : "swatch" }), line.name);
      made.addEventListener("click", () => {
        const hide = !signals.off.has(line.name);
        if (hide) signals.off.add(line.name); else signals.off.delete(line.name);
        made.setAttribute("aria-pressed", String(!hide));
        signals.touch();
      });
      return made;
    });
  }

  function setMode(signals, mode) {
    signals.mode = mode;
    signals.modes.forEach((made) => made.setAttribute("aria-pressed", String(made.dataset.mode === mode)));
  }

  /* Shows the statistics of the selection. */
  function showStatistics(signals) {
    const { spec } = signals, some = signals.lit ?? signals.rows, found = statistics(some, signals.rows, spec);
    const percent = (x) => `${number(100 * x)}\u00a0%`;
    const facts = [
      [signals.lit ? "selected" : "all samples", `${found.samples.toLocaleString("en")} ${signals.lit ? `(${percent(found.share)})` : ""}`],
      ["time", found.samples ? `${number(found.from, 4)} … ${number(found.to, 4)} s` : "–"],
      ...found.lines.filter((line) => !signals.off.has(line.name)).flatMap((line) => [
        [`${line.name}, mean`, `${number(line.mean)} ${spec.units[line.name] ?? spec.unit}`],
        [`${line.name}, rms`, `${number(line.rms)} ${spec.units[line.name] ?? spec.unit}${spec.floor ? ` = ${number(line.floors)} × floor` : ""}`],
        ...(signals.lit && spec.floor ? [[`of all squares of ${line.name}`, percent(line.squares)]] : []),
      ]),
    ];
    const list = make("dl", {}, ...facts.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
    signals.said.toggleAttribute("data-lit", Boolean(signals.lit));
    signals.said.replaceChildren(list, ...(found.estimated ? [make("p", {}, `Mean and rms of ${some.count.toLocaleString("en")} of them, picked at random.`)] : []));
  }

  return { make, bar, showStatistics, ZOOM };
})());
