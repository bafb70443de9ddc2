// The pad as it is now: the picture, the force, the counters. Every event is the latest there is; none is waited for.

const find = (id) => document.getElementById(id);
const taxels = data.rows * data.columns;
const SILENT_S = 1.5; // without news from the program for so long, nothing on this page is shown as live
const LATE_S = 1; // a stream that is this far behind is dropped and opened again

let latest = null, shown = null, frozen = false, mirrored = data.fromBehind, dirty = true;
let heardAt = 0, stream = null, soonest = Infinity;
const watchers = []; // who else wants the events, and who else draws

find("device").textContent = data.device;
find("port").textContent = data.port;

const seconds = () => performance.now() / 1000;

// Drop what is old, and open the stream again: the server then sends what is new.
function listen() {
  if (stream) stream.close();
  soonest = Infinity;
  stream = new EventSource("/events");
  stream.addEventListener("message", (message) => take(JSON.parse(message.data)));
}

function take(event) {
  if (event.page !== data.page) { // another program serves this address now: its page is made for its pad
    stream.close();
    return location.reload();
  }
  heardAt = seconds();
  const behind = heardAt - event.sent;
  soonest = Math.min(soonest, behind);
  latest = event;
  if (!frozen) shown = event;
  dirty = true;
  for (const watcher of watchers) if (watcher.take) watcher.take(event);
  if (behind - soonest > LATE_S) listen();
}

document.addEventListener("visibilitychange", () => {
  if (document.hidden) stream.close();
  else listen();
});

function freeze() {
  frozen = !frozen;
  if (!frozen) shown = latest;
  freezeButton.setAttribute("aria-pressed", String(frozen));
  dirty = true;
}
const command = (name) => fetch(`/do/${name}`, { method: "POST", headers: { "X-Tactsim": "1" } }).catch(() => {});
// A button that was clicked with the pointer does not keep the focus: the next key is meant for the page.
const button = (text, key, action, more) => h("button", {
  type: "button", "aria-keyshortcuts": key, title: `key ${key}`, ...more,
  click: (event) => {
    if (event.detail) event.currentTarget.blur();
    action();
  },
}, text);
const freezeButton = button("Freeze", "f", freeze, { "aria-pressed": "false" });
const mirror = button("As seen from above", "m", () => {
  mirrored = !mirrored;
  mirror.setAttribute("aria-pressed", String(mirrored));
  dirty = true;
}, { "aria-pressed": String(mirrored) });
find("buttons").append(freezeButton, button("Tare", "t", () => command("tare")), mirror);
document.addEventListener("keydown", (event) => {
  if (event.key === " " && event.target.closest("button, summary")) return; // it presses that one
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const pressed = document.querySelector(`button[aria-keyshortcuts="${CSS.escape(event.key)}"]`);
  if (!pressed) return;
  event.preventDefault(); // or space scrolls the page
  if (!event.repeat) pressed.click();
});

// Edges of the taxel in mm, left, right, low, high, as they are seen.
function edges(taxel) {
  const [low, high] = data.rowEdges[Math.floor(taxel / data.columns)];
  const [left, right] = data.columnEdges[taxel % data.columns];
  return mirrored ? [-right, -left, low, high] : [left, right, low, high];
}
const reachX = Math.max(...data.columnEdges.flat()) + 0.3, reachY = Math.max(...data.rowEdges.flat()) + 0.3;

const picture = find("picture");
let width = 0;
whenSized(picture.parentElement, (now) => {
  width = now;
  dirty = true;
});

function drawPicture(event, live) {
  const ratio = window.devicePixelRatio || 1;
  const scale = width / (2 * reachX), height = 2 * reachY * scale;
  picture.width = Math.round(width * ratio);
  picture.height = Math.round(height * ratio);
  picture.style.height = `${height}px`;
  const context = picture.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  const { color: soft } = getComputedStyle(find("readout")), { borderTopColor: line } = getComputedStyle(picture.closest(".block"));
  context.textAlign = "center";
  context.textBaseline = "middle";
  const values = live && event ? event.pressures : null;
  const leftOut = new Set(event ? event.leftOut : []);
  for (let taxel = 0; taxel < taxels; taxel++) {
    const [left, right, low, high] = edges(taxel);
    const x = (left + reachX) * scale, y = (reachY - high) * scale;
    const w = (right - left) * scale, tall = (high - low) * scale;
    const value = values ? values[taxel] : null;
    context.font = `500 ${Math.min(0.3 * tall, 0.32 * w, 22)}px system-ui, sans-serif`;
    if (value === null) {
      context.strokeStyle = line;
      context.strokeRect(x + 0.5, y + 0.5, w - 1, tall - 1);
      context.fillStyle = soft;
      if (w > 14 && leftOut.has(taxel)) context.fillText("x", x + w / 2, y + tall / 2);
      continue;
    }
    const colour = ramp("up", value / event.scale);
    context.fillStyle = rgb(colour);
    context.fillRect(x, y, w, tall);
    if (w > 26) {
      context.fillStyle = ink(colour);
      context.fillText(String(Math.round(value) + 0), x + w / 2, y + tall / 2);
    }
  }
}

function drawScale(event) {
  const bar = find("scale"), context = bar.getContext("2d");
  for (let i = 0; i < bar.width; i++) {
    context.fillStyle = rgb(ramp("up", i / (bar.width - 1)));
    context.fillRect(i, 0, 1, 1);
  }
  find("most").textContent = `${event.scale} kPa`;
  find("marks").textContent = event.leftOut.length ? `x left out: ${event.leftOut.map((taxel) => data.taxels[taxel]).join(", ")}` : "";
}

let historyWidth = 0;
whenSized(find("history"), (now) => {
  historyWidth = now;
  dirty = true;
});
function drawHistory() {
  if (!historyWidth) return;
  const height = 130, left = 40, bottom = height - 20, bins = Math.round(data.historySeconds / data.binSeconds);
  const forces = latest ? latest.history : []; // in bins; null where nothing came
  const known = forces.filter((value) => value !== null);
  const most = Math.max(0.1, ...known), least = Math.min(0, ...known);
  const x = (i) => left + ((historyWidth - left - 4) * (i + bins - forces.length)) / Math.max(bins - 1, 1);
  const y = (value) => bottom - ((bottom - 8) * (value - least)) / (most - least);
  // Bins without a reading are a gap in the line, unless the pad is as slow as that.
  const usual = 3 + 3 / (Math.max(latest ? latest.rate : 0, 0.2) * data.binSeconds);
  let path = "", gap = Infinity;
  forces.forEach((value, i) => {
    if (value !== null) path += `${gap > usual ? "M" : "L"}${x(i).toFixed(1)} ${y(value).toFixed(1)}`;
    gap = value === null ? gap + 1 : 0;
  });
  const label = (at, value, anchor = "end") => s("text", { x: left - 6, y: at + 4, "text-anchor": anchor }, plain(value));
  const axis = s("g", { class: "axis" },
    [0, most].map((value) => [s("line", { class: "grid", x1: left, x2: historyWidth, y1: y(value), y2: y(value) }), label(y(value), value)]),
    s("text", { x: left, y: height - 4 }, `${data.historySeconds} s ago`),
    s("text", { x: historyWidth - 4, y: height - 4, "text-anchor": "end" }, "now"));
  const now = known.length ? `now ${fixed(forces[forces.length - 1], 2)} N, at most ${fixed(most, 2)} N` : "nothing yet";
  find("history").replaceChildren(
    s("svg", { class: "plot m0", role: "img", "aria-label": `Force of the last ${data.historySeconds} s: ${now}`, width: historyWidth, height },
      axis, s("path", { class: "line", d: path })));
}

const WRONG = new Set(["garbage_bytes", "bad_checksums", "missed", "torn", "impossible", "stale", "strays", "timeouts", "unpaired", "clock_restarts", "reconnects"]);
function drawCounters(event) {
  const more = Object.entries(event.counters).filter(([name, count]) => count && name !== "readings"); // which stand above
  find("counters").parentElement.hidden = !more.length;
  find("counters").replaceChildren(...more.map(([name, count]) =>
    h("div", { class: WRONG.has(name) ? "wrong" : null }, h("dt", {}, data.counterWords[name]), h("dd", {}, count.toLocaleString("en-US")))));
}

// A number with so many decimals; what rounds to nothing has no minus.
const unsigned = (value, digits) => (value === null ? MISSING : (Number(value.toFixed(digits)) + 0).toFixed(digits));
const say = (id, text) => {
  if (find(id).textContent !== text) find(id).textContent = text;
};

let pointed = null;
picture.addEventListener("pointermove", (event) => {
  const box = picture.getBoundingClientRect();
  const x = ((event.clientX - box.left) / box.width - 0.5) * 2 * reachX, y = (0.5 - (event.clientY - box.top) / box.height) * 2 * reachY;
  pointed = null;
  for (let taxel = 0; taxel < taxels; taxel++) {
    const [left, right, low, high] = edges(taxel);
    if (left <= x && x <= right && low <= y && y <= high) pointed = taxel;
  }
  dirty = true;
});
picture.addEventListener("pointerleave", () => {
  pointed = null;
  dirty = true;
});

// What there is to say of the connection: the program's own word, unless it is silent or the picture is frozen.
function stateNow() {
  const silent = seconds() - heardAt;
  if (!heardAt) return { state: "waiting", word: "waiting", why: "waiting for the program" };
  if (silent > SILENT_S) return { state: "gone", word: "no connection", why: `The program that reads the pad has said nothing for ${silent.toFixed(0)} s.` };
  if (latest.state === "lost") return { state: "lost", word: "lost", why: `The pad is lost: ${latest.trouble}` };
  if (latest.state === "ended") return { state: "ended", word: "ended", why: "The recording has ended." };
  if (latest.state === "waiting") return { state: "waiting", word: "waiting", why: "Waiting for the first reading." };
  return { state: "live", word: "live", why: "" };
}

let saidAt = 0;
function draw() {
  const now = stateNow();
  const live = now.state === "live" || frozen;
  say("state", frozen ? `frozen (${now.word})` : now.word);
  find("state").dataset.state = frozen && now.state === "live" ? "frozen" : now.state;
  find("veil").hidden = live;
  say("veil", now.why);
  picture.parentElement.classList.toggle("frozen", frozen);
  const event = live && shown && shown.pressures ? shown : null;
  if (width) drawPicture(event || latest, Boolean(event));
  if (!latest) return;
  drawScale(event || latest);
  drawHistory();
  drawCounters(latest);
  const values = event ? event.pressures.filter((value) => value !== null) : [];
  const largest = event ? Math.max(...values) : null;
  say("force", unsigned(event ? event.force : null, 2));
  say("largest", unsigned(largest, 1));
  say("rate", now.state === "live" ? latest.rate.toFixed(1) : "0");
  say("readings", latest.readings.toLocaleString("en-US"));
  say("message", frozen && now.why ? now.why : latest.message || (latest.tared ? "" : "Not tared: take a tare with nothing on the pad."));
  const at = pointed === null ? "" : `taxel ${data.taxels[pointed]}, row ${Math.floor(pointed / data.columns)}, column ${pointed % data.columns}: `;
  const here = pointed === null || !event ? null : event.pressures[pointed];
  say("seen", data.seen[Number(mirrored)]);
  say("readout", at && at + (here === null ? "no value" : `${here.toFixed(1)} kPa`));
  if (seconds() - saidAt > 1) { // a screen reader is not told sixty times a second
    saidAt = seconds();
    picture.setAttribute("aria-label", event ? `The pad: largest ${largest.toFixed(1)} kPa, force ${event.force.toFixed(2)} N` : `The pad: ${now.why}`);
  }
  for (const watcher of watchers) watcher.draw(now, event);
  document.documentElement.dataset.ready = "";
}

function frame() {
  if (dirty || seconds() - heardAt > SILENT_S) {
    dirty = false;
    draw();
  }
  requestAnimationFrame(frame);
}
onTheme(() => {
  dirty = true;
});

// What an estimator makes of the touches: beliefs as bars, and the pad on the most probable letter.

if (data.live) {
  const RECENT = 12; // touches that are drawn; more hide the letter
  let now = null, belief = null;
  const scene = find("scene"), bars = find("bars");
  const halfX = reachX - 0.3, halfY = reachY - 0.3;
  find("live").hidden = false;
  document.body.classList.add("live");

  const keys = { " ": ["Take it as it is", "take"], r: ["Redo the last", "redo"], s: ["Skip", "skip"], n: ["New object", "begin"] };
  if (data.live.commands.length) {
    find("touch-buttons").append(...Object.entries(keys).map(([key, [text, name]]) => button(text, key, () => command(name))));
  }

  const contour = (xy) => "M" + xy.map(([x, y]) => `${x.toFixed(2)} ${(-y).toFixed(2)}`).join("L") + "Z";
  const at = ([x, y, theta]) => `translate(${x} ${-y}) rotate(${(-theta * 180) / Math.PI})`;
  const pad = (name, pose) => s("rect", { class: name, x: -halfX, y: -halfY, width: 2 * halfX, height: 2 * halfY, transform: at(pose) });

  function drawScene() {
    const known = belief && belief.inObject && data.live.outlines[belief.label];
    let size = 20;
    const parts = [];
    if (known) {
      const places = [...belief.inObject, ...(now.asked ? [now.asked] : [])];
      for (const [x, y] of places) size = Math.max(size, Math.abs(x) + Math.hypot(halfX, halfY), Math.abs(y) + Math.hypot(halfX, halfY));
      parts.push(s("path", { class: "object", "fill-rule": "evenodd", d: known.map(contour).join("") }));
      parts.push(...belief.inObject.slice(-RECENT, -1).map((pose) => pad("earlier", pose)));
      const last = belief.inObject[belief.inObject.length - 1];
      const most = Math.max(1, ...belief.felt.filter((value) => value !== null));
      const felt = s("g", { class: "now", transform: at(last) }, belief.felt.map((value, taxel) => {
        const [low, high] = data.rowEdges[Math.floor(taxel / data.columns)], [left, right] = data.columnEdges[taxel % data.columns];
        return value === null ? null : s("rect", { x: left, y: -high, width: right - left, height: high - low, fill: rgb(ramp("up", value / most)) });
      }));
      parts.push(felt, pad("current", last));
      if (now.asked) parts.push(pad("ghost", now.asked));
    } else {
      const words = !belief || !belief.touch ? "no touch yet" : "none of the known letters";
      parts.push(s("text", { class: "nothing", "text-anchor": "middle", "font-size": 2.4 }, words));
    }
    scene.setAttribute("viewBox", `${-size} ${-size} ${2 * size} ${2 * size}`);
    scene.setAttribute("aria-label", known ? `The last touch on the letter ${belief.label}, and where the next is asked for, dashed` : "No letter is believed in");
    scene.replaceChildren(...parts);
  }

  function drawBars() {
    const ranked = Object.entries((belief && belief.probabilities) || {}).sort((a, b) => b[1] - a[1]).slice(0, 8);
    bars.replaceChildren(...ranked.map(([label, p]) => barRow(label, p, Math.max(data.live.letters.indexOf(label), 0))));
  }

  watchers.push({
    take(event) {
      now = event.live;
      if (now.belief) belief = now.belief;
    },
    draw(connection) {
      if (!now) return;
      const gone = connection.state === "gone" || connection.state === "lost";
      say("phase", gone ? connection.word : now.phase + (now.progress ? ` ${Math.round(100 * now.progress)} %` : ""));
      find("progress").value = gone ? 0 : now.progress;
      say("where", now.where);
      say("trouble", now.message);
      const felt = belief && belief.touch;
      say("verdict", felt ? `${belief.label}, ${fixed(belief.probabilities[belief.label], 3)}` : MISSING);
      say("details", felt ? `after ${belief.touch} touch${belief.touch > 1 ? "es" : ""}; ${belief.details}` : "no touch yet");
      find("verdict").classList.toggle("bad", Boolean(belief && belief.right === false));
      drawScene();
      drawBars();
    },
  });
}

listen();
frame();
