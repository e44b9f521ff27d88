// The page of `locplan explore`: a title bar, the map with its tools, four sections, and the profile.
import { batch, computed, effect } from "@preact/signals";
import { render } from "preact";
import { fetchAbout } from "./data.js";
import { drawAtMiddle, dropTool, startDrawing, TOOLS } from "./draw.js";
import { startLink, work } from "./link.js";
import { probeTitle, screenOf, showWhole, startMap, zoomBy } from "./map.js";
import { startMarkers, waypointAt } from "./markers.js";
import { ellipseFactor, layers, startMarks } from "./marks.js";
import { html, Panel, share } from "./panel.js";
import { profileTitle, startProfile } from "./profile.js";
import { canRedo, canUndo, setChanges, startRoute, step, takeChanges } from "./route.js";
import { about, changes, complain, hasRoute, held, isTouched, job, layer, layerName, link, lines, probe, results, route, routeKey, server, shared, spoken, status, toast, tool } from "./state.js";
import { centimetres, metres } from "./text.js";
import { rampGradient, startTheme, theme } from "./theme.js";
import "./page.css";

const byId = (id) => document.getElementById(id);

async function start() {
	startTheme();
	const { dataset } = document.documentElement;
	effect(() => void (dataset.state = link.value));
	for (const name of Object.keys(status)) effect(() => void (dataset[name] = status[name].value));
	try {
		about.value = await fetchAbout();
	} catch {
		document.body.textContent = "The server does not answer. Start it again and open its new address.";
		return;
	}
	document.title = `${mapName()} – locplan`;
	if (shared) document.documentElement.dataset.shared = "";
	render(html`<${Page} />`, document.body);
	startMap(byId("map"), layers);
	startMarks();
	startMarkers(byId("markers"));
	startDrawing();
	startProfile(byId("chart"));
	document.addEventListener("keydown", onKey);
	if (shared) openShared();
	else startLink({ state: follow, progress: ({ done, total }) => (server.value = { ...server.value, busy: { done, total } }), error: ({ error }) => complain(error) });
}

function openShared() {
	const { state, plan, view } = shared;
	batch(() => {
		server.value = state;
		takeChanges(state);
		layerName.value = view?.layer ?? layerName.value;
		const { start, goal, via } = plan ?? state.route;
		route.value = { start, goal, via, weight: view?.weight ?? state.default_weight };
		results.plan.value = plan && { ...plan, basis: { ...state.basis, route: routeKey.value } };
		link.value = "ready";
	});
}

let isStarted = false;
function follow(state) {
	batch(() => {
		server.value = state;
		takeChanges(state);
		if (!route.value && state.route) route.value = { ...state.route, weight: state.default_weight };
		link.value = "ready";
	});
	if (isStarted || !route.value) return;
	isStarted = true;
	startRoute();
	if (about.value.has_report) work("report", {}, (answer) => (results.report.value = answer));
}

function mapName() {
	return String(about.value.map.name).replace(/^.*[\\/]/, "").replace(/\.ya?ml$/, "");
}

function Page() {
	return html`<${Bar} />
		<main><div id="map" tabindex="0" role="application" aria-label="Map. Arrow keys pan, plus and minus zoom, 0 shows the whole map, question mark lists the keys."><i class="cross"></i></div><div id="markers"></div><${Tools} /><${Zoom} /><${Legend} /><${Readout} /><${Hint} /></main>
		<aside aria-label="Results"><${Panel} /></aside>
		<footer><div class="row"><h2>${profileTitle}</h2><span class="sub">${profileNote}</span></div><canvas id="chart" tabindex="0" role="slider" aria-label="Place along the route" aria-valuemin="0" aria-valuemax="0" aria-valuenow="0"></canvas></footer>
		<${Toast} /><div class="unseen" aria-live="polite">${spoken}</div><${Help} />`;
}
const profileNote = computed(() => (lines.value.isSimulated ? "shaded: 90 % of the drives" : ""));

function Bar() {
	return html`<header><h1>locplan</h1><span class="name">${mapName()}</span><${Robot} />
		${link.value === "offline" ? html`<span class="strip" role="status">The server does not answer. Trying again …</span>` : html`<${Busy} />`}<span class="grow"></span>
		${!shared && html`<button id="undo" disabled=${!canUndo.value} onClick=${() => step(true)}>Undo</button><button id="redo" disabled=${!canRedo.value} onClick=${() => step(false)}>Redo</button>
		<button id="share" disabled=${Boolean(job.value) || !hasRoute.value || !server.value.field?.is_whole} onClick=${share}>Share</button>`}<button id="help-open" aria-label="Keys and hints" onClick=${openHelp}>?</button></header>`;
}

function Busy() {
	const busy = server.value?.busy;
	return busy ? html`<span class="busy" role="status">Computing … <progress max=${busy.total || 1} value=${busy.total ? busy.done : undefined} aria-label="Computing"></progress></span>` : null;
}

// The lidar is a change like others: the list has at most one, and the robot's own needs none.
function Robot() {
	const { robot } = server.value ?? {};
	if (!robot) return null;
	const change = changes.value.find(({ kind }) => kind === "lidar");
	const choose = ({ target }) => {
		const rest = changes.value.filter(({ kind }) => kind !== "lidar");
		const preset = about.value.lidars.find(({ name }) => name === target.value);
		setChanges(preset ? [...rest, { kind: "lidar", lidar: preset.name, range: preset.range }] : rest);
	};
	const title = `${robot.lidar ?? robot.title.split(/[,;]/)[0]}${Number.isFinite(robot.range) ? ` · ${robot.range} m` : ""}`;
	return html`<select class="chip" aria-label="Lidar" title="Change the lidar" disabled=${Boolean(shared)} onChange=${choose}>
		<option value="" selected=${!change}>${change ? "The robot's lidar" : title}</option>${about.value.lidars.map((one) => html`<option value=${one.name} selected=${change?.lidar === one.name}>${one.title}</option>`)}</select>`;
}

function Tools() {
	if (shared) return null;
	return html`<div class="tools" role="toolbar" aria-label="Tools">${TOOLS.map(({ name, title, key, isZone }) => html`<button data-tool=${name} class=${isZone ? "for-zone" : ""} aria-pressed=${tool.value === name} title="${title} (${key.toUpperCase()})" onClick=${() => (tool.value = name)}><i class="zone ${name}"></i>${title}</button>`)}</div>`;
}

function Zoom() {
	return html`<div class="zoom"><button aria-label="Zoom in" onClick=${() => zoomBy(1.5)}>+</button><button aria-label="Zoom out" onClick=${() => zoomBy(1 / 1.5)}>−</button></div>`;
}

function Legend() {
	const shown = layer.value;
	if (!shown) return null;
	theme.value;
	return html`<div class="legend"><select aria-label="Layer" onChange=${({ target }) => (layerName.value = target.value)}>${server.value.layers.map(({ name, title }) => html`<option value=${name} selected=${name === shown.name}>${title}</option>`)}</select>
		<div class="ramp" style=${{ background: rampGradient() }}></div><div class="row"><span>${shown.labels[0]}</span><span>${shown.labels[1]}</span></div>${server.value.weak_spots?.length ? html`<div class="row"><span>Outlined: weak spots</span></div>` : null}</div>`;
}

function Readout() {
	const at = probe.value;
	if (!at || held.value) return null;
	const [px, py] = screenOf([at.x, at.y]) ?? [0, 0];
	const main = byId("map").getBoundingClientRect();
	const style = { transform: `translate(${px > main.width - 320 ? `calc(${px - 20}px - 100%)` : `${px + 20}px`}, ${py > main.height - 150 ? `calc(${py - 20}px - 100%)` : `${py + 20}px`})` };
	const factor = ellipseFactor();
	return html`<div class="readout" style=${style}><p><b>${probeTitle(at)}</b></p>${at.known && html`${at.reason && html`<p>${at.reason}</p>`}<p>Position ± ${at.axes[0] < 1.05 * at.axes[1] ? centimetres(at.axes[0]) : `${centimetres(at.axes[0])} × ${centimetres(at.axes[1])}`}${Number.isFinite(at.heading_deg) ? `, heading ± ${at.heading_deg.toFixed(1)}°` : ""}</p>`}
		<p class="sub">${at.x.toFixed(2)}, ${metres(at.y, 2)}${Number.isFinite(at.clearance) ? `, ${metres(at.clearance, 2)} from an obstacle` : ""}${at.known && factor > 1 ? `. Ellipse enlarged ${factor}\u202f×` : ""}</p></div>`;
}

function Hint() {
	if (shared) return null;
	if (TOOLS.find(({ name }) => name === tool.value)?.isZone) return html`<p class="hint">Drag across the map to draw a zone.</p>`;
	if (isTouched.value || !hasRoute.value) return null;
	return html`<p class="hint">Drag <b>S</b> and <b class="goal">G</b>. Double-click adds a waypoint.</p>`;
}

let toastTimer = 0;
function Toast() {
	clearTimeout(toastTimer);
	if (!toast.value) return null;
	const { text, isError } = toast.value;
	toastTimer = setTimeout(() => (toast.value = null), isError ? 9000 : 4000);
	return html`<div class="toast ${isError ? "error" : ""}" role="alert">${text}</div>`;
}

function Help() {
	return html`<dialog id="help" aria-labelledby="help-title"><h2 id="help-title">Keys and gestures</h2><dl>
		<dt>Drag S or G</dt><dd>Move start or goal</dd>
		<dt>Double-click, long press</dt><dd>Add a waypoint</dd>
		<dt>Wheel, two fingers</dt><dd>Zoom</dd>
		<dt>Drag a corner or an edge of a zone</dt><dd>Change its shape (Move tool)</dd>
		<dt><kbd>Tab</kbd>, arrows</dt><dd>Focus a marker, the map or the chart, and move it. <kbd>Shift</kbd> moves markers farther</dd>
		<dt><kbd>+</kbd> <kbd>-</kbd> <kbd>0</kbd></dt><dd>Zoom in, zoom out, show the whole map</dd>
		<dt><kbd>Delete</kbd></dt><dd>Remove the focused waypoint</dd>
		<dt><kbd>A</kbd></dt><dd>Add a waypoint halfway</dd>
		${TOOLS.map(({ title, key }) => html`<dt><kbd>${key.toUpperCase()}</kbd></dt><dd>${title}</dd>`)}
		<dt><kbd>Enter</kbd></dt><dd>Use the tool at the centre of the map. Press twice for a line or a zone</dd>
		<dt><kbd>Ctrl</kbd> <kbd>Z</kbd></dt><dd>Undo. With <kbd>Shift</kbd>: redo</dd>
		<dt><kbd>L</kbd></dt><dd>Next layer</dd>
		<dt><kbd>Esc</kbd></dt><dd>Return to the Move tool</dd></dl>
		<p class="sub">Localization is weak where a scan looks the same after a move. The aware path avoids such places. The slider sets the detour that avoiding a metre of them is worth. A simulation recommends a path.</p>
		<form method="dialog"><button class="main">Close</button></form></dialog>`;
}

function openHelp() {
	if (!byId("help").open) byId("help").showModal();
}

function onKey(event) {
	const isTyping = event.target.matches?.("textarea, select, input:not([type=range])");
	if (event.defaultPrevented || byId("help").open || isTyping) return;
	const key = event.key.toLowerCase();
	if ((event.ctrlKey || event.metaKey) && key === "z") {
		event.preventDefault();
		return void (shared || step(!event.shiftKey));
	}
	if (event.ctrlKey || event.metaKey || event.altKey) return;
	const chosen = TOOLS.find((one) => one.key === key);
	const isOnMap = event.target === byId("map");
	const names = server.value?.layers.map(({ name }) => name) ?? [];
	if (key === "escape") dropTool();
	else if (key === "?") openHelp();
	else if (key === "0") showWhole();
	else if (!isOnMap && (key === "+" || key === "=")) zoomBy(1.5);
	else if (!isOnMap && key === "-") zoomBy(1 / 1.5);
	else if (key === "l" && names.length) layerName.value = names[(names.indexOf(layer.value.name) + 1) % names.length];
	else if (key === "a") waypointAt(null);
	else if (key === "enter" && isOnMap) drawAtMiddle();
	else if (chosen && !shared) tool.value = chosen.name;
	else return;
	event.preventDefault();
}

start().catch(complain);
