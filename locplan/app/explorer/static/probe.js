// The place under the cursor: its ellipse and heading wedge, and a readout in words and units.
import { byId } from "./dom.js";
import { repaint } from "./frames.js";
import { fetchLayer } from "./data.js";
import { ask, isLinked } from "./link.js";
import { announce } from "./say.js";
import { model, tell } from "./store.js";
import { haloedStroke } from "./strokes.js";
import { latticeValue } from "./texture.js";
import { centimetres, degeneracyWords, metres, short } from "./text.js";
import { palette } from "./theme.js";
import { classAt } from "./tiles.js";
import { gridOf, perMetre, screenAngle, screenOf, view } from "./view.js";

const FACTORS = [1, 2, 5, 10, 20, 50, 100, 200];
const REACH = 110; // pixels that the greatest ellipse may take
let sharedLayers = null;

/** Ask for the place under the cursor. */
export async function probeAt(point) {
	if (model.shared) return showProbe(await sharedProbe(point));
	if (!isLinked() || !model.state?.field) return undefined;
	try {
		const answer = await ask("at", { x: point[0], y: point[1] });
		return answer ? showProbe(answer) : undefined;
	} catch {
		return clearProbe(); // the next move asks again
	}
}

/** Take the ellipse and the readout away. */
export function clearProbe() {
	if (!model.probe && byId("readout").hidden) return;
	model.probe = null;
	byId("readout").hidden = true;
	tell("probe");
	repaint("overlay");
}

/** By how much ellipses are enlarged at this zoom: the greatest on the map stay readable. */
function ellipseFactor() {
	return factorWithin(REACH / (greatestOf("sigma", 1) * perMetre()));
}

// By how much the wedge of the heading is enlarged; the greatest ones take an eighth of a turn to each side.
function wedgeFactor() {
	return Math.min(10, factorWithin(Math.PI / 4 / greatestOf("heading", 0.2)));
}

function greatestOf(name, usual) {
	const layer = model.state?.layers?.find((each) => each.name === name);
	return layer?.present?.[1] ?? layer?.anchors?.[1] ?? usual;
}

function factorWithin(room) {
	return FACTORS.filter((factor) => factor <= room).at(-1) ?? 1;
}

/** Draw the ellipse and the wedge. */
export function paintProbe(pen) {
	const probe = model.probe;
	if (!probe?.known || model.held) return;
	const [px, py] = screenOf(probe.x, probe.y);
	const perCm = (ellipseFactor() * perMetre()) / 100;
	const half = Math.min(Math.PI, (wedgeFactor() * probe.heading_deg * Math.PI) / 180);
	pen.save();
	pen.translate(px, py);
	pen.beginPath();
	pen.moveTo(0, 0);
	pen.arc(0, 0, 42, -Math.PI / 2 - half, -Math.PI / 2 + half);
	pen.closePath();
	washed(pen, palette.goal, 1.2);
	pen.beginPath();
	pen.ellipse(0, 0, Math.max(2, probe.axes[0] * perCm), Math.max(2, probe.axes[1] * perCm), screenAngle(probe.angle ?? 0), 0, 2 * Math.PI);
	washed(pen, palette.teal, 1.8);
	pen.restore();
}

function washed(pen, colour, width) {
	pen.globalAlpha = 0.33;
	pen.fillStyle = colour;
	pen.fill();
	pen.globalAlpha = 1;
	haloedStroke(pen, colour, width);
}

function showProbe(probe) {
	if (!model.pointer && !model.cross) return;
	model.probe = probe;
	const box = byId("readout");
	box.replaceChildren(...linesOf(probe).map(([text, className]) => Object.assign(document.createElement("p"), { textContent: text, className })));
	box.hidden = false;
	const [px, py] = screenOf(probe.x, probe.y);
	const right = px + 28 + box.offsetWidth > view.width - (model.insets?.right ?? 0);
	const above = py + 30 + box.offsetHeight > view.height - (model.insets?.bottom ?? 0);
	box.style.transform = `translate(${Math.max(8, right ? px - 24 - box.offsetWidth : px + 24).toFixed(0)}px, ${Math.max(8, above ? py - 24 - box.offsetHeight : py + 24).toFixed(0)}px)`;
	if (model.cross) announce(linesOf(probe).slice(0, 3).map(([text]) => text).join(", "));
	tell("probe");
	repaint("overlay");
}

function linesOf(probe) {
	const place = `${probe.x.toFixed(2)}, ${metres(probe.y, 2)}`;
	if (!probe.known) return [[whatIs(probe), "strong"], [place, "quiet"]];
	const [major, minor] = probe.axes;
	const size = Math.abs(major - minor) < 0.05 * major ? centimetres(major) : `${centimetres(major)} × ${centimetres(minor)}`;
	const lines = [
		[`${degeneracyWords(probe.u)}`, "strong"],
		[`position deviation ${model.shared ? "at most " : ""}${size}`, ""],
		[`heading deviation ${probe.heading_deg.toFixed(1)}°`, ""],
		[`degeneracy ${probe.u.toFixed(2)}   e ${short(probe.e)} m² rad`, "quiet"],
		[place + (Number.isFinite(probe.clearance) ? `   ${metres(probe.clearance, 2)} from an obstacle` : ""), "quiet"],
	];
	const enlarged = [["ellipse", ellipseFactor()], ["wedge", wedgeFactor()]].filter(([, factor]) => factor > 1);
	if (enlarged.length) lines.push([enlarged.map(([what, factor]) => `${what} enlarged ${factor} ×`).join(", "), "quiet"]);
	return lines;
}

function whatIs(probe) {
	const kind = classAt(...gridOf(probe.x, probe.y));
	return kind === 2 ? "Obstacle" : kind === 0 ? "Unknown" : "No value here";
}

// A shared page has the layers only: a circle of the largest deviation stands for the ellipse.
async function sharedProbe([x, y]) {
	sharedLayers ??= Promise.all(model.state.layers.map(async (layer) => [layer, await fetchLayer(null, layer.name)]));
	const value = {};
	for (const [layer, bytes] of await sharedLayers) value[layer.name] = latticeValue(bytes, layer, ...gridOf(x, y));
	const known = value.sigma !== null && value.sigma !== undefined && classAt(...gridOf(x, y)) === 1;
	if (!known) return { x, y, known: false };
	return { x, y, known, axes: [100 * value.sigma, 100 * value.sigma], angle: 0, heading_deg: (180 / Math.PI) * (value.heading ?? 0), u: value.degeneracy ?? 0, e: value.e ?? 0 };
}
