"use strict";
// Helpers for elements, numbers and arrays. Text from a log is only ever inserted as text, never as HTML.

const data = JSON.parse(document.getElementById("data").textContent);

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== undefined && value !== false) element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat().filter((child) => child !== undefined && child !== null));
  return element;
}
const h = (tag, attributes = {}, ...children) => fill(document.createElement(tag), attributes, children);
const svg = (tag, attributes = {}, ...children) =>
  fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
const byId = (id) => document.getElementById(id);

function unpack(text, Kind) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Kind(bytes.buffer);
}
// Splits a flat array into rows of `count` values.
const rowsOf = (values, count) => Array.from({ length: count ? values.length / count : 0 },
  (_, k) => values.subarray(k * count, (k + 1) * count));

const whole = (value) => Math.round(value).toLocaleString("en-GB");
const known = (value) => value !== null && value !== undefined && Number.isFinite(value);
const share = (part, total) => (total ? `${((100 * part) / total).toFixed(1)} %` : "–");
const short = (value) => (!known(value) ? "–" : Math.abs(value) >= 100 ? whole(value) : String(+value.toPrecision(3)));
const plural = (count, one, many = `${one}s`) => `${whole(count)} ${count === 1 ? one : many}`;

const frames = {
  count: data.frames.count,
  recording: unpack(data.frames.recording, Uint16Array),
  number: unpack(data.frames.frame, Uint32Array),
  seconds: unpack(data.frames.seconds, Float32Array),
};
function frameName(row) {
  const name = `frame ${frames.number[row]}`;
  return data.recordings.length > 1 ? `${data.recordings[frames.recording[row]]}, ${name}` : name;
}
const frameTime = (row) => `${frames.seconds[row].toFixed(2)} s`;

// Colours of K range rings: distinct colours for a few, otherwise a ramp from the nearest to the farthest.
function ringColors(count) {
  const { lines, ramp } = data.palette;
  if (count <= lines.length) return lines.slice(0, count);
  const parse = (color) => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));
  const [first, middle, last] = ramp.map(parse);
  return Array.from({ length: count }, (_, k) => {
    const position = (2 * k) / (count - 1);
    const [from, to, part] = position < 1 ? [first, middle, position] : [middle, last, position - 1];
    return `rgb(${from.map((value, i) => Math.round(value + part * (to[i] - value))).join(",")})`;
  });
}
