// What the page knows, in one place, and who is told when a part of it changes.

/** The state of the page. Positions are world metres [x, y]. */
export const model = {
	about: null, // the answer of /about
	state: null, // the newest state event
	shared: false, // a read-only page without a server
	layer: "degeneracy", // name of the layer shown
	tool: "move",
	start: null,
	goal: null,
	via: [],
	weight: 4,
	plan: null, // the newest answer of plan
	held: null, // the marker being dragged: "start", "goal", "via:K"
	along: null, // {s, name}: the place marked on the profile
	probe: null, // the newest answer of at
	pointer: null, // {px, py} of the cursor over the map
	simulated: null,
	stroke: null, // the stroke being drawn
	sent: [], // strokes that the server has not answered yet
	checked: null, // the report of a check
};

const listeners = new Map();

/** Call `listener` whenever `topic` is told. */
export function on(topic, listener) {
	if (!listeners.has(topic)) listeners.set(topic, []);
	listeners.get(topic).push(listener);
}

/** Tell all listeners of a topic. */
export function tell(topic, value) {
	for (const listener of listeners.get(topic) ?? []) listener(value);
}
