// The page: a header, then a section for each protocol; runs of two protocols never meet.

function header() {
  const runs = data.protocols.flatMap((protocol) => protocol.tasks.flatMap((task) => task.runs));
  const count = runs.reduce((sum, run) => sum + run.scans, 0);
  const pooled = count > runs.length ? ", those that differ in the seed alone taken together" : "";
  const facts = [`${count} run${count > 1 ? "s" : ""}${pooled}`, ...data.dates.slice(0, 1), data.machine];
  pageHeader("Recognising objects by touch: what each method gets right, how exactly, and what it costs", facts.join(" · "), data.remarks,
    [`Made with ${data.versions}.`, "Every plotted curve stands beside this page as CSV."]);
}

const section = (title, ...content) => h("section", { class: "block", "aria-label": title }, h("h3", {}, title), content);

function readingsSection(task) {
  const spec = (run) => ({ method: run.method, dash: run.dash, run });
  const ranks = new Map();
  for (const run of [...task.runs].reverse()) {
    const rank = ranks.get(run.method) || 0;
    run.dash = DASHES[rank % DASHES.length]; // the largest budget of a method is the solid line
    run.rank = rank;
    ranks.set(run.method, rank + 1);
  }
  const visible = new Set(task.runs.filter((run) => task.runs.length <= 6 || run.rank === 0).slice(0, 8));
  const series = (value, low, high) => (run) => ({ ...spec(run), values: run[value], low: run[low], high: run[high] });
  const accuracy = series("accuracy", "accuracyLow", "accuracyHigh");
  const error = series("error", "errorLow", "errorHigh");
  const bounded = task.runs.find((run) => run.bound.some((value) => value !== null));
  const bound = bounded ? [{ bound: true, dash: "5 3", values: bounded.bound }] : [];
  const [low, high] = task.errorAxis;
  const stars = task.printed.map((one) => ({ ...one, run: task.runs[one.run], x: one.readings, y: one.share }));

  const last = Math.max(...task.runs.map((run) => run.readings));
  const control = slider("Values at reading", last, Math.min(10, last), update);
  const move = (k) => {
    if (String(k) !== control.input.value) control.set(k);
  };
  const left = curves({
    title: "Share of trials right", alt: "Accuracy against readings seen",
    y: { kind: "linear", low: 0, high: 1 }, series: task.runs.map(accuracy), stars: stars.filter((one) => one.x <= last),
  }, move);
  const right = curves({
    title: "Placement error where the letter is right, mm", alt: "Placement error against readings seen",
    y: { kind: "log", low, high }, series: [...task.runs.map(error), ...bound],
    levels: stars.filter((one) => one.error !== null).map((one) => ({ y: one.error, text: `the paper: ${one.error} mm` })),
  }, move);
  const values = runsTable([
    ["right", (run, k) => within(run.accuracy[k], run.accuracyLow[k], run.accuracyHigh[k], 3)],
    ["error, mm", (run, k) => within(run.error[k], run.errorLow[k], run.errorHigh[k], 2)],
    ["error / bound", (run, k) => fixed(run.efficiency[k], 2)],
    ["error over all trials, mm", (run, k) => fixed(run.errorAll[k], 2)],
  ]);
  const boxes = task.runs.map((run) => {
    const input = h("input", { type: "checkbox", checked: visible.has(run) });
    input.addEventListener("change", () => {
      if (input.checked) visible.add(run);
      else visible.delete(run);
      update(Number(control.input.value));
    });
    return h("label", { class: "toggle" }, input, lineSwatch(run.method, run.dash), run.label);
  });
  const set = (runs) => {
    visible.clear();
    for (const run of runs) visible.add(run);
    task.runs.forEach((run, i) => (boxes[i].querySelector("input").checked = visible.has(run)));
    update(Number(control.input.value));
  };
  const buttons = task.runs.length > 3 && [
    h("button", { type: "button", click: () => set(task.runs) }, "All"),
    h("button", { type: "button", click: () => set([]) }, "None"),
  ];

  function update(reading) {
    const shown = task.runs.filter((run) => visible.has(run));
    left.show(shown.map(accuracy), reading);
    right.show([...shown.map(error), ...bound], reading);
    values.show(shown, reading);
  }
  update(Math.min(10, last));
  return section("Accuracy and error against readings",
    h("fieldset", { class: "legend" }, h("legend", {}, "Runs"), boxes, buttons),
    h("div", { class: "two" }, left.box, right.box),
    h("p", { class: "hint" }, `${bandWords(task)}${bounded ? " Dashed in grey: the Cramer-Rao bound of the error." : ""}${stars.length ? " Stars: what the paper prints." : ""}`),
    task.notes.map((note) => h("p", { class: "hint" }, note)),
    h("div", { class: "controls" }, control.field),
    scrolling("Values at the chosen reading", values.table));
}

// Runs at a reading, a row each; columns: what each is called, and what it says of a run after reading k + 1.
function runsTable(columns) {
  const body = h("tbody");
  const table = h("table", { class: "values" }, heads(["run", ...columns.map(([title]) => title)]), body);
  const row = (run, k) => h("tr", {}, h("th", { scope: "row" }, swatch(run.method), run.label),
    columns.map(([, cell]) => h("td", {}, cell(run, k))));
  return { table, show: (runs, reading) => body.replaceChildren(...runs.map((run) => row(run, reading - 1))) };
}

const bandWords = (task) => (task.runs.some((run) => run.scans > 1)
  ? "Bands: 95 % intervals over scans and trials."
  : "Bands: 95 % Wilson interval of the share, 95 % interval of the mean error.");

// What the paper prints, beside what came out here.
function paperSection(task) {
  const titles = ["filter", "bins (Table I)", "the paper: right", "here, as early", "the paper: error, mm", `here, after ${task.readings}`];
  const rows = task.printed.map((one) => {
    const run = task.runs[one.run], k = one.readings - 1, last = task.readings - 1;
    return h("tr", {}, h("th", { scope: "row" }, swatch(run.method), run.label), h("td", {}, one.bins ?? MISSING),
      h("td", {}, `${fixed(one.share, 2)} from ${one.readings} readings`),
      h("td", {}, within(run.accuracy[k], run.accuracyLow[k], run.accuracyHigh[k], 3)),
      h("td", {}, one.error ?? MISSING), h("td", {}, within(run.error[last], run.errorLow[last], run.errorHigh[last], 2)));
  });
  return section("Beside what the paper prints", scrolling("The paper's figures and those found here",
    h("table", { class: "values" }, heads(titles), h("tbody", {}, rows))),
    h("p", { class: "hint" }, "The paper pressed real letters by hand against a real pad; here both are simulated. The paper gives its results without intervals."));
}

// Uncertainty and its calibration: regions of the pose, and the letter's probability. Methods without
// samples have no regions.
function certaintySection(task) {
  const right = reliability({
    title: "Share right against the probability stated", alt: "Reliability diagram of the letter's probability.",
    points: task.runs.flatMap((run) => run.reliability.map((bin) => ({
      ...bin, run,
      text: `${run.label}: ${bin.count} estimates stated with ${fixed(bin.p, 3)} on average, of which ${fixed(bin.right, 3)} are right`,
    }))),
  });
  const marked = "all readings of all trials; the larger a mark, the more estimates it stands for.";
  const title = "Uncertainty and its calibration";
  const sure = task.runs.filter((run) => run.coverage90.some((value) => value !== null));
  if (!sure.length) return section(title, h("div", { class: "two" }, right), h("p", { class: "hint" }, `Dashed: as it should be. Marks: ${marked}`));

  const last = Math.max(...task.runs.map((run) => run.readings));
  const held = (run) => ({ method: run.method, dash: run.dash, values: run.coverage90 });
  const control = slider("How sure at reading", last, Math.min(10, last), update);
  const left = curves({
    title: "Share of 90 % regions that hold the truth", alt: "Coverage of the 90 % regions against readings seen",
    y: { kind: "linear", low: 0, high: 1, ideal: 0.9 }, series: sure.map(held),
  }, (k) => {
    if (String(k) !== control.input.value) control.set(k);
  });
  const values = runsTable([
    ["90 % regions that hold the truth", (run, k) => fixed(run.coverage90[k], 3)],
    ["50 % regions", (run, k) => fixed(run.coverage50[k], 3)],
    ["90 % within, mm", (run, k) => fixed(run.sharpness[k], 2)],
    ["error, mm", (run, k) => fixed(run.error[k], 2)],
  ]);
  function update(reading) {
    left.show(sure.map(held), reading);
    values.show(task.runs, reading);
  }
  update(Math.min(10, last));
  return section(title,
    h("p", { class: "lead" }, "A region is all placements within a distance of the estimate that hold together 90 % of the belief. Its radius is the error that the method itself expects not to exceed in nine of ten trials."),
    h("div", { class: "two" }, left.box, right),
    h("p", { class: "hint" }, `Dashed: as it should be. Left: over the trials whose letter is right. Right: ${marked}`),
    h("div", { class: "controls" }, control.field),
    scrolling("How sure at the chosen reading", values.table));
}

function paretoSection(task, methods) {
  const points = task.pareto.map((point) => ({ ...point, of: task.runs[point.run], ms: 1e3 * point.seconds }));
  const xName = "processor time of a recognition, ms";
  const words = (point) =>
    `${point.of.label}: ${plain(point.ms)} ms; error ${fixed(point.error, 2)} mm; 95 % settled${point.settled ? ` by ${point.settled}` : `: not yet by reading ${task.readings}`}`;
  const placed = points.filter((point) => point.error !== null);
  const errors = placed.flatMap((point) => [point.error, point.low, point.high]).filter((value) => value > 0);
  const late = task.readings * 1.35;
  const ticks = [1, 2, 3, 5, 7, 10, 15, 20, 30, 40, 60, 100, 150].filter((tick) => tick <= task.readings);
  const never = points.some((point) => point.settled === null);
  const settled = points.map((point) => point.settled ?? late);
  const common = (point) => ({ method: point.of.method, x: point.ms, budget: point.of.budget, text: words(point) });
  const left = errors.length > 0 && scatter({
    title: `Placement error after ${task.readings} readings, mm`, alt: "Computing time against placement error.", xName,
    y: { kind: "log", low: Math.max(Math.min(...errors) / 1.15, task.errorAxis[0]), high: Math.max(...errors) * 1.15 },
    points: placed.map((point) => ({ ...common(point), y: Math.max(point.error, task.errorAxis[0]), low: point.low, high: point.high, frontier: point.errorFrontier })),
  });
  const right = scatter({
    title: "Readings until 95 % of the trials are and stay right", alt: "Computing time against readings needed.", xName,
    y: {
      kind: "log", low: Math.max(0.8, Math.min(...settled) / 1.25), high: never ? late * 1.1 : Math.max(...settled) * 1.2,
      ticks: [...ticks.filter((tick) => tick >= Math.min(...settled) / 1.25 && tick <= Math.max(...settled) * 1.2), ...(never ? [late] : [])],
      format: (value) => (value > task.readings ? "later" : plain(value)),
    },
    points: points.map((point) => ({ ...common(point), y: point.settled ?? late, frontier: point.settledFrontier })),
  });
  const used = [...new Set(task.runs.map((run) => run.method))];
  const legend = h("ul", { class: "keys" }, used.map((method) => h("li", {}, swatch(method), methods[method])), h("li", {}, h("span", { class: "ring-key" }), "on the frontier"));
  const yes = (flag) => (flag ? "yes" : "");
  const table = h("table", { class: "values" },
    heads(["run", "ms a recognition", "error, mm", "on its frontier", "95 % settled by", "on its frontier"]),
    h("tbody", {}, points.map((point) =>
      h("tr", {}, h("th", { scope: "row" }, swatch(point.of.method), point.of.label), h("td", {}, plain(point.ms)), h("td", {}, fixed(point.error, 2)),
        h("td", {}, yes(point.errorFrontier)), h("td", {}, String(point.settled ?? MISSING)), h("td", {}, yes(point.settledFrontier))))));
  return section("Run time against error",
    h("p", { class: "lead" }, `Each mark is a run, each line a method over its budget. Time is the median over the trials of the processor time that all updates and estimates of ${task.readings} readings take, ` +
      `mapping not counted; bars are the 95 % interval of the mean. No other run is at once as fast and as good as a run on the frontier. Measured on ${task.machine}.`),
    legend,
    h("div", { class: "two" }, left, right),
    h("details", {}, h("summary", {}, "The values"), scrolling("Time and error of every run", table)));
}

// The matrices of each method's largest budget side by side, or of one run.
function confusionSection(task) {
  const largest = [...new Map(task.runs.map((run) => [run.method, run])).values()];
  const last = Math.max(...task.runs.map((run) => run.readings));
  const holder = h("div", { class: "matrices" });
  let chosen = largest;
  const fill = (reading) => holder.replaceChildren(...chosen.map((run) => confusionTable(run, Math.min(reading, run.readings))));
  const control = slider("After reading", last, last, fill);
  const several = largest.length > 1 ? [["", task.runs.length > largest.length ? "largest budget of each method" : "all"]] : [];
  const pick = choice("Runs", [...several, ...task.runs.map((run, i) => [i, run.label])], (i) => {
    chosen = i === "" ? largest : [task.runs[i]];
    fill(Number(control.input.value));
  });
  if (!several.length) pick.select.value = String(task.runs.indexOf(largest[0]));
  fill(last);
  return section("Which letters are taken for which",
    h("div", { class: "controls" }, pick.field, control.field),
    h("p", { class: "hint" }, "Rows: the true letter. Columns: what is said. Numbers: trials."),
    holder);
}

function taskSections(task, protocol) {
  return [
    section("Headlines", headlineTable(task)),
    task.printed.length > 0 && paperSection(task),
    task.runs.length > 1 && paretoSection(task, protocol.methods),
    readingsSection(task),
    certaintySection(task),
    confusionSection(task),
  ];
}

function protocolSection(protocol) {
  const many = protocol.tasks.length > 1;
  const content = h("div", {}, taskSections(protocol.tasks[0], protocol));
  const pick = many && choice("Condition", protocol.tasks.map((task, i) => [i, task.name]), (i) => content.replaceChildren(...taskSections(protocol.tasks[i], protocol).flat().filter(Boolean)));
  const about = !many && protocol.tasks[0].name !== "defaults" && h("p", { class: "lead" }, `Differs from the defaults in: ${protocol.tasks[0].name}.`);
  const trials = protocol.recognitions.length > 0;
  const of = many && protocol.replayedTask !== null ? ` (condition: ${protocol.replayedTask})` : "";
  return h("section", { class: "protocol", "aria-label": protocol.name },
    h("h2", {}, protocol.title), about,
    many && section("Conditions", conditionsTable(protocol)),
    pick && h("div", { class: "controls" }, pick.field),
    content,
    trials && section(`A recognition, reading by reading${of}`, recognitionView(protocol)),
    protocol.maps.length > 0 && section(`Learned maps${of}`, protocol.maps.map(mapSet)));
}

async function start() {
  await unpackArrays();
  header();
  document.getElementById("content").append(...data.protocols.map(protocolSection));
  document.documentElement.dataset.ready = "yes";
}

start();
