// Tables: headlines, conditions, confusion, and the values behind plots.

// The plot of that name, as it was drawn for the page.
const plot = (name, title) => h("figure", { class: "chart" }, h("figcaption", {}, title), document.getElementById(name).content.cloneNode(true));

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

// A table that scrolls sideways by itself, so that the page never does.
function scrolling(label, table) {
  const box = h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": label }, table);
  whenSized(box, () => box.classList.toggle("wider", box.scrollWidth > box.clientWidth + 1));
  return h("div", { class: "scroller" }, box, h("p", { class: "more", "aria-hidden": "true" }, "the table goes on to the right: scroll it →"));
}

const heads = (words) => h("thead", {}, h("tr", {}, words.map((text) => h("th", { scope: "col" }, text))));

const swatch = (method) => {
  const svg = s("svg", { class: "swatch", width: 14, height: 14, viewBox: "-7 -7 14 14", "aria-hidden": "true" });
  svg.append(s("path", { class: `mark m${method % COLOURS}`, d: mark(method, 4.5) }));
  return svg;
};

// A figure, and small its interval, with as many decimals, `digits` at least, as tell the interval's ends apart; with
// three digits in all if `digits` is null.
function within([value, low, high], digits) {
  if (digits === null) return [plain(value)];
  const known = typeof low === "number" && typeof high === "number";
  while (known && low < high && digits && digits < 6 && fixed(low, digits) === fixed(high, digits)) digits++;
  if (!known && value > 0 && value < 0.5 * 10 ** -digits) return [`<${fixed(10 ** -digits, digits)}`];
  return [fixed(value, digits), known && (digits || low < high) && h("small", {}, `${fixed(low, digits)}–${fixed(high, digits)}`)];
}

// A figure of a run after reading k + 1, or of the whole run, with its interval where that is known.
const figureOf = (run, name, k) => (Array.isArray(run.figures[name]) ? run.figures[name].map((part) => part.at(k)) : [run.figures[name]]);
const figureCell = (run, name, k) => within(figureOf(run, name, k), data.figures[name].digits);
// The names of the figures that a section shows.
const figuresOf = (section) => Object.keys(data.figures).filter((name) => data.figures[name].section === section);

// Those of them that some run has after some reading.
const knownOf = (runs, names) => names.filter((name) => runs.some((run) => run.figures[name][0].some((value) => value !== null)));

// The headline table of the runs of a task. A click on a heading sorts by it.
function headlineTable(task) {
  const columns = [
    { heading: "run", value: (run) => run.label, cell: (run) => [swatch(run.method), run.label] },
    { heading: "trials", value: (run) => run.trials, cell: (run) => [String(run.trials), h("small", {}, `${run.letters.length} ${data.thing}${run.letters.length > 1 ? "s" : ""}${run.scans > 1 ? `, ${run.scans} scans` : ""}`)] },
    ...task.headlines.map(({ heading, digits }, i) => ({ heading, value: (run) => run.headlines[i][0], cell: (run) => within(run.headlines[i], digits) })),
  ];
  const rows = task.runs.map((run) =>
    h("tr", {}, columns.map((column, i) =>
      h(i ? "td" : "th", { "data-value": column.value(run), class: i ? "number" : null, scope: i ? null : "row" }, column.cell(run)))));
  const table = h("table", { class: "wide" }, heads(columns.map((column) => column.heading)), h("tbody", {}, rows));
  sortable(table);
  const options = task.runs.filter((run) => run.description).map((run) => h("p", { class: "hint" }, swatch(run.method), `${run.label}: ${run.description}`));
  return [
    scrolling("Headline figures of every run", table),
    options.length > 0 && h("details", { open: options.length < 4 }, h("summary", {}, "The options"), options,
      h("p", { class: "hint" }, "Bins are named as they were asked for; where equal steps cannot make as many, there are fewer.")),
  ];
}

const MEASURES = ["settled_95", "all_right_from", "error_mm", "accuracy"];

// One row a task, one column a run: how each holds up when the data get worse.
function conditionsTable(protocol) {
  const labels = [...new Set(protocol.tasks.flatMap((task) => task.runs.map((run) => run.label)))];
  const holder = h("div");
  function fill(name) {
    const { digits, better } = data.figures[name];
    const cells = protocol.tasks.map((task) => labels.map((label) => {
      const run = task.runs.find((one) => one.label === label);
      return run ? figureOf(run, name, -1)[0] : undefined;
    }));
    const known = cells.flat().filter((v) => typeof v === "number");
    const [low, high] = [Math.min(...known), Math.max(...known)];
    const shade = (v) => {
      if (v === undefined) return "";
      if (v === null) return "shade4";
      const t = high > low ? (v - low) / (high - low) : 0;
      return `shade${Math.round(4 * (better < 0 ? t : 1 - t))}`;
    };
    const head = h("tr", {}, h("th", { scope: "col" }, "condition"), labels.map((label) => h("th", { scope: "col" }, label)));
    const rows = protocol.tasks.map((task, i) =>
      h("tr", {}, h("th", { scope: "row" }, task.name), cells[i].map((v) => h("td", { class: shade(v) }, v === undefined ? "" : fixed(v, digits)))),
    );
    holder.replaceChildren(scrolling("Every condition against every run", h("table", { class: "wide" }, h("thead", {}, head), h("tbody", {}, rows))));
  }
  const pick = choice("Show", MEASURES.map((name) => [name, data.figures[name].heading + (data.figures[name].section ? ", at the end" : "")]), fill);
  fill(MEASURES[0]);
  return [h("div", { class: "controls" }, pick.field), holder];
}

// The confusion matrix of a run after a number of readings.
function confusionTable(run, reading) {
  const { letters, right, counts } = run.confusion;
  const all = row(counts, reading - 1);
  const n = letters.length;
  const rows = letters.map((truth, i) => {
    const mine = [...all.subarray(i * n, (i + 1) * n)];
    const total = mine.reduce((sum, count) => sum + count, 0);
    if (!total) return null;
    return h("tr", {}, h("th", { scope: "row" }, truth), mine.map((count, j) => {
      const cell = h("td", { class: j === right[i] ? "right" : count ? "wrong" : "none" }, count ? String(count) : "·");
      cell.style.setProperty("--share", (count / total).toFixed(3));
      return cell;
    }));
  });
  const head = h("tr", {}, h("th", { scope: "col" }, "true \\ said"), letters.map((label) => h("th", { scope: "col" }, label)));
  return scrolling(
    `Confusion matrix of ${run.label} after ${reading} readings`,
    h("table", { class: n > 12 ? "confusion large" : "confusion" }, h("caption", {}, swatch(run.method), run.label),
      h("thead", {}, head), h("tbody", {}, rows)),
  );
}

// The learned maps of the letters, each with its own scale.
function mapSet(set) {
  const canvases = set.charts.map((chart) => {
    const canvas = h("canvas", { class: "map", role: "img", "aria-label": `Learned map of ${chart.letter}` });
    const limit = plain(chart.limit);
    return h("figure", { class: "chart small" }, h("figcaption", {}, chart.letter, h("small", {}, `±${limit}, ${plain(chart.width)} mm wide`)), canvas);
  });
  const bar = h("canvas", { class: "scale", "aria-hidden": "true" });
  const draw = () => {
    set.charts.forEach((chart, i) => {
      const [rows, columns] = chart.root.shape;
      const values = array(chart.root);
      paint(canvases[i].querySelector("canvas"), rows, columns, (k) => ramp("map", 0.5 + values[k] / 254));
    });
    paint(bar, 1, 128, (k) => ramp("map", k / 127));
  };
  onTheme(draw);
  draw();
  return [
    h("p", { class: "hint" }, `Learned by ${set.runs.join("; ")}.`),
    h("div", { class: "maps" }, canvases),
    h("div", { class: "legend-bar" }, "−", bar, "+", h("span", {}, "log-odds of occupancy, the prior taken off: minus is free, the middle was not touched, plus is occupied. Each map has a scale of its own, up to its largest value.")),
  ];
}
