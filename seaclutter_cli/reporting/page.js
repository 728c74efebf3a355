// The page: each section fills itself from the data.

const { methods, samples, labelled, palette } = data;
const steps = data.bins.length;
const figure = (host, title, note) => {
  const root = h("figure");
  host.append(h("h3", {}, title), root);
  if (note) root.append(h("figcaption", {}, note));
  return root;
};
const select = (options, onChange, label) => {
  const box = h("select", { change: () => onChange(box.selectedIndex), "aria-label": label }, options.map((text, i) => h("option", { value: i }, text)));
  return box;
};

function fillHead() {
  const name = data.recordings.length === 1 ? data.recordings[0] : plural(data.recordings.length, "recording");
  document.title = `${name || "no recording"} – seaclutter report`;
  at("title").textContent = name;
  const seconds = frames.count ? frames.seconds[frames.count - 1] : 0;
  const span = data.recordings.length === 1 && seconds ? `, ${seconds.toFixed(1)} s` : "";
  at("subtitle").textContent = `${plural(frames.count, "frame")}${span}; filtered by ${methods.map(({ name }) => name).join(", ")}`;
  at("footer").textContent = `Written by seaclutter ${data.version}. This page holds all of its data and loads nothing.`;
}

function tile(name, value, bad = false) {
  return h("div", { class: "tile" }, h("dt", {}, name), h("dd", { class: bad ? "bad" : undefined }, value));
}
function fillSummary(host) {
  if (data.notes.length) host.append(h("ul", { class: "notes" }, data.notes.map((note) => h("li", {}, note))));
  if (!frames.count) { host.append(h("p", {}, "There was no frame to look at.")); return; }
  const { totals, summary, name } = methods[0];
  const points = totals.reduce((a, b) => a + b, 0);
  if (methods.length > 1) host.append(h("p", { class: "muted" }, `The figures below are of ${name}; the table compares all methods.`));
  host.append(h("dl", { class: "tiles" },
    tile("Frames", whole(frames.count)), tile("Points in", whole(points)), tile("Points kept", share(totals[0], points)),
    labelled ? [tile("Frames with false alarms", `${whole(summary.N_FP)} of ${whole(summary.frames)}`, summary.N_FP > 0),
      tile("Frames with omitted alarms", `${whole(summary.N_FN)} of ${whole(summary.frames)}`, summary.N_FN > 0)] : []));
  host.append(reasonTable(points));
  if (labelled) host.append(h("h3", {}, "Methods compared"), h("p", { class: "muted" },
    "R_FP and R_FN are the shares of labelled frames with a false and with an omitted alarm."), comparison());
}
function tableOf(head, rows) {
  return h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": head[0] }, h("table", {},
    h("thead", {}, h("tr", {}, head.map((cell) => h("th", { scope: "col" }, cell)))),
    h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell)))))));
}
function reasonTable(points) {
  const used = palette.order.filter((reason) => methods.some(({ totals }) => totals[reason]));
  const rows = used.map((reason) => [palette.names[reason], ...methods.flatMap(({ totals }) =>
    methods.length > 1 ? [share(totals[reason], points)] : [whole(totals[reason]), share(totals[reason], points)])]);
  return tableOf(["what became of points", ...(methods.length > 1 ? methods.map(({ name }) => name) : ["points", "share"])], rows);
}
function comparison() {
  const percent = (value) => (known(value) ? `${(100 * value).toFixed(2)} %` : "–");
  const columns = [
    ["frames", (s) => whole(s.frames)], ["N_FP", (s) => whole(s.N_FP)], ["N_FN", (s) => whole(s.N_FN)],
    ["R_FP", (s) => percent(s.R_FP)], ["R_FN", (s) => percent(s.R_FN)], ["F1", (s) => (known(s.f1) ? s.f1.toFixed(3) : "–")],
    ["false/frame", (s) => (known(s.false_alarms_per_frame) ? s.false_alarms_per_frame.toFixed(2) : "–")],
  ];
  if (methods.some(({ summary }) => known(summary.clutter_removal))) columns.push(
    ["clutter removed", (s) => percent(s.clutter_removal)], ["target lost", (s) => percent(s.target_loss)], ["R_c", (s) => percent(s.R_c)]);
  return tableOf(["method", ...columns.map(([name]) => name)], methods.map(({ name, summary }) => [name, ...columns.map(([, cell]) => cell(summary))]));
}

const alarms = methods.map((method) => ({ name: method.name, bits: unpack(method.alarms, Uint8Array),
  wrong: unpack(method.false_alarms, Uint8Array), lost: unpack(method.omitted, Uint8Array) }));
function verdict({ bits, wrong, lost }, row) {
  if (!(bits[row] & 1)) return "not labelled";
  const parts = [];
  if (wrong[row]) parts.push(plural(wrong[row], "false alarm"));
  if (lost[row]) parts.push(plural(lost[row], "omitted alarm"));
  return parts.join(", ") || "all right";
}

function fillFrames(host, look) {
  if (!samples.length) { host.append(h("p", {}, "There is no frame to show.")); return; }
  const bad = alarms[0].bits.reduce((sum, bits) => sum + (bits > 1), 0);
  const badness = ({ row }) => alarms[0].wrong[row] + alarms[0].lost[row];
  const judged = ({ row }) => alarms[0].bits[row] & 1;
  const groups = labelled ? [
    [`Frames that went wrong, the worst first: ${whole(samples.filter(badness).length)} of ${whole(bad)}`, (sample) => badness(sample)],
    ["Frames that went well", (sample) => judged(sample) && !badness(sample)],
    ["Frames not labelled", (sample) => !judged(sample)],
  ] : [
    ["Frames of which the largest share was removed as clutter", ({ why }) => why === "worst"],
    ["Frames of which the smallest share was removed", ({ why }) => why === "best"],
    ["Evenly spread", ({ why }) => why === "even"],
    ["Asked for", ({ why }) => why === "picked"],
  ];
  host.append(h("p", {}, `Of ${plural(frames.count, "frame")}, ${whole(samples.length)} can be looked at here: the ${labelled ? "worst, the best" : "most and the least filtered"} and some evenly spread. Choose one to see its points.`
    + (labelled && methods.length > 1 ? ` Right and wrong are those of ${methods[0].name}.` : "")
    + (labelled && !bad ? " No labelled frame went wrong." : "")));
  const buttons = samples.map((sample, number) => h("button", { type: "button", click: () => { look(number); at("look").scrollIntoView(); } },
    frameName(sample.row), h("small", {}, labelled ? verdict(alarms[0], sample.row) : frameTime(sample.row))));
  for (const [title, belongs] of groups) {
    const own = buttons.filter((_, number) => belongs(samples[number]));
    if (own.length) host.append(h("h3", {}, title), h("ul", { class: "picks" }, own.map((button) => h("li", {}, button))));
  }
  if (labelled) {
    unseen(host);
    const root = figure(host, "Alarms over time", "Triangles mark the frames that can be looked at; a click shows the nearest one. Pale frames are labelled and all right, empty ones not labelled.");
    root.prepend(legend([["false alarm (upper half)", palette.states["false alarm"], null], ["omitted alarm (lower half)", palette.states["omitted alarm"], null]]));
    const numberAt = (row) => samples.findIndex((sample) => sample.row === row);
    timelineChart(root, { methods: alarms, picks: samples.map(({ row }) => row), onPick: (row) => { look(numberAt(row)); at("look").scrollIntoView(); },
      describe: (row) => `${frameName(row)}, ${frameTime(row)}: ${alarms.map((one) => `${one.name} ${verdict(one, row)}`).join("; ")}` });
  }
  return buttons;
}

// Frames that went wrong and are not among those chosen, as far as a reader can follow.
function unseen(host, most = 300) {
  const rest = alarms[0].bits.map((bits) => Number(bits > 1));
  for (const { row } of samples) rest[row] = 0;
  const spans = runs(rest, 1), count = rest.reduce((a, b) => a + b, 0);
  if (!count) return;
  const name = data.recordings.length > 1 ? frameName : (row) => frames.number[row];
  const names = spans.slice(0, most).map(([from, to]) => (from === to ? name(from) : `${name(from)} to ${frames.number[to]}`));
  if (spans.length > most) names.push(`and so on; ${whole(spans.length - most)} more stretches are in the timeline below`);
  host.append(h("details", {}, h("summary", {}, `${plural(count, "more frame")} that went wrong`),
    h("p", {}, `${names.join(", ")}. Their points are not in this page; --pick K puts those of frame K into it, --show N those of more frames.`)));
}

const STAGES = [["Raw", () => true], ["After intensity", (reason) => reason === 0 || reason === 4], ["After outliers", (reason) => reason === 0]];
function fillLook(host) {
  const state = { number: 0, layout: "one", stage: 0, method: 0, other: Math.min(1, methods.length - 1), color: "reason", boxes: true, clusters: true, hidden: new Set() };
  const camera = new Camera();
  let views = [], marks = [];
  const panes = h("div", { class: "panes" }), info = h("p", { class: "muted", "aria-live": "polite", id: "shown" }), keys = h("ul", { class: "legend" });
  const groups = [];
  const pressed = (name, options, label, also = () => {}) => {
    const buttons = options.map(([value, text]) => h("button", { type: "button", click: () => { state[name] = value; also(value); rebuild(); } }, text));
    groups.push(() => buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(state[name] === options[i][0]))));
    return h("span", { class: "group", role: "group", "aria-label": label }, buttons);
  };
  const check = (name, text) => h("label", {}, h("input", { type: "checkbox", checked: true, change: (event) => { state[name] = event.target.checked; update(); } }), text);
  const chooser = select(samples.map((sample) => labelled ? `${frameName(sample.row)}: ${verdict(alarms[0], sample.row)}`
    : `${frameName(sample.row)} (${{ worst: "much removed", best: "little removed", even: "evenly spread", picked: "asked for" }[sample.why]})`), (number) => look(number), "frame");
  const names = methods.map(({ name }) => name);
  const first = select(names, (number) => { state.method = number; rebuild(); }, "method");
  const second = select(names, (number) => { state.other = number; rebuild(); }, "second method");
  second.selectedIndex = state.other;
  const layouts = [["one", "One view"], ["stages", "Stage by stage"], ...(methods.length > 1 ? [["two", "Two methods"]] : [])];
  const colors = [["reason", "Reason"], ...(labelled ? [["truth", "Label"]] : []), ...(data.intensity_top > 0 ? [["intensity", "Intensity"]] : [])];
  const against = h("label", {}, "beside", second);
  const stages = h("span", { class: "bar" }, "Stage", pressed("stage", STAGES.map(([name], i) => [i, name]), "stage"));
  host.append(
    h("div", { class: "bar steps" }, h("button", { type: "button", click: () => look(state.number - 1) }, "Previous"), chooser, h("button", { type: "button", click: () => look(state.number + 1) }, "Next")),
    h("div", { class: "bar" }, pressed("layout", layouts, "layout", (layout) => { if (layout === "two") state.stage = 2; }), methods.length > 1 ? h("label", {}, "Method", first) : null, against, stages),
    h("div", { class: "bar" }, "Colour", pressed("color", colors, "colour"), labelled ? check("boxes", "labelled boxes") : null, check("clusters", "clusters"),
      h("button", { type: "button", click: () => camera.top() }, "From above"), h("button", { type: "button", click: () => camera.home() }, "Reset view")),
    info, panes, keys,
    h("p", { class: "muted" }, "Drag to turn, hold Shift to move, pinch or scroll (after a click) to zoom. Keys: arrows turn, Shift and arrows move, + and − zoom, T from above, 0 resets."));

  const panesOf = () => state.layout === "stages" ? STAGES.map(([name, shows]) => [name, state.method, shows])
    : state.layout === "two" ? [state.method, state.other].map((method) => [names[method], method, STAGES[state.stage][1]])
    : [[methods.length > 1 ? names[state.method] : "", state.method, STAGES[state.stage][1]]];
  function rebuild() {
    for (const view of views) view.close();
    panes.replaceChildren();
    panes.className = `panes ${{ one: "", two: "two", stages: "three" }[state.layout]}`;
    views = panesOf().map(([title]) => {
      const pane = h("div", { class: "pane" }, title ? h("h3", {}, title) : null);
      panes.append(pane);
      return new CloudView(pane, camera);
    });
    against.hidden = state.layout !== "two";
    stages.hidden = state.layout === "stages";
    for (const sync of groups) sync();
    update();
  }
  function update() {
    const sample = openSample(state.number);
    panesOf().forEach(([title, method, shows], i) => views[i].show({
      sample, method, color: state.color, boxes: state.boxes, clusters: state.clusters && !(state.layout === "stages" && i < 2) && (state.layout === "stages" || state.stage === 2 || state.stage === 0),
      rings: methods[method].edges, shows: (reason) => shows(reason) && !(state.color === "reason" && state.hidden.has(reason)),
    }, `Point cloud of ${frameName(sample.row)}${title ? `, ${title}` : ""}: ${plural(sample.shown, "point")}`));
    const thinned = sample.shown < sample.valid ? `${whole(sample.shown)} of ${whole(sample.valid)} returns are drawn; kept and target points come first` : `all ${whole(sample.valid)} returns are drawn`;
    const told = labelled ? ` ${alarms.filter((_, method) => alarms.length < 5 || panesOf().some((pane) => pane[1] === method)).map((one) => `${one.name}: ${verdict(one, sample.row)}`).join("; ")}.` : "";
    info.textContent = `${frameName(sample.row)}, ${frameTime(sample.row)}.${told} ${thinned[0].toUpperCase()}${thinned.slice(1)}.`;
    chooser.selectedIndex = state.number;
    marks.forEach((button, number) => button.setAttribute("aria-current", String(number === state.number)));
    keys.replaceChildren(...legendOf(sample));
  }
  function legendOf(sample) {
    if (state.color === "truth") return palette.truth_names.map((name, i) => sample.truth.includes(i) ? h("li", {}, h("span", {}, swatch(palette.truth[i], null), name)) : null).filter(Boolean);
    if (state.color === "intensity") return [h("li", {}, h("span", {}, `light: weak; dark: ${short(data.intensity_top)} and above`))];
    const used = palette.order.filter((reason) => sample.reasons.some((reasons) => reasons.includes(reason)));
    return used.map((reason) => h("li", {}, h("label", {},
      h("input", { type: "checkbox", checked: !state.hidden.has(reason), change: (event) => { state.hidden[event.target.checked ? "delete" : "add"](reason); camera.changed(); } }),
      swatch(palette.reasons[reason], null), palette.names[reason])));
  }
  function look(number) {
    state.number = Math.min(Math.max(number, 0), samples.length - 1);
    update();
  }
  const end = Math.max(...methods.map(({ edges }) => edges[edges.length - 1] || 0)) || Infinity;
  camera.home(Math.min(openSample(0).reach, end));
  rebuild();
  return { look, mark: (buttons) => { marks = buttons; update(); } };
}

function fillCurves(host) {
  if (!frames.count) { host.hidden = true; return; }
  if (steps < frames.count) host.append(h("p", { class: "muted" }, `Each step of a curve is the mean over ${data.bins[1]} frames; the pale band around thresholds reaches from the least to the greatest.`));
  const root = h("div");
  const draw = (number) => { root.replaceChildren(); curvesOf(root, methods[number]); };
  if (methods.length > 1) host.append(h("div", { class: "bar" }, h("label", {}, "Method", select(methods.map(({ name }) => name), draw, "method of the curves"))));
  host.append(root);
  draw(0);
}
function curvesOf(host, method) {
  const counts = rowsOf(unpack(method.counts, Float32Array), steps);
  const used = palette.order.filter((reason) => method.totals[reason]);
  const series = used.map((reason) => ({ name: palette.names[reason], color: palette.reasons[reason], values: counts[reason] }));
  const stacked = figure(host, "Points of a frame by what became of them");
  stacked.append(legend(series.map(({ name, color }) => [name, color, null])));
  stackChart(stacked, { series, yLabel: "points", label: "Points of each frame by reason" });
  const scenes = Object.fromEntries(Object.entries(method.scenes).map(([name, text]) => [name, unpack(text, Uint8Array)]));
  if (Object.keys(scenes).length) sceneChart(figure(host, "Scene of each frame"), { scenes, label: "Scene of each frame" });
  const rings = method.edges.length - 1;
  if (rings < 1) return;
  const colors = ringColors(rings), few = rings <= palette.lines.length;
  const [thresholds, low, high, corrections] = ["thresholds", "thresholds_low", "thresholds_high", "corrections"]
    .map((name) => rowsOf(unpack(method[name], Float32Array), steps));
  const charts = h("div");
  const names = method.edges.slice(0, -1).map((edge, k) => `${short(edge)} to ${short(method.edges[k + 1])} m`);
  if (!few) host.append(h("div", { class: "bar" }, h("label", {}, "Ring", select(["all rings", ...names], (number) => draw(number - 1), "ring"))));
  host.append(charts);
  const ringsOf = (values, spread) => values.map((row, k) => ({ name: names[k], color: colors[k],
    dash: few ? DASHES[k] : undefined, values: row, low: spread ? low[k] : undefined, high: spread ? high[k] : undefined }));
  const draw = (only) => {
    charts.replaceChildren();
    for (const [title, values, spread, note] of [
      ["Threshold of each ring", thresholds, true],
      ["Correction of each ring", corrections, false, "What the outliers of the frame before say the threshold should be; 0 where there were none."],
    ]) {
      if (!values.some((row) => row.some((value) => known(value) && value))) continue;
      const all = ringsOf(values, spread), own = only < 0 ? all : [all[only]];
      const root = figure(charts, title, note);
      root.append(legend((few || own.length < 3 ? own : [own[0], own[rings >> 1], own[rings - 1]]).map(({ name, color, dash }) => [name, color, dash])));
      lineChart(root, { series: own, yLabel: "intensity", label: title });
    }
  };
  draw(-1);
}

function fillDensity(host) {
  const able = methods.filter(({ density }) => density);
  if (!able.length) { host.hidden = true; return; }
  host.append(h("p", { class: "muted" }, `Points a frame by range and intensity, from ${plural(able[0].density.frames, "frame")} evenly spread over the log; darker is more.${able.some(({ edges }) => edges.length) ? " The line is each ring's mean threshold." : ""}`));
  let [method, chosen] = [0, 0];
  const root = h("figure");
  const groups = () => [["all points", null], ...palette.order.filter((reason) => able[method].density.counts[reason]).map((reason) => [palette.names[reason], reason])];
  const pick = h("span");
  const draw = () => {
    const { density, edges, mean_thresholds: thresholds } = able[method];
    const found = groups();
    chosen = Math.min(chosen, found.length - 1);
    const box = select(found.map(([name]) => name), (number) => { chosen = number; draw(); }, "points shown");
    box.selectedIndex = chosen;
    pick.replaceChildren(box);
    const reason = found[chosen][1];
    const parts = Object.entries(density.counts).filter(([key]) => reason === null || Number(key) === reason).map(([, text]) => unpack(text, Float32Array));
    const counts = parts.reduce((sum, part) => sum.map((value, i) => value + part[i]));
    root.replaceChildren();
    densityChart(root, { density, counts, edges, thresholds, color: reason === null ? palette.reasons[0] : palette.reasons[reason], label: "Points by range and intensity" });
  };
  host.append(h("div", { class: "bar" }, able.length > 1 ? h("label", {}, "Method", select(able.map(({ name }) => name), (number) => { method = number; draw(); }, "method of the density")) : null,
    h("label", {}, "Points", pick)), root);
  draw();
}

function fillConfig(host) {
  for (const { name, config } of methods) host.append(h("details", { open: methods.length === 1 }, h("summary", {}, name), h("pre", { tabindex: 0 }, config)));
}

fillHead();
fillSummary(at("summary"));
if (samples.length) {
  const view = fillLook(at("look"));
  view.mark(fillFrames(at("frames"), view.look));
} else {
  fillFrames(at("frames"));
  at("look").hidden = true;
}
fillCurves(at("curves"));
fillDensity(at("density"));
fillConfig(at("config"));
