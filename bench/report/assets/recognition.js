// One recognition, reading by reading: pad on the letter, tactile image, belief over letters and plane.

const SHOWN_LETTERS = 6;

// The letters worth a panel: those that were ever believed in most, in the order of the estimator.
function lettersToShow(trial) {
  const n = trial.labels.length;
  if (n <= SHOWN_LETTERS) return trial.labels.map((_, i) => i);
  const p = array(trial.probabilities);
  const most = trial.labels.map((label, i) => {
    let high = label === trial.answer ? 2 : 0;
    for (let k = 0; k < trial.estimate.length; k++) high = Math.max(high, p[k * n + i]);
    return high;
  });
  return most.map((value, i) => [value, i]).sort((a, b) => b[0] - a[0]).slice(0, SHOWN_LETTERS).map(([, i]) => i).sort((a, b) => a - b);
}

// A contour (k, 2) moved by a pose [x, y, theta], as an SVG path with y up.
function contourPath(place, pose) {
  const xy = array(place);
  const [px, py, theta] = pose;
  const cos = Math.cos(theta), sin = Math.sin(theta);
  let path = "";
  for (let i = 0; i < xy.length; i += 2) {
    const x = px + cos * xy[i] - sin * xy[i + 1], y = py + sin * xy[i] + cos * xy[i + 1];
    path += `${i ? "L" : "M"}${x.toFixed(2)} ${(-y).toFixed(2)}`;
  }
  return path + "Z";
}
const outlinePath = (outline, pose) => outline.contours.map((contour) => contourPath(contour, pose)).join("");
const poseTransform = ([x, y, theta]) => `translate(${x} ${-y}) rotate(${(-theta * 180) / Math.PI})`;

function recognitionView(protocol) {
  const trials = protocol.recognitions;
  const runs = [...new Set(trials.map((trial) => trial.run))];
  let trial = trials[0], reading = 1, timer = null;

  const scene = s("svg", { class: "scene", role: "img" });
  const tactile = s("svg", { class: "tactile", role: "img" }), heading = h("h4", {});
  const bars = h("div", { class: "bars" });
  const history = s("svg", { class: "history", role: "img" }), historyHint = h("p", { class: "hint" });
  const planes = h("div", { class: "planes" });
  const planesHint = h("p", { class: "hint" }, "x and y of the robot in the object's frame, the angle summed out. The stronger the colour, the more probable; drawn is the square root of the probability, so that faint places are seen, too. Cross: true. Ring: estimate, at any of the turns that look the same.");
  const status = h("p", { class: "status", "aria-live": "polite" });
  const remark = h("p", { class: "hint" });
  const grey = h("span", {});
  const onObject = h("div", { class: "card a" }, h("h4", {}, `The pad on the ${data.thing}`), scene,
    h("p", { class: "hint" }, `In the ${data.thing}'s own frame. `, grey, ` Squares: the pad now. Thin: where it was pressed before. Dashed: the estimate. Ellipse: where the ${data.thing}'s centre is with 90 %.`));

  const runChoice = choice("Method", runs.map((run, i) => [i, run]), (i) => start(runs[i], trial.kind));
  const kinds = [...new Set(trials.map((one) => one.kind))];
  const kindChoice = choice("Trial", kinds.map((kind) => [kind, kind]), (kind) => start(trial.run, kind));
  const holder = h("div", { class: "grow" });
  const play = h("button", { type: "button", "aria-pressed": "false", click: () => (timer ? stop() : go()) }, "Play");
  const back = h("button", { type: "button", "aria-label": "Previous reading", click: () => step(-1) }, "‹");
  const next = h("button", { type: "button", "aria-label": "Next reading", click: () => step(1) }, "›");
  let control = null;

  function start(run, kind) {
    stop();
    trial = trials.find((one) => one.run === run && one.kind === kind) || trials.find((one) => one.run === run);
    for (const option of kindChoice.select.options) {
      const one = trials.find((other) => other.run === trial.run && other.kind === option.value);
      option.textContent = one ? `${one.kind}: ${one.truth}, trial ${one.trial}` : option.value;
      option.disabled = !one;
    }
    kindChoice.select.value = trial.kind;
    const count = trial.estimate.length;
    reading = clamp(reading, 1, count);
    control = slider("Reading", count, reading, (k) => {
      reading = k;
      draw();
    });
    holder.replaceChildren(control.field);
    remark.textContent = trial.same
      ? ""
      : "This trial came out differently when it was done again for this page: the run was made by another version or on other readings.";
    remark.hidden = trial.same;
    draw();
  }
  function step(by) {
    stop();
    control.set(clamp(reading + by, 1, trial.estimate.length));
  }
  function stop() {
    clearInterval(timer);
    timer = null;
    play.textContent = "Play";
    play.setAttribute("aria-pressed", "false");
  }
  function go() {
    if (reading === trial.estimate.length) control.set(1);
    timer = setInterval(() => {
      if (reading >= trial.estimate.length) stop();
      else control.set(reading + 1);
    }, 600);
    play.textContent = "Pause";
    play.setAttribute("aria-pressed", "true");
  }

  const pressureScale = () => {
    let most = 1;
    for (const value of array(trial.pressures)) most = Math.max(most, value);
    return most;
  };

  function draw() {
    const k = reading - 1;
    drawScene(k);
    drawTactile(k);
    drawLetters(k);
    drawHistory(k);
    drawPlane(k);
    const said = trial.estimate[k];
    const at = trial.labels.indexOf(said);
    const p = at < 0 ? null : row(trial.probabilities, k)[at];
    status.textContent =
      `After reading ${reading}: it says ${said} (p = ${fixed(p, 3)}), which is ${said === trial.answer ? "right" : `wrong: it is ${trial.truth}`}` +
      (trial.answer !== trial.truth ? `; ${trial.truth} was held out of the training.`
        : Number.isNaN(array(trial.error)[k]) ? "."
        : `; placed ${fixed(array(trial.error)[k], 2)} mm off${trial.radius[k] === null ? "" : `, 90 % sure of it within ${fixed(trial.radius[k], 2)} mm`}.`);
    status.classList.toggle("bad", said !== trial.answer);
  }

  function taxelRects(values, most, inset) {
    const [w, height] = trial.taxelSize;
    return trial.taxels.map(([x, y], i) =>
      s("rect", {
        x: (x - w / 2 + inset).toFixed(3), y: (-y - height / 2 + inset).toFixed(3),
        width: w - 2 * inset, height: height - 2 * inset, fill: rgb(ramp("up", values[i] / most)),
      }),
    );
  }

  function drawScene(k) {
    const count = trial.estimate.length;
    const outlines = protocol.outlines;
    grey.textContent = outlines[trial.truth] && !outlines[trial.truth].drawn ? `Grey: what is occupied in the map that was learned of the ${data.thing}, as there is no drawing of it.` : `Grey: the ${data.thing}.`;
    const xs = trial.taxels.map(([x]) => Math.abs(x)), ys = trial.taxels.map(([, y]) => Math.abs(y));
    const [w, height] = trial.taxelSize;
    const halfX = Math.max(...xs) + w / 2, halfY = Math.max(...ys) + height / 2;
    const outline = outlines[trial.truth];
    onObject.hidden = !outline?.contours.length && !placed(); // nobody knows where the pad is on what
    const sensors = array(trial.sensor);
    let size = 1;
    for (let i = 0; i < count; i++) size = Math.max(size, Math.abs(sensors[3 * i]), Math.abs(sensors[3 * i + 1]));
    size += Math.hypot(halfX, halfY) + 0.5; // whatever its angle, the pad stays inside
    const most = 4 * size; // an estimate farther off is cut, so that the letter is still seen
    const drawn = [[outline, [0, 0]], ...trial.estimate.map((label, i) => [outlines[label], row(trial.ghost, i)])];
    for (const [of, [x, y]] of drawn) if (of) size = Math.max(size, Math.abs(x) + of.radius + 1, Math.abs(y) + of.radius + 1);
    size = Math.min(size, most);
    scene.setAttribute("viewBox", `${-size} ${-size} ${2 * size} ${2 * size}`);
    scene.setAttribute("aria-label", `The pad on the ${data.thing} ${trial.truth} at reading ${reading}, with the estimate's outline dashed`);
    const pad = (i, name) => s("rect", { class: name, x: -halfX, y: -halfY, width: 2 * halfX, height: 2 * halfY, transform: poseTransform(row(trial.sensor, i)) });
    const parts = [];
    if (outline) parts.push(s("path", { class: "object", "fill-rule": "evenodd", d: outlinePath(outline, [0, 0, 0]) }));
    for (let i = 0; i < k; i++) parts.push(pad(i, "earlier"));
    const now = s("g", { class: "now", transform: poseTransform(row(trial.sensor, k)) }, taxelRects(row(trial.pressures, k), pressureScale(), 0.06));
    parts.push(now, pad(k, "current"));
    const guess = outlines[trial.estimate[k]];
    if (guess) parts.push(s("path", { class: trial.estimate[k] === trial.answer ? "ghost" : "ghost bad", d: outlinePath(guess, row(trial.ghost, k)) }));
    if (trial.region && trial.estimate[k] === trial.answer) {
      const [x, y, a, b, turn] = row(trial.region, k);
      parts.push(s("ellipse", { class: "region", rx: a.toFixed(3), ry: b.toFixed(3), transform: poseTransform([x, y, turn]) }));
    }
    parts.push(s("path", { class: "ruler", d: `M${1 - size} ${size - 1}h10` }),
      s("text", { class: "ruler-name", x: 1 - size, y: size - 1 - 0.02 * size, "font-size": 0.08 * size }, "10 mm"));
    scene.replaceChildren(...parts);
  }

  function drawTactile(k) {
    const values = row(trial.pressures, k), most = pressureScale();
    const [w, height] = trial.taxelSize;
    const halfX = Math.max(...trial.taxels.map(([x]) => Math.abs(x))) + w / 2 + 0.1;
    const halfY = Math.max(...trial.taxels.map(([, y]) => Math.abs(y))) + height / 2 + 0.1;
    tactile.setAttribute("viewBox", `${-halfX} ${-halfY} ${2 * halfX} ${2 * halfY}`);
    const highest = Math.max(...values);
    heading.textContent = `Tactile image, ${trial.unit}`;
    tactile.setAttribute("aria-label", `Tactile image of reading ${reading}: ${trial.taxels.length} taxels, highest ${highest.toFixed(1)} ${trial.unit}`);
    const numbers = trial.taxels.map(([x, y], i) =>
      s("text", { x, y: -y + height * 0.12, "text-anchor": "middle", "font-size": (height * 0.36).toFixed(2), fill: ink(ramp("up", values[i] / most)) },
        String(Math.round(values[i]))),
    );
    tactile.replaceChildren(...taxelRects(values, most, 0), ...(trial.taxels.length <= 64 ? numbers : []));
  }

  function drawLetters(k) {
    const p = row(trial.probabilities, k);
    bars.replaceChildren(...lettersToShow(trial).map((i, place) => barRow(trial.labels[i], p[i], place, trial.labels[i] === trial.answer)));
  }

  // Every reading's belief as a stacked column, and the error below, if the object is placed; a click goes to a reading.
  const placed = () => !Number.isNaN(array(trial.error)[0]);
  let historyWidth = 0;
  const left = 34;
  function drawHistory(k) {
    if (!historyWidth) return;
    const count = trial.estimate.length, shown = lettersToShow(trial);
    const width = historyWidth, top = 8, middle = 100, gap = 14, bottom = placed() ? 172 : middle, height = bottom + 20;
    history.setAttribute("width", width);
    history.setAttribute("height", height);
    history.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const column = (width - left - 2) / count;
    const x = (i) => left + i * column;
    const label = (y, text) => s("text", { x: left - 6, y: y + 4, "text-anchor": "end" }, text);
    const axis = s("g", { class: "axis", "aria-hidden": "true" }, label(top + 2, "1"), label(middle, "0"));
    const parts = [axis];
    for (let i = 0; i < count; i++) {
      const p = row(trial.probabilities, i);
      let y = middle;
      shown.forEach((letter, place) => {
        const tall = (middle - top) * p[letter];
        if (tall > 0.2) parts.push(s("rect", { class: `area m${place % COLOURS}`, x: x(i), y: y - tall, width: Math.max(column * 0.92, 0.5), height: tall }));
        y -= tall;
      });
    }
    const errors = array(trial.error);
    if (placed()) {
      // Near 0 the scale is linear, far from it logarithmic: first guesses are 20 mm off, last ones 0.2.
      const most = Math.max(1, ...errors);
      const sy = (value) => bottom - ((bottom - middle - gap) * Math.log1p(4 * value)) / Math.log1p(4 * most);
      for (const value of [0, 1, ...(most > 4 ? [most] : [])]) {
        axis.append(s("line", { class: "grid", x1: left, x2: width, y1: sy(value), y2: sy(value) }), label(sy(value), value === most ? plain(value) : String(value)));
      }
      parts.push(s("path", { class: "error-line", d: "M" + Array.from(errors, (value, i) => `${(x(i) + 0.46 * column).toFixed(1)} ${sy(value).toFixed(1)}`).join("L") }));
      parts.push(s("circle", { class: "error-dot", cx: x(k) + 0.46 * column, cy: sy(errors[k]), r: 3.5 }));
    }
    axis.append(s("text", { x: left, y: height - 4 }, "1"), s("text", { x: width - 2, y: height - 4, "text-anchor": "end" }, String(count)));
    axis.append(s("text", { class: "name", x: (left + width) / 2, y: height - 4, "text-anchor": "middle" }, "reading"));
    parts.push(s("rect", { class: "here", x: x(k) - 1.5, y: top - 3, width: 0.92 * column + 3, height: bottom - top + 6, rx: 2 }));
    history.replaceChildren(...parts);
    history.setAttribute("aria-label", `Belief over the ${data.thing}s${placed() ? " and placement error" : ""} after every reading`);
    historyHint.textContent = placed()
      ? "Above: the belief after every reading. Below: the placement error, mm. Click to go to a reading."
      : "The belief after every reading. Click to go to a reading.";
  }
  history.addEventListener("click", (event) => {
    const count = trial.estimate.length;
    stop();
    control.set(clamp(1 + Math.floor(((event.offsetX - left) / (historyWidth - left - 2)) * count), 1, count));
  });

  function drawPlane(k) {
    const plane = trial.plane;
    planesHint.hidden = !plane;
    if (!plane) {
      planes.replaceChildren(h("p", { class: "hint" }, "This method does not show its belief over the plane."));
      return;
    }
    const values = row(plane.rootShare, k);
    const [rows, columns] = plane.rootShare.shape.slice(2);
    const half = [(plane.x.at(-1) - plane.x[0]) / 2 / Math.max(1, columns - 1), (plane.y.at(-1) - plane.y[0]) / 2 / Math.max(1, rows - 1)];
    const left = plane.x[0] - half[0], right = plane.x.at(-1) + half[0];
    const low = plane.y[0] - half[1], high = plane.y.at(-1) + half[1];
    const place = ([x, y]) => [((x - left) / (right - left)) * 100, ((high - y) / (high - low)) * 100];
    planes.replaceChildren(
      ...lettersToShow(trial).filter((i) => plane.labels.includes(trial.labels[i])).map((i) => {
        const label = trial.labels[i];
        const first = plane.labels.indexOf(label) * rows * columns;
        const canvas = h("canvas", { class: "map", role: "img", "aria-label": `Belief that it is ${label}, over the plane` });
        paint(canvas, rows, columns, (at) => ramp("up", values[first + at] / 255));
        const over = s("svg", { class: "over", viewBox: "0 0 100 100", "aria-hidden": "true" });
        if (label === trial.truth) {
          const [x, y] = place(row(trial.truePose, k));
          over.append(s("path", { class: "cross", d: `M${x - 5} ${y}H${x + 5}M${x} ${y - 5}V${y + 5}` }));
        }
        if (label === trial.estimate[k]) {
          const [x, y] = place(row(trial.pose, k));
          over.append(s("circle", { class: "found", cx: x, cy: y, r: 6 }));
        }
        return h("figure", { class: "chart small" }, h("figcaption", {}, label, h("small", {}, `${plain(right - left)} mm wide`)), h("div", { class: "stack" }, canvas, over));
      }),
    );
  }

  onTheme(draw);
  start(runs[0], kinds[0]);
  const letters = h("div", { class: "card c" }, h("h4", {}, `Belief over the ${data.thing}s`), bars, history, historyHint);
  whenSized(letters, (width) => {
    historyWidth = width;
    drawHistory(reading - 1);
  });
  return [
    h("div", { class: "controls" }, runChoice.field, kindChoice.field),
    remark,
    h("div", { class: "controls sticky" }, back, play, next, holder),
    status,
    h("div", { class: "recognition" },
      onObject,
      h("div", { class: "card b" }, heading, tactile),
      letters,
      h("div", { class: "card d" }, h("h4", {}, "Belief over the plane"), planes,
        planesHint),
    ),
  ];
}
