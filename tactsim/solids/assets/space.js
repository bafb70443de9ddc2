// A view in space that can be turned: triangles and dots into a canvas with a depth buffer. It needs no WebGL.

// Turn a vector by a unit quaternion [w, x, y, z].
function turned([w, x, y, z], [a, b, c]) {
  const tx = 2 * (y * c - z * b), ty = 2 * (z * a - x * c), tz = 2 * (x * b - y * a);
  return [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx];
}

function quaternionProduct([a, b, c, d], [e, f, g, i]) {
  return [a * e - b * f - c * g - d * i, a * f + b * e + c * i - d * g, a * g - b * i + c * e + d * f, a * i + b * g - c * f + d * e];
}

// The camera looks along its own -z; `light` is in its frame, so that a turned object stays lit.
const LIGHT = [0.35, 0.5, 0.79];

// The canvas is square. `draw` is called with the scene after it has been cleared, whenever it must be drawn again.
function turnableScene(canvas, reach, draw) {
  let view = quaternionProduct([Math.cos(0.55), -Math.sin(0.55), 0, 0], [Math.cos(0.4), 0, 0, Math.sin(0.4)]);
  let zoom = 1, size = 0, image = null, depth = null, asked = false, centre = [0, 0, 0];
  const context = canvas.getContext("2d", { willReadFrequently: true });

  // Into the camera's frame, in pixels; x right, y down, z towards who looks.
  function seen([a, b, c]) {
    const [x, y, z] = turned(view, [a - centre[0], b - centre[1], c - centre[2]]);
    const scale = (zoom * size) / (2 * reach);
    return [size / 2 + scale * x, size / 2 - scale * y, scale * z];
  }

  function triangle(p, q, r, colour, sparse) {
    const area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if (!area) return;
    const left = Math.max(0, Math.ceil(Math.min(p[0], q[0], r[0]))), right = Math.min(size - 1, Math.floor(Math.max(p[0], q[0], r[0])));
    const top = Math.max(0, Math.ceil(Math.min(p[1], q[1], r[1]))), bottom = Math.min(size - 1, Math.floor(Math.max(p[1], q[1], r[1])));
    for (let y = top; y <= bottom; y++) {
      for (let x = left; x <= right; x++) {
        if (sparse !== undefined && (x + y) % 2 !== sparse) continue;
        const u = ((x - p[0]) * (r[1] - p[1]) - (y - p[1]) * (r[0] - p[0])) / area;
        const v = ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) / area;
        if (u < -1e-6 || v < -1e-6 || u + v > 1 + 1e-6) continue;
        pixel(y * size + x, p[2] + u * (q[2] - p[2]) + v * (r[2] - p[2]), colour);
      }
    }
  }

  function pixel(at, z, [red, green, blue]) {
    if (z <= depth[at]) return;
    depth[at] = z;
    image.data[4 * at] = red;
    image.data[4 * at + 1] = green;
    image.data[4 * at + 2] = blue;
    image.data[4 * at + 3] = 255;
  }

  const scene = {
    // Put a point in the middle of the view.
    look(point) {
      centre = point;
    },
    // A closed mesh {vertices, faces} at a pose [x, y, z, qw, qx, qy, qz]; a sparse one, 0 or 1, takes
    // every other pixel and leaves the rest to what is behind: of two such meshes both are seen.
    mesh(shape, pose, colour, sparse) {
      const [x, y, z] = pose, rotation = pose.slice(3), corners = [];
      for (let i = 0; i < shape.vertices.length; i += 3) {
        const [a, b, c] = turned(rotation, shape.vertices.subarray(i, i + 3));
        corners.push(seen([a + x, b + y, c + z]));
      }
      for (let i = 0; i < shape.faces.length; i += 3) {
        const [p, q, r] = [corners[shape.faces[i]], corners[shape.faces[i + 1]], corners[shape.faces[i + 2]]];
        // Seen from outside corners go counter-clockwise; y points down here.
        const nx = (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1]);
        const ny = (q[2] - p[2]) * (r[0] - p[0]) - (q[0] - p[0]) * (r[2] - p[2]);
        const nz = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        if (nz >= 0) continue;
        const length = Math.hypot(nx, ny, nz);
        const bright = 0.42 + 0.58 * Math.max(0, (-nx * LIGHT[0] + ny * LIGHT[1] - nz * LIGHT[2]) / length);
        triangle(p, q, r, colour.map((part) => Math.round(part * bright)), sparse);
      }
    },
    // A flat piece with two sides.
    quad(corners, colour) {
      const [p, q, r, t] = corners.map(seen);
      triangle(p, q, r, colour);
      triangle(p, r, t, colour);
    },
    // A dot on a surface, seen also where the surface lies a little before it.
    dot(point, colour) {
      const [x, y, z] = seen(point).map(Math.round), half = Math.max(1, Math.round(size / 500));
      for (let j = y - half; j < y + half; j++) {
        for (let i = x - half; i < x + half; i++) {
          if (i >= 0 && j >= 0 && i < size && j < size) pixel(j * size + i, z + size / 100, colour);
        }
      }
    },
  };

  function drawn() {
    asked = false;
    if (!size) return;
    image = context.createImageData(size, size);
    depth = new Float32Array(size * size).fill(-Infinity);
    draw(scene);
    context.putImageData(image, 0, 0);
  }
  function again() {
    if (asked) return;
    asked = true;
    requestAnimationFrame(drawn);
  }
  // Turn about the camera's own axes: up and right, radians.
  function turn(up, right) {
    const about = quaternionProduct([Math.cos(up / 2), Math.sin(up / 2), 0, 0], [Math.cos(right / 2), 0, Math.sin(right / 2), 0]);
    view = quaternionProduct(about, view);
    const length = Math.hypot(...view);
    view = view.map((part) => part / length);
    again();
  }
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) turn(0.01 * event.movementY, 0.01 * event.movementX);
  });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowUp: [-0.15, 0], ArrowDown: [0.15, 0], ArrowLeft: [0, -0.15], ArrowRight: [0, 0.15] }[event.key];
    const factor = { "+": 1.15, "-": 1 / 1.15 }[event.key];
    if (step) turn(...step);
    else if (factor) zoom = clamp(zoom * factor, 0.5, 6);
    else return;
    event.preventDefault();
    again();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom = clamp(zoom * Math.exp(-0.001 * event.deltaY), 0.5, 6);
    again();
  }, { passive: false });
  whenSized(canvas.parentElement, (width) => {
    size = Math.round(Math.min(width, 640) * Math.min(2, window.devicePixelRatio || 1));
    canvas.width = canvas.height = size;
    again();
  });
  onTheme(again);
  return again;
}

// The page of runs with objects in space: curves against touches, the objects, and trials touch by touch.

const section = (title, ...content) => h("section", { class: "block", "aria-label": title }, h("h2", {}, title), content);

function curvesSection() {
  const last = Math.max(...data.runs.map((run) => run.figures.accuracy[0].length));
  const names = [...figuresOf("curves"), "coverage_90", "settled_95"];
  const plots = [
    ["Share of trials right", "accuracy"],
    ["Mean surface distance where the object is right, mm", "error_mm"],
    ["Angle where the object is right, degrees", "angle_deg"],
  ].map(([title, name]) => plot(`plot-${name}`, title));
  const values = h("tbody");
  const control = slider("Values at touch", last, last, (touch) => {
    const k = touch - 1;
    values.replaceChildren(...data.runs.map((run, i) =>
      h("tr", {}, h("th", { scope: "row" }, lineSwatch(i), run.label),
        names.map((name) => h("td", {}, figureCell(run, name, k))), h("td", {}, fixed(run.seconds, 2)))));
  });
  control.set(last);
  return section("Accuracy and error against touches",
    h("div", { class: "three" }, plots),
    h("p", { class: "hint" }, "Bands: 95 % intervals. The error is the mean distance of the surfaces where the object is right; error and angle are the least over the object's symmetry. Dotted: 1 mm and 5 degrees."),
    h("div", { class: "controls" }, control.field),
    scrolling("Values at the chosen touch", h("table", { class: "values" },
      heads(["run", ...names.map((name) => data.figures[name].heading), "s a recognition"]), values)));
}

const OF_OBJECTS = ["accuracy", "error_mm", "angle_deg"];

function objectsSection() {
  const rows = data.objects.map((label) =>
    h("tr", {}, h("th", { scope: "row" }, label), data.runs.flatMap((run) => {
      const one = run.objects[label];
      return one
        ? [...OF_OBJECTS.map((name) => h("td", {}, fixed(one[name], data.figures[name].digits))), h("td", {}, one.taken || "")]
        : Array.from({ length: 4 }, () => h("td", {}, MISSING));
    })));
  const names = data.runs.flatMap((run, i) => {
    const of = data.runs.length > 1 ? ` (${i + 1})` : "";
    return [...OF_OBJECTS.map((name) => data.figures[name].heading), "taken for"].map((heading) => heading + of);
  });
  return section("Object by object, after the last touch",
    scrolling("Every object after the last touch", h("table", { class: "values" }, heads(["object", ...names]), h("tbody", {}, rows))));
}

const COLOURS_OF = {
  light: { truth: [150, 158, 170], right: [40, 150, 90], wrong: [205, 70, 50], belief: [31, 95, 168] },
  dark: { truth: [120, 130, 146], right: [95, 208, 143], wrong: [255, 130, 118], belief: [125, 183, 245] },
};

function trialsSection() {
  let trial = data.trials[0], touch = 1;
  const shapes = Object.fromEntries(Object.entries(data.shapes).map(([label, of]) =>
    [label, { vertices: array(of.vertices), faces: array(of.faces), points: array(of.points) }]));
  const shown = { truth: true, estimate: true, belief: true, pads: true };
  const boxes = Object.entries({ truth: "true object", estimate: "estimate", belief: "belief", pads: "touches" }).map(([name, text]) => {
    const input = h("input", { type: "checkbox", checked: true });
    input.addEventListener("change", () => {
      shown[name] = input.checked;
      redraw();
    });
    return h("label", { class: "toggle" }, input, text);
  });
  const canvas = h("canvas", { class: "space", tabindex: 0, role: "img" });
  const stage = h("div", { class: "stage" }, canvas);
  const redraw = turnableScene(canvas, data.reach, drawScene);
  const status = h("p", { class: "status", "aria-live": "polite" });
  const bars = h("div", { class: "bars" });
  const holder = h("div", { class: "grow" });

  const poseAt = (place, k) => Array.from(row(place, k));
  function drawScene(scene) {
    const k = touch - 1, colours = COLOURS_OF[isDark() ? "dark" : "light"];
    const label = trial.label[k];
    scene.look(Array.from(array(trial.truePose)).slice(0, 3));
    if (shown.truth) scene.mesh(shapes[trial.truth], Array.from(array(trial.truePose)), colours.truth, shown.estimate ? 0 : undefined);
    if (shown.estimate) scene.mesh(shapes[label], poseAt(trial.pose, k), label === trial.truth ? colours.right : colours.wrong, shown.truth ? 1 : undefined);
    if (shown.belief && trial.belief) {
      const poses = row(trial.belief, k);
      const points = shapes[label].points;
      for (let i = 0; i < poses.length; i += 7) {
        const pose = Array.from(poses.subarray(i, i + 7)), rotation = pose.slice(3);
        for (let j = 0; j < points.length; j += 3) {
          const [a, b, c] = turned(rotation, points.subarray(j, j + 3));
          scene.dot([a + pose[0], b + pose[1], c + pose[2]], colours.belief);
        }
      }
    }
    if (shown.pads) for (let i = 0; i <= k; i++) drawPads(scene, i, i === k);
  }
  function drawPads(scene, k, current) {
    const poses = row(trial.sensors, k), readings = row(trial.readings, k), taxels = data.taxelPoints.length;
    const half = 0.46 * data.pitch;
    for (let pad = 0; pad * 7 < poses.length; pad++) {
      const pose = Array.from(poses.subarray(7 * pad, 7 * pad + 7)), rotation = pose.slice(3);
      const most = Math.max(1, ...array(trial.readings));  // of all touches, so that one that met nothing looks like it
      for (let i = 0; i < taxels; i++) {
        const value = readings[pad * taxels + i];
        if (!current && value < 0.1 * most) continue; // of earlier touches, only where they met something
        const [x, y, z] = data.taxelPoints[i];
        const corners = [[-half, -half], [half, -half], [half, half], [-half, half]].map(([a, b]) => {
          const [u, v, w] = turned(rotation, [x + a, y + b, z]);
          return [u + pose[0], v + pose[1], w + pose[2]];
        });
        scene.quad(corners, ramp("up", 0.15 + (0.85 * Math.max(0, value)) / most));
      }
    }
  }
  function show() {
    const k = touch - 1, label = trial.label[k], right = label === trial.truth;
    status.textContent = `Touch ${touch}: ${right ? "right" : "wrong"}, ${label} ${fixed(trial.probabilities[k][data.labels.indexOf(label)], 3)}`
      + (right ? `; surface distance ${fixed(trial.error[k], 2)} mm, angle ${fixed(trial.angle[k], 1)} degrees` : `; it is the ${trial.truth}`)
      + (trial.met[k] ? "" : "; the pad met nothing");
    status.classList.toggle("bad", !right);
    canvas.setAttribute("aria-label", `${status.textContent}. Drag, or use the arrow keys, to turn the view; + and - make it larger and smaller.`);
    const order = data.labels.map((_, i) => i).sort((a, b) => trial.probabilities[k][b] - trial.probabilities[k][a]).slice(0, 6);
    bars.replaceChildren(...order.map((i) => barRow(data.labels[i], trial.probabilities[k][i], i, data.labels[i] === trial.truth)));
    redraw();
  }
  function start(i) {
    trial = data.trials[i];
    const count = trial.label.length;
    touch = clamp(touch, 1, count);
    const control = slider("Touch", count, touch, (value) => {
      touch = value;
      show();
    });
    holder.replaceChildren(control.field);
    show();
  }
  const pick = choice("Trial", data.trials.map((one, i) => [i, `${one.run}: ${one.kind}, ${one.truth}, trial ${one.trial}`]), (i) => start(Number(i)));
  start(0);
  return section("One trial, touch by touch",
    h("div", { class: "controls" }, pick.field, h("fieldset", { class: "legend" }, h("legend", {}, "Show"), boxes)),
    h("div", { class: "controls" }, holder),
    status,
    h("div", { class: "two" }, h("div", { class: "card" }, stage,
      h("p", { class: "hint" }, "Grey: the true object. Green, or red if it is another object: the estimate. Dots: surface points of the belief's poses. Squares: the taxels of the touch, darker or brighter with pressure. Drag or use the arrow keys to turn; wheel, + and - to zoom.")),
      h("div", { class: "card top" }, h("h3", {}, "Belief over the objects"), bars)));
}

async function page() {
  await unpackArrays();
  pageHeader("Recognising objects in space by touch: which one it is, and how it lies", data.facts, data.remarks, [`Made with ${data.versions}.`]);
  const parts = [curvesSection(), data.trials.length && trialsSection(), objectsSection()].filter(Boolean);
  document.getElementById("content").append(...parts);
  document.documentElement.dataset.ready = "yes";
}
page();
