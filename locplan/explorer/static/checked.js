// The report of a check: letters of its weak spots and its trips on the map, and its cures.
import { byId, hear, make, write } from "./dom.js";
import { repaint } from "./frames.js";
import { showLandmarks } from "./landmarks.js";
import { pointAlong } from "./lines.js";
import { tryAsking } from "./link.js";
import { planNow } from "./route.js";
import { announce } from "./say.js";
import { model, on, tell } from "./store.js";
import { haloedPath, haloedStroke, traceDisc, writeAt } from "./strokes.js";
import { metres } from "./text.js";
import { palette } from "./theme.js";
import { screenOf } from "./view.js";

const OFTEN = 0.1; // share of lost drives from which on a trip is coloured as one that loses them
let labels = [];

/** Ask for the report, where the page was opened on one. */
export function startChecked() {
	if (!model.about.checked || model.shared) return;
	hear("checked-show", "change", () => repaint("overlay"));
	on("settled", () => model.checked ?? tryAsking("checked", {}, showChecked));
	on("markers", markChosen);
}

/** Draw the trips below the paths, and the paths that the check recommends. */
export function paintTrips(pen) {
	if (!isShown()) return;
	for (const { trip } of labels) {
		haloedPath(pen, trip.xy, { colour: colourOf(trip), width: 2.5 });
		haloedPath(pen, trip.chosen, { colour: palette.via, width: 3, dash: [14, 4, 3, 4] });
	}
}

/** Draw the letters of the weak spots, and crosses where drives were lost. */
export function paintSpots(pen) {
	if (!isShown()) return;
	for (const { trip } of labels) for (const [x, y] of trip.lost_at ?? []) writeAt(pen, "×", ...screenOf(x, y), palette.mark, "center", "700 15px");
	for (const { letter, x, y } of model.checked.spots) {
		if (!letter) continue;
		const [px, py] = screenOf(x, y);
		traceDisc(pen, px, py, 12);
		pen.fillStyle = palette.faults;
		pen.fill();
		haloedStroke(pen, palette.ink, 1.5, [], 1.5);
		pen.fill();
		writeAt(pen, letter, px, py + 0.5, palette.theme === "dark" ? "#fff" : "#20242f", "center", "750 14px");
	}
}

/** Put the trips' names at the middle of their lines. */
export function placeTrips() {
	for (const { label, trip } of labels) {
		label.hidden = !isShown();
		const place = pointAlong(trip.xy, trip.along);
		const [px, py] = screenOf(...place);
		label.style.transform = `translate(${px.toFixed(1)}px, ${py.toFixed(1)}px) translate(-50%, -50%)`;
	}
}

function isShown() {
	return model.checked && byId("checked-show").checked;
}

function colourOf(trip) {
	return (trip.lost[0] ?? 0) >= OFTEN ? palette.mark : palette.drive;
}

function showChecked(answer) {
	model.checked = answer;
	byId("checked-group").hidden = false;
	write("checked-next", answer.next);
	labels = answer.trips.filter(({ xy }) => xy).map(madeLabel);
	byId("checked-trips").replaceChildren(head("trip", "length", "> 1 m", "arrives", "lost near"), ...answer.trips.map(tripRow));
	byId("checked-cures").hidden = !answer.cures.length;
	byId("checked-cures").replaceChildren(head("cure", "> 1 m", "arrives", ""), make("tr", {}, ...cells("as it is", rate(answer.as_is.lost), rate(answer.as_is.arrives), "")), ...answer.cures.map(cureRow));
	write("checked-note", noteOf(answer));
	if (answer.poles.length) showPoles(answer);
	markChosen();
	repaint("overlay");
}

function showPoles({ poles, pole, cures }) {
	const { title } = cures.find(({ kind }) => kind === "landmarks");
	showLandmarks({ object: { kind: "Pole", diameter: pole }, landmarks: poles.map(([x, y]) => ({ x, y })), advice: [title] });
}

function noteOf({ recommended, trips, spots }) {
	const words = {
		map: "The mended map is at hand in Faults of the map: Try the mend.",
		walls: "The page shows the map with the right threshold, which the check has written.",
		paths: trips.some(({ chosen }) => chosen) ? "Violet: the paths to take." : "",
		landmarks: "The proposed poles are on the map; Landmarks puts them in.",
	};
	const letters = spots.some(({ letter }) => letter) ? "Letters: weak spots." : "";
	return [letters, "Red trips lose a tenth of their drives or more. A click takes a trip's ends.", ...recommended.map((kind) => words[kind])].filter(Boolean).join(" ");
}

function madeLabel(trip, number, { length }) {
	const label = make("button", { className: "trip", textContent: trip.name, title: `Trip ${trip.name}: take its ends as start and goal` });
	trip.along = trip.length * (0.35 + (0.3 * number) / Math.max(1, length - 1)); // so that names of trips on one way stand apart
	label.addEventListener("click", () => takeTrip(trip));
	label.addEventListener("pointerdown", (event) => event.stopPropagation());
	byId("markers").prepend(label);
	return { label, trip };
}

function takeTrip(trip) {
	Object.assign(model, { start: trip.start, goal: trip.goal, via: [], headings: {} });
	tell("markers");
	tell("touched");
	announce(`Start and goal are those of the trip ${trip.name}.`);
	planNow();
}

function markChosen() {
	const near = ([x, y], [a, b]) => Math.hypot(x - a, y - b) < 0.5;
	for (const { label, trip } of labels) label.setAttribute("aria-pressed", String(near(model.start, trip.start) && near(model.goal, trip.goal)));
}

function head(...words) {
	return make("thead", {}, make("tr", {}, ...words.map((textContent) => make("th", { textContent, scope: "col" }))));
}

function cells(first, ...others) {
	return [make("th", { scope: "row" }, first), ...others.map((each) => make("td", {}, each))];
}

function tripRow(trip) {
	const button = make("button", { className: "plain", textContent: trip.name });
	button.addEventListener("click", () => takeTrip(trip));
	return make("tr", {}, ...cells(button, metres(trip.length), rate(trip.lost), rate(trip.arrives), trip.lost_near || "–"));
}

function cureRow({ kind, title, lost, lost_low, lost_high, arrives, arrives_low, arrives_high, verdict }) {
	const row = make("tr", {}, ...cells(title, rate([lost, lost_low, lost_high]), rate([arrives, arrives_low, arrives_high]), verdict));
	if (model.checked.recommended.includes(kind)) row.className = "chosen";
	return row;
}

// A share with its 95 % interval below it.
function rate([value, low, high]) {
	if (!Number.isFinite(value)) return "–";
	const percent = (share) => (100 * share).toFixed(0);
	const both = make("span", {}, `${percent(value)}\u202f%`);
	both.append(make("small", { textContent: `${percent(low)}–${percent(high)}` }));
	return both;
}
