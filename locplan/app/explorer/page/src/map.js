// The map: view, panning and zooming, and what is under the pointer. Its coordinates are metres along the map's axes.
import { effect } from "@preact/signals";
import OlMap from "ol/Map.js";
import View from "ol/View.js";
import { defaults } from "ol/interaction/defaults.js";
import Layer from "ol/layer/Layer.js";
import Projection from "ol/proj/Projection.js";
import { classAt, colourBase, knownPart, layerValueAt, paintBase, setCells, setTexels } from "./base.js";
import { fetchCells, fetchLayer } from "./data.js";
import { mapSize, nearestAlong, toPlane, toWorld } from "./geometry.js";
import { ask, isLinked } from "./link.js";
import { waypointAt } from "./markers.js";
import { about, along, complain, held, layer, lines, probe, server, shared, spoken, tool } from "./state.js";
import { degeneracyText } from "./text.js";
import { theme } from "./theme.js";

const NEAR = 14; // pixels from a path at which the pointer marks it
const LONG_PRESS = 600; // milliseconds
const STILL = 8; // pixels that a resting finger may move
export let map = null;
let paintedBase = "";
let baseVersion = 0;
let isWhole = true; // the view still shows the whole map

/** Build the map in an element; `layers` are drawn above the ground. */
export function startMap(target, layers) {
	const [width, height] = mapSize();
	const { resolution } = about.value.map;
	const view = new View({
		projection: new Projection({ code: "map", units: "m" }),
		center: [width / 2, height / 2],
		extent: [0, 0, width, height],
		constrainOnlyCenter: true,
		minResolution: resolution / 80,
		maxResolution: Math.max(width, height) / 150,
		resolution,
		enableRotation: false,
	});
	const interactions = defaults({ doubleClickZoom: false, altShiftDragRotate: false, pinchRotate: false, shiftDragZoom: false });
	map = new OlMap({ target, view, layers: [new Layer({ render: paintGround }), ...layers], controls: [], interactions });
	const listen = (kind, listener) => map.on(kind, (event) => void listener(event)); // false would stop the event
	listen("pointermove", ({ coordinate, dragging, originalEvent }) => dragging || originalEvent.pointerType !== "mouse" || hover(coordinate));
	listen("click", ({ coordinate }) => hover(coordinate));
	listen("dblclick", ({ coordinate }) => tool.value === "move" && waypointAt(toWorld(coordinate)));
	listen("movestart", () => (probe.value = null));
	listen("moveend", () => isKeyboardOnMap() && probeMiddle());
	listen("pointerdrag", () => (isWhole = false));
	listen("change:size", () => isWhole && showWhole());
	const viewport = map.getViewport();
	viewport.addEventListener("wheel", () => (isWhole = false), { passive: true });
	viewport.addEventListener("pointerleave", leave);
	viewport.addEventListener("contextmenu", (event) => {
		event.preventDefault();
		if (press === null) addWaypointAt(event);
	});
	viewport.addEventListener("pointerdown", startPress);
	viewport.addEventListener("pointermove", (event) => Math.hypot(event.clientX - pressed?.clientX, event.clientY - pressed?.clientY) > STILL && clearTimeout(press));
	for (const kind of ["pointerup", "pointercancel"]) viewport.addEventListener(kind, () => clearTimeout(press));
	target.addEventListener("focus", () => isKeyboardOnMap() && probeMiddle());
	target.addEventListener("blur", leave);
	effect(() => void loadCells(server.value?.basis.map));
	effect(() => void loadLayer(server.value?.field?.digest, layer.value?.name));
	effect(() => {
		theme.value; // every colour is another one
		colourBase();
		repaintBase();
	});
}

function addWaypointAt(event) {
	if (tool.value === "move") waypointAt(toWorld(map.getEventCoordinate(event)));
}

// Some browsers have no context menu event for a finger that rests; others have one, too.
let press = null; // the timer of the newest touch, null after a mouse
let pressed = null;
function startPress(event) {
	clearTimeout(press);
	const isTouch = event.pointerType === "touch";
	pressed = event;
	press = isTouch ? setTimeout(() => event.isPrimary && addWaypointAt(event), LONG_PRESS) : null;
}

/** Show the whole map. */
export function showWhole() {
	const { resolution, rows } = about.value.map;
	const [left, top, cols, high] = knownPart;
	const extent = [left, rows - top - high, left + cols, rows - top].map((cells) => cells * resolution);
	const isNarrow = map.getSize()[0] < 640;
	map.getView().fit(extent, { padding: isNarrow ? [60, 16, 16, 16] : [64, 24, 96, 24] });
	isWhole = true;
}

/** Zoom about the middle. */
export function zoomBy(factor) {
	isWhole = false;
	const view = map.getView();
	view.animate({ resolution: view.getConstrainedResolution(view.getResolution() / factor), duration: 150 });
}

/** World position of a point on the screen, relative to the map. */
export function worldAt(pixel) {
	return toWorld(map.getCoordinateFromPixel(pixel));
}

/** Point on the screen of a world position, relative to the map; null before the first frame. */
export function screenOf(xy) {
	return map.getPixelFromCoordinate(toPlane(xy));
}

/** The known part of the map's position nearest to a world position. */
export function withinMap(xy) {
	const { resolution, rows } = about.value.map;
	const [left, top, cols, high] = knownPart;
	const clamp = (value, low, size) => Math.min(Math.max(value, (low + 0.5) * resolution), (low + size - 0.5) * resolution);
	const [across, up] = toPlane(xy);
	return toWorld([clamp(across, left, cols), clamp(up, rows - top - high, high)]);
}

/** Pixels of a metre. */
export function perMetre() {
	return 1 / map.getView().getResolution();
}

/** World position in the middle of the map, where keys act. */
export function middle() {
	return toWorld(map.getView().getCenter());
}

function repaintBase() {
	baseVersion++;
	map.render();
}

let loadedCells = null;
async function loadCells(digest) {
	if (!digest || digest === loadedCells) return;
	try {
		const cells = await fetchCells(digest);
		if (!cells || server.value.basis.map !== digest) return;
		const isFirst = loadedCells === null;
		loadedCells = digest;
		setCells(cells, about.value.map.rows, about.value.map.cols);
		if (isFirst) showWhole();
		document.documentElement.dataset.map = digest;
		repaintBase();
	} catch (error) {
		complain(error);
	}
}

async function loadLayer(digest, name) {
	try {
		const values = digest && name ? await fetchLayer(digest, name) : null;
		if (!server.value || server.value.field?.digest !== digest || layer.value?.name !== name || (digest && !values)) return;
		setTexels(values);
		document.documentElement.dataset.field = digest ?? "";
		repaintBase();
	} catch (error) {
		complain(error);
	}
}

// The element around the canvas keeps other layers from drawing into it.
const canvas = document.createElement("canvas");
const ground = document.createElement("div");
ground.className = "ground";
ground.append(canvas);
function paintGround({ size: [width, height], pixelRatio, viewState: { center, resolution } }) {
	const key = [width, height, pixelRatio, ...center, resolution, baseVersion].join();
	if (key === paintedBase) return ground;
	paintedBase = key;
	[canvas.width, canvas.height] = [width, height].map((length) => Math.round(length * pixelRatio));
	const scale = pixelRatio / resolution;
	const [x, y] = [canvas.width / 2 - center[0] * scale, canvas.height / 2 + (center[1] - mapSize()[1]) * scale];
	paintBase(canvas.getContext("2d", { alpha: false }), { x, y, cell: about.value.map.resolution * scale, width: canvas.width, height: canvas.height });
	return ground;
}

function hover(coordinate) {
	if (held.value || tool.value !== "move") return;
	const place = toWorld(coordinate);
	const near = [lines.value.recommended, lines.value.shortest].filter(Boolean).map(({ xy }) => nearestAlong(xy, place));
	const [best] = near.sort((a, b) => a.distance - b.distance);
	along.value = best && best.distance * perMetre() < NEAR ? best.s : null;
	probeAt(place);
}

async function probeAt(place) {
	if (shared) return void (probe.value = await probeShared(place));
	if (!isLinked() || !server.value?.field) return undefined;
	const answer = await ask("at", { x: place[0], y: place[1] }).catch(() => null); // the next move asks again
	if (answer && !held.value && tool.value === "move") probe.value = answer;
	return answer;
}

// The keyboard's cursor is the middle of the map.
async function probeMiddle() {
	if ((await probeAt(middle())) && probe.value) spoken.value = probeTitle(probe.value);
}

/** What is at a probed place, in a few words. */
export function probeTitle({ known, u, x, y }) {
	if (known) return degeneracyText(u);
	return ["Unknown", "No value here", "Obstacle"][classAt(...cellOf([x, y]))];
}

function leave(event) {
	if (event.pointerType === "touch") return;
	probe.value = null;
	along.value = null;
}

function isKeyboardOnMap() {
	return map.getTargetElement().matches(":focus-visible");
}

function cellOf(xy) {
	const { rows, resolution } = about.value.map;
	const [across, up] = toPlane(xy);
	return [across / resolution, rows - up / resolution];
}

// A shared page has the layers only: a circle stands for the ellipse.
async function probeShared([x, y]) {
	const values = {};
	for (const one of server.value.layers) values[one.name] = layerValueAt(one, await fetchLayer(null, one.name), ...cellOf([x, y]));
	const { degeneracy, deviation } = values;
	const known = Number.isFinite(deviation) && classAt(...cellOf([x, y])) === 1;
	const factor = server.value.layers.find(({ name }) => name === "deviation")?.unit === "m" ? 100 : 1;
	return { x, y, known, axes: [factor * deviation, factor * deviation], angle: 0, u: degeneracy ?? 0, heading_deg: null, clearance: null, reason: null };
}
