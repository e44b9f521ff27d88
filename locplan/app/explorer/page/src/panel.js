// The four sections next to the map.
import { computed, signal } from "@preact/signals";
import { h } from "preact";
import htm from "htm";
import { saveDownload } from "./data.js";
import { boxSize, lengthOf } from "./geometry.js";
import { cancel, work } from "./link.js";
import { planSoon, note, routeContent, setChanges, setRoute } from "./route.js";
import { about, changes, fresh, hasBoth, hasPath, hasRoute, isFixShown, isTouched, job, layerName, lines, outdatedText, primary, results, route, say, server, shared, spoken, status } from "./state.js";
import { errorMetres, interval, metres, percent } from "./text.js";

export const html = htm.bind(h);
const distro = signal(null);

/** The sections. */
export function Panel() {
	return html`<${Route} /><${WeakSpots} /><${Changes} /><${Report} />`;
}

function Section({ title, name, children }) {
	const outdated = name && outdatedText(name);
	const isDim = name && !["none", "fresh"].includes(status[name].value);
	return html`<section id=${name} aria-label=${title} class=${isDim ? "outdated" : ""}><h2>${title}</h2>
		${outdated && html`<p class="strip" role="status">${outdated}</p>`}${children}</section>`;
}

// Texts that follow a drag: they are written into their nodes, without the sections around them.
const headline = computed(() => {
	if (lines.value.isSimulated) return results.simulated.value.verdict;
	if (!hasBoth.value) return server.value?.field ? (status.plan.value === "waiting" ? "Planning …" : (results.plan.value?.why ?? "Planning …")) : "Computing how well scans fix the position …";
	const { recommended, shortest } = lines.value;
	const [longer, fewer] = [recommended.length - shortest.length, shortest.degenerate - recommended.degenerate];
	if (fewer < 0.05) return longer < 0.05 ? "The shortest path is fine" : `The aware path is ${metres(longer)} longer`;
	return `The longer path avoids ${metres(fewer, fewer < 10 ? 1 : 0)} of weak localization`;
});
const evidence = computed(() => {
	if (lines.value.isSimulated) return results.simulated.value.evidence ?? "";
	if (!hasBoth.value) return "";
	const { recommended, shortest } = lines.value;
	const longer = recommended.length - shortest.length;
	return longer < 0.05 ? `${metres(recommended.length)}. ` : `${metres(recommended.length)}, ${metres(longer)} longer. `;
});
const tag = computed(() => (lines.value.isSimulated ? "simulated" : "predicted"));
const isSimulated = computed(() => lines.value.isSimulated);
const columns = computed(() => (isSimulated.value ? ["length", "error", "lost"] : ["length", "weak", "mean ±"]));
const cells = ["recommended", "shortest"].map((name) => [0, 1, 2].map((column) => computed(() => cellText(lines.value[name], column, lines.value.isSimulated))));

function cellText(path, column, isSimulated) {
	if (!path) return "–";
	if (column === 0) return metres(path.length);
	if (isSimulated) return column === 1 ? errorMetres(path.error) : percent(path.lost);
	const value = column === 1 ? path.degenerate : (path.mean_sigma_cm ?? NaN) / 100;
	return Number.isFinite(value) ? (column === 1 ? metres(value) : errorMetres(value)) : "–";
}

function Route() {
	const head = columns.value;
	return html`<section aria-label="Route"><h2>Route</h2>
		${outdatedText("simulated") && html`<p class="strip" role="status">${outdatedText("simulated")} <span class="nowrap">Simulate again.</span></p>`}
		<p class="head">${headline}</p>
		<p class="sub">${evidence}${hasBoth.value && html` <span class="tag ${tag}">${tag}</span>`}</p>
		<table><thead><tr><th scope="col"><span class="unseen">Path</span></th>${head.map((title) => html`<th scope="col">${title}</th>`)}</tr></thead><tbody>
		${[isSimulated.value ? "Recommended" : "Aware", "Shortest"].map((title, row) => html`<tr class=${row ? "" : "best"}><th scope="row"><i class="line ${row ? "dashed" : ""}"></i>${title}</th>${cells[row].map((cell) => html`<td>${cell}</td>`)}</tr>`)}</tbody></table>
		<${Candidates} /><${Weight} /><${Primary} /></section>`;
}

function Candidates() {
	const known = fresh("simulated");
	if (!known) return null;
	const others = known.candidates.filter((one) => !one.is_recommended && !one.is_shortest).length;
	return html`<details><summary>${others ? `${others} other ${others > 1 ? "paths" : "path"}, intervals` : "Intervals"}</summary><table class="small"><thead><tr><th scope="col">path</th><th scope="col">length</th><th scope="col">error</th><th scope="col">lost</th></tr></thead><tbody>
		${known.candidates.map((one) => html`<tr><th scope="row">${one.title}</th><td>${metres(one.length)}</td><td>${errorMetres(one.error)}<small>${one.error_interval?.every(Number.isFinite) ? interval(one.error_interval, errorMetres) : ""}</small></td>
			<td>${percent(one.lost)}<small>${one.lost_interval?.every(Number.isFinite) ? interval(one.lost_interval, percent) : ""}</small></td></tr>`)}
		</tbody></table>${(known.advice ?? []).map((sentence) => html`<p class="sub">${sentence}</p>`)}</details>`;
}

const mostWeight = computed(() => Math.min(50, about.value?.max_weight ?? 50));
const weightText = computed(() => (route.value ? `Detour per metre of weak localization: ${metres(route.value.weight, route.value.weight < 10 ? 1 : 0)}` : "Detour per metre of weak localization"));

function Weight() {
	if (shared || !hasRoute.value) return null;
	const most = mostWeight.value;
	const move = ({ target }) => {
		isTouched.value = true;
		route.value = { ...route.peek(), weight: Math.round(10 * most * (target.valueAsNumber / 1000) ** 2) / 10 };
		planSoon(null);
	};
	return html`<label>${weightText}<input type="range" min="0" max="1000" step="5" value=${sliderPlace} onInput=${move} onChange=${note} aria-valuetext=${weightText} /></label>`;
}
const sliderPlace = computed(() => Math.round(1000 * Math.sqrt(Math.min(1, (route.value?.weight ?? 0) / mostWeight.value))));

function Primary() {
	if (shared) return null;
	const kind = primary.value;
	const isCancel = kind === "cancel";
	const hasChanges = about.value.can_export && changes.value.length > 0 && kind !== "export" && !isCancel && hasPath.value;
	return html`${job.value && html`<progress max=${job.value.total || 1} value=${job.value.total ? job.value.done : undefined} aria-label=${JOBS[job.value.kind]}></progress>`}
		${kind === "export" && html`<${Distro} />`}
		${kind !== "none" && html`<button class="main" data-do=${kind} onClick=${PRIMARY[kind].act}>${isCancel ? `Cancel: ${JOBS[job.value.kind].toLowerCase()}` : PRIMARY[kind].title}</button>`}
		${hasChanges && html`<div class="row"><button class="wide" data-do="export" onClick=${exportRoute}>Export for Nav2</button><${Distro} /></div>`}
		<${Receipt} />`;
}

const JOBS = { simulate: "Simulating", report: "Reading the report", export: "Exporting", share: "Making the page" };
const PRIMARY = {
	cancel: { act: () => cancel(job.value.kind) },
	fix: { title: "Show the fix", act: showFix },
	export: { title: "Export for Nav2", act: exportRoute },
	simulate: { title: "Simulate this route", act: simulate },
};

function Distro() {
	const { distros } = about.value;
	distro.value ??= distros.includes("jazzy") ? "jazzy" : (distros[0] ?? null);
	return html`<select aria-label="ROS 2 distribution" value=${distro.value} onChange=${({ target }) => (distro.value = target.value)}>${distros.map((name) => html`<option value=${name} selected=${name === distro.value}>ROS 2 ${name}</option>`)}</select>`;
}

function Receipt() {
	const receipt = results.receipt.value;
	if (!receipt) return null;
	if (!fresh("receipt")) return html`<p class="strip" role="status">${outdatedText("receipt") || "Outdated."} Export again.</p>`;
	return html`<div class="receipt"><p>Wrote ${receipt.files.length} files to ${receipt.folder}.</p>${receipt.warnings.map((warning) => html`<p class="sub">${warning}</p>`)}</div>`;
}

function showFix() {
	isFixShown.value = true;
	document.getElementById("report").scrollIntoView({ behavior: "smooth" });
}

function simulate() {
	isTouched.value = true;
	work("simulate", { ...routeContent(), path: results.plan.value?.recommended?.xy }, (answer) => {
		results.simulated.value = answer;
		spoken.value = answer.verdict;
	});
}

function exportRoute() {
	work("export", { ...routeContent(), distro: distro.value }, (answer) => {
		results.receipt.value = answer;
		say(`Wrote ${answer.files.length} files to ${answer.folder}.`);
	});
}

/** Download the page that can be sent to others. */
export function share() {
	work("share", { ...routeContent(), view: { layer: layerName.value, weight: route.value.weight } }, ({ download }) => {
		saveDownload(download);
		say("The page is being downloaded.");
	});
}

function WeakSpots() {
	const state = server.value;
	const list = fresh("spots")?.list ?? [];
	const text = !state?.field ? "Computing …" : !state.weak_spots || status.spots.value !== "fresh" ? "Looking for weak spots …" : list.length ? "" : "No weak spots: scans fix the position everywhere.";
	return html`<${Section} title="Weak spots">${text && html`<p class="sub">${text}</p>`}
		<ul>${list.slice(0, 3).map(spotRow)}</ul>
		${list.length > 3 && html`<details><summary>${list.length - 3} more</summary><ul>${list.slice(3).map(spotRow)}</ul></details>`}<//>`;
}

function spotRow({ letter, title, reason, sigma_cm }) {
	return html`<li><div class="row"><span><i class="dot">${letter}</i>${title}</span>${Number.isFinite(sigma_cm) && html`<span class="nowrap">± ${sigma_cm < 100 ? `${sigma_cm.toFixed(0)} cm` : metres(sigma_cm / 100)}</span>`}</div><p class="sub">${reason}</p></li>`;
}

function Changes() {
	const list = changes.value;
	if (shared && !list.length) return null;
	return html`<${Section} title="Changes"><ul>${list.map((change, index) => html`<${Change} key=${index} change=${change} index=${index} />`)}</ul>
		${list.length === 0 && html`<p class="sub">Draw on the map, or change the lidar.</p>`}<//>`;
}

function Change({ change, index }) {
	const title = changeTitle(change);
	const put = (part) => setChanges(changes.value.toSpliced(index, 1, { ...change, ...part }));
	const number = (name, unit, low, high, label) => html`<input type="number" class="short" min=${low} max=${high} aria-label=${label} value=${change[name]} disabled=${Boolean(shared)}
		onChange=${({ target }) => (target.checkValidity() && Number.isFinite(target.valueAsNumber) ? put({ [name]: target.valueAsNumber }) : (target.value = change[name]))} /> ${unit}`;
	return html`<li class="row"><span><i class="zone ${change.zone ?? change.kind}"></i>${title}${change.zone === "slow" && html`, ${number("percent", "%", 1, 100, "Percent of the top speed")}`}${change.kind === "lidar" && html`, ${number("range", "m", 0.5, 200, "Range of the lidar in metres")}`}</span>
		${!shared && html`<button class="plain" aria-label=${`Remove ${title}`} onClick=${() => setChanges(changes.value.toSpliced(index, 1))}>✕</button>`}</li>`;
}

function changeTitle({ kind, zone, polygon, points, lidar, width }) {
	if (kind === "zone") return `${{ "no-go": "No-go", slow: "Slow", prefer: "Prefer" }[zone]}, ${boxSize(polygon).map((side) => side.toFixed(1)).join(" × ")} m`;
	if (kind === "lidar") return `Lidar ${lidar ?? server.value?.robot.title ?? ""}`;
	if (kind === "pole") return `Pole, ${(100 * width).toFixed(0)} cm`;
	return `${kind === "wall" ? "Wall" : "Erased"}, ${metres(lengthOf(points))}`;
}

function Report() {
	if (!about.value?.has_report) return null;
	const known = results.report.value;
	if (!known) return html`<${Section} title="Check report"><p class="sub">Reading the report …</p><//>`;
	const best = known.fixes.find(({ kind }) => known.recommended.includes(kind));
	const lost = (rate) => (Array.isArray(rate) ? rate[0] : rate);
	return html`<${Section} title="Check report" name="report"><p><b>${known.next}</b></p>
		${best && html`<p class="sub">Lost drives: ${percent(lost(known.baseline.lost))} → ${percent(lost(best.lost))}${Array.isArray(best.lost) && best.lost.length > 2 ? ` ${interval(best.lost.slice(1), percent)}` : ""}</p>`}
		<details open=${isFixShown.value}><summary>Routes and fixes</summary>
		<table class="small"><thead><tr><th scope="col">route</th><th scope="col">lost</th></tr></thead><tbody>${known.routes.map((one) => html`<tr><th scope="row"><button class="plain" disabled=${Boolean(shared)} onClick=${() => setRoute({ start: one.start, goal: one.goal, via: [] })}>${one.name}</button><small>${one.title}</small></th><td>${percent(lost(one.lost))}</td></tr>`)}</tbody></table>
		<table class="small"><thead><tr><th scope="col">fix</th><th scope="col">lost</th></tr></thead><tbody>${known.fixes.map((fix) => html`<tr class=${fix === best ? "best" : ""}><th scope="row">${fix.title}</th><td>${percent(lost(fix.lost))}</td></tr>`)}</tbody></table>
		${best?.settings && html`<${Settings} settings=${best.settings} />`}</details>
		${status.report.value === "fresh" && html`<label class="check"><input type="checkbox" checked=${isFixShown.value} onChange=${({ target }) => (isFixShown.value = target.checked)} /> Show on the map</label>`}<//>`;
}

function Settings({ settings }) {
	const text = typeof settings === "string" ? settings : Object.entries(settings).map(([name, value]) => `${name}: ${value}`).join("\n");
	const copy = () => navigator.clipboard.writeText(text).then(() => say("Copied."), () => say("The browser does not allow copying.", true));
	return text ? html`<pre tabindex="0">${text}</pre><button onClick=${copy}>Copy settings</button>` : null;
}
