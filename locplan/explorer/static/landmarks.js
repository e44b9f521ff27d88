// Landmarks proposed for the route: numbered ghosts until they are accepted or dismissed.
import { byId, hear, write } from "./dom.js";
import { drawStroke, sendStrokes } from "./editing.js";
import { repaint } from "./frames.js";
import { work } from "./link.js";
import { routeAsked } from "./route.js";
import { report } from "./say.js";
import { model } from "./store.js";
import { haloedStroke, numberedDot, traceDisc } from "./strokes.js";
import { palette } from "./theme.js";
import { screenOf } from "./view.js";

/** Connect the buttons. */
export function startLandmarks() {
	hear("landmarks-find", "click", proposeLandmarks);
	hear("landmarks-accept", "click", acceptLandmarks);
	hear("landmarks-show", "change", () => repaint("overlay"));
	hear("landmarks-drop", "click", () => dropLandmarks(""));
}

/** Draw the ghosts. */
export function paintLandmarks(pen) {
	if (!byId("landmarks-show").checked) return;
	model.landmarks?.strokes.forEach((stroke, k) => {
		drawStroke(pen, stroke, 0.75);
		const [px, py] = screenOf(...stroke.points[0]);
		traceDisc(pen, px, py, 9);
		haloedStroke(pen, palette.ghost, 2, [3, 3]);
		numberedDot(pen, px + 15, py - 15, String(k + 1), palette.ghost);
	});
}

function dropLandmarks(text) {
	model.landmarks = null;
	byId("landmarks-take").hidden = true;
	write("landmarks-verdict", text);
	repaint("overlay");
}

function proposeLandmarks() {
	const object = byId("object").value;
	const count = Math.min(20, Math.max(1, Math.round(byId("landmark-count").valueAsNumber || 3)));
	const content = { ...routeAsked(), object, count };
	return work("landmarks", "Looking for places of landmarks", content, showLandmarks, "Search for landmarks cancelled.");
}

/** Show places of objects on the map, which can be put in. */
export function showLandmarks(answer) {
	const { kind, diameter, length, width } = answer.object;
	const tool = kind.toLowerCase();
	const stroke = ({ x, y, heading }) => ({ tool, points: [[x, y]], width: diameter ?? [length, width], ...(tool === "box" && { heading }) });
	model.landmarks = { ...answer, strokes: answer.landmarks.map(stroke) };
	byId("landmarks-take").hidden = !answer.landmarks.length;
	byId("landmarks-show").checked = true;
	byId("landmarks-accept").classList.toggle("main", answer.verification?.helps !== false);
	report("landmarks-verdict", [verdictOf(answer), ...(answer.advice ?? [])].map((text) => `${text[0].toUpperCase()}${text.slice(1)}.`).join(" "));
	repaint("overlay");
}

function verdictOf({ verification }) {
	if (!verification) return "not verified: nothing was driven";
	return `${verification.verdict} (${verification.before.drives} drives each; 100 tell more)`;
}

function acceptLandmarks() {
	const strokes = model.landmarks?.strokes ?? [];
	dropLandmarks("");
	if (strokes.length) sendStrokes(strokes);
}
