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
