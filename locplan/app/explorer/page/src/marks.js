// What is drawn above the ground: zones, weak spots, both paths, the report, the probed place, strokes on their way.
import { effect } from "@preact/signals";
import Feature from "ol/Feature.js";
import LineString from "ol/geom/LineString.js";
import Point from "ol/geom/Point.js";
import Polygon from "ol/geom/Polygon.js";
import VectorLayer from "ol/layer/Vector.js";
import VectorSource from "ol/source/Vector.js";
import { Circle, Fill, Stroke, Style, Text } from "ol/style.js";
import { pointAlong, toPlane } from "./geometry.js";
import { map, perMetre } from "./map.js";
import { onPlan } from "./route.js";
import { along, changes, digests, fresh, held, isFixShown, lines, probe } from "./state.js";
import { palette, theme } from "./theme.js";

const FACTORS = [1, 2, 5, 10, 20, 50, 100, 200];
const REACH = 110; // pixels that the largest ellipse may take
const ZONE_COLOURS = { "no-go": "mark", slow: "slow", prefer: "teal" };
const ZONE_DASHES = { "no-go": [], slow: [7, 5], prefer: [2, 5] };

const [under, paths, over] = Array.from({ length: 3 }, () => new VectorSource());
export const layers = [under, paths, over].map((source) => new VectorLayer({ source, className: "marks", style: styleOf, updateWhileAnimating: true, updateWhileInteracting: true }));
export const zones = []; // features, in the order of the changes

const shortest = new Feature({ kind: "shortest", geometry: new LineString([]) });
const recommended = new Feature({ kind: "recommended", geometry: new LineString([]) });

/** Draw what changes, as it changes. */
export function startMarks() {
	paths.addFeatures([shortest, recommended]);
	effect(() => {
		for (const [feature, path] of [[recommended, lines.value.recommended], [shortest, lines.value.shortest]]) feature.getGeometry().setCoordinates(path ? path.xy.map(toPlane) : []);
	});
	effect(() => {
		zones.splice(0, zones.length, ...changes.value.flatMap((change, index) => (change.kind === "zone" ? [polygon("zone", change.polygon, { zone: change.zone, index })] : [])));
		replace(under, "zone", zones);
	});
	effect(() => replace(under, "stroke", digests.value.map ? [] : changes.value.filter(({ points }) => points).map(strokeFeature)));
	effect(() => {
		const list = fresh("spots")?.list ?? [];
		replace(under, "spot", list.filter(({ outline }) => outline?.length > 2).map(({ outline }) => polygon("spot", outline)));
		replace(over, "letter", list.map(({ letter, x, y }) => point("letter", [x, y], { text: letter })));
	});
	effect(() => {
		const known = isFixShown.value ? fresh("report") : null;
		const routes = (known?.routes ?? []).filter(({ xy }) => xy);
		replace(under, "driven", routes.map(({ xy }) => line("driven", xy)));
		replace(under, "chosen", routes.flatMap(({ chosen }) => (chosen ? [line("chosen", chosen)] : [])));
		replace(over, "pole", (known?.poles ?? []).map((place, k) => point("pole", place, { text: String(k + 1) })));
	});
	effect(() => {
		const places = along.value === null ? [] : ["shortest", "recommended"].map((name) => [name, lines.value[name] && pointAlong(lines.value[name].xy, along.value)]);
		replace(over, "dot", places.flatMap(([name, place]) => (place ? [point("dot", place, { name })] : [])));
	});
	effect(() => replace(over, "probe", probe.value?.known && !held.value ? [ellipse(probe.value)] : []));
	effect(() => {
		theme.value;
		for (const layer of layers) layer.changed();
	});
	onPlan((moment) => requestAnimationFrame(() => paintPlan(moment)));
}

/** By how much the ellipse of a probe is enlarged at this zoom. */
export function ellipseFactor() {
	const worst = Math.max(50, ...(fresh("spots")?.list ?? []).map(({ sigma_cm }) => sigma_cm ?? 0)) / 100;
	return FACTORS.filter((factor) => factor * worst * perMetre() <= REACH).at(-1) ?? 1;
}

// For the benchmark and the tests: the number of painted answers, and times from a move to the painted path.
let painted = 0;
function paintPlan(moment) {
	map.renderSync();
	document.documentElement.dataset.painted = String(++painted);
	if (moment === null) return;
	if (painted % 1000 === 0) performance.clearMeasures("locplan:drag");
	performance.measure("locplan:drag", { start: moment, end: performance.now() });
}

function replace(source, kind, features) {
	for (const feature of source.getFeatures().filter((one) => one.get("kind") === kind)) source.removeFeature(feature);
	if (features.length) source.addFeatures(features); // otherwise every drag builds the layer again
}

function line(kind, xy) {
	return new Feature({ kind, geometry: new LineString(xy.map(toPlane)) });
}

function point(kind, xy, properties = {}) {
	return new Feature({ kind, geometry: new Point(toPlane(xy)), ...properties });
}

function polygon(kind, xy, properties = {}) {
	return new Feature({ kind, geometry: new Polygon([[...xy, xy[0]].map(toPlane)]), ...properties });
}

function strokeFeature({ kind, points, width }) {
	const ends = points.length > 1 ? points : [points[0], points[0]];
	return new Feature({ kind: "stroke", tool: kind, width, geometry: new LineString(ends.map(toPlane)) });
}

function ellipse({ x, y, axes, angle }) {
	const [major, minor] = axes.map((axis) => Math.max((axis / 100) * ellipseFactor(), 2 / perMetre()));
	const [cos, sin] = [Math.cos(angle ?? 0), Math.sin(angle ?? 0)];
	const corners = Array.from({ length: 48 }, (_, k) => {
		const [a, b] = [major * Math.cos((k * Math.PI) / 24), minor * Math.sin((k * Math.PI) / 24)];
		return [x + a * cos - b * sin, y + a * sin + b * cos];
	});
	return polygon("probe", corners);
}

const STYLES = {
	recommended: () => haloed(palette.route, 6),
	shortest: () => haloed(palette.ink, 3, [9, 6]),
	driven: () => haloed(palette.quiet, 2.5),
	chosen: () => haloed(palette.route, 4),
	spot: () => [new Style({ stroke: stroke(palette.halo, 3.5) }), new Style({ stroke: stroke("#7a3b00", 1.5, [3, 3]) })],
	zone: (feature) => zoneStyle(feature.get("zone")),
	letter: (feature) => badge(feature, "#7a3b00", "#fff"),
	pole: (feature) => badge(feature, palette.pole, palette.halo),
	dot: (feature) => new Style({ image: disc(6.5, feature.get("name") === "recommended" ? palette.route : palette.ink) }),
	probe: () => new Style({ fill: new Fill({ color: `${palette.teal}55` }), stroke: stroke(palette.teal, 2) }),
	stroke: (feature) => strokeStyle(feature.get("tool"), feature.get("width")),
};

function styleOf(feature) {
	return STYLES[feature.get("kind")](feature);
}

/** Style of a zone of a kind. */
export function zoneStyle(zone) {
	const colour = palette[ZONE_COLOURS[zone]];
	return new Style({ fill: new Fill({ color: `${colour}40` }), stroke: stroke(colour, 2, ZONE_DASHES[zone]) });
}

/** Style of a wall, a pole or an erased line of a width [m]. */
export function strokeStyle(kind, width) {
	return new Style({ stroke: new Stroke({ color: kind === "erase" ? palette.free : palette.wall, width: Math.max(1.5, width * perMetre()), lineCap: "round", lineJoin: "round" }) });
}

function stroke(color, width, lineDash = []) {
	return new Stroke({ color, width, lineDash, lineCap: lineDash.length ? "butt" : "round", lineJoin: "round" });
}

function haloed(colour, width, dash) {
	return [new Style({ stroke: stroke(palette.halo, width + 3.5) }), new Style({ stroke: stroke(colour, width, dash) })];
}

function disc(radius, colour) {
	return new Circle({ radius, fill: new Fill({ color: colour }), stroke: new Stroke({ color: palette.halo, width: 2.5 }) });
}

function badge(feature, colour, ink) {
	return new Style({ image: disc(12, colour), text: new Text({ text: feature.get("text"), font: "700 13px system-ui, sans-serif", fill: new Fill({ color: ink }), offsetY: 0.5 }) });
}
