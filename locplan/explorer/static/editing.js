// Drawing and erasing on the map: tools, the stroke under the pointer, undo and redo, saving.
import { byId, hear, write } from "./dom.js";
import { repaint } from "./frames.js";
import { tryAsking } from "./link.js";
import { announce, toast } from "./say.js";
import { model, on, tell } from "./store.js";
import { haloedStroke, traceDisc, tracePath } from "./strokes.js";
import { palette } from "./theme.js";
import { gridOf, perMetre, screenAngle, screenOf, worldOf } from "./view.js";

let turn = Promise.resolve(); // edits are sent one after the other, none is dropped

/** Connect the tools. */
export function startEditing() {
	for (const button of toolButtons()) button.addEventListener("click", () => chooseTool(button.dataset.tool));
	hear("undo", "click", () => stepBack("undo"));
	hear("redo", "click", () => stepBack("redo"));
	hear("save", "submit", saveMap);
	on("event:state", showEdits);
}

/** Take a tool: move, wall, erase, pole or box. */
export function chooseTool(tool) {
	if (model.shared) return;
	model.tool = tool;
	model.stroke = null;
	for (const button of toolButtons()) button.setAttribute("aria-pressed", String(button.dataset.tool === tool));
	byId("stage").dataset.tool = tool;
	if (tool !== "move") byId("edit-group").open = true;
	repaint("overlay");
	tell("tool");
}

function toolButtons() {
	return byId("edit-tools").children;
}

/** Begin a stroke at a world point. */
export function beginStroke(point) {
	const width = model.tool === "pole" ? byId("pole-width").valueAsNumber : byId("wall-width").valueAsNumber;
	model.stroke = { tool: model.tool, points: [point], width: Number.isFinite(width) ? width : 0.2 };
	repaint("overlay");
}

/** Lead the stroke on to a world point. */
export function leadStroke(point) {
	const stroke = model.stroke;
	if (!stroke) return;
	if (stroke.tool === "pole") stroke.points = [point];
	else if (stroke.tool === "box") stroke.points = [stroke.points[0], point];
	else if (distance(stroke.points.at(-1), point) > 0.5 * model.about.map.resolution) stroke.points.push(point);
	repaint("overlay");
}

/** End the stroke and send it. */
export function endStroke() {
	const stroke = model.stroke;
	model.stroke = null;
	if (!stroke) return;
	const sent = stroke.tool === "box" ? boxStroke(stroke) : { ...stroke, points: thinned(stroke.points) };
	sendStrokes([sent]);
}

/** Send strokes as one edit; they stay drawn until the map that holds them is here. */
export function sendStrokes(strokes) {
	model.sent.push(...strokes);
	repaint("overlay");
	turn = turn.then(async () => {
		await tryAsking("edit", { strokes }, () => announce(strokes.length > 1 ? `${strokes.length} objects put in.` : `${strokes[0].tool} drawn.`));
		model.sent = model.sent.filter((stroke) => !strokes.includes(stroke));
		repaint("overlay");
	});
	return turn;
}

/** Undo or redo. */
export function stepBack(kind) {
	if (byId(kind).disabled) return;
	turn = turn.then(() => tryAsking(kind, {}, () => announce(kind === "undo" ? "Undone." : "Done again.")));
}

/** Draw the stroke under the pointer, those under way, and outlines of the tool. */
export function paintStrokes(pen) {
	for (const stroke of model.sent) drawStroke(pen, stroke, 0.6);
	if (model.stroke) drawStroke(pen, model.stroke.tool === "box" ? boxStroke(model.stroke) : model.stroke, 0.9);
	else if (model.pointer && ["wall", "erase", "pole"].includes(model.tool)) drawCursor(pen);
}

/** Draw a stroke as the map will hold it. */
export function drawStroke(pen, { tool, points, width, heading = 0 }, faint) {
	pen.save();
	pen.globalAlpha = faint;
	pen.fillStyle = pen.strokeStyle = tool === "erase" ? palette.free : palette.wall;
	const [px, py] = screenOf(...points[0]);
	if (tool === "pole") {
		traceDisc(pen, px, py, Math.max(1.5, (width / 2) * perMetre()));
		pen.fill();
	} else if (tool === "box") {
		const [length, breadth] = Array.isArray(width) ? width : [width, width];
		pen.translate(px, py);
		pen.rotate(screenAngle(heading));
		const size = [Math.max(2, length * perMetre()), Math.max(2, breadth * perMetre())];
		pen.fillRect(-size[0] / 2, -size[1] / 2, ...size);
	} else {
		pen.lineCap = pen.lineJoin = "round";
		pen.lineWidth = Math.max(1.5, width * perMetre());
		tracePath(pen, points.length > 1 ? points : [points[0], points[0]]);
		pen.stroke();
	}
	pen.restore();
}

function drawCursor(pen) {
	const field = byId(model.tool === "pole" ? "pole-width" : "wall-width");
	traceDisc(pen, model.pointer.px, model.pointer.py, Math.max(3, ((field.valueAsNumber || 0.2) / 2) * perMetre()));
	haloedStroke(pen, palette.ink, 1.2);
}

// A box lies along the map's axes; a click alone gives a square of half a metre.
function boxStroke({ points }) {
	const heading = model.about.map.origin[2];
	if (points.length < 2 || distance(points[0], points[1]) < model.about.map.resolution) return { tool: "box", points: [points[0]], width: [0.5, 0.5], heading };
	const [a, b] = points.map(([x, y]) => gridOf(x, y));
	const { resolution } = model.about.map;
	const size = [0, 1].map((axis) => Math.max(1, Math.abs(a[axis] - b[axis])) * resolution);
	return { tool: "box", points: [worldOf((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)], width: size, heading };
}

function distance(a, b) {
	return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

// At most some hundred points a stroke go over the wire.
function thinned(points) {
	const step = Math.ceil(points.length / 400);
	return points.filter((_, k) => k % step === 0 || k === points.length - 1);
}

function showEdits({ map }) {
	byId("undo").disabled = !map.can_undo;
	byId("redo").disabled = !map.can_redo;
	write("save-note", map.edited ? "The map was changed and is not saved." : "");
}

function saveMap(event) {
	event.preventDefault();
	const name = byId("save-name").value.trim();
	if (name) tryAsking("save", { name }, (answer) => toast(`Saved as ${answer.name}${answer.folder ? ` in ${answer.folder}` : ""}.`));
}
