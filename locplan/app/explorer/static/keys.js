// The keyboard: keys of the map, keys that hold everywhere, and the help that lists them.
import { byId, hear } from "./dom.js";
import { beginStroke, chooseTool, endStroke, leadStroke, stepBack } from "./editing.js";
import { repaint } from "./frames.js";
import { chooseLayer } from "./layers.js";
import { addWaypoint } from "./route.js";
import { announce } from "./say.js";
import { keyPlace, panByKeys, showCross, showWhole, zoomBy } from "./stage.js";
import { model } from "./store.js";
import { toggleTheme } from "./theme.js";

const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const TOOLS = { v: "move", w: "wall", e: "erase", p: "pole" };

/** Listen to keys. */
export function startKeys() {
	document.addEventListener("keydown", onKey);
	hear("help-open", "click", openHelp);
}

function openHelp() {
	if (!byId("help").open) byId("help").showModal();
}

function onKey(event) {
	if (event.defaultPrevented || document.querySelector("dialog[open]")) return;
	const isUndo = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z";
	if (isUndo && !isTyping(event.target)) {
		event.preventDefault();
		stepBack(event.shiftKey ? "redo" : "undo");
		return;
	}
	if (event.ctrlKey || event.metaKey || event.altKey) return;
	if (event.key === "Escape") return letGo();
	if (isTyping(event.target) || !model.about) return;
	if (onMap(event) || anywhere(event)) event.preventDefault();
}

// Fields for text and lists use letters themselves.
function isTyping(target) {
	return target.matches?.("textarea, select, input:not([type=range], [type=checkbox])");
}

function onMap(event) {
	if (event.target !== byId("overlay")) return false;
	const arrow = ARROWS[event.key];
	if (arrow) {
		const step = event.shiftKey ? 240 : 60;
		panByKeys(arrow[0] * step, arrow[1] * step);
		showCross();
		return true;
	}
	if (event.key !== "Enter") return false;
	useTool();
	return true;
}

function anywhere(event) {
	const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
	if (key === "+" || key === "=") zoomBy(1.5);
	else if (key === "-" || key === "_") zoomBy(1 / 1.5);
	else if (key === "0") showWhole();
	else if (key === "?") openHelp();
	else if (key === "l" && model.state) chooseLayer(null);
	else if (key === "d") toggleTheme();
	else if (key === "a") addWaypoint(null);
	else if (TOOLS[key]) chooseTool(TOOLS[key]);
	else return false;
	return true;
}

// Enter uses the tool at the middle of the map: a pole at once, a wall from one Enter to the next.
function useTool() {
	const point = keyPlace();
	if (model.tool === "move") return void addWaypoint(point);
	const isLine = model.tool === "wall" || model.tool === "erase";
	if (model.stroke) {
		leadStroke(point);
		return endStroke();
	}
	beginStroke(point);
	if (isLine) announce("The line begins here. Move on and press Enter to end it.");
	else endStroke();
	return undefined;
}

function letGo() {
	model.stroke = null;
	chooseTool("move");
	repaint("overlay");
}
