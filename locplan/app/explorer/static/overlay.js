// Everything that moves above the map, in the order in which it is painted.
import { byId } from "./dom.js";
import { paintSpots, paintRoutes, placeRoutes } from "./checked.js";
import { paintStrokes } from "./editing.js";
import { paints } from "./frames.js";
import { placeMarkers } from "./markers.js";
import { paintProbe } from "./probe.js";
import { paintAlong } from "./profile.js";
import { freshSimulation, paintCandidates } from "./simulating.js";
import { model } from "./store.js";
import { haloedDot, haloedPath, haloedStroke } from "./strokes.js";
import { palette } from "./theme.js";
import { scaleBar, screenOf, view } from "./view.js";

/** Name the overlay as a part to be painted. */
export function startOverlay() {
	paints("overlay", paintOverlay);
	paints("scale", paintScale);
}

/** Draw paths and marks on a pen; the cursor's own marks are left out of pictures. */
export function drawOverlay(pen, isPicture = false) {
	const { aware, shortest } = model.plan ?? {};
	const isLive = !freshSimulation();
	paintRoutes(pen);
	if (isLive) haloedPath(pen, shortest?.xy, { colour: palette.ink, width: 3, dash: [9, 6] });
	if (isLive) haloedPath(pen, aware?.xy, { colour: palette.teal, width: 4 });
	paintCandidates(pen);
	paintSpots(pen);
	if (isPicture) return;
	paintSnap(pen);
	paintStrokes(pen);
	paintAlong(pen);
	paintProbe(pen);
	paintCross(pen);
}

function paintOverlay() {
	const canvas = byId("overlay");
	const ratio = canvas.width / view.width;
	const pen = canvas.getContext("2d");
	pen.setTransform(ratio, 0, 0, ratio, 0, 0);
	pen.clearRect(0, 0, view.width, view.height);
	drawOverlay(pen);
	placeMarkers();
	placeRoutes();
}

// While a marker is held inside a wall, a ring shows where the server lets the path begin.
function paintSnap(pen) {
	if (!model.held || !model.plan) return;
	const snapped = model.held.startsWith("via:") ? model.plan.via?.[Number(model.held.slice(4))] : model.plan[model.held];
	if (snapped) haloedDot(pen, ...screenOf(...snapped), 4, palette.quiet);
}

// The keyboard's cursor: the middle of the map.
function paintCross(pen) {
	if (!model.cross) return;
	const [px, py] = model.cross;
	pen.beginPath();
	pen.moveTo(px - 12, py);
	pen.lineTo(px + 12, py);
	pen.moveTo(px, py - 12);
	pen.lineTo(px, py + 12);
	haloedStroke(pen, palette.ink, 1.5);
}

function paintScale() {
	const bar = scaleBar(view.width < 700 ? 90 : 130);
	byId("scale-bar").style.width = `${bar.pixels.toFixed(1)}px`;
	byId("scale-bar").firstElementChild.textContent = bar.words;
}
