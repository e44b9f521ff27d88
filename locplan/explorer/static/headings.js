// Headings of start and goal, turned by hand for the lattice planner, and the robot's outline along its path.
import { byId, hear, make } from "./dom.js";
import { repaint } from "./frames.js";
import { planNow, planSoon } from "./route.js";
import { announce } from "./say.js";
import { model, on, tell } from "./store.js";
import { haloedStroke } from "./strokes.js";
import { palette } from "./theme.js";
import { perMetre, screenOf, view, worldAt } from "./view.js";

const FROM_MARKER = 44; // pixels from a marker's middle to its handle
const TURN_STEP = Math.PI / 12;
const handles = {};

/** Connect the choice of the planner; it is offered where the robot's outline or turning radius asks for it. */
export function startHeadings() {
	byId("planner-row").hidden = !model.about.robot?.lattice;
	hear("planner", "change", choosePlanner);
	hear("headings-reset", "click", () => turnTo({}));
	for (const name of ["start", "goal"]) handles[name] = madeHandle(name);
	on("plan", placeHandles);
}

/** Exchange the ends' headings where the route is reversed: the robot comes back the other way. */
export function turnAround() {
	const turned = Object.entries(model.headings).map(([name, heading]) => [name === "start" ? "goal" : "start", wrapped(heading + Math.PI)]);
	model.headings = Object.fromEntries(turned);
}

/** Put the handles beside their markers. */
export function placeHandles() {
	for (const [name, handle] of Object.entries(handles)) {
		handle.hidden = !model.planner || !model[name];
		if (handle.hidden) continue;
		const [px, py] = inWindow(aheadOf(name, FROM_MARKER));
		handle.style.transform = `translate(${px.toFixed(1)}px, ${py.toFixed(1)}px)`;
		handle.classList.toggle("set", name in model.headings);
		const degrees = Math.round((headingOf(name) * 180) / Math.PI);
		handle.setAttribute("aria-label", `Heading at the ${name}: ${name in model.headings ? `${degrees} degrees` : "not set"}`);
	}
}

/** Draw an arrow at each end whose heading is set. */
export function paintArrows(pen) {
	if (!model.planner) return;
	for (const name of Object.keys(model.headings)) {
		const [[px, py], [qx, qy]] = [screenOf(...model[name]), aheadOf(name, FROM_MARKER - 4)];
		const [dx, dy] = [(qx - px) / (FROM_MARKER - 4), (qy - py) / (FROM_MARKER - 4)];
		pen.beginPath();
		pen.moveTo(px, py);
		pen.lineTo(qx, qy);
		pen.moveTo(qx - 10 * dx - 7 * dy, qy - 10 * dy + 7 * dx);
		pen.lineTo(qx, qy);
		pen.lineTo(qx - 10 * dx + 7 * dy, qy - 10 * dy - 7 * dx);
		haloedStroke(pen, name === "start" ? palette.teal : palette.goal, 3);
	}
}

/** Draw the outline lightly along a path with headings: at both ends, and as often as outlines do not overlap. */
export function paintOutlines(pen, { xy, heading }) {
	const { outline, length } = model.about.robot;
	if (!outline) return;
	const apart = Math.max(length, 36 / perMetre());
	let [left, before] = [0, xy[0]];
	xy.forEach((at, k) => {
		left -= Math.hypot(at[0] - before[0], at[1] - before[1]);
		before = at;
		if (left > 0 && k < xy.length - 1) return;
		left = apart;
		paintOutline(pen, outline, at, heading[k]);
	});
}

function paintOutline(pen, outline, [x, y], heading) {
	const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
	pen.beginPath();
	for (const [a, b] of outline) pen.lineTo(...screenOf(x + cos * a - sin * b, y + sin * a + cos * b));
	pen.closePath();
	pen.fillStyle = palette["teal-soft"];
	pen.fill();
	pen.strokeStyle = palette.teal;
	pen.lineWidth = 1;
	pen.stroke();
}

function madeHandle(name) {
	const handle = make("button", { className: `handle ${name}`, title: "Heading: drag, or arrow keys; double-click or Delete resets" }, make("span"));
	handle.hidden = true;
	byId("markers").append(handle);
	handle.addEventListener("pointerdown", (event) => holdHandle(event, handle, name));
	handle.addEventListener("dblclick", () => forget(name));
	handle.addEventListener("keydown", (event) => keyOnHandle(event, name));
	return handle;
}

function holdHandle(down, handle, name) {
	if (down.button !== 0) return;
	down.stopPropagation();
	handle.setPointerCapture(down.pointerId);
	const move = ({ clientX, clientY }) => {
		const [x, y] = worldAt(clientX, clientY);
		model.headings = { ...model.headings, [name]: Math.atan2(y - model[name][1], x - model[name][0]) };
		afterTurn();
	};
	const release = () => {
		handle.removeEventListener("pointermove", move);
		if (name in model.headings) planNow();
	};
	handle.addEventListener("pointermove", move);
	handle.addEventListener("lostpointercapture", release, { once: true });
}

function keyOnHandle(event, name) {
	const turn = { ArrowLeft: TURN_STEP, ArrowUp: TURN_STEP, ArrowRight: -TURN_STEP, ArrowDown: -TURN_STEP }[event.key];
	if (event.key === "Delete" || event.key === "Backspace") forget(name);
	else if (turn) {
		model.headings = { ...model.headings, [name]: wrapped(headingOf(name) + turn) };
		afterTurn();
		planSoon(null);
	} else return;
	event.preventDefault();
	event.stopPropagation();
}

function forget(name) {
	const { [name]: _, ...others } = model.headings;
	turnTo(others);
}

function turnTo(headings) {
	model.headings = headings;
	afterTurn();
	announce("Heading reset.");
	planNow();
}

function afterTurn() {
	byId("headings-reset").disabled = !Object.keys(model.headings).length;
	tell("touched");
	repaint("overlay");
}

function choosePlanner() {
	model.planner = byId("planner").value || null;
	byId("headings-note").hidden = !model.planner;
	tell("touched");
	repaint("overlay");
	planNow();
}

// The heading that is set, or else that of the path, or along the line to the other end.
function headingOf(name) {
	if (name in model.headings) return model.headings[name];
	const facing = model.plan?.aware?.heading;
	if (facing) return facing.at(name === "start" ? 0 : -1);
	return Math.atan2(model.goal[1] - model.start[1], model.goal[0] - model.start[0]);
}

// Place on the screen so many pixels from a marker in its heading.
function aheadOf(name, pixels) {
	const [x, y] = model[name];
	const far = pixels / perMetre();
	const heading = headingOf(name);
	return screenOf(x + far * Math.cos(heading), y + far * Math.sin(heading));
}

function inWindow([px, py]) {
	return [Math.min(Math.max(px, 16), view.width - 16), Math.min(Math.max(py, 16), view.height - 16)];
}

function wrapped(heading) {
	return Math.atan2(Math.sin(heading), Math.cos(heading));
}
