// Taking results away: a picture, a shareable page, costmaps for Nav2.
import { byId, hear, setOptions, write } from "./dom.js";
import { mapName, saveAddress, saveDownload } from "./data.js";
import { barTicks, drawBase } from "./layers.js";
import { work } from "./link.js";
import { drawOverlay } from "./overlay.js";
import { rampColour } from "./ramps.js";
import { onRoute, routeAsked } from "./route.js";
import { report, toast } from "./say.js";
import { model, on } from "./store.js";
import { haloedStroke, numberedDot, writeAt } from "./strokes.js";
import { candidateDash, candidateWords, errorColour, freshSimulation } from "./simulating.js";
import { shownLayer } from "./texture.js";
import { metres, short, titleWithUnit } from "./text.js";
import { palette } from "./theme.js";
import { scaleBar, screenOf, view } from "./view.js";

const WIDE = 760; // pixels from which on the legend takes one row

/** Connect the buttons. */
export function startSharing() {
	const { can = {}, distros = [] } = model.about;
	hear("picture", "click", savePicture);
	hear("share", "click", sharePage);
	hear("export", "click", exportCostmap);
	hear("export-to", "change", sayWhich);
	onRoute(sayWhich);
	on("simulated", sayWhich);
	setOptions(byId("distro"), distros.map((distro) => ({ value: distro, label: distro })), distros.includes("jazzy") ? "jazzy" : undefined);
	byId("export-row").hidden = !can.export;
	byId("save").hidden = !can.save;
	write("export-note", can.export ? "" : "Exports and saved maps need locplan explore --output FOLDER.");
}

function sayWhich() {
	const { aware } = model.plan ?? {};
	const isPath = byId("export-to").value === "path" && aware;
	byId("export-which").hidden = !isPath;
	if (!isPath) return;
	const simulated = freshSimulation();
	const isOther = simulated && simulated.taken !== `aware, weight ${short(model.weight)}`;
	write("export-which", `Exports the aware path at weight ${short(model.weight)}, ${metres(aware.length)}.${isOther ? " The simulation recommends another." : ""}`);
}

function sharePage() {
	const look = { layer: model.layer, theme: palette.theme, ...routeAsked() };
	return work("share", "Making a page to share", { view: look }, (answer) => {
		saveDownload(answer.download);
		toast("The page is being downloaded.");
	});
}

function exportCostmap() {
	const content = { to: byId("export-to").value, distro: byId("distro").value, ...routeAsked() };
	return work("export", "Exporting for Nav2", content, ({ files, folder, warnings = [] }) => {
		const [first] = files[0].split("/");
		const done = files.length === 1 ? `${files[0]} is in ${folder}.` : `${files.length} files are in ${folder}/${first}.`;
		report("export-note", [done, ...warnings.map((each) => `Mind: ${each}.`)].join(" "));
		toast(warnings.length ? `${done} Mind the warning in the panel.` : done);
	});
}

// The picture shows what no card covers, with a legend below.
function savePicture() {
	const ratio = 2;
	const { left, top, right, bottom } = model.insets;
	const [x, y] = [Math.max(0, left - 12), Math.max(0, top - 12)];
	const size = { width: Math.max(view.width - right + 12 - x, 300), height: view.height - bottom + 12 - y };
	const canvas = document.createElement("canvas");
	canvas.width = size.width * ratio;
	canvas.height = (size.height + footOf(size)) * ratio;
	const pen = canvas.getContext("2d");
	pen.scale(ratio, ratio);
	pen.save();
	pen.translate(-x, -y);
	drawBase(pen, ratio);
	drawOverlay(pen, true);
	drawPins(pen);
	pen.restore();
	drawLegend(pen, size);
	canvas.toBlob((blob) => {
		const address = URL.createObjectURL(blob);
		saveAddress(address, `${mapName()}.png`);
		setTimeout(() => URL.revokeObjectURL(address), 30000);
		toast("The picture is being saved.");
	});
}

function footOf({ width }) {
	return (width < WIDE ? 190 : 92) + 20 * Math.max(0, drawnPaths().length - 2);
}

function drawPins(pen) {
	if (!model.start) return;
	model.via.forEach((via, k) => numberedDot(pen, ...screenOf(...via), String(k + 1), palette.via));
	numberedDot(pen, ...screenOf(...model.start), "A", palette.teal);
	numberedDot(pen, ...screenOf(...model.goal), "B", palette.goal);
}

function drawLegend(pen, size) {
	const [top, isWide] = [size.height, size.width >= WIDE];
	pen.fillStyle = palette.halo;
	pen.fillRect(0, top, size.width, footOf(size));
	pen.fillStyle = palette.ink;
	drawScale(pen, 20, top + 34);
	drawKeys(pen, isWide ? 190 : 20, top + (isWide ? 26 : 64), size.width - (isWide ? 310 : 20));
	if (model.state.field) drawBar(pen, isWide ? size.width - 280 : 20, top + (isWide ? 26 : footOf(size) - 68), 256);
	writeAt(pen, `${mapName()}   ${byId("field-note").textContent}   locplan ${model.about.version}`, 20, top + footOf(size) - 14, palette.quiet, "left", "12px", size.width - 40);
}

function drawScale(pen, x, y) {
	const bar = scaleBar(130);
	pen.fillRect(x, y, bar.pixels, 2);
	pen.fillRect(x, y - 6, 2, 8);
	pen.fillRect(x + bar.pixels - 2, y - 6, 2, 8);
	writeAt(pen, bar.words, x, y - 16, palette.ink, "left", "13px");
}

function drawKeys(pen, x, y, right) {
	drawnPaths().forEach(({ words, colour, dash }, k) => {
		pen.beginPath();
		pen.moveTo(x, y + 20 * k);
		pen.lineTo(x + 34, y + 20 * k);
		haloedStroke(pen, colour, 3.5, dash);
		writeAt(pen, words, x + 44, y + 20 * k, palette.ink, "left", "13px", right - x - 44);
	});
}

// The paths on the map, as the legend tells them: those that were simulated, or both that are planned.
function drawnPaths() {
	const { aware, shortest } = model.plan ?? {};
	const simulated = freshSimulation();
	const told = ({ length, degenerate }) => [metres(length), Number.isFinite(degenerate) ? `${metres(degenerate)} degenerate` : "degeneracy not known"].join(", ");
	const paths = simulated
		? simulated.candidates.map((each, k) => ({ path: each, words: candidateWords(each, k), colour: errorColour(each), dash: candidateDash(k) }))
		: [{ path: aware, name: "aware", colour: palette.teal, dash: [] }, { path: shortest, name: "shortest", colour: palette.ink, dash: [8, 5] }];
	return paths.filter(({ path }) => path).map((each) => ({ ...each, words: each.words ?? `${each.name}: ${told(each.path)}` }));
}

function drawBar(pen, x, y, width) {
	const layer = shownLayer();
	for (let k = 0; k < width; k++) {
		pen.fillStyle = `rgb(${rampColour(palette.theme, k / (width - 1)).join(" ")})`;
		pen.fillRect(x + k, y, 1.5, 10);
	}
	writeAt(pen, titleWithUnit(layer), x, y - 10, palette.ink);
	for (const { share, text } of barTicks(5)) writeAt(pen, text, x + share * width, y + 20, palette.ink, "center");
}
