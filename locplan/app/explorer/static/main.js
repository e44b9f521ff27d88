// The explorer's page: starts every part, then follows the server's state.
import { byId, root, write } from "./dom.js";
import { carried, fetchAbout, mapName } from "./data.js";
import { startChecked } from "./checked.js";
import { startEditing } from "./editing.js";
import { repaint } from "./frames.js";
import { startKeys } from "./keys.js";
import { loadField, startLayers } from "./layers.js";
import { startLink } from "./link.js";
import { placeMarkers, startMarkers } from "./markers.js";
import { startOverlay } from "./overlay.js";
import { startProfile } from "./profile.js";
import { planNow, setWeight, startRoute, takePlan } from "./route.js";
import { complain, setStatus } from "./say.js";
import { startSensor } from "./sensor.js";
import { startSharing } from "./sharing.js";
import { startHint, startSheet } from "./sheet.js";
import { startSimulating } from "./simulating.js";
import { showWhole, startStage } from "./stage.js";
import { model, on, tell } from "./store.js";
import { setTheme, startTheme } from "./theme.js";

let wasLost = false; // what moved while there was no connection is not planned yet

async function start() {
	startTheme();
	startSheet();
	startLayers();
	startOverlay();
	startProfile();
	startMarkers();
	startStage();
	try {
		model.about = await fetchAbout();
	} catch (error) {
		setStatus("offline", "The server does not answer. Reload the page when it runs.");
		byId("retry").onclick = () => location.reload();
		return;
	}
	model.shared = carried() !== null;
	describeMap();
	for (const begin of [startRoute, startSimulating, startEditing, startSensor, startChecked, startSharing, startKeys, startHint]) begin();
	showWhole();
	if (carried()) await openShared(carried());
	else {
		on("event:state", followState);
		on("lost", () => (wasLost = true));
		on("event:error", ({ error }) => complain(error));
		startLink();
	}
}

function describeMap() {
	const { rows, cols, resolution } = model.about.map;
	write("map-name", mapName());
	write("map-size", `${(cols * resolution).toFixed(0)} × ${(rows * resolution).toFixed(0)} m, ${cols} × ${rows} cells`);
	document.title = `${mapName()} – locplan`;
}

async function followState(state) {
	const before = model.state;
	model.state = state;
	if (!model.start && state.start) {
		Object.assign(model, { start: state.start, goal: state.goal, via: state.via ?? [] });
		setWeight(state.default_weight);
	}
	tell("state");
	tell("markers");
	await loadField();
	const isNew = !before || before.map.digest !== state.map.digest || before.field?.digest !== state.field?.digest;
	setStatus("ready");
	const isFirst = !model.plan?.aware;
	const isDue = isNew || isFirst || wasLost;
	wasLost = false;
	if (isDue) await planNow();
	if (isFirst) tell("settled"); // the cards have their words, and their height
}

async function openShared(page) {
	root.dataset.shared = "";
	model.state = page.state;
	const { answer, view: look } = page;
	if (look?.theme) setTheme(look.theme);
	Object.assign(model, { layer: look?.layer ?? model.layer, start: answer?.start ?? page.state.start, goal: answer?.goal ?? page.state.goal, via: answer?.via ?? page.state.via ?? [] });
	setWeight(look?.weight ?? page.state.weight);
	tell("state");
	await loadField();
	placeMarkers();
	if (answer) takePlan(answer);
	repaint("base", "overlay", "profile", "scale");
	setStatus("ready");
}

start().catch(complain);
