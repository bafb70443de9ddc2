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
  const ranks = new Map();
  for (const run of [...task.runs].reverse()) {
    const rank = ranks.get(run.method) || 0;
    run.dash = DASHES[rank % DASHES.length]; // the largest budget of a method is the solid line
    run.rank = rank;
    ranks.set(run.method, rank + 1);
  }
  const visible = new Set(task.runs.filter((run) => task.runs.length <= 6 || run.rank === 0).slice(0, 8));
  const placed = document.getElementById(`${task.plots}-error`) !== null;
  const plots = h("div", { class: "two" }, plot(`${task.plots}-share`, "Share of trials right"),
    placed && plot(`${task.plots}-error`, `Placement error where the ${data.thing} is right, mm`));
  const last = Math.max(...task.runs.map((run) => run.readings));
  const control = slider("Values at reading", last, Math.min(10, last), update);
  const values = runsTable(knownOf(task.runs, figuresOf("curves")));
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
    task.runs.forEach((run, i) => plots.querySelectorAll(`.run-${i}`).forEach((part) => part.classList.toggle("off", !visible.has(run))));
    values.show(task.runs.filter((run) => visible.has(run)), reading);
  }
  update(Math.min(10, last));
  const bounded = task.runs.some((run) => run.bounded);
  return section(placed ? "Accuracy and error against readings" : "Accuracy against readings",
    h("fieldset", { class: "legend" }, h("legend", {}, "Runs"), boxes, buttons),
    plots,
    h("p", { class: "hint" }, `${bandWords(task, placed)}${bounded ? " Dashed in the colour of the text: the Cramer-Rao bound of the error." : ""}${task.printed.length ? " Stars and dotted lines: what the paper prints." : ""}`),
    task.notes.map((note) => h("p", { class: "hint" }, note)),
    h("div", { class: "controls" }, control.field),
    scrolling("Values at the chosen reading", values.table));
}

// Runs at a reading, a row each, with these figures.
function runsTable(names) {
  const body = h("tbody");
  const table = h("table", { class: "values" }, heads(["run", ...names.map((name) => data.figures[name].heading)]), body);
  const row = (run, k) => h("tr", {}, h("th", { scope: "row" }, swatch(run.method), run.label),
    names.map((name) => h("td", {}, figureCell(run, name, k))));
  return { table, show: (runs, reading) => body.replaceChildren(...runs.map((run) => row(run, reading - 1))) };
}

const bandWords = (task, placed) => (task.runs.some((run) => run.scans > 1)
  ? "Bands: 95 % intervals over scans and trials."
  : `Bands: 95 % Wilson interval of the share${placed ? ", 95 % interval of the mean error" : ""}.`);

// What the paper prints, beside what came out here.
function paperSection(task) {
  const titles = ["filter", "bins (Table I)", "the paper: right", "here, as early", "the paper: error, mm", `here, after ${task.readings}`];
  const rows = task.printed.map((one) => {
    const run = task.runs[one.run], k = one.readings - 1, last = task.readings - 1;
    return h("tr", {}, h("th", { scope: "row" }, swatch(run.method), run.label), h("td", {}, one.bins ?? MISSING),
      h("td", {}, `${fixed(one.share, 2)} from ${one.readings} readings`),
      h("td", {}, figureCell(run, "accuracy", k)),
      h("td", {}, one.error ?? MISSING), h("td", {}, figureCell(run, "error_mm", last)));
  });
  return section("Beside what the paper prints", scrolling("The paper's figures and those found here",
    h("table", { class: "values" }, heads(titles), h("tbody", {}, rows))),
    h("p", { class: "hint" }, "The paper pressed real letters by hand against a real pad; here both are simulated. The paper gives its results without intervals."));
}

// Uncertainty and its calibration: regions of the pose, and the letter's probability. Methods without
// samples have no regions.
function certaintySection(task) {
  const right = plot(`${task.plots}-stated`, "Share right against the probability stated");
  const marked = "all readings of all trials; the larger a mark, the more estimates it stands for.";
  const title = "Uncertainty and its calibration";
  const sure = task.runs.some((run) => run.figures.coverage_90[0].some((value) => value !== null));
  if (!sure) return section(title, h("div", { class: "two" }, right), h("p", { class: "hint" }, `Dashed: as it should be. Marks: ${marked}`));

  const last = Math.max(...task.runs.map((run) => run.readings));
  const control = slider("How sure at reading", last, Math.min(10, last), update);
  const values = runsTable([...figuresOf("certainty"), "error_mm"]);
  function update(reading) {
    values.show(task.runs, reading);
  }
  update(Math.min(10, last));
  return section(title,
    h("p", { class: "lead" }, "A region is all placements within a distance of the estimate that hold together 90 % of the belief. Its radius is the error that the method itself expects not to exceed in nine of ten trials."),
    h("div", { class: "two" }, plot(`${task.plots}-held`, "Share of 90 % regions that hold the truth"), right,
      plot(`${task.plots}-ranks`, "Share of trials of a lower rank, less that rank, after the last reading")),
    h("p", { class: "hint" }, `Dashed: as it should be. Regions and ranks: over the trials whose ${data.thing} is right. Shares right: ${marked} ` +
      "A rank is the share of the belief that lies nearer to the estimate than the truth does. The ranks of beliefs that are right stay within the grey band from end to end in 95 of 100 runs; a line below it is of beliefs that are too narrow, one above it of beliefs that are too wide."),
    h("div", { class: "controls" }, control.field),
    scrolling("How sure at the chosen reading", values.table));
}

function paretoSection(task, methods) {
  const points = task.pareto.map((point) => ({ ...point, of: task.runs[point.run], ms: 1e3 * point.seconds }));
  const left = points.some((point) => point.error !== null) && plot(`${task.plots}-time`, `Placement error after ${task.readings} readings, mm`);
  const right = plot(`${task.plots}-settled`, "Readings until 95 % of the trials are and stay right");
  const used = [...new Set(task.runs.map((run) => run.method))];
  const legend = h("ul", { class: "keys" }, used.map((method) => h("li", {}, swatch(method), methods[method])), h("li", {}, "Thick: the frontier"));
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
  return section(`Which ${data.thing}s are taken for which`,
    h("div", { class: "controls" }, pick.field, control.field),
    h("p", { class: "hint" }, `Rows: the true ${data.thing}. Columns: what is said. Numbers: trials.`),
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
