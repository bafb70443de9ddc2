// Plots as inline SVG, drawn in real pixels so that text keeps its size on every screen.

const DASHES = ["", "7 4", "2 4", "9 3 2 3", "1 3"];

// A marker's outline about (0, 0) with radius r; the shape tells methods apart without colour.
function mark(number, r) {
  const polygon = (corners, turn) =>
    "M" +
    Array.from({ length: corners }, (_, i) => {
      const angle = turn + (2 * Math.PI * i) / corners;
      return `${(1.2 * r * Math.cos(angle)).toFixed(2)} ${(1.2 * r * Math.sin(angle)).toFixed(2)}`;
    }).join("L") +
    "Z";
  const q = r / 2.4;
  return [
    `M${-r} 0a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`,
    polygon(4, Math.PI / 4),
    polygon(4, 0),
    polygon(3, -Math.PI / 2),
    polygon(3, Math.PI / 2),
    `M${-q} ${-r}H${q}V${-q}H${r}V${q}H${q}V${r}H${-q}V${q}H${-r}V${-q}H${-q}Z`,
    polygon(6, 0),
    polygon(5, -Math.PI / 2),
  ][(number + Math.floor(number / COLOURS)) % MARKS];
}

// How a method's curve looks: its line with its marker.
const lineSwatch = (method, dash) =>
  s("svg", { class: "swatch", width: 26, height: 14, viewBox: "0 0 26 14", "aria-hidden": "true" },
    s("path", { class: `line m${method % COLOURS}`, "stroke-dasharray": dash, d: "M1 7H25" }),
    s("path", { class: `mark m${method % COLOURS}`, d: mark(method, 3.6), transform: "translate(13 7)" }));

const STAR = `M${Array.from({ length: 10 }, (_, i) => {
  const angle = (Math.PI * i) / 5 - Math.PI / 2, r = i % 2 ? 3.4 : 8;
  return `${(r * Math.cos(angle)).toFixed(2)} ${(r * Math.sin(angle)).toFixed(2)}`;
}).join("L")}Z`;

function scale(kind, low, high, from, to) {
  const f = kind === "log" ? Math.log10 : (value) => value;
  const a = f(low), b = f(high);
  return (value) => from + ((f(value) - a) / (b - a || 1)) * (to - from);
}

function ticksOf(kind, low, high, most, least = 0) {
  if (kind === "log" && high > 3 * low) {
    for (const steps of [[1, 2, 3, 5, 7], [1, 2, 5], [1, 3], [1]]) {
      const ticks = [];
      for (let power = Math.floor(Math.log10(low)) - 1; power <= Math.ceil(Math.log10(high)); power++) {
        for (const step of steps) {
          const tick = Number((step * 10 ** power).toPrecision(6));
          if (tick >= low * 0.999 && tick <= high * 1.001) ticks.push(tick);
        }
      }
      if (ticks.length <= most) return ticks;
    }
  }
  const rough = (high - low) / Math.max(1, most);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = Math.max(least, power * [1, 2, 5, 10].find((factor) => factor * power >= rough));
  const ticks = [];
  for (let tick = Math.ceil(low / step - 1e-9) * step; tick <= high + 1e-9 * step; tick += step) {
    ticks.push(Number(tick.toPrecision(10)));
  }
  return ticks;
}

// Axes, grid and labels. Returns the group to draw in and the scales.
function frame(svg, width, height, x, y) {
  const margin = { left: 46, right: 12, top: 10, bottom: 40 };
  const sx = scale(x.kind, x.low, x.high, margin.left, width - margin.right);
  const sy = scale(y.kind, y.low, y.high, height - margin.bottom, margin.top);
  const axis = s("g", { class: "axis", "aria-hidden": "true" });
  const yTicks = y.ticks || ticksOf(y.kind, y.low, y.high, 6);
  for (const tick of yTicks) {
    const at = sy(tick);
    axis.append(s("line", { class: "grid", x1: margin.left, x2: width - margin.right, y1: at, y2: at }));
    axis.append(s("text", { x: margin.left - 7, y: at + 4, "text-anchor": "end" }, (y.format || plain)(tick)));
  }
  for (const tick of x.ticks || ticksOf(x.kind, x.low, x.high, Math.floor(width / 62), x.leastStep)) {
    const at = sx(tick);
    axis.append(s("line", { class: "tick", x1: at, x2: at, y1: height - margin.bottom, y2: height - margin.bottom + 4 }));
    axis.append(s("text", { x: at, y: height - margin.bottom + 17, "text-anchor": "middle" }, plain(tick)));
  }
  axis.append(s("line", { class: "base", x1: margin.left, x2: width - margin.right, y1: height - margin.bottom, y2: height - margin.bottom }));
  axis.append(s("text", { class: "name", x: (margin.left + width - margin.right) / 2, y: height - 4, "text-anchor": "middle" }, x.name));
  const inside = s("g");
  svg.replaceChildren(axis, inside);
  return { inside, sx, sy, margin };
}

// Broken where a value is missing, so that a gap is seen as a gap.
const linePath = (values, sx, sy) => values.map((value, i) =>
  (value === null ? "" : `${(values[i - 1] ?? null) === null ? "M" : "L"}${sx(i + 1).toFixed(1)} ${sy(value).toFixed(1)}`)).join("");

function bandPath(low, high, sx, sy) {
  const known = low.map((value, i) => (value === null || high[i] === null ? null : i)).filter((i) => i !== null);
  if (!known.length) return "";
  const up = known.map((i) => `${sx(i + 1).toFixed(1)} ${sy(high[i]).toFixed(1)}`);
  const down = known.reverse().map((i) => `${sx(i + 1).toFixed(1)} ${sy(low[i]).toFixed(1)}`);
  return `M${up.join("L")}L${down.join("L")}Z`;
}

// A plot of curves over the reading count. `spec`: title, alt, y {kind, low, high, ...}, series of
// {method, run, dash, values, low, high, bound}; a bound is a line of its own look, without a mark. stars: {run, x, y,
// words} of others' figures, shown with their run, levels: {y, text}, lines across. onReading(k) is called when the pointer
// asks for a reading.
function curves(spec, onReading) {
  const svg = s("svg", { class: "plot", role: "img", "aria-label": spec.alt });
  const box = h("figure", { class: "chart" }, h("figcaption", {}, spec.title), svg);
  let shown = spec.series, reading = 1, width = 0, scales = null;

  function draw() {
    if (!width) return;
    const height = Math.round(clamp(width * 0.62, 210, 340));
    svg.setAttribute("width", width);
    svg.setAttribute("height", height);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const last = Math.max(2, ...spec.series.map((one) => one.values.length));
    scales = frame(svg, width, height, { kind: "linear", low: 1, high: last, leastStep: 1, name: spec.xName || "readings seen" }, spec.y);
    const { inside, sx, sy, margin } = scales;
    const kept = (value) => (value === null ? null : clamp(value, spec.y.low, spec.y.high));
    if (spec.y.ideal) inside.append(s("path", { class: "ideal", d: `M${sx(1)} ${sy(spec.y.ideal)}H${sx(last)}` }));
    for (const one of shown) {
      if (one.low) {
        inside.append(s("path", { class: `band m${one.method % COLOURS}`, d: bandPath(one.low.map(kept), one.high.map(kept), sx, sy) }));
      }
    }
    for (const one of shown) {
      const look = one.bound ? "bound" : `m${one.method % COLOURS}`;
      inside.append(s("path", { class: `line ${look}`, "stroke-dasharray": one.dash, d: linePath(one.values.map(kept), sx, sy) }));
    }
    for (const level of spec.levels || []) {
      inside.append(s("path", { class: "level", d: `M${sx(1)} ${sy(level.y)}H${sx(last)}` }),
        s("text", { class: "note", x: sx(last), y: sy(level.y) - 5, "text-anchor": "end" }, level.text));
    }
    const runs = new Set(shown.map((one) => one.run));
    for (const star of (spec.stars || []).filter((one) => runs.has(one.run))) {
      inside.append(s("path", { class: `star m${star.run.method % COLOURS}`, d: STAR, transform: `translate(${sx(star.x)} ${sy(star.y)})` },
        s("title", {}, `the paper: ${star.words}`)));
    }
    inside.append(s("line", { class: "cursor", x1: sx(reading), x2: sx(reading), y1: margin.top, y2: height - margin.bottom }));
    for (const one of shown) {
      const value = kept(one.values[reading - 1] ?? null);
      if (value !== null && !one.bound) {
        inside.append(s("path", { class: `dot m${one.method % COLOURS}`, d: mark(one.method, 4), transform: `translate(${sx(reading)} ${sy(value)})` }));
      }
    }
  }
  svg.addEventListener("pointermove", (event) => {
    if (!scales) return;
    const last = Math.max(...spec.series.map((one) => one.values.length));
    const { margin } = scales;
    const share = (event.offsetX - margin.left) / (width - margin.left - margin.right);
    onReading(clamp(Math.round(1 + share * (last - 1)), 1, last));
  });
  whenSized(box, (now) => {
    width = now;
    draw();
  });
  return {
    box,
    show(series, at) {
      shown = series;
      reading = at;
      draw();
    },
  };
}

// A plot of marks that pointer and arrow keys go through. `spec`: title, alt. `points`: in the order of the keys, each
// with the text that is read out. draw(svg, width, height, chosen, choose) draws it all anew; `ratio` and `heights` give
// its height for a width.
function marks(spec, points, ratio, heights, draw) {
  const svg = s("svg", { class: "plot", role: "group", tabindex: 0, "aria-label": `${spec.alt} Use the arrow keys to go from point to point.` });
  const say = h("p", { class: "readout", "aria-live": "polite" }, "Point at a mark, or tab to the plot and use the arrow keys.");
  const box = h("figure", { class: "chart" }, h("figcaption", {}, spec.title), svg, say);
  let chosen = -1, width = 0;

  function drawn() {
    if (!width) return;
    const height = Math.round(clamp(width * ratio, ...heights));
    svg.setAttribute("width", width);
    svg.setAttribute("height", height);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    draw(svg, width, height, chosen, choose);
  }
  function choose(i) {
    if (i === chosen || !points.length) return;
    chosen = i;
    say.textContent = points[i].text;
    drawn();
  }
  svg.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
    const end = { Home: 0, End: points.length - 1 }[event.key];
    if (step === undefined && end === undefined) return;
    event.preventDefault();
    choose(end ?? clamp(chosen + step, 0, points.length - 1));
  });
  whenSized(box, (now) => {
    width = now;
    drawn();
  });
  return box;
}

// What was stated against what came true, both 0 to 1. `spec`: title, alt, points of {run, p, right, count, text}.
function reliability(spec) {
  const points = spec.points;
  const most = Math.max(1, ...points.map((point) => point.count));
  const share = (name) => ({ kind: "linear", low: 0, high: 1, name });
  return marks(spec, points, 0.62, [210, 340], (svg, width, height, chosen, choose) => {
    const { inside, sx, sy } = frame(svg, width, height, share("probability stated"), share());
    inside.append(s("path", { class: "ideal", d: `M${sx(0)} ${sy(0)}L${sx(1)} ${sy(1)}` }));
    for (const run of new Set(points.map((point) => point.run))) {
      const mine = points.filter((point) => point.run === run);
      inside.append(s("path", { class: `line thin m${run.method % COLOURS}`, "stroke-dasharray": run.dash, d: "M" + mine.map((point) => `${sx(point.p)} ${sy(point.right)}`).join("L") }));
    }
    points.forEach((point, i) => {
      inside.append(s("path", {
        class: `mark m${point.run.method % COLOURS}${i === chosen ? " chosen" : ""}`, pointerenter: () => choose(i),
        d: mark(point.run.method, 3 + 5 * Math.sqrt(point.count / most)), transform: `translate(${sx(point.p)} ${sy(point.right)})`,
      }));
    });
  });
}

// A plot of points joined by method, with the frontier behind. `spec`: title, alt, xName, y, points of
// {method, x, y, low, high, budget, frontier, text}.
function scatter(spec) {
  const byTime = [...spec.points].sort((a, b) => a.x - b.x);
  return marks(spec, byTime, 0.72, [250, 420], (svg, width, height, chosen, choose) => {
    const xs = spec.points.map((point) => point.x);
    const x = { kind: "log", low: Math.min(...xs) / 1.35, high: Math.max(...xs) * 1.5, name: spec.xName };
    const { inside, sx, sy } = frame(svg, width, height, x, spec.y);
    const best = byTime.filter((point) => point.frontier);
    if (best.length) {
      let path = `M${sx(best[0].x)} ${sy(best[0].y)}`;
      for (const point of best.slice(1)) path += `H${sx(point.x)}V${sy(point.y)}`;
      inside.append(s("path", { class: "frontier", d: path }));
    }
    for (const method of new Set(spec.points.map((point) => point.method))) {
      const mine = spec.points.filter((point) => point.method === method);
      inside.append(s("path", { class: `line thin m${method % COLOURS}`, d: "M" + mine.map((p) => `${sx(p.x)} ${sy(p.y)}`).join("L") }));
    }
    for (const point of spec.points) {
      if (point.low !== undefined && point.low !== null) {
        const [low, high] = [point.low, point.high].map((value) => sy(clamp(value, spec.y.low, spec.y.high)));
        inside.append(s("line", { class: `bar m${point.method % COLOURS}`, x1: sx(point.x), x2: sx(point.x), y1: low, y2: high }));
      }
    }
    byTime.forEach((point, i) => {
      const at = `translate(${sx(point.x)} ${sy(point.y)})`;
      if (point.frontier) inside.append(s("circle", { class: "ring", r: 9, transform: at }));
      const look = `mark m${point.method % COLOURS}${i === chosen ? " chosen" : ""}`;
      inside.append(s("path", { class: look, d: mark(point.method, 5), transform: at, pointerenter: () => choose(i) }));
    });
    // Budgets beside their marks, those of the frontier first; where there is no room, the mark says it when pointed at.
    const taken = byTime.map((point) => [sx(point.x) - 6, sy(point.y) - 6, 12, 12]);
    for (const point of [...best, ...byTime.filter((one) => !one.frontier)]) {
      const wide = 6.5 * (point.budget || "").length, at = [sx(point.x), sy(point.y)];
      const free = [[9, -7], [9, 14], [-9 - wide, -7], [-9 - wide, 14]].map(([x, y]) => [at[0] + x, at[1] + y]).find(([x, y]) =>
        x + wide < width && taken.every(([left, top, w, high]) => x + wide + 3 < left || left + w + 3 < x || y < top || top + high < y - 10));
      if (!wide || !free) continue;
      taken.push([free[0], free[1] - 10, wide, 10]);
      inside.append(s("text", { class: `note m${point.method % COLOURS}`, x: free[0], y: free[1] }, point.budget));
    }
    if (chosen >= 0) {
      const point = byTime[chosen];
      inside.append(s("circle", { class: "halo", cx: sx(point.x), cy: sy(point.y), r: 12 }));
    }
  });
}
