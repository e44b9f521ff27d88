// Drawing and erasing on the map: tools, the stroke under the pointer, undo and redo, saving.
import { byId, hear, write } from "./dom.js";
import { repaint } from "./frames.js";
import { tryAsking } from "./link.js";
import { announce, toast } from "./say.js";
import { model, on, tell } from "./store.js";
import { haloedStroke, traceDisc, tracePath } from "./strokes.js";
import { palette } from "./theme.js";
import { perMetre, screenOf } from "./view.js";

let turn = Promise.resolve(); // edits are sent one after the other, none is dropped

/** Connect the tools. */
export function startEditing() {
	for (const button of toolButtons()) button.addEventListener("click", () => chooseTool(button.dataset.tool));
	hear("undo", "click", () => stepBack("undo"));
	hear("redo", "click", () => stepBack("redo"));
	hear("save", "submit", saveMap);
	on("event:state", showEdits);
}

/** Take a tool: move, wall, erase or pole. */
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
	else if (distance(stroke.points.at(-1), point) > 0.5 * model.about.map.resolution) stroke.points.push(point);
	repaint("overlay");
}

/** End the stroke and send it. */
export function endStroke() {
	const stroke = model.stroke;
	model.stroke = null;
	if (!stroke) return;
	sendStroke({ ...stroke, points: thinned(stroke.points) });
}

// A stroke stays drawn until the map that holds it is here.
function sendStroke(stroke) {
	model.sent.push(stroke);
	repaint("overlay");
	turn = turn.then(async () => {
		await tryAsking("edit", { strokes: [stroke] }, () => announce(`${stroke.tool} drawn.`));
		model.sent = model.sent.filter((other) => other !== stroke);
		repaint("overlay");
	});
}

/** Undo or redo. */
export function stepBack(kind) {
	if (byId(kind).disabled) return;
	turn = turn.then(() => tryAsking(kind, {}, () => announce(kind === "undo" ? "Undone." : "Done again.")));
}

/** Draw the stroke under the pointer, those under way, and outlines of the tool. */
export function paintStrokes(pen) {
	for (const stroke of model.sent) drawStroke(pen, stroke, 0.6);
	if (model.stroke) drawStroke(pen, model.stroke, 0.9);
	else if (model.pointer && ["wall", "erase", "pole"].includes(model.tool)) drawCursor(pen);
}

// Draw a stroke as the map will hold it.
function drawStroke(pen, { tool, points, width }, faint) {
	pen.save();
	pen.globalAlpha = faint;
	pen.fillStyle = pen.strokeStyle = tool === "erase" ? palette.free : palette.wall;
	const [px, py] = screenOf(...points[0]);
	if (tool === "pole") {
		traceDisc(pen, px, py, Math.max(1.5, (width / 2) * perMetre()));
		pen.fill();
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
