// Lidar and range: changed in place; the present field stays usable until the new one is here.
import { byId, hear, setOptions, write } from "./dom.js";
import { showWork, work } from "./link.js";
import { planNow, setWeight } from "./route.js";
import { model, on } from "./store.js";
import { short } from "./text.js";

let awaited = false; // the next field brings its own weight
let fieldSeen = null;

/** Connect the form. */
export function startSensor() {
	const first = { value: "", label: model.about.needs_lidar ? "as it is" : "none" };
	setOptions(byId("lidar"), [first, ...model.about.lidars.map(({ name, title }) => ({ value: name, label: title ?? name }))]);
	hear("lidar", "change", () => {
		const lidar = model.about.lidars.find(({ name }) => name === byId("lidar").value);
		if (lidar) byId("range").value = Math.round(10 * lidar.range) / 10;
	});
	hear("configure", "submit", configure);
	on("state", showField);
	on("event:progress", (message) => awaited || showWork(message.do, "Computing the field", message));
	on("lost", () => showWork("field", "", null));
}

function showField() {
	const field = model.state.field;
	write("field-note", fieldWords(field));
	write("robot", model.state.robot);
	if (!model.state.busy) showWork("field", "", null);
	if (!field || field.digest === fieldSeen) return;
	fieldSeen = field.digest;
	byId("lidar").value = field.lidar ?? "";
	if (Number.isFinite(field.range)) byId("range").value = Math.round(10 * field.range) / 10;
	if (!awaited) return;
	awaited = false;
	setWeight(model.state.default_weight);
}

function fieldWords(field) {
	if (!field) return "There is no field yet.";
	const lidar = model.about.lidars.find(({ name }) => name === field.lidar)?.title ?? field.lidar;
	const parts = [`Estimator ${field.estimator}, ${lidar ? lidar : `range ${short(field.range)} m`}`];
	if (field.saturated > 0.005) parts.push(`at ${(100 * field.saturated).toFixed(0)} % of the places a match counts as perfect`);
	return `${parts.join("; ")}.${field.whole === false ? " It is still being computed." : ""}`;
}

async function configure(event) {
	event.preventDefault();
	const range = byId("range").valueAsNumber;
	const content = { range: Number.isFinite(range) ? range : null };
	const lidar = byId("lidar").value;
	if (lidar || !model.about.needs_lidar) content.lidar = lidar || null;
	awaited = true;
	await work("configure", "Computing the field", content, planNow, "The field stays as it was.");
	awaited = false;
}
