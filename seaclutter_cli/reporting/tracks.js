// Tracks of objects seen from above, and a list of them: one that is chosen is drawn alone in colour.

const VIEW = 600; // side of the picture in its own units

function fillTracks(host) {
  const { tracks } = data;
  if (!tracks.length) { host.hidden = true; return; }
  const reach = Math.max(20, ...tracks.flatMap(({ places, size }) => places.flat().map((one) => Math.abs(one) + Math.hypot(size[0], size[1]) / 2))) * 1.05;
  const px = ([x, y]) => [VIEW / 2 * (1 - y / reach), VIEW / 2 * (1 - x / reach)]; // x, ahead, is up
  const lines = data.palette.lines;
  host.append(h("p", { class: "muted" }, `${plural(tracks.length, "object")} of ${methods[0].name}, those seen in most frames; positions are relative to own ship, which points up, and velocities too. The last box is drawn.`));
  const picture = svg("svg", { viewBox: `0 0 ${VIEW} ${VIEW}`, role: "img", "aria-label": "Tracks of objects from above", class: "tracks" });
  for (const range of ticks(0, reach, 4).slice(1)) {
    picture.append(svg("circle", { class: "grid", fill: "none", cx: VIEW / 2, cy: VIEW / 2, r: VIEW / 2 * range / reach }),
      svg("text", { x: VIEW / 2 + 4, y: VIEW / 2 * (1 - range / reach) - 3 }, `${tickText(range)} m`));
  }
  picture.append(svg("path", { d: `M${VIEW / 2} ${VIEW / 2 - 9}l6 15h-12z`, class: "ownship" }));
  const drawn = tracks.map(({ places, size: [length, width], yaw, id }, k) => {
    const color = lines[k % lines.length], [x, y] = places[places.length - 1];
    const corners = [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([along, across]) => [along * length / 2, across * width / 2])
      .map(([along, across]) => px([x + along * Math.cos(yaw) - across * Math.sin(yaw), y + along * Math.sin(yaw) + across * Math.cos(yaw)]));
    const [left, top] = px([x, y]);
    const group = svg("g", { stroke: color, fill: "none", "stroke-width": 2, click: () => choose(k) },
      svg("polyline", { points: places.map((place) => px(place).join()).join(" ") }), svg("polygon", { points: corners.map((corner) => corner.join()).join(" ") }),
      svg("text", { x: left + 6, y: top - 6, stroke: "none", fill: color }, String(id)));
    picture.append(group);
    return group;
  });
  const buttons = tracks.map(({ id }, k) => h("button", { type: "button", "aria-pressed": "false", click: () => choose(k) }, String(id)));
  let chosen = -1;
  const choose = (number) => {
    chosen = number === chosen ? -1 : number;
    drawn.forEach((group, k) => group.setAttribute("opacity", chosen < 0 || k === chosen ? 1 : 0.12));
    buttons.forEach((button, k) => button.setAttribute("aria-pressed", String(k === chosen)));
  };
  const rows = tracks.map(({ recording, rows: seen, frames: number, size, speed, score, kind }, k) => [buttons[k], kind,
    ...(data.recordings.length > 1 ? [data.recordings[recording]] : []), `${frameTime(seen[0])} to ${frameTime(seen[seen.length - 1])}`, whole(number),
    size.map((side) => side.toFixed(1)).join(" × "), speed.toFixed(1), score.toFixed(2)]);
  host.append(h("figure", {}, picture), tableOf(["object", "class", ...(data.recordings.length > 1 ? ["recording"] : []), "seen", "frames",
    "size in m", "last speed in m/s", "score"], rows));
}
