// Look-alike places: where a scan taken at a place would match as well, joined to it by lines.
import { byId, hear, write } from "./dom.js";
import { repaint } from "./frames.js";
import { chooseLayer } from "./layers.js";
import { work } from "./link.js";
import { report } from "./say.js";
import { model, on } from "./store.js";
import { haloedDot, haloedStroke, numberedDot } from "./strokes.js";
import { metres } from "./text.js";
import { palette } from "./theme.js";
import { screenAngle, screenOf } from "./view.js";

let hasLayer = false; // whether the layer of the whole map is there
let layerWords = ""; // what was found there

/** Connect the buttons. */
export function startTwins() {
	hear("twins-find", "click", () => awaitPlace(!model.picking));
	hear("twins-clear", "click", clearTwins);
	hear("twins-everywhere", "click", () => work("twins_everywhere", "Look-alikes", {}, takeLayer));
	on("state", forgetLayer);
	byId("twins-group").hidden = !canShowTwins();
}

/** Ask for the look-alikes of a world point. */
export function showTwinsOf([x, y]) {
	awaitPlace(false);
	if (canShowTwins()) work("twins", "Looking for look-alike places", { x, y }, (answer) => takeTwins(answer, [x, y]));
}

// The next click chooses the place, or no longer.
function awaitPlace(waits) {
	model.picking = waits;
	byId("twins-find").setAttribute("aria-pressed", String(waits));
	byId("stage").classList.toggle("picking", waits);
	if (waits && byId("panel").classList.contains("open")) byId("sheet-handle").click(); // else it covers the map
}

/** Take the look-alikes away. */
export function clearTwins() {
	awaitPlace(false);
	model.twins = null;
	write("twins-note", "");
	byId("twins-clear").hidden = true;
	repaint("overlay");
}

/** Draw the place, its look-alikes and the lines. */
export function paintTwins(pen) {
	if (!model.twins) return;
	const from = screenOf(...model.twins.place);
	const places = model.twins.twins.map((twin) => ({ at: screenOf(twin.x, twin.y), angle: screenAngle(twin.heading ?? 0) }));
	pen.beginPath();
	for (const { at } of places) {
		pen.moveTo(...from);
		pen.lineTo(...at);
	}
	haloedStroke(pen, palette.twin, 1.8, [7, 4]);
	haloedDot(pen, ...from, 7, palette.twin);
	places.forEach(({ at, angle }, k) => {
		pen.beginPath();
		pen.moveTo(...at);
		pen.lineTo(at[0] + 20 * Math.cos(angle), at[1] + 20 * Math.sin(angle));
		pen.lineWidth = 3;
		pen.strokeStyle = palette.twin;
		pen.stroke();
		numberedDot(pen, ...at, String(k + 1), palette.twin);
	});
}

function takeLayer({ layer, share, alike, spacing }) {
	const part = share === 0 ? "None" : share < 0.01 ? "Less than 1 %" : `${(100 * share).toFixed(0)} %`;
	layerWords = `${part} of the places have a look-alike within ${alike} nats. The map shows the excess of each place; other layers are under Field. Places are ${metres(spacing)} apart.`;
	report("twins-layer-note", layerWords);
	chooseLayer(layer);
}

// The server offers the layer only for the map and the lidar that it belongs to.
function forgetLayer() {
	const isThere = model.state.layers.some(({ name }) => name === "twins");
	if (hasLayer !== isThere) write("twins-layer-note", isThere ? layerWords : "The map or the lidar has changed: search the whole map again.");
	hasLayer = isThere;
}

function canShowTwins() {
	return !model.shared;
}

function takeTwins(answer, place) {
	model.twins = { ...answer, place };
	const count = answer.twins.length;
	const far = count ? ` ${count > 1 ? "The nearest" : "It"} is ${metres(Math.min(...answer.twins.map((twin) => Math.hypot(twin.x - place[0], twin.y - place[1]))))} away.` : "";
	const slides = answer.stretch > 0.5 ? ` A match can slide by ${metres(answer.stretch)} here.` : "";
	byId("twins-group").open = true;
	byId("twins-clear").hidden = false;
	report("twins-note", (count ? `${count === 1 ? "One place looks" : `${count} places look`} the same to the lidar.${far}` : "No other place looks like this one.") + slides);
	repaint("overlay");
}
