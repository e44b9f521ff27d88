// What the page knows, and the one rule that decides whether a result still holds.
import { computed, signal } from "@preact/signals";

export const shared = window.LOCPLAN ?? null; // the content of a shared page, which has no server

export const about = signal(null); // map, lidars and what the server can do
export const server = signal(null); // the newest state event
export const digests = signal({}); // of map, robot, field and zones; none while a change is under way
export const changes = signal([]);
export const route = signal(null); // {start, goal, via, weight}; positions are world metres [x, y]
export const held = signal(null); // the marker being dragged: "start", "goal", "via:K"
export const tool = signal("move");
export const layerName = signal("degeneracy");
export const along = signal(null); // metres from the start of the place marked on the profile
export const probe = signal(null); // the newest answer of `at`
export const job = signal(null); // {kind, done, total} of the long question under way
export const link = signal("loading"); // loading, ready, offline
export const isTouched = signal(false); // the user has moved or changed something
export const isFixShown = signal(false);
export const toast = signal(null); // {text, isError}
export const spoken = signal(""); // for screen readers

const plan = signal(null);
const simulated = signal(null);
const report = signal(null);
const receipt = signal(null);
const spots = computed(() => server.value?.weak_spots && { basis: server.value.basis, list: server.value.weak_spots });
export const results = { plan, simulated, report, receipt, spots };

const MAP = ["map", "robot", "field"];
const ALL = [...MAP, "zones", "route"];
const PARTS = { plan: ALL, simulated: ALL, receipt: ALL, spots: MAP, report: ["map", "robot", "zones"] };
const NAMES = { map: "the map", robot: "the lidar", field: "the map", zones: "the zones", route: "the route" };

/** The route as text, which the server puts into the basis of its answers. */
export const routeKey = computed(() => route.value && keyOf(route.value));

/** A route as text. */
export function keyOf({ start, via, goal, weight }) {
	return JSON.stringify([...[start, ...via, goal].map((place) => place.map((value) => Math.round(1000 * value) / 1000)), weight]);
}

/** For each result: "none", "fresh", "waiting" for the answer to a change, or the first part that differs. */
export const status = Object.fromEntries(Object.keys(results).map((name) => [name, computed(() => statusOf(name))]));

function statusOf(name) {
	const result = results[name].value;
	if (!result) return "none";
	const present = { ...digests.value, route: routeKey.value };
	if (!present.map) return "waiting";
	return PARTS[name].find((part) => result.basis[part] !== present[part]) ?? "fresh";
}

/** What to tell about a result that no longer holds, or an empty text. */
export function outdatedText(name) {
	const part = status[name].value;
	return NAMES[part] ? `Outdated: you changed ${NAMES[part]}.` : "";
}

/** The result of a name if it holds. */
export function fresh(name) {
	return status[name].value === "fresh" ? results[name].value : null;
}

// A moved route keeps the plan on the map until its next answer, which is already asked for.
const livePlan = computed(() => (["fresh", "route"].includes(status.plan.value) ? plan.value : null));

/** The two paths that the map, the table and the profile show: {recommended, shortest, isSimulated}. Until a simulation recommends one, the first is the aware path. */
export const lines = computed(() => {
	const known = fresh("simulated");
	if (!known) return { recommended: livePlan.value?.recommended, shortest: livePlan.value?.shortest, isSimulated: false };
	const best = known.candidates.find((one) => one.is_recommended) ?? known.candidates.find((one) => one.is_shortest);
	return { recommended: best, shortest: known.candidates.find((one) => one.is_shortest), isSimulated: true };
});

/** Whether there is a route, a recommended path, and both paths: these change rarely, unlike what they are about. */
export const hasRoute = computed(() => route.value !== null);
export const hasPath = computed(() => Boolean(lines.value.recommended));
export const hasBoth = computed(() => Boolean(lines.value.recommended && lines.value.shortest));

/** The layer of the field that the map shows. */
export const layer = computed(() => server.value?.layers.find(({ name }) => name === layerName.value) ?? server.value?.layers[0] ?? null);

/** What the primary button does: "none", "cancel", "fix", "export" or "simulate". */
export const primary = computed(() => {
	if (job.value) return "cancel";
	if (shared || !server.value?.field?.is_whole || !hasPath.value) return "none";
	if (fresh("report")?.recommended.length && !isTouched.value && !isFixShown.value) return "fix";
	return fresh("simulated") && about.value.can_export ? "export" : "simulate";
});

/** Show a line for some seconds. */
export function say(text, isError = false) {
	toast.value = { text: text.charAt(0).toUpperCase() + text.slice(1), isError };
	spoken.value = toast.value.text;
}

/** Show an error. */
export function complain(error) {
	say(String(error?.message ?? error), true);
}
