// The report of a check: letters of its weak spots and its routes on the map, and its fixes.
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

const NAMED = 110; // pixels from which on a route has room for its name on the map
let routeLabels = [];

/** Ask for the report, where the page was opened on one. */
export function startChecked() {
	if (!model.about.checked || model.shared) return;
	hear("checked-show", "change", () => repaint("overlay"));
	on("settled", () => model.checked ?? tryAsking("checked", {}, showChecked));
	on("markers", markChosen);
}

/** Draw the routes below the paths, and the paths that the check recommends. */
export function paintRoutes(pen) {
	if (!isShown()) return;
	for (const { route } of routeLabels) {
		haloedPath(pen, route.xy, { colour: routeColour(route), width: 2.5 });
		haloedPath(pen, route.chosen, { colour: palette.via, width: 3, dash: [14, 4, 3, 4] });
	}
}

/** Draw the letters of the weak spots, crosses where drives were lost, squares where they stop instead of at the goal, and the poles that the check proposes. */
export function paintSpots(pen) {
	if (!isShown()) return;
	for (const { route } of routeLabels) for (const [x, y] of route.lost_at ?? []) writeAt(pen, "×", ...screenOf(x, y), palette.mark, "center", "700 15px");
	for (const { route } of routeLabels) for (const [x, y] of route.stopped_at ?? []) writeAt(pen, "■", ...screenOf(x, y), palette.mark, "center", "700 13px");
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

/** Put the routes' names at the middle of their lines. */
export function placeRoutes() {
	for (const { label, route } of routeLabels) {
		label.hidden = !isShown() || route.length * perMetre() < NAMED;
		const [px, py] = screenOf(...route.place);
		label.style.transform = `translate(${px.toFixed(1)}px, ${py.toFixed(1)}px) translate(-50%, -50%)`;
	}
}

function isShown() {
	return model.checked && byId("checked-show").checked;
}

function routeColour(route) {
	return route.problem ? palette.mark : palette.drive;
}

function showChecked(answer) {
	model.checked = answer;
	byId("checked-group").hidden = false;
	write("checked-next", answer.next);
	const drawn = answer.routes.filter(({ xy }) => xy);
	drawn.forEach(placeName);
	routeLabels = drawn.map(madeLabel);
	byId("checked-routes").replaceChildren(headRow("route", "length", "lost", "reaches the goal"), ...answer.routes.map(routeRow));
	byId("checked-fixes").hidden = !answer.fixes.length;
	byId("checked-fixes").replaceChildren(headRow("fix", "lost", "reaches the goal"), make("tr", {}, ...rowCells("none", rateCell(answer.baseline.lost), rateCell(answer.baseline.reached))), ...answer.fixes.map(fixRow));
	write("checked-note", noteOf(answer));
	markChosen();
	repaint("overlay");
}

function noteOf({ recommended, routes, spots }) {
	const words = {
		map: "The repaired map for the filter is map_amcl.yaml in the report's folder.",
		walls: "The page shows the map with the right threshold, which the check has written.",
		paths: routes.some(({ chosen }) => chosen) ? "Violet: the paths to take." : "",
		landmarks: "Blue numbers: the proposed poles.",
	};
	const letters = spots.some(({ letter }) => letter) ? "Brown letters: weak spots." : "";
	const crosses = routes.some(({ lost_at }) => lost_at?.length) ? "Crosses: where a drive was first lost." : "";
	const squares = routes.some(({ stopped_at }) => stopped_at?.length) ? "Squares: where a drive stops instead of at the goal." : "";
	return [letters, crosses, squares, "Drives fail on red routes. A click takes a route's ends.", ...recommended.map((kind) => words[kind])].filter(Boolean).join(" ");
}

// The name stands where it is farthest from those before, since routes share ways.
function placeName(route, number, routes) {
	const before = routes.slice(0, number).map(({ place }) => place);
	const apart = ([x, y]) => Math.min(...before.map(([a, b]) => Math.hypot(x - a, y - b)));
	const places = [0.5, 0.35, 0.65, 0.2, 0.8].map((share) => pointAlong(route.xy, share * route.length) ?? route.xy[0]);
	route.place = places.reduce((best, place) => (apart(place) > apart(best) ? place : best));
}

function madeLabel(route) {
	const label = make("button", { className: "checked-route", textContent: route.name, title: `Route ${route.name}: take its ends as start and goal` });
	label.addEventListener("click", () => takeRoute(route));
	label.addEventListener("pointerdown", (event) => event.stopPropagation());
	byId("markers").prepend(label);
	return { label, route };
}

function takeRoute(route) {
	Object.assign(model, { start: route.start, goal: route.goal, via: [] });
	tell("markers");
	tell("touched");
	announce(`Start and goal are those of the route ${route.name}.`);
	planNow();
}

function markChosen() {
	const near = ([x, y], [a, b]) => Math.hypot(x - a, y - b) < 0.5;
	for (const { label, route } of routeLabels) label.setAttribute("aria-pressed", String(near(model.start, route.start) && near(model.goal, route.goal)));
}

function headRow(...words) {
	return make("thead", {}, make("tr", {}, ...words.map((textContent) => make("th", { textContent, scope: "col" }))));
}

function rowCells(first, ...others) {
	return [make("th", { scope: "row" }, first), ...others.map((each) => make("td", {}, each))];
}

function routeRow(route) {
	const button = make("button", { className: "plain", textContent: route.name });
	button.addEventListener("click", () => takeRoute(route));
	const name = make("span", {}, button, make("small", { textContent: route.problem }));
	return make("tr", {}, ...rowCells(name, metres(route.length), rateCell(route.lost), rateCell(route.reached)));
}

function fixRow({ kind, title, lost, lost_low, lost_high, reached, reached_low, reached_high, verdict }) {
	const what = make("span", { textContent: title }, make("small", { textContent: verdict }));
	const row = make("tr", {}, ...rowCells(what, rateCell([lost, lost_low, lost_high]), rateCell([reached, reached_low, reached_high])));
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
