// What every part of the page needs: the data, making elements, numbers as text, colours.

const data = JSON.parse(document.getElementById("data").textContent);

const KINDS = { u1: Uint8Array, i1: Int8Array, u4: Uint32Array, f4: Float32Array };
let bytes = new ArrayBuffer(0);

// Decompress the block of arrays; `array` reads from it afterwards.
async function unpackArrays() {
  const text = document.getElementById("arrays").textContent.trim();
  const packed = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  bytes = await new Response(stream).arrayBuffer();
}

function array(place) {
  const count = place.shape.reduce((product, n) => product * n, 1);
  return new KINDS[place.kind](bytes, place.at, count);
}

// Row k of an array whose first axis is the reading.
function row(place, k) {
  const size = place.shape.slice(1).reduce((product, n) => product * n, 1);
  return array(place).subarray(k * size, (k + 1) * size);
}

// Make an element. Children that are strings become text, whatever they hold; nothing is parsed.
function make(space, tag, attributes, children) {
  const element = document.createElementNS(space, tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(name, value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat(Infinity)) {
    if (child !== null && child !== undefined && child !== false) element.append(child);
  }
  return element;
}
const h = (tag, attributes, ...children) => make("http://www.w3.org/1999/xhtml", tag, attributes, children);
const s = (tag, attributes, ...children) => make("http://www.w3.org/2000/svg", tag, attributes, children);

let lastId = 0;
const newId = (word) => `${word}-${++lastId}`;

// Numbers for reading: as many digits as make sense beside each other in a table.
const MISSING = "–";
const fixed = (value, digits) => (value === null || value === undefined ? MISSING : value.toFixed(digits));
function plain(value) {
  if (value === null || value === undefined) return MISSING;
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1000) return Math.round(value).toLocaleString("en-US");
  return String(Number(value.toPrecision(size >= 100 ? 3 : 2)));
}

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

// Light or dark, paper always light, and who must draw again when it changes: canvases and computed fills.
const systemDark = window.matchMedia("(prefers-color-scheme: dark)"), onPaper = window.matchMedia("print");
const redraws = [];
const isDark = () => {
  const chosen = document.documentElement.dataset.theme;
  return !onPaper.matches && (chosen ? chosen === "dark" : systemDark.matches);
};
const onTheme = (redraw) => redraws.push(redraw);
const themeChanged = () => redraws.forEach((redraw) => redraw());
for (const query of [systemDark, onPaper]) query.addEventListener("change", themeChanged);

// Colour ramps from 0 to 1, and from -1 to 1 for maps; stops are [r, g, b].
const RAMPS = {
  light: {
    up: [[246, 248, 251], [198, 219, 239], [107, 174, 214], [33, 113, 181], [8, 48, 107]],
    map: [[24, 86, 150], [118, 171, 214], [243, 244, 246], [238, 146, 96], [146, 38, 10]],
  },
  dark: {
    up: [[24, 29, 38], [29, 62, 104], [38, 118, 176], [98, 190, 220], [247, 236, 178]],
    map: [[120, 184, 240], [44, 92, 142], [30, 35, 44], [186, 92, 40], [255, 190, 130]],
  },
};
function ramp(name, t) {
  const stops = RAMPS[isDark() ? "dark" : "light"][name];
  const place = clamp(t, 0, 1) * (stops.length - 1);
  const low = Math.min(Math.floor(place), stops.length - 2);
  return stops[low].map((value, i) => Math.round(value + (place - low) * (stops[low + 1][i] - value)));
}
const rgb = (colour) => `rgb(${colour.join(" ")})`;
// Black or white, whichever reads better on a colour.
const ink = ([r, g, b]) => (0.299 * r + 0.587 * g + 0.114 * b > 140 ? "#10151c" : "#ffffff");

// So many colours, the classes m0 to m15 of the style, and markers: up to their product, no two methods look the same.
const COLOURS = 16, MARKS = 8;

// A belief as a bar: its name, the share of the belief, the number of its colour, and whether it is the true one.
function barRow(name, p, number, isTrue) {
  const fill = h("span", { class: `fill m${number % COLOURS}` });
  fill.style.setProperty("width", `${(100 * p).toFixed(2)}%`);
  return h("div", { class: "bar-row" },
    h("span", { class: "bar-name" }, name, isTrue && h("span", { class: "tag" }, "true")),
    h("span", { class: "bar-track" }, fill),
    h("span", { class: "bar-value" }, p < 0.0005 ? "0" : p > 0.9995 ? "1" : p.toFixed(3)));
}

// Paint rows x columns values on a canvas, the first row at the bottom.
function paint(canvas, rows, columns, colourOf) {
  canvas.width = columns;
  canvas.height = rows;
  const context = canvas.getContext("2d");
  const image = context.createImageData(columns, rows);
  for (let r = 0; r < rows; r++) {
    for (let c = 0; c < columns; c++) {
      image.data.set([...colourOf(r * columns + c), 255], 4 * ((rows - 1 - r) * columns + c));
    }
  }
  context.putImageData(image, 0, 0);
}

// A labelled <select>; options are [value, text] pairs.
function choice(label, options, onChange) {
  const id = newId("choice");
  const select = h("select", { id }, options.map(([value, text]) => h("option", { value }, text)));
  select.addEventListener("change", () => onChange(select.value));
  return { field: h("div", { class: "field" }, h("label", { for: id }, label), select), select };
}

// The header of a page: what it is, in light or dark, and facts and remarks on what it shows.
function pageHeader(words, facts, remarks, bottom) {
  const theme = choice("Theme", [["", "as the system"], ["light", "light"], ["dark", "dark"]], (value) => {
    if (value) document.documentElement.dataset.theme = value;
    else delete document.documentElement.dataset.theme;
    themeChanged();
  });
  document.getElementById("top").append(
    h("div", { class: "title" }, h("h1", {}, "tactsim"), h("p", {}, words)),
    theme.field,
    h("p", { class: "facts" }, facts),
    ...remarks.map((text) => h("p", { class: "facts remark" }, text)),
  );
  document.getElementById("bottom").append(...bottom.map((text) => h("p", {}, text)));
}

// A labelled slider from 1 to `last` that says in words where it stands.
function slider(label, last, start, onInput) {
  const id = newId("slider");
  const output = h("output", { for: id });
  const input = h("input", { id, type: "range", min: 1, max: last, step: 1, value: start });
  const say = () => {
    output.textContent = `${input.value} of ${last}`;
    input.setAttribute("aria-valuetext", `reading ${input.value} of ${last}`);
  };
  const moved = () => {
    say();
    onInput(Number(input.value));
  };
  input.addEventListener("input", moved);
  say();
  const set = (value) => {
    input.value = value;
    moved();
  };
  return { field: h("div", { class: "field slide" }, h("label", { for: id }, label), input, output), input, set };
}

// Call draw(width) now and whenever the element's width changes.
function whenSized(element, draw) {
  let last = 0;
  new ResizeObserver(([entry]) => {
    const width = Math.floor(entry.contentRect.width);
    if (width && width !== last) {
      last = width;
      draw(width);
    }
  }).observe(element);
}
