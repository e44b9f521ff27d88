// The map under the hand: pan, wheel, pinch, double-click and long press, strokes of the tools, hovering.
import { byId, hear } from "./dom.js";
import { beginStroke, endStroke, leadStroke } from "./editing.js";
import { keepMoving, repaint } from "./frames.js";
import { waypointAt } from "./markers.js";
import { clearProbe, probeAt } from "./probe.js";
import { markNear, markAlong } from "./profile.js";
import { model, on, tell } from "./store.js";
import { knownPart } from "./tiles.js";
import { fitMap, panBy, view, worldAt, zoomAt } from "./view.js";

const LONG_PRESS = 550; // milliseconds
const STILL = 8; // pixels a finger may tremble
const fingers = new Map(); // pointer id -> {x, y}
let press = null; // {x, y, timer, moved, touch}
let wasFitted = true;

/** Connect the stage. */
export function startStage() {
	const stage = byId("overlay");
	hear("overlay", "pointerdown", pressed);
	hear("overlay", "pointermove", moved);
	hear("overlay", "pointerup", released);
	hear("overlay", "pointercancel", released);
	hear("overlay", "pointerleave", left);
	stage.addEventListener("wheel", wheeled, { passive: false });
	hear("overlay", "dblclick", (event) => model.tool === "move" && waypointAt(worldAt(event.offsetX, event.offsetY)));
	stage.addEventListener("focus", () => stage.matches(":focus-visible") && showCross());
	hear("overlay", "blur", hideCross);
	hear("zoom-in", "click", () => zoomBy(1.5));
	hear("zoom-out", "click", () => zoomBy(1 / 1.5));
	hear("zoom-fit", "click", showWhole);
	for (const topic of ["hint", "cells", "settled"]) on(topic, () => wasFitted && showWhole());
	new ResizeObserver(resized).observe(byId("stage"));
	resized();
}

/** Show the whole map beside the cards. */
export function showWhole() {
	model.insets = insets();
	fitMap(model.insets, knownPart());
	wasFitted = true;
	viewChanged();
}

/** Zoom about the middle of the free part of the stage. */
export function zoomBy(factor) {
	const [px, py] = middle();
	glide(6, () => zoomAt(px, py, factor ** (1 / 6)));
}

/** Pan by arrows. */
export function panByKeys(dx, dy) {
	panBy(dx, dy);
	viewChanged();
	if (model.cross) showCross();
}

/** The place that keys act on: under the cursor, or the middle of the map. */
export function keyPlace() {
	const place = model.pointer ? [model.pointer.px, model.pointer.py] : middle();
	return worldAt(...place);
}

/** Show the keyboard's cursor at the middle, and what is there. */
export function showCross() {
	if (model.shared && !model.state) return;
	model.cross = middle();
	repaint("overlay");
	probeAt(worldAt(...model.cross));
}

function hideCross() {
	if (!model.cross) return;
	model.cross = null;
	clearProbe();
	repaint("overlay");
}

function middle() {
	const { left: x, right, top, bottom } = model.insets ?? insets();
	return [(x + view.width - right) / 2, (top + view.height - bottom) / 2];
}

function insets() {
	const [panel, profile, title, tools] = ["panel", "profile", "title", "tools"].map((id) => byId(id).getBoundingClientRect());
	const top = Math.max(title.bottom, tools.width > tools.height ? tools.bottom : 0) + 14;
	const hint = byId("hint").getBoundingClientRect(); // all 0 while it is hidden
	if (view.width < 700) return { left: 12, top: Math.max(top, hint.bottom + 12), right: 12, bottom: view.height - panel.top + 26 };
	const low = Math.min(profile.top, hint.top || profile.top);
	const side = tools.width > tools.height ? 14 : tools.right + 18;
	return { left: side, top, right: view.width - panel.left + 18, bottom: view.height - low + 24 };
}

function glide(steps, step) {
	if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
		for (let k = 0; k < steps; k++) step();
		return viewChanged();
	}
	let left = steps;
	return keepMoving(() => {
		step();
		viewChanged();
		return --left > 0;
	});
}

function viewChanged() {
	repaint("base", "overlay", "scale");
	tell("view");
}

function resized() {
	const stage = byId("stage");
	const ratio = Math.min(window.devicePixelRatio || 1, 2);
	[view.width, view.height] = [Math.max(1, stage.clientWidth), Math.max(1, stage.clientHeight)];
	for (const canvas of [byId("base"), byId("overlay")]) {
		canvas.width = Math.round(view.width * ratio);
		canvas.height = Math.round(view.height * ratio);
	}
	if (!model.about) return;
	if (wasFitted) showWhole();
	model.insets = insets();
	viewChanged();
	repaint("profile");
}

function pressed(event) {
	byId("overlay").setPointerCapture(event.pointerId);
	fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
	hideCross();
	if (fingers.size === 2) {
		cancelPress();
		model.stroke = null;
		return;
	}
	if (event.button !== 0) return;
	const point = worldAt(event.offsetX, event.offsetY);
	press = { x: event.offsetX, y: event.offsetY, moved: false, draws: model.tool !== "move" };
	if (press.draws) return beginStroke(point);
	if (event.pointerType !== "mouse") press.timer = setTimeout(() => longPressed(point), LONG_PRESS);
}

function longPressed(point) {
	if (!press || press.moved) return;
	press = null;
	waypointAt(point);
}

function moved(event) {
	const place = { x: event.offsetX, y: event.offsetY };
	const before = fingers.get(event.pointerId);
	if (before && fingers.size === 2) pinch(event.pointerId, place);
	else if (before && press) drag(before, place, event);
	else if (!before) hover(place);
	if (before) fingers.set(event.pointerId, place);
}

function drag(before, place, event) {
	if (!press.moved && Math.hypot(place.x - press.x, place.y - press.y) < (event.pointerType === "mouse" ? 3 : STILL)) return;
	press.moved = true;
	clearTimeout(press.timer);
	if (press.draws) {
		for (const part of event.getCoalescedEvents?.() ?? []) leadStroke(worldAt(part.offsetX, part.offsetY));
		leadStroke(worldAt(place.x, place.y));
		return;
	}
	wasFitted = false;
	byId("stage").classList.add("panning");
	panBy(place.x - before.x, place.y - before.y);
	viewChanged();
}

function pinch(id, place) {
	const [other] = [...fingers].filter(([key]) => key !== id).map(([, at]) => at);
	const before = fingers.get(id);
	const [was, is] = [before, place].map((at) => ({ x: (at.x + other.x) / 2, y: (at.y + other.y) / 2, d: Math.hypot(at.x - other.x, at.y - other.y) }));
	wasFitted = false;
	panBy(is.x - was.x, is.y - was.y);
	if (was.d > 0) zoomAt(is.x, is.y, is.d / was.d);
	viewChanged();
}

function released(event) {
	fingers.delete(event.pointerId);
	byId("stage").classList.remove("panning");
	if (!press) return;
	const { moved: hasMoved, draws } = press;
	cancelPress();
	if (draws) endStroke();
	else if (!hasMoved && event.pointerType !== "mouse") {
		model.pointer = { px: event.offsetX, py: event.offsetY };
		probeAt(worldAt(event.offsetX, event.offsetY));
	}
}

function cancelPress() {
	clearTimeout(press?.timer);
	press = null;
}

function hover({ x, y }) {
	model.pointer = { px: x, py: y };
	const point = worldAt(x, y);
	if (model.tool === "move") {
		markNear(point);
		probeAt(point);
	} else repaint("overlay");
}

function left(event) {
	if (event.pointerType !== "mouse") return;
	model.pointer = null;
	markAlong(null);
	clearProbe();
	repaint("overlay");
}

function wheeled(event) {
	event.preventDefault();
	wasFitted = false;
	const lines = event.deltaMode === 1 ? 18 : 1;
	zoomAt(event.offsetX, event.offsetY, Math.exp(-Math.max(-80, Math.min(80, event.deltaY * lines)) * (event.ctrlKey ? 0.012 : 0.0028)));
	viewChanged();
}
