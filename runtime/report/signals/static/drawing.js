"use strict";
/* Draws a panel on its canvas: axes, noise floor, lines, clouds, curves and the selection. */
Object.assign(globalThis.TendonSignals, (() => {
  const { ticks, tick, place, number } = globalThis.TendonSignals;
  const EDGE = { left: 58, right: 12, top: 8, bottom: 33 };
  const BROAD = 3.4, PALE = 0.4;
  const GAP = 5, DOT = { few: 0.55, many: 0.2, faded: 0.12, lit: 0.75 };

  /* The frame of a panel: its rectangle, and conversions between values and pixels. */
  function frame(panel, width, height) {
    const { view } = panel, box = { x: EDGE.left, y: EDGE.top, w: width - EDGE.left - EDGE.right, h: height - EDGE.top - EDGE.bottom };
    const across = box.w / (view.u1 - view.u0), up = box.h / (view.v1 - view.v0);
    return {
      box,
      x: (value) => box.x + (panel.xAxis.to(value) - view.u0) * across,
      y: (value) => box.y + box.h - (panel.yAxis.to(value) - view.v0) * up,
      valueX: (px) => panel.xAxis.from(view.u0 + (px - box.x) / across),
      valueY: (py) => panel.yAxis.from(view.v0 + (box.y + box.h - py) / up),
    };
  }

  /* The colour of what was measured, where models are drawn over it. */
  const pale = ({ rgb }) => `rgb(${rgb.paper.map((c, k) => Math.round(c + PALE * (rgb.ink[k] - c))).join()})`;

  /* Whether a line breaks: the value is NaN, or samples are missing. */
  const broken = (data, least, k, first) => Number.isNaN(least[k]) || (k > first && data.t[k] - data.t[k - 1] > GAP * data.pitch);

  /* A line over time that joins every sample. */
  function closely(pen, at, data, line, first, last) {
    const { t } = data, least = data.least[line], most = data.most[line];
    let joined = false;
    pen.beginPath();
    for (let k = first; k <= last; k++) {
      if (broken(data, least, k, first)) joined = false;
      if (Number.isNaN(least[k])) continue;
      const x = at.x(t[k]);
      if (joined) pen.lineTo(x, at.y(least[k])); else pen.moveTo(x, at.y(least[k]));
      if (most[k] !== least[k]) pen.lineTo(x, at.y(most[k]));
      joined = true;
    }
    pen.stroke();
  }

  /* A line over a long time: in each column of pixels a bar from its smallest to its largest value, extended to meet the
     bar before. Filled rectangles on whole pixels are fast; a path with as many strokes takes a tenth of a second. */
  function densely(pen, at, data, line, first, last, scale, broad) {
    const { t } = data, least = data.least[line], most = data.most[line], wide = 1 / scale;
    let column = NaN, low = 0, high = 0, low0 = NaN, high0 = NaN;
    const bar = () => {
      if (Number.isNaN(column)) return;
      const top = Math.round(at.y(high < low0 ? low0 : high) * scale), bottom = Math.round(at.y(low > high0 ? high0 : low) * scale);
      pen.fillRect(column * wide - broad / 2, top * wide - broad / 2, wide + broad, Math.max(bottom - top, 1) * wide + broad);
      low0 = low;
      high0 = high;
    };
    for (let k = first; k <= last; k++) {
      if (broken(data, least, k, first)) { bar(); column = low0 = high0 = NaN; }
      if (Number.isNaN(least[k])) continue;
      const here = Math.floor(at.x(t[k]) * scale);
      if (here === column) {
        if (least[k] < low) low = least[k];
        if (most[k] > high) high = most[k];
      } else {
        bar();
        column = here; low = least[k]; high = most[k];
      }
    }
    bar();
  }

  /* broad: px by which a line is wider than a thin one. */
  function trace(pen, at, data, line, begin, end, scale, broad) {
    const { t } = data, first = Math.max(0, place(t, begin) - 1), last = Math.min(t.length - 1, place(t, end));
    if (first > last) return;
    const dense = (at.x(t[last]) - at.x(t[first])) * scale < 2 * (last - first);
    if (dense) densely(pen, at, data, line, first, last, scale, broad); else closely(pen, at, data, line, first, last);
  }

  /* The background of the frame with the noise floor, as an image to which dots are added. */
  function background(pen, at, panel, colours, scale) {
    const { box } = at, wide = Math.max(1, Math.round(box.w * scale)), tall = Math.max(1, Math.round(box.h * scale));
    const image = pen.createImageData(wide, tall), words = new Uint32Array(image.data.buffer);
    const word = ([r, g, b]) => (255 << 24) | (b << 16) | (g << 8) | r;
    const mixed = colours.rgb.paper.map((c, k) => Math.round(c + 0.2 * (colours.rgb.faint[k] - c)));
    const top = Math.round((at.y(panel.band) - box.y) * scale), bottom = Math.round((at.y(panel.low0) - box.y) * scale);
    words.fill(word(colours.rgb.paper));
    if (panel.band > 0) words.fill(word(mixed), wide * Math.min(Math.max(top, 0), tall), wide * Math.min(Math.max(bottom, 0), tall));
    return { image, wide, tall };
  }

  /* Adds the dots of samples to an image. */
  function dots(into, at, xs, ys, rgb, alpha, scale) {
    const { image: { data }, wide, tall } = into, size = Math.max(2, Math.round(1.6 * scale));
    const [red, green, blue] = rgb, { box } = at;
    for (let k = 0; k < xs.length; k++) {
      const px = Math.round((at.x(xs[k]) - box.x) * scale), py = Math.round((at.y(ys[k]) - box.y) * scale);
      if (!(px >= 0 && py >= 0 && px + size < wide && py + size < tall)) continue;
      for (let j = 0; j < size; j++) {
        let o = 4 * ((py + j) * wide + px);
        for (let i = 0; i < size; i++, o += 4) {
          data[o] += (red - data[o]) * alpha;
          data[o + 1] += (green - data[o + 1]) * alpha;
          data[o + 2] += (blue - data[o + 2]) * alpha;
        }
      }
    }
  }

  function cloud(pen, at, panel, scene, scale) {
    const { colours, rows, lit, shown } = scene, into = background(pen, at, panel, colours, scale);
    const some = rows ? rows.count : 0, plain = Math.min(DOT.few, Math.max(DOT.many, 600 / Math.max(some, 1)));
    for (const line of panel.lines) {
      if (!rows || !shown(line.name)) continue;
      dots(into, at, rows.signals[panel.x], rows.signals[line.line], lit ? colours.rgb.faint : colours.rgb[line.colour], lit ? DOT.faded : plain, scale);
    }
    for (const line of panel.lines)
      if (lit && shown(line.name)) dots(into, at, lit.signals[panel.x], lit.signals[line.line], colours.rgb[line.colour], Math.min(DOT.lit, Math.max(2 * plain, 600 / Math.max(lit.count, 1))), scale);
    pen.putImageData(into.image, Math.round(at.box.x * scale), Math.round(at.box.y * scale));
  }

  function band(pen, at, panel, colours) {
    if (!(panel.band > 0)) return;
    const top = Math.max(at.y(panel.band), at.box.y), bottom = Math.min(at.y(panel.low0), at.box.y + at.box.h);
    pen.globalAlpha = 0.2;
    pen.fillStyle = colours.faint;
    if (bottom > top) pen.fillRect(at.box.x, top, at.box.w, bottom - top);
    pen.globalAlpha = 1;
  }

  /* Shades the times of the selected samples. */
  function litColumns(pen, at, lit, colours) {
    const { box } = at, { time } = lit.signals, seen = new Uint8Array(Math.ceil(box.w) + 1);
    for (let k = 0; k < time.length; k++) {
      const px = Math.floor(at.x(time[k]) - box.x);
      if (px >= 0 && px < box.w) seen[px] = 1;
    }
    pen.globalAlpha = 0.13;
    pen.fillStyle = colours.ink;
    for (let a = 0; a < box.w; a++) {
      if (!seen[a]) continue;
      let b = a;
      while (b < box.w && seen[b]) b++;
      pen.fillRect(box.x + a, box.y, b - a, box.h);
      a = b;
    }
    pen.globalAlpha = 1;
  }

  function curves(pen, at, panel, scene) {
    for (const curve of panel.curves) {
      if (!scene.shown(curve.name)) continue;
      pen.strokeStyle = scene.colours[curve.colour];
      pen.lineWidth = panel.kind === "curves" ? 1.2 : curve.dashed ? 1.6 : 2.2;
      pen.setLineDash(curve.dashed ? [5, 3] : []);
      pen.beginPath();
      let joined = false;
      curve.x.forEach((x, k) => {
        if (x === null) { joined = false; return; }
        if (joined) pen.lineTo(at.x(x), at.y(curve.y[k])); else pen.moveTo(at.x(x), at.y(curve.y[k]));
        joined = true;
      });
      pen.stroke();
    }
    pen.setLineDash([]);
  }

  function axes(pen, at, panel, colours) {
    const { box } = at, { view } = panel;
    const xs = ticks(panel.xAxis, view.u0, view.u1, box.w / 85), ys = ticks(panel.yAxis, view.v0, view.v1, box.h / 42);
    pen.font = `11px ${colours.font}`;
    pen.lineWidth = 1;
    pen.strokeStyle = colours.rule;
    pen.beginPath();
    for (const y of ys) { pen.moveTo(box.x, Math.round(at.y(y)) + 0.5); pen.lineTo(box.x + box.w, Math.round(at.y(y)) + 0.5); }
    pen.stroke();
    pen.strokeStyle = colours.faint;
    pen.beginPath();
    pen.moveTo(box.x, box.y + box.h + 0.5);
    pen.lineTo(box.x + box.w, box.y + box.h + 0.5);
    for (const x of xs) { pen.moveTo(Math.round(at.x(x)) + 0.5, box.y + box.h); pen.lineTo(Math.round(at.x(x)) + 0.5, box.y + box.h + 4); }
    pen.stroke();
    pen.fillStyle = colours.ink;
    pen.textBaseline = "top";
    pen.textAlign = "center";
    for (const x of xs) pen.fillText(tick(x, xs), at.x(x), box.y + box.h + 6);
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const y of ys) pen.fillText(panel.log ? number(y, 2) : tick(y, ys), box.x - 6, at.y(y));
    pen.fillStyle = colours.faint;
    pen.textAlign = "right";
    pen.textBaseline = "bottom";
    pen.fillText(panel.labels[0], box.x + box.w, box.y + box.h + EDGE.bottom);
    pen.save();
    pen.translate(2, box.y + box.h / 2);
    pen.rotate(-Math.PI / 2);
    pen.textAlign = "center";
    pen.textBaseline = "top";
    pen.fillText(panel.labels[1], 0, 0);
    pen.restore();
  }

  function marks(pen, at, panel, colours) {
    pen.font = `11px ${colours.font}`;
    pen.textBaseline = "top";
    panel.marks.forEach((value, k) => {
      const px = at.x(value), far = px > at.box.x + 0.75 * at.box.w;
      pen.strokeStyle = colours.faint;
      pen.lineWidth = 1;
      pen.setLineDash([3, 3]);
      pen.beginPath();
      pen.moveTo(px, at.box.y);
      pen.lineTo(px, at.box.y + at.box.h);
      pen.stroke();
      pen.setLineDash([]);
      pen.fillStyle = colours.ink;
      pen.textAlign = far ? "right" : "left";
      pen.fillText(`${number(value)} Hz`, px + (far ? -4 : 4), at.box.y + 2 + 13 * k);
    });
  }

  /* The rectangle of the selection, and the sample under the pointer. */
  function brush(pen, at, panel, scene) {
    const { box } = at, range = scene.brushed(panel);
    if (range) {
      const [x0, x1] = range.x.map(at.x), [y1, y0] = range.y ? range.y.map(at.y) : [box.y + box.h, box.y];
      pen.strokeStyle = scene.colours.ink;
      pen.lineWidth = 1;
      pen.setLineDash([4, 3]);
      pen.strokeRect(x0, y0, Math.max(x1 - x0, 1), Math.max(y1 - y0, 1));
      pen.setLineDash([]);
    }
    const near = scene.near;
    if (!near || panel.kind === "curves") return;
    pen.strokeStyle = scene.colours.ink;
    pen.lineWidth = 1;
    pen.beginPath();
    if (panel.kind === "time") { pen.moveTo(at.x(near.time), box.y); pen.lineTo(at.x(near.time), box.y + box.h); }
    else for (const line of panel.lines) {
      if (!scene.shown(line.name)) continue;
      pen.moveTo(at.x(near[panel.x]) + 5, at.y(near[line.line]));
      pen.arc(at.x(near[panel.x]), at.y(near[line.line]), 5, 0, 2 * Math.PI);
    }
    pen.stroke();
  }

  /* Draws a whole panel. `scene` holds the colours, the table of samples, the selection and the blocks of the lines. */
  function draw(panel, scene) {
    const { canvas, pen } = panel, scale = canvas.width / canvas.clientWidth || 1;
    const at = frame(panel, canvas.clientWidth, canvas.clientHeight), { box } = at, { colours } = scene;
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.fillStyle = colours.paper;
    pen.fillRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    if (panel.kind === "over") cloud(pen, at, panel, scene, scale); else band(pen, at, panel, colours);
    axes(pen, at, panel, colours);
    pen.save();
    pen.beginPath();
    pen.rect(box.x, box.y, box.w, box.h);
    pen.clip();
    if (panel.kind === "time") {
      if (scene.lit) litColumns(pen, at, scene.lit, colours);
      for (const line of panel.lines) {
        if (!scene.shown(line.name)) continue;
        // What was measured is a broad pale line below the thin ones of the models, so that both are seen where they agree.
        const broad = line.colour === "ink" && panel.lines.length > 1 ? BROAD : 0;
        pen.strokeStyle = pen.fillStyle = broad ? pale(colours) : colours[line.colour];
        pen.lineWidth = 1.1 + broad;
        for (const [data, begin, end] of scene.stretches(panel)) trace(pen, at, data, scene.lineNumber(line.line), begin, end, scale, broad);
      }
    }
    curves(pen, at, panel, scene);
    marks(pen, at, panel, colours);
    brush(pen, at, panel, scene);
    pen.restore();
  }

  return { draw, frame };
})());
