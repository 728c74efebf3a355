// Point clouds in 3D, rendered in software into a canvas: no GPU and no library, the same pixels everywhere.

// Camera shared by all views.
class Camera {
  constructor() { this.views = new Set(); this.home(); }
  home(reach = this.reach || 50) { Object.assign(this, { reach, yaw: -Math.PI / 2, pitch: 0.95, distance: 2.5 * reach, x: -0.14 * reach, y: 0 }); this.changed(); }
  top() { Object.assign(this, { yaw: -Math.PI / 2, pitch: Math.PI / 2, distance: 2.4 * this.reach, x: 0, y: 0 }); this.changed(); }
  rotate(yaw, pitch) { this.yaw += yaw; this.pitch = Math.min(Math.max(this.pitch + pitch, 0.02), Math.PI / 2); this.changed(); }
  zoom(factor) { this.distance = Math.min(Math.max(this.distance * factor, 2), 40 * this.reach); this.changed(); }
  move(right, up) {
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    this.x += c * right - s * up;
    this.y += s * right + c * up;
    this.changed();
  }
  changed() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; for (const view of this.views) view.draw(); });
  }
}

const colorWord = (color) => { // the four bytes of a pixel as a little-endian word
  const [r, g, b] = [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));
  return (255 << 24) | (b << 16) | (g << 8) | r;
};
const INTENSITIES = Uint32Array.from({ length: 256 }, (_, i) => { // light to dark blue, so that strong returns stand out
  const mix = (weak, strong) => Math.round(weak + (i / 255) ** 0.7 * (strong - weak));
  return (255 << 24) | (mix(232, 60) << 16) | (mix(178, 20) << 8) | mix(150, 8);
});
const HEIGHT_STEP_M = 0.02;
const HEIGHTS = (() => { // the colour of each step of height above the water
  const stops = data.palette.heights, top = stops[stops.length - 1][0];
  const parse = (color) => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));
  return Uint32Array.from({ length: Math.round(top / HEIGHT_STEP_M) + 1 }, (_, i) => {
    const height = i * HEIGHT_STEP_M, k = Math.max(1, stops.findIndex(([stop]) => stop >= height - 1e-9));
    const [[low, from], [high, to]] = [stops[k - 1], stops[k]];
    const [r, g, b] = parse(to).map((value, c) => Math.round(value + ((high - height) / (high - low)) * (parse(from)[c] - value)));
    return (255 << 24) | (b << 16) | (g << 8) | r;
  });
})();
const REASON_WORDS = Uint32Array.from(data.palette.reasons, colorWord);
const TRUTH_WORDS = Uint32Array.from(data.palette.truth, colorWord);

// A view of one frame. `content` holds sample, method, color, shows(reason), rings, boxes, clusters.
class CloudView {
  constructor(host, camera) {
    this.camera = camera;
    this.canvas = h("canvas", { tabindex: 0, role: "img" });
    host.append(this.canvas);
    this.pen = this.canvas.getContext("2d", { willReadFrequently: true });
    camera.views.add(this);
    this.observer = new ResizeObserver(() => this.draw());
    this.observer.observe(this.canvas);
    this.listen();
  }
  close() { this.observer.disconnect(); this.camera.views.delete(this); }
  show(content, label) { this.content = content; this.canvas.setAttribute("aria-label", label); this.draw(); }

  listen() {
    const fingers = new Map();
    const metres = () => this.camera.distance / this.canvas.clientHeight;
    this.canvas.addEventListener("pointerdown", (event) => { fingers.set(event.pointerId, event); this.canvas.setPointerCapture(event.pointerId); });
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    this.canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
      const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
      fingers.set(event.pointerId, event);
      if (other) {
        const gap = (finger) => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY) || 1;
        this.camera.zoom(gap(before) / gap(event));
      } else if (event.shiftKey || event.buttons === 2) this.camera.move(-dx * metres(), dy * metres());
      else this.camera.rotate(-dx * 0.006, dy * 0.006);
    });
    this.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    this.canvas.addEventListener("wheel", (event) => { // without focus, the wheel scrolls the page
      if (document.activeElement !== this.canvas) return;
      event.preventDefault();
      this.camera.zoom(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
    const step = 0.08, keys = {
      ArrowLeft: () => this.camera.rotate(-step, 0), ArrowRight: () => this.camera.rotate(step, 0),
      ArrowUp: () => this.camera.rotate(0, step), ArrowDown: () => this.camera.rotate(0, -step),
      "+": () => this.camera.zoom(0.85), "=": () => this.camera.zoom(0.85), "-": () => this.camera.zoom(1 / 0.85),
      t: () => this.camera.top(), 0: () => this.camera.home(),
    };
    this.canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
      event.preventDefault();
      if (event.shiftKey && event.key.startsWith("Arrow")) {
        const [right, up] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
        this.camera.move(0.05 * this.camera.distance * right, 0.05 * this.camera.distance * up);
      } else keys[event.key]();
    });
  }

  // Writes the pixel position and the depth of a point to `out`. The camera targets a point on the ground, at first with x ahead.
  project(x, y, z, out) {
    const { sin, cos, sinPitch, cosPitch, distance, focus } = this.lens;
    const dx = x - this.camera.x, dy = y - this.camera.y, dz = z - this.ground;
    const right = cos * dx + sin * dy, ahead = cos * dy - sin * dx;
    const depth = distance + cosPitch * ahead - sinPitch * dz;
    out[0] = this.canvas.width / 2 + (focus * right) / depth;
    out[1] = this.canvas.height / 2 - (focus * (sinPitch * ahead + cosPitch * dz)) / depth;
    out[2] = depth;
  }

  draw() {
    if (!this.content || !this.canvas.clientWidth) return;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map((side) => Math.round(side * ratio));
    if (this.canvas.width !== width || this.canvas.height !== height) {
      Object.assign(this.canvas, { width, height });
      this.image = this.pen.createImageData(width, height);
      this.words = new Uint32Array(this.image.data.buffer);
      this.depths = new Float32Array(width * height);
    }
    const { yaw, pitch, distance } = this.camera;
    this.lens = { sin: Math.sin(yaw), cos: Math.cos(yaw), sinPitch: Math.sin(pitch), cosPitch: Math.cos(pitch), distance, focus: Math.min(height, width) * 1.1 };
    this.ground = this.content.sample.ground;
    this.ratio = ratio;
    this.points(width, height);
    this.pen.putImageData(this.image, 0, 0);
    this.rings();
    this.outlines();
  }

  points(width, height) {
    const { sample, method, color, shows } = this.content;
    const { xyz, scale, truth, intensity, heights } = sample;
    const reasons = sample.reasons[method];
    const { words, depths } = this;
    words.fill(0xffffffff);
    depths.fill(Infinity);
    const out = [0, 0, 0], bold = reasons.length > 8000 ? 2 : 3.2;
    const lifts = color === "reason" ? { 3: 0.5, 4: 1, 7: 1 } : {}; // metres towards the camera: kept points would hide removed points among them
    for (let i = 0; i < reasons.length; i++) {
      if (!shows(reasons[i])) continue;
      this.project(xyz[3 * i] * scale, xyz[3 * i + 1] * scale, xyz[3 * i + 2] * scale, out);
      const depth = out[2];
      if (depth < 0.5) continue;
      const word = color === "truth" ? TRUTH_WORDS[truth[i]] : color === "intensity" ? INTENSITIES[intensity[i]]
        : color === "height" ? heights[i] : REASON_WORDS[reasons[i]];
      const large = color === "truth" ? truth[i] === 2 : reasons[i] === 0 || reasons[i] === 4 || reasons[i] === 7;
      const over = depth - (lifts[reasons[i]] || 0);
      const size = Math.round(this.ratio * (large ? bold : Math.min(bold, 2)));
      const [left, top] = [Math.round(out[0] - size / 2), Math.round(out[1] - size / 2)];
      if (left < 0 || top < 0 || left + size > width || top + size > height) continue;
      for (let row = top; row < top + size; row++) {
        for (let cell = row * width + left; cell < row * width + left + size; cell++) {
          if (over < depths[cell]) { depths[cell] = over; words[cell] = word; }
        }
      }
    }
  }

  line(points, color, weight, dash = []) {
    this.pen.beginPath();
    const out = [0, 0, 0];
    let pen = false;
    for (const [x, y, z] of points) {
      this.project(x, y, z, out);
      if (out[2] < 0.5) { pen = false; continue; }
      if (pen) this.pen.lineTo(out[0], out[1]);
      else this.pen.moveTo(out[0], out[1]);
      pen = true;
    }
    this.pen.strokeStyle = color;
    this.pen.lineWidth = weight * this.ratio;
    this.pen.setLineDash(dash.map((length) => length * this.ratio));
    this.pen.stroke();
  }

  // A text that would cover one of `others` is left out, until the view is nearer.
  text(words, x, y, z, color, others = []) {
    const out = [0, 0, 0];
    this.project(x, y, z, out);
    if (out[2] < 0.5) return;
    this.pen.font = `${12 * this.ratio}px system-ui, sans-serif`;
    const half = this.pen.measureText(words).width / 2;
    if (others.some((one) => Math.abs(one[0] - out[0]) < one[2] + half && Math.abs(one[1] - out[1]) < 14 * this.ratio)) return;
    others.push([out[0], out[1], half]);
    this.pen.textAlign = "center";
    this.pen.lineWidth = 3 * this.ratio;
    this.pen.setLineDash([]);
    this.pen.strokeStyle = "#fff";
    this.pen.strokeText(words, out[0], out[1] - 4 * this.ratio);
    this.pen.fillStyle = color;
    this.pen.fillText(words, out[0], out[1] - 4 * this.ratio);
  }

  rings() {
    const edges = this.content.rings, out = [0, 0, 0];
    let last = Infinity;
    for (const radius of edges) {
      this.project(0, radius, this.ground, out);
      const crowded = Math.abs(out[0] - last) < 40 * this.ratio; // labels would overlap
      if (crowded && edges.length > 8) continue;
      const circle = Array.from({ length: 97 }, (_, i) => [radius * Math.sin((i * Math.PI) / 48), radius * Math.cos((i * Math.PI) / 48), this.ground]);
      this.line(circle, "rgba(82,96,109,.35)", 1);
      if (crowded) continue;
      last = out[0];
      this.text(`${short(radius)} m`, 0, radius, this.ground, "#52606d");
    }
    this.line([[0, 0, this.ground], [0, 0, 0]], "#52606d", 2);
  }

  outlines() {
    const { sample, method, boxes, clusters, shows } = this.content;
    const { states } = data.palette;
    const colors = { target: data.palette.reasons[0], unknown: data.palette.reasons[0], false: states["false alarm"], unconfirmed: data.palette.reasons[7] };
    for (const { low, high, kind } of clusters ? sample.clusters[method] : []) {
      if (kind === "unconfirmed" && !shows(7)) continue;
      const center = low.map((value, i) => (value + high[i]) / 2), size = low.map((value, i) => high[i] - value + 0.3);
      this.box(center, size, 0, colors[kind], kind === "false" ? 2 : kind === "unconfirmed" ? 1.6 : 1, kind === "unconfirmed" ? [2, 3] : []);
      if (kind === "false") this.text("false alarm", center[0], center[1], high[2], colors.false);
    }
    const stateOf = ({ state }) => (Array.isArray(state) ? state[method] : state);
    const missedFirst = [...(boxes ? sample.boxes : [])].sort((a, b) => (stateOf(b) === "missed") - (stateOf(a) === "missed"));
    const names = [];
    for (const box of missedFirst) {
      const state = stateOf(box);
      const color = state === "missed" ? states["missed target"] : state === "detected" ? states.detected : "#52606d";
      this.box(box.center, box.size, box.yaw, color, 1.6, state === "detected" ? [] : [5, 4]);
      if (state === "ignored") continue;
      const note = { missed: " (missed)", hidden: " (not visible)" }[state] || "";
      this.text(`${box.class}${note}`, box.center[0], box.center[1], box.center[2] + box.size[2] / 2, color, names);
    }
  }

  box(center, size, yaw, color, weight, dash) {
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    const corner = (i, j, k) => {
      const [x, y] = [(i * size[0]) / 2, (j * size[1]) / 2];
      return [center[0] + c * x - s * y, center[1] + s * x + c * y, center[2] + (k * size[2]) / 2];
    };
    const face = (k) => [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]].map(([i, j]) => corner(i, j, k));
    for (const k of [-1, 1]) this.line(face(k), color, weight, dash);
    for (const [i, j] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) this.line([corner(i, j, -1), corner(i, j, 1)], color, weight, dash);
  }
}

// Arrays of a sample, unpacked when it is first shown.
const opened = new Map();
function openSample(number) {
  if (!opened.has(number)) {
    const packed = data.samples[number];
    const xyz = unpack(packed.xyz, Int16Array);
    const levels = xyz.filter((_, i) => i % 3 === 2).sort();
    const reasons = packed.reasons.map((text) => unpack(text, Uint8Array));
    opened.set(number, {
      ...packed, xyz,
      intensity: unpack(packed.intensity, Uint8Array),
      truth: unpack(packed.truth, Uint8Array),
      reasons, reach: reachOf(xyz, packed, reasons[0]),
      ground: (levels[Math.floor(levels.length / 5)] || 0) * packed.scale,
      heights: heightWords(xyz, packed),
    });
  }
  return opened.get(number);
}

// Colours of the points by their height above the mean plane of the water; grey without water.
function heightWords(xyz, { scale, water }) {
  const words = new Uint32Array(xyz.length / 3).fill(TRUTH_WORDS[0]);
  for (let i = 0; water && i < words.length; i++) {
    const [x, y, z] = xyz.subarray(3 * i, 3 * i + 3);
    const height = scale * (z - water.slope_x * x - water.slope_y * y) - water.level;
    words[i] = HEIGHTS[Math.min(Math.max(Math.round(height / HEIGHT_STEP_M), 0), HEIGHTS.length - 1)];
  }
  return words;
}

// Range within which almost all clutter and targets are; points removed as near or far do not count.
function reachOf(xyz, { scale, boxes }, reasons) {
  const ranges = [];
  reasons.forEach((reason, i) => {
    if (reason === 0 || reason === 3 || reason === 4 || reason === 7) ranges.push(Math.hypot(xyz[3 * i], xyz[3 * i + 1]) * scale);
  });
  ranges.sort((a, b) => a - b);
  return Math.max(ranges[Math.floor(0.97 * ranges.length)] || 10, ...boxes.map(({ center }) => 1.1 * Math.hypot(center[0], center[1])));
}
