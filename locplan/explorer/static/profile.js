// The profile along both paths; hovering or arrow keys mark a place on the chart and on the map.
import { byId, fittedContext } from "./dom.js";
import { paints, repaint } from "./frames.js";
import { nearestAlong, pointAlong, stepAt } from "./lines.js";
import { candidateDash, errorColour } from "./simulating.js";
import { model, on } from "./store.js";
import { haloedDot } from "./strokes.js";
import { metres, short, ticks } from "./text.js";
import { palette } from "./theme.js";
import { pixelsPerMetre, screenOf } from "./view.js";

const EDGE_LEFT = 40;
const EDGE_RIGHT = 14;
const EDGE_TOP = 8;
const EDGE_BOTTOM = 22;

/** Connect the chart. */
export function startProfile() {
  const chart = byId("profile-chart");
  chart.addEventListener("pointermove", (event) => markAlong(metresAt(event.offsetX)));
  chart.addEventListener("pointerdown", (event) => markAlong(metresAt(event.offsetX)));
  chart.addEventListener("pointerleave", () => markAlong(null));
  chart.addEventListener("blur", () => markAlong(null));
  chart.addEventListener("keydown", walkAlong);
  byId("profile-kind").addEventListener("change", () => repaint("profile"));
  paints("profile", paintProfile);
  on("plan", () => chart.setAttribute("aria-valuemax", longest().toFixed(1)));
  on("theme", () => repaint("profile"));
}

/** Mark a place `s` metres along, or none. */
export function markAlong(s) {
  const next = s === null ? null : { s: Math.min(Math.max(s, 0), longest()) };
  if (next === null && model.along === null) return;
  model.along = next;
  if (next) sayPlace(next.s);
  repaint("profile", "overlay");
}

/** Mark the place of the nearer path under a world point, if it is close. */
export function markNear(point) {
  const near = shownPaths().map(({ path }) => nearestAlong(path.xy, point));
  const best = near.sort((a, b) => a.distance - b.distance)[0];
  markAlong(best && best.distance * pixelsPerMetre() < 14 ? best.s : null);
}

/** Draw the dots of the marked place on the map. */
export function paintAlong(context) {
  if (!model.along) return;
  for (const { path, colour } of shownPaths()) {
    const place = pointAlong(path.xy, model.along.s);
    if (place) haloedDot(context, ...screenOf(...place), 6.5, colour);
  }
}

function shownPaths() {
  const { aware, shortest } = model.plan ?? {};
  return [{ name: "shortest", path: shortest, colour: palette.ink }, { name: "aware", path: aware, colour: palette.teal }].filter(({ path }) => path?.xy.length);
}

function longest() {
  const lengths = shownPaths().map(({ path }) => path.length);
  if (showsErrors()) lengths.push(...model.simulated.candidates.map(({ length }) => length));
  return Math.max(0.1, ...lengths);
}

function showsErrors() {
  return byId("profile-kind").value === "error" && model.simulated !== null;
}

// The lines of the chart: {s, values, colour, dash, band?}.
function series() {
  if (showsErrors())
    return model.simulated.candidates.filter(({ profile }) => profile?.s?.length).map((candidate, index) => ({ s: candidate.profile.s, values: candidate.profile.median_cm, band: candidate.profile.p95_cm, colour: errorColour(candidate), dash: candidateDash(index), end: candidate.length }));
  const key = byId("profile-kind").value === "sigma" ? "sigma_cm" : "u";
  return shownPaths().map(({ name, path, colour }) => ({ s: path.profile.s, values: path.profile[key], colour, dash: name === "shortest" ? [6, 4] : [], steps: true, soft: name === "aware" ? palette["teal-soft"] : palette["ink-soft"], end: path.length }));
}

function paintProfile() {
  const chart = byId("profile-chart");
  if (!chart.clientHeight) return;
  const context = fittedContext(chart);
  context.clearRect(0, 0, chart.clientWidth, chart.clientHeight);
  byId("profile-kind").options[2].disabled = !model.simulated;
  byId("profile-title").textContent = { u: "Degeneracy along the path", sigma: "Predicted deviation along the path [cm]", error: "Simulated error along the path [cm]: median, band to 95 %" }[byId("profile-kind").value];
  const lines = series();
  const top = byId("profile-kind").value === "u" ? 1 : Math.max(1, ...lines.flatMap(({ values, band }) => [...values, ...(band ?? [])]).filter(Number.isFinite));
  const frame = { width: chart.clientWidth, height: chart.clientHeight, top, end: longest() };
  drawAxes(context, frame);
  for (const line of lines) drawFill(context, frame, line);
  for (const line of lines) drawLine(context, frame, line);
  drawMark(context, frame, lines);
}

function acrossOf(frame, s) {
  return EDGE_LEFT + (s / frame.end) * (frame.width - EDGE_LEFT - EDGE_RIGHT);
}

function heightOf(frame, value) {
  return EDGE_TOP + (1 - Math.min(1, value / frame.top)) * (frame.height - EDGE_TOP - EDGE_BOTTOM);
}

function drawAxes(context, frame) {
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = palette.quiet;
  context.strokeStyle = palette.line;
  context.lineWidth = 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  const isFar = frame.top > 300; // centimetres: shown as metres
  for (const tick of ticks(0, frame.top, false, frame.height < 110 ? 2 : 4)) {
    const y = Math.round(heightOf(frame, tick)) + 0.5;
    context.beginPath();
    context.moveTo(EDGE_LEFT, y);
    context.lineTo(frame.width - EDGE_RIGHT, y);
    context.stroke();
    context.fillText(isFar ? `${short(tick / 100)} m` : short(tick), EDGE_LEFT - 7, y);
  }
  context.textAlign = "center";
  context.textBaseline = "top";
  const marks = ticks(0, frame.end, false, Math.max(2, Math.min(10, frame.width / 90)));
  marks.forEach((tick, k) => context.fillText(k ? short(tick) : "0 m", acrossOf(frame, tick), frame.height - EDGE_BOTTOM + 6));
}

// A step of a profile ends at its s and holds the largest value since the one before.
function traceLine(context, frame, { s, values, steps }) {
  s.forEach((at, k) => {
    const y = heightOf(frame, values[k] ?? 0);
    if (steps) context.lineTo(acrossOf(frame, k ? s[k - 1] : 0), y);
    context.lineTo(acrossOf(frame, at), y);
  });
}

function drawFill(context, frame, line) {
  context.beginPath();
  traceLine(context, frame, line);
  if (line.band) {
    for (let k = line.s.length - 1; k >= 0; k--) context.lineTo(acrossOf(frame, line.s[k]), heightOf(frame, line.band[k] ?? 0));
    context.globalAlpha = 0.16;
  } else {
    context.lineTo(acrossOf(frame, line.end), heightOf(frame, 0));
    context.lineTo(acrossOf(frame, 0), heightOf(frame, 0));
  }
  context.closePath();
  context.fillStyle = line.soft ?? line.colour;
  context.fill();
  context.globalAlpha = 1;
}

function drawLine(context, frame, line) {
  context.beginPath();
  traceLine(context, frame, line);
  context.lineWidth = 2;
  context.strokeStyle = line.colour;
  context.setLineDash(line.dash);
  context.stroke();
  context.setLineDash([]);
}

function drawMark(context, frame, lines) {
  if (!model.along) return;
  const x = acrossOf(frame, model.along.s);
  context.beginPath();
  context.moveTo(x, EDGE_TOP);
  context.lineTo(x, frame.height - EDGE_BOTTOM);
  context.strokeStyle = palette.mark;
  context.lineWidth = 1.5;
  context.stroke();
  for (const line of lines) {
    const value = line.values[stepAt(model.along.s, line.s)];
    if (model.along.s <= line.end && Number.isFinite(value)) haloedDot(context, x, heightOf(frame, value), 4, line.colour);
  }
}

function metresAt(offset) {
  const wide = byId("profile-chart").clientWidth - EDGE_LEFT - EDGE_RIGHT;
  return ((offset - EDGE_LEFT) / wide) * longest();
}

function walkAlong(event) {
  const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
  const at = event.key === "Home" ? 0 : event.key === "End" ? longest() : step ? (model.along?.s ?? 0) + (step * longest()) / 100 : null;
  if (at === null) return;
  event.preventDefault();
  event.stopPropagation();
  markAlong(at);
}

function sayPlace(s) {
  const chart = byId("profile-chart");
  const words = shownPaths().filter(({ path }) => s <= path.length).map(({ name, path }) => `${name} ${path.profile.u[stepAt(s, path.profile.s)]?.toFixed(2)}`);
  chart.setAttribute("aria-valuenow", s.toFixed(1));
  chart.setAttribute("aria-valuetext", `${metres(s)} along: degeneracy ${words.join(", ")}`);
}
