// The report of a check: letters of its weak spots and its trips on the map, and its cures.
import { byId, hear, make, write } from "./dom.js";
import { repaint } from "./frames.js";
import { pointAlong } from "./lines.js";
import { tryAsking } from "./link.js";
import { planNow } from "./route.js";
import { announce } from "./say.js";
import { model, on, tell } from "./store.js";
import { haloedPath, haloedStroke, numberedDot, traceDisc, writeAt } from "./strokes.js";
import { metres } from "./text.js";
import { palette } from "./theme.js";
import { perMetre, screenOf } from "./view.js";

const OFTEN = 0.1; // share of lost drives from which on a trip is coloured as one that loses them
const NAMED = 110; // pixels from which on a trip has room for its name on the map
let tripLabels = [];

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
	for (const { trip } of tripLabels) {
		haloedPath(pen, trip.xy, { colour: tripColour(trip), width: 2.5 });
		haloedPath(pen, trip.chosen, { colour: palette.via, width: 3, dash: [14, 4, 3, 4] });
	}
}

/** Draw the letters of the weak spots, crosses where drives were lost, and the poles that the check proposes. */
export function paintSpots(pen) {
	if (!isShown()) return;
	for (const { trip } of tripLabels) for (const [x, y] of trip.lost_at ?? []) writeAt(pen, "×", ...screenOf(x, y), palette.mark, "center", "700 15px");
	for (const { letter, x, y } of model.checked.spots) {
		if (!letter) continue;
		const [px, py] = screenOf(x, y);
		traceDisc(pen, px, py, 12);
		haloedStroke(pen, "#fff", 3);
		pen.fillStyle = "#7a3b00"; // as in the report's picture, on light and dark
		pen.fill();
		writeAt(pen, letter, px, py + 0.5, "#fff", "center", "750 14px");
	}
	model.checked.poles.forEach((place, k) => numberedDot(pen, ...screenOf(...place), String(k + 1), palette.pole));
}

/** Put the trips' names at the middle of their lines. */
export function placeTrips() {
	for (const { label, trip } of tripLabels) {
		label.hidden = !isShown() || trip.length * perMetre() < NAMED;
		const [px, py] = screenOf(...trip.place);
		label.style.transform = `translate(${px.toFixed(1)}px, ${py.toFixed(1)}px) translate(-50%, -50%)`;
	}
}

function isShown() {
	return model.checked && byId("checked-show").checked;
}

function tripColour(trip) {
	return (trip.lost[0] ?? 0) >= OFTEN ? palette.mark : palette.drive;
}

function showChecked(answer) {
	model.checked = answer;
	byId("checked-group").hidden = false;
	write("checked-next", answer.next);
	const drawn = answer.trips.filter(({ xy }) => xy);
	drawn.forEach(placeName);
	tripLabels = drawn.map(madeLabel);
	byId("checked-trips").replaceChildren(headRow("trip", "length", "> 1 m", "arrives", "lost near"), ...answer.trips.map(tripRow));
	byId("checked-cures").hidden = !answer.cures.length;
	byId("checked-cures").replaceChildren(headRow("cure", "> 1 m", "arrives"), make("tr", {}, ...rowCells("as it is", rateCell(answer.as_is.lost), rateCell(answer.as_is.arrives))), ...answer.cures.map(cureRow));
	write("checked-note", noteOf(answer));
	markChosen();
	repaint("overlay");
}

function noteOf({ recommended, trips, spots }) {
	const words = {
		map: "The mended map for the filter is map_amcl.yaml in the report's folder.",
		walls: "The page shows the map with the right threshold, which the check has written.",
		paths: trips.some(({ chosen }) => chosen) ? "Violet: the paths to take." : "",
		landmarks: "Blue numbers: the proposed poles.",
	};
	const letters = spots.some(({ letter }) => letter) ? "Brown letters: weak spots." : "";
	const crosses = trips.some(({ lost_at }) => lost_at?.length) ? "Crosses: where a drive was first off by over 1 m." : "";
	return [letters, crosses, "Red trips lose a tenth of their drives or more. A click takes a trip's ends.", ...recommended.map((kind) => words[kind])].filter(Boolean).join(" ");
}

// The name stands where it is farthest from those before, since trips share ways.
function placeName(trip, number, trips) {
	const before = trips.slice(0, number).map(({ place }) => place);
	const apart = ([x, y]) => Math.min(...before.map(([a, b]) => Math.hypot(x - a, y - b)));
	const places = [0.5, 0.35, 0.65, 0.2, 0.8].map((share) => pointAlong(trip.xy, share * trip.length) ?? trip.xy[0]);
	trip.place = places.reduce((best, place) => (apart(place) > apart(best) ? place : best));
}

function madeLabel(trip) {
	const label = make("button", { className: "trip", textContent: trip.name, title: `Trip ${trip.name}: take its ends as start and goal` });
	label.addEventListener("click", () => takeTrip(trip));
	label.addEventListener("pointerdown", (event) => event.stopPropagation());
	byId("markers").prepend(label);
	return { label, trip };
}

function takeTrip(trip) {
	Object.assign(model, { start: trip.start, goal: trip.goal, via: [] });
	tell("markers");
	tell("touched");
	announce(`Start and goal are those of the trip ${trip.name}.`);
	planNow();
}

function markChosen() {
	const near = ([x, y], [a, b]) => Math.hypot(x - a, y - b) < 0.5;
	for (const { label, trip } of tripLabels) label.setAttribute("aria-pressed", String(near(model.start, trip.start) && near(model.goal, trip.goal)));
}

function headRow(...words) {
	return make("thead", {}, make("tr", {}, ...words.map((textContent) => make("th", { textContent, scope: "col" }))));
}

function rowCells(first, ...others) {
	return [make("th", { scope: "row" }, first), ...others.map((each) => make("td", {}, each))];
}

function tripRow(trip) {
	const button = make("button", { className: "plain", textContent: trip.name });
	button.addEventListener("click", () => takeTrip(trip));
	const name = make("span", {}, button, make("small", { textContent: trip.ends ? `else ${trip.ends}` : "" }));
	return make("tr", {}, ...rowCells(name, metres(trip.length), rateCell(trip.lost), rateCell(trip.arrives), trip.lost_near || "–"));
}

function cureRow({ kind, title, lost, lost_low, lost_high, arrives, arrives_low, arrives_high, verdict }) {
	const what = make("span", { textContent: title }, make("small", { textContent: verdict }));
	const row = make("tr", {}, ...rowCells(what, rateCell([lost, lost_low, lost_high]), rateCell([arrives, arrives_low, arrives_high])));
	if (model.checked.recommended.includes(kind)) row.className = "chosen";
	return row;
}

// A share with its 95 % interval below it.
function rateCell([value, low, high]) {
	if (!Number.isFinite(value)) return "–";
	const percent = (share) => (100 * share).toFixed(0);
	const both = make("span", {}, `${percent(value)}\u202f%`);
	both.append(make("small", { textContent: `${percent(low)}–${percent(high)}` }));
	return both;
}
