// The field's layers: fetched as they change, chosen, coloured, with a colour bar in the units of people.
import { byId, hear, make, root, setOptions } from "./dom.js";
import { fetchCells, fetchLayer } from "./data.js";
import { paints, repaint } from "./frames.js";
import { complain } from "./say.js";
import { rampGradient, shareOf } from "./ramps.js";
import { model, on, tell } from "./store.js";
import { colourTexture, paintTexture, setTexture, shownLayer, textureAt } from "./texture.js";
import { layerValue, ticks, titleWithUnit } from "./text.js";
import { palette } from "./theme.js";
import { dropTiles, paintTiles, setCells } from "./tiles.js";
import { gridOf, view } from "./view.js";

let cellsHere = null; // digest of the cells that are drawn
let textureHere = null; // digest and name of the texture that is drawn

/** Connect the controls of the field. */
export function startLayers() {
	hear("layer", "change", () => chooseLayer(byId("layer").value));
	paints("base", paintBase);
	on("probe", markValue);
	on("theme", () => {
		dropTiles();
		colourTexture();
		drawColourBar();
		repaint("base");
	});
}

/** Fetch what a new state asks for: cells, then the layer shown. */
export async function loadField() {
	const { map, layers } = model.state;
	const choices = layers.map((layer) => ({ value: layer.name, label: titleWithUnit(layer) }));
	setOptions(byId("layer"), choices.length ? choices : [{ value: "", label: "no field yet" }], shownLayer()?.name);
	try {
		if (map.digest !== cellsHere) {
			const cells = await fetchCells(map.digest);
			if (map.digest !== model.state.map.digest) return;
			setCells(cells, model.about.map.rows, model.about.map.cols);
			if (!cellsHere) tell("cells");
			cellsHere = map.digest;
			root.dataset.map = map.digest;
		}
		await loadTexture();
	} catch (error) {
		if (error.status !== 404) complain(error); // else it is out of date, and a newer state is on its way
	}
	repaint("base", "overlay");
}

/** Show another layer; `null` goes to the next one. */
export function chooseLayer(name) {
	const names = model.state.layers.map((layer) => layer.name);
	model.layer = name ?? names[(names.indexOf(model.layer) + 1) % names.length];
	byId("layer").value = model.layer;
	loadField();
}

/** Draw ground, field and walls on a pen. */
export function drawBase(pen, ratio) {
	pen.fillStyle = palette.ground;
	pen.fillRect(0, 0, view.width, view.height);
	const { rows, cols } = model.about.map;
	pen.fillStyle = palette.free;
	const box = [view.x + 1, view.y + 1, cols * view.scale - 2, rows * view.scale - 2]; // nothing shows beside the tiles
	pen.fillRect(...box);
	pen.save();
	pen.beginPath();
	pen.rect(...box);
	pen.clip();
	paintTexture(pen);
	pen.restore();
	paintTiles(pen, ratio);
}

/** The ticks of the colour bar: {share, text}. */
export function barTicks(most) {
	const layer = shownLayer();
	const span = layer.anchors;
	const factor = layer.factor ?? 1;
	const found = ticks(Math.min(...span) * factor, Math.max(...span) * factor, layer.scale === "log", most);
	return found.map((tick) => ({ share: shareOf(layer, tick / factor, span), text: String(Number(tick.toPrecision(3))) })).filter(({ share }) => share > -0.001 && share < 1.001);
}

async function loadTexture() {
	const layer = shownLayer();
	if (!layer || !model.state.field) {
		setTexture(null, null);
		textureHere = null;
		byId("ramp-bar").hidden = true;
		return repaint("base");
	}
	const wanted = addressOf(layer);
	if (wanted !== textureHere) {
		const bytes = await fetchLayer(...wanted.split("/"));
		if (wanted !== addressOf(shownLayer())) return undefined;
		setTexture(bytes, model.state.lattice);
		textureHere = wanted;
	}
	root.dataset.field = model.state.field.digest;
	byId("ramp-bar").hidden = false;
	colourTexture();
	drawColourBar();
	return repaint("base");
}

function addressOf(layer) {
	return layer && `${model.state.field?.digest}/${layer.name}`;
}

function paintBase() {
	if (!cellsHere) return;
	const canvas = byId("base");
	const ratio = canvas.width / view.width;
	const pen = canvas.getContext("2d", { alpha: false });
	pen.setTransform(ratio, 0, 0, ratio, 0, 0);
	drawBase(pen, ratio);
}

function drawColourBar() {
	const layer = model.state && shownLayer();
	if (!layer) return;
	byId("ramp-colours").style.background = rampGradient(palette.theme);
	byId("ramp-ticks").replaceChildren(...barTicks(5).map(({ share, text }) => {
		const tick = make("span", { textContent: text });
		tick.style.left = `${(100 * share).toFixed(1)}%`;
		return tick;
	}));
	const span = layer.anchors;
	byId("ramp-bar").setAttribute("aria-label", `${layer.title}: from ${layerValue(layer, span[0])} to ${layerValue(layer, span[1])}`);
}

// A small mark shows on the bar what the field is worth under the cursor.
function markValue() {
	const mark = byId("ramp-mark");
	const layer = model.state && shownLayer();
	const value = model.probe?.known && layer ? textureAt(...gridOf(model.probe.x, model.probe.y)) : null;
	mark.hidden = value === null;
	if (value !== null) mark.style.left = `${(100 * Math.min(1, Math.max(0, shareOf(layer, value, layer.anchors)))).toFixed(1)}%`;
}
