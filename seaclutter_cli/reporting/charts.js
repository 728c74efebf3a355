// Charts: axes, curves, stacked areas, a density plot and the timeline, redrawn when the width changes.

function ticks(low, high, count) {
  const raw = (high - low) / Math.max(count, 1);
  const size = 10 ** Math.floor(Math.log10(raw));
  const step = size * ([1, 2, 5, 10].find((factor) => factor * size >= raw) || 10);
  const found = [];
  for (let value = Math.ceil(low / step - 1e-9) * step; value <= high + 1e-9 * step; value += step) found.push(value);
  return found.map((value) => (Math.abs(value) < step * 1e-6 ? 0 : value));
}
const tickText = (value) => (Math.abs(value) >= 1e7 ? value.toExponential(0) : (+value.toPrecision(6)).toLocaleString("en-GB"));

// A plot with axes. `paint` draws the content; `stops` are the x positions of the cursor, `describe` returns the readout.
class Plot {
  constructor(host, options) {
    Object.assign(this, { height: 240, x: [0, 1], y: [0, 1], stops: [], left: 68, bottom: 42, ticksY: true }, options);
    if (this.ticksY) this.left = Math.max(this.left, 34 + 7.4 * Math.max(...this.yTicks().map((value) => tickText(value).length)));
    this.root = svg("svg", { role: "img", tabindex: 0, "aria-label": this.label });
    this.readout = h("div", { class: "readout", "aria-live": "polite" });
    host.append(h("div", { class: "plot" }, this.root), this.readout);
    if (!this.stops.length) this.root.removeAttribute("tabindex");
    this.root.addEventListener("pointermove", (event) => this.point(event));
    this.root.addEventListener("pointerleave", () => this.show(-1));
    this.root.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.draw()).observe(host);
    this.draw();
  }
  yTicks() { return ticks(...this.y, this.height / 55); }
  px(x) { return this.left + ((x - this.x[0]) / (this.x[1] - this.x[0] || 1)) * (this.width - this.left - 12); }
  py(y) { return this.height - this.bottom - ((y - this.y[0]) / (this.y[1] - this.y[0] || 1)) * (this.height - this.bottom - 12); }
  draw() {
    const width = Math.max(this.root.parentElement.clientWidth, 240);
    if (width === this.width) return;
    this.width = width;
    this.root.setAttribute("viewBox", `0 0 ${width} ${this.height}`);
    this.root.setAttribute("height", this.height);
    this.root.replaceChildren();
    this.axes();
    this.paint(this);
    this.cursor = svg("line", { class: "cursor", visibility: "hidden", y1: 8, y2: this.height - this.bottom });
    this.root.append(this.cursor);
    this.show(-1);
  }
  axes() {
    const [left, right, floor] = [this.left, this.width - 12, this.height - this.bottom];
    for (const value of this.ticksY ? this.yTicks() : []) {
      this.root.append(svg("line", { class: "grid", x1: left, x2: right, y1: this.py(value), y2: this.py(value) }),
        svg("text", { x: left - 8, y: this.py(value) + 4, "text-anchor": "end" }, tickText(value)));
    }
    for (const value of ticks(...this.x, this.width / 110).filter((tick) => !this.wholeX || Number.isInteger(tick))) {
      this.root.append(svg("line", { class: "axis", x1: this.px(value), x2: this.px(value), y1: floor, y2: floor + 4 }),
        svg("text", { x: this.px(value), y: floor + 18, "text-anchor": "middle" }, tickText(value)));
    }
    this.root.append(svg("path", { class: "axis", d: `M${left} 8V${floor}H${right}` }),
      svg("text", { x: (left + right) / 2, y: this.height - 4, "text-anchor": "middle" }, this.xLabel),
      svg("text", { transform: `translate(13 ${(floor + 8) / 2}) rotate(-90)`, "text-anchor": "middle" }, this.yLabel));
  }
  point(event) {
    const box = this.root.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * this.width;
    let best = -1;
    for (let i = 0; i < this.stops.length; i++) {
      if (best < 0 || Math.abs(this.px(this.stops[i]) - x) < Math.abs(this.px(this.stops[best]) - x)) best = i;
    }
    this.show(best);
  }
  key(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || !this.stops.length) return;
    event.preventDefault();
    this.show(Math.min(Math.max((this.shown ?? -1) + step, 0), this.stops.length - 1));
  }
  show(index) {
    this.shown = index;
    this.cursor.setAttribute("visibility", index < 0 ? "hidden" : "visible");
    if (index >= 0) for (const end of ["x1", "x2"]) this.cursor.setAttribute(end, this.px(this.stops[index]));
    this.readout.textContent = index < 0 ? "" : this.describe(index);
  }
}

const DASHES = [undefined, "7 3", "2 3", "9 3 2 3", "4 2", "12 4"];
function swatch(color, dash) {
  return svg("svg", { "aria-hidden": "true" }, dash === null ? svg("rect", { width: 22, height: 12, rx: 2, fill: color })
    : svg("line", { x1: 0, x2: 22, y1: 6, y2: 6, stroke: color, "stroke-width": 3, "stroke-dasharray": dash }));
}
const legend = (items) => h("ul", { class: "legend" },
  items.map(([name, color, dash]) => h("li", {}, h("span", {}, swatch(color, dash), name))));

// Path through the known values, interrupted at unknown ones.
function curve(plot, xs, values) {
  let path = "", pen = false;
  for (let i = 0; i < xs.length; i++) {
    if (!known(values[i])) { pen = false; continue; }
    path += `${pen ? "L" : "M"}${plot.px(xs[i]).toFixed(1)} ${plot.py(values[i]).toFixed(1)}`;
    pen = true;
  }
  return path;
}

// Dots at all values if there are few, otherwise at isolated values, which no line connects.
function dots(plot, xs, values, color, few = 10) {
  return xs.map((x, i) => i).filter((i) => known(values[i]) && (xs.length <= few || (!known(values[i - 1]) && !known(values[i + 1]))))
    .map((i) => svg("circle", { cx: plot.px(xs[i]).toFixed(1), cy: plot.py(values[i]).toFixed(1), r: xs.length <= few ? 4 : 2, fill: color }));
}

// Frame number at the middle of each bin.
const binMiddles = data.bins.map((start, i) => (start + ((data.bins[i + 1] ?? frames.count) - 1)) / 2);
function binName(i) {
  const first = data.bins[i], last = (data.bins[i + 1] ?? frames.count) - 1;
  return first === last ? `${frameName(first)}, ${frameTime(first)}`
    : `${frameName(first)} to ${frames.number[last]}, from ${frameTime(first)}`;
}
function overFrames(host, options) {
  const x = frames.count > 1 ? [0, frames.count - 1] : [-0.5, 0.5];
  const paint = (plot) => { boundaries(plot); options.paint(plot); };
  return new Plot(host, { x, wholeX: true, stops: binMiddles, xLabel: "Frame", ...options, paint });
}
function boundaries(plot) {
  for (let row = 1; row < frames.count; row++) {
    if (frames.recording[row] !== frames.recording[row - 1]) {
      plot.root.append(svg("line", { class: "axis", "stroke-dasharray": "1 3", x1: plot.px(row - 0.5), x2: plot.px(row - 0.5), y1: 8, y2: plot.height - plot.bottom }));
    }
  }
}

// series: name, color, dash, values and, where bins contain several frames, low and high. The y axis starts at 0, or with
// `span` fits the values and has at least this length.
function lineChart(host, { series, yLabel, label, span }) {
  const top = series.flatMap(({ values, high }) => [...(high || values)].filter(known)).reduce((a, b) => Math.max(a, b), span ? -Infinity : 0);
  const bottom = series.flatMap(({ values, low }) => [...(low || values)].filter(known)).reduce((a, b) => Math.min(a, b), span ? Infinity : 0);
  const [middle, half] = [(top + bottom) / 2, Math.max(0.58 * (top - bottom), (span || 0) / 2)];
  overFrames(host, {
    label, yLabel, y: span ? [middle - half, middle + half] : [bottom, bottom < top ? top + 0.08 * (top - bottom) : bottom + 1],
    describe: (i) => `${binName(i)}: ${series.slice(0, 12).map(({ name, values }) => `${name} ${short(values[i])}`).join("; ")}`,
    paint: (plot) => {
      for (const { color, dash, values, low, high } of series) {
        if (low && data.bins.length < frames.count) {
          plot.root.append(svg("path", { d: band(plot, low, high), fill: color, "fill-opacity": 0.15 }));
        }
        plot.root.append(svg("path", { d: curve(plot, binMiddles, values), fill: "none", stroke: color, "stroke-width": 1.8, "stroke-dasharray": dash, "stroke-linejoin": "round" }),
          ...dots(plot, binMiddles, values, color));
      }
    },
  });
}
function band(plot, low, high) {
  const indices = binMiddles.map((_, i) => i).filter((i) => known(low[i]));
  if (!indices.length) return "";
  const corner = (i, values) => `${plot.px(binMiddles[i]).toFixed(1)} ${plot.py(values[i]).toFixed(1)}`;
  return `M${indices.map((i) => corner(i, high)).join("L")}L${indices.reverse().map((i) => corner(i, low)).join("L")}Z`;
}

// Stacked counts, the first series at the bottom.
function stackChart(host, { series, yLabel, label }) {
  const sums = [binMiddles.map(() => 0)];
  for (const { values } of series) sums.push(sums[sums.length - 1].map((sum, i) => sum + (known(values[i]) ? values[i] : 0)));
  const top = sums[sums.length - 1].reduce((a, b) => Math.max(a, b), 1);
  const edges = frames.count > 1 ? binMiddles : [-0.5, 0.5];
  const pick = (values, i) => values[Math.min(i, values.length - 1)];
  overFrames(host, {
    label, yLabel, y: [0, 1.04 * top],
    describe: (i) => `${binName(i)}: ${series.map(({ name, values }) => `${name} ${known(values[i]) ? whole(values[i]) : "–"}`).join("; ")}`,
    paint: (plot) => series.forEach(({ color }, k) => {
      const line = (values) => edges.map((x, i) => `${plot.px(x).toFixed(1)} ${plot.py(pick(values, i)).toFixed(1)}`);
      plot.root.append(svg("path", { d: `M${line(sums[k + 1]).join("L")}L${line(sums[k]).reverse().join("L")}Z`, fill: color }));
    }),
  });
}

const SHADES = 8;
// Points by range and intensity in shades of one colour, darker for more points, with the thresholds of the range rings.
function densityChart(host, { density, counts, color, edges, thresholds, label }) {
  const top = counts.reduce((a, b) => Math.max(a, b), 0);
  const least = counts.reduce((a, b) => (b > 0 ? Math.min(a, b) : a), Infinity);
  const span = Math.log(top / least) || 1;
  new Plot(host, {
    label, height: 300, x: [0, density.reach], y: [density.low, density.high], xLabel: "Range (m)", yLabel: "Intensity (sensor units)",
    stops: Array.from({ length: density.columns }, (_, i) => ((i + 0.5) / density.columns) * density.reach),
    describe: (i) => {
      const range = ((i + 0.5) / density.columns) * density.reach;
      const ring = edges.findIndex((edge, k) => range >= edge && range < edges[k + 1]);
      let points = 0;
      for (let row = 0; row < density.rows; row++) points += counts[row * density.columns + i];
      return `${range.toFixed(1)} m: ${short(points)} points per frame${ring < 0 ? "" : `, mean threshold ${short(thresholds[ring])}`}`;
    },
    paint: (plot) => {
      const paths = Array(SHADES).fill("");
      const [w, t] = [density.reach / density.columns, (density.high - density.low) / density.rows];
      counts.forEach((count, cell) => {
        if (!count) return;
        const x = (cell % density.columns) * w, y = density.low + Math.floor(cell / density.columns) * t;
        const shade = Math.min(SHADES - 1, Math.floor((SHADES * Math.log(count / least)) / span));
        const [x0, x1, y0, y1] = [plot.px(x), plot.px(x + w), plot.py(y), plot.py(y + t)];
        paths[shade] += `M${x0.toFixed(1)} ${y0.toFixed(1)}H${x1.toFixed(1)}V${y1.toFixed(1)}H${x0.toFixed(1)}Z`;
      });
      paths.forEach((d, k) => plot.root.append(svg("path", { d, fill: color, "fill-opacity": 0.2 + (0.8 * k) / (SHADES - 1), "shape-rendering": "crispEdges" })));
      plot.root.append(svg("path", { d: stairs(plot, edges, thresholds), fill: "none", stroke: "#fff", "stroke-width": 5 }),
        svg("path", { d: stairs(plot, edges, thresholds), fill: "none", stroke: data.palette.states["false alarm"], "stroke-width": 2.5 }));
    },
  });
}
const stairs = (plot, edges, values) => values.map((value, k) =>
  `${k ? "L" : "M"}${plot.px(edges[k])} ${plot.py(value)}L${plot.px(edges[k + 1])} ${plot.py(value)}`).join("");

// One row per method: false alarms in the upper half, missed targets in the lower. A click selects the nearest of `picks`.
function timelineChart(host, { methods, picks, onPick, describe }) {
  const step = 34, names = methods.map(({ name }) => shortened(name, host.clientWidth < 500 ? 14 : 24));
  const plot = overFrames(host, {
    label: "Frames with false alarms and missed targets over time", height: methods.length * step + 58, left: rowLeft(names), x: [-0.5, frames.count - 0.5], yLabel: "",
    y: [0, 1], ticksY: false, bottom: 44, stops: Array.from({ length: frames.count }, (_, row) => row), describe,
    paint: (plot) => {
      methods.forEach(({ bits }, k) => {
        const y = 12 + k * step;
        rowName(plot, names[k], y + 16);
        const rows = { 1: ["correct", 0, 24], 2: ["false alarm", 0, 12], 4: ["missed target", 12, 12] };
        for (const [bit, [state, top, height]] of Object.entries(rows)) {
          plot.root.append(svg("path", { d: bars(plot, runs(bits, bit), y + top, height), fill: data.palette.states[state] }));
        }
      });
      const floor = plot.height - plot.bottom;
      for (const row of picks) plot.root.append(svg("path", { d: `M${plot.px(row)} ${floor - 10}l5 9h-10Z`, fill: data.palette.lines[0] }));
    },
  });
  const pick = (row) => onPick(picks.reduce((best, other) => (Math.abs(other - row) < Math.abs(best - row) ? other : best), picks[0]));
  plot.root.addEventListener("click", () => plot.shown >= 0 && pick(plot.shown));
  plot.root.addEventListener("keydown", (event) => event.key === "Enter" && plot.shown >= 0 && pick(plot.shown));
}
const shortened = (name, most) => (name.length > most ? `${name.slice(0, most - 6)}…${name.slice(-5)}` : name);
const rowLeft = (names) => Math.max(68, Math.max(...names.map((name) => name.length)) * 7.2 + 18);
const rowName = (plot, name, y) => plot.root.append(svg("text", { x: plot.left - 8, y, "text-anchor": "end" }, name));
function bars(plot, spans, y, height) {
  const size = Math.max(1.5, plot.px(1) - plot.px(0));
  return spans.map(([from, to]) => {
    const x = plot.px(from) - size / 2;
    return `M${x.toFixed(1)} ${y}h${(plot.px(to) - plot.px(from) + size).toFixed(1)}v${height}H${x.toFixed(1)}Z`;
  }).join("");
}

// One row per class of scene, with the frames of that class.
function sceneChart(host, { scenes, label }) {
  const classes = Object.keys(scenes), names = classes.map((name) => shortened(name, 20)), colors = ringColors(classes.length);
  overFrames(host, {
    label, height: classes.length * 26 + 56, left: rowLeft(names), x: [-0.5, frames.count - 0.5], yLabel: "", y: [0, 1], ticksY: false,
    stops: Array.from({ length: frames.count }, (_, row) => row),
    describe: (row) => `${frameName(row)}, ${frameTime(row)}: ${classes.find((name) => scenes[name][row]) ?? "unknown"}`,
    paint: (plot) => classes.forEach((name, k) => {
      rowName(plot, names[k], 12 + 26 * k + 13);
      plot.root.append(svg("path", { d: bars(plot, runs(scenes[name], 1), 12 + 26 * k, 18), fill: colors[k] }));
    }),
  });
}
function runs(bits, bit) {
  const found = [];
  bits.forEach((value, row) => {
    if (!(value & bit)) return;
    const last = found[found.length - 1];
    if (last && last[1] === row - 1) last[1] = row;
    else found.push([row, row]);
  });
  return found;
}
