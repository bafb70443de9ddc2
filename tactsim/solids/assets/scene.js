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
