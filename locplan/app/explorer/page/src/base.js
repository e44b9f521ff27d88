// The ground of the map: the field as a picture, and above it the walls as a pyramid of tiles.
import { about, layer, server } from "./state.js";
import { palette, rampColour } from "./theme.js";

const EDGE = 512; // pixels of a tile
const KEPT = 64; // tiles
const OPACITY = 0.9;
const tiles = new Map(); // key -> canvas, the newest last
let pyramid = []; // levels {cells, rows, cols}; row 0 on top; 0 unknown, 1 free, 2 occupied
let spread = null; // steps of the layer, two points wider than its lattice, so that smoothing reaches the walls
let picture = null;

/** The part of the map that is not unknown: [column, row from the top, columns, rows]. */
export let knownPart = [0, 0, 1, 1];

/** Take the cells of a map. Halving keeps the highest class, so that thin walls survive. */
export function setCells(cells, rows, cols) {
	pyramid = [{ cells, rows, cols }];
	knownPart = boxOfKnown(pyramid[0]);
	while (Math.max(pyramid.at(-1).rows, pyramid.at(-1).cols) > EDGE) pyramid.push(halve(pyramid.at(-1)));
	tiles.clear();
}

/** Take the steps of a layer, or null. */
export function setTexels(values) {
	const { rows, cols } = server.value.field ?? {};
	spread = values && dilate(dilate(values, rows, cols), rows, cols);
	colourBase();
}

/** Colour everything again, after the theme has changed. */
export function colourBase() {
	tiles.clear();
	picture = null;
	if (!spread) return;
	const { rows, cols } = server.value.field;
	const table = Uint32Array.from({ length: 256 }, (_, step) => (step ? wordOf(rampColour((step - 1) / 254)) : 0));
	picture = drawCanvas(rows, cols, (row, column) => table[spread[row * cols + column]]);
}

function boxOfKnown({ cells, rows, cols }) {
	let [left, right, top, bottom] = [cols, -1, rows, -1];
	for (let row = 0; row < rows; row++) {
		const line = cells.subarray(row * cols, (row + 1) * cols);
		const first = line.findIndex(Boolean);
		if (first < 0) continue;
		left = Math.min(left, first);
		right = Math.max(right, line.findLastIndex(Boolean));
		top = Math.min(top, row);
		bottom = row;
	}
	return right < 0 ? [0, 0, cols, rows] : [left, top, right + 1 - left, bottom + 1 - top];
}

/** Class of a cell: 0 unknown, 1 free, 2 occupied. */
export function classAt(column, down) {
	const [level] = pyramid;
	const isInside = level && column >= 0 && down >= 0 && column < level.cols && down < level.rows;
	return isInside ? level.cells[Math.floor(down) * level.cols + Math.floor(column)] : 0;
}

/** Value of a layer's steps at a place in cells, or null. */
export function layerValueAt({ low, high, scale }, values, column, down) {
	const { rows, cols, stride_cells: stride } = server.value.field;
	const [left, top] = pictureBox();
	const [i, j] = [Math.floor((down - top) / stride), Math.floor((column - left) / stride)];
	const value = i >= 0 && j >= 0 && i < rows && j < cols ? values[i * cols + j] : 0;
	const share = (value - 1) / 254;
	if (!value) return null;
	return scale === "log" ? low * (high / low) ** share : low + share * (high - low);
}

/** Paint ground, field and walls on a pen; `view` is the place [px] of the map's top left corner and the pixels of a cell. */
export function paintBase(pen, view) {
	pen.fillStyle = palette.ground;
	pen.fillRect(0, 0, view.width, view.height);
	if (!pyramid.length) return;
	const { rows, cols } = about.value.map;
	pen.fillStyle = palette.free;
	pen.save();
	pen.beginPath();
	pen.rect(view.x + 1, view.y + 1, cols * view.cell - 2, rows * view.cell - 2); // nothing shows next to the tiles
	pen.clip();
	pen.fillRect(0, 0, view.width, view.height);
	if (picture && layer.value) {
		const [column, down, width, height] = pictureBox();
		pen.globalAlpha = OPACITY;
		pen.drawImage(picture, view.x + column * view.cell, view.y + down * view.cell, width * view.cell, height * view.cell);
	}
	pen.restore();
	paintTiles(pen, view);
}

function paintTiles(pen, view) {
	const k = Math.max(0, Math.min(pyramid.length - 1, Math.floor(Math.log2(1 / view.cell) + 0.35)));
	const { rows, cols } = pyramid[k];
	const pixel = view.cell * 2 ** k;
	const size = EDGE * pixel;
	pen.imageSmoothingEnabled = pixel < 2.5;
	const range = (offset, room, count) => [Math.max(0, Math.floor(-offset / size)), Math.min(Math.ceil(count / EDGE), Math.ceil((room - offset) / size))];
	const [[top, bottom], [left, right]] = [range(view.y, view.height, rows), range(view.x, view.width, cols)];
	for (let row = top; row < bottom; row++)
		for (let column = left; column < right; column++) {
			const tile = tileOf(k, row, column);
			const [x, y] = [view.x + column * size, view.y + row * size];
			const [px, py] = [Math.round(x), Math.round(y)]; // whole pixels, so that no seam shows between tiles
			pen.drawImage(tile, px, py, Math.round(x + tile.width * pixel) - px, Math.round(y + tile.height * pixel) - py);
		}
}

function tileOf(k, row, column) {
	const key = `${k}/${row}/${column}`;
	const tile = tiles.get(key) ?? drawTile(pyramid[k], row, column);
	tiles.delete(key);
	tiles.set(key, tile);
	if (tiles.size > KEPT) tiles.delete(tiles.keys().next().value);
	return tile;
}

function drawTile({ cells, rows, cols }, row, column) {
	const colours = [wordOf(rgbOf(palette.ground)), 0, wordOf(rgbOf(palette.wall))];
	const at = row * EDGE * cols + column * EDGE;
	return drawCanvas(Math.min(EDGE, rows - row * EDGE), Math.min(EDGE, cols - column * EDGE), (y, x) => colours[cells[at + y * cols + x]]);
}

function drawCanvas(rows, cols, colourAt) {
	const canvas = Object.assign(document.createElement("canvas"), { width: cols, height: rows });
	const pen = canvas.getContext("2d");
	const image = pen.createImageData(cols, rows);
	const words = new Uint32Array(image.data.buffer);
	for (let row = 0; row < rows; row++) for (let column = 0; column < cols; column++) words[row * cols + column] = colourAt(row, column);
	pen.putImageData(image, 0, 0);
	return canvas;
}

function rgbOf(hex) {
	return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
}

function wordOf([red, green, blue]) {
	return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}

// In cells; the centre of a texel is the centre of its lattice point's cell.
function pictureBox() {
	const { rows, cols, stride_cells: stride } = server.value.field;
	return [0.5 - stride / 2, about.value.map.rows - (rows - 1) * stride - 0.5 - stride / 2, cols * stride, rows * stride];
}

function halve({ cells, rows, cols }) {
	const [half, wide] = [Math.ceil(rows / 2), Math.ceil(cols / 2)];
	const out = new Uint8Array(half * wide);
	for (let row = 0; row < rows; row++)
		for (let column = 0; column < cols; column++) {
			const at = (row >> 1) * wide + (column >> 1);
			if (cells[row * cols + column] > out[at]) out[at] = cells[row * cols + column];
		}
	return { cells: out, rows: half, cols: wide };
}

function dilate(values, rows, cols) {
	const out = values.slice();
	for (let row = 0; row < rows; row++)
		for (let column = 0; column < cols; column++) {
			if (values[row * cols + column]) continue;
			let [sum, count] = [0, 0];
			for (let y = Math.max(0, row - 1); y <= Math.min(rows - 1, row + 1); y++)
				for (let x = Math.max(0, column - 1); x <= Math.min(cols - 1, column + 1); x++) {
					const near = values[y * cols + x];
					if (near) [sum, count] = [sum + near, count + 1];
				}
			if (count) out[row * cols + column] = Math.round(sum / count);
		}
	return out;
}
