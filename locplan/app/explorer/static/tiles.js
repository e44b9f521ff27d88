// The walls: a pyramid by maximum class, so that thin walls survive, drawn in tiles of 512 pixels.
import { palette } from "./theme.js";
import { view } from "./view.js";

const EDGE = 512;
const KEPT = 64;
let known = null;
let pyramid = []; // levels {cells, rows, cols}; row 0 on top; 0 unknown, 1 free, 2 occupied
const tiles = new Map(); // key -> canvas, the newest last

/** Take new cells and build the pyramid. */
export function setCells(cells, rows, cols) {
	pyramid = [{ cells, rows, cols }];
	known = knownBox(cells, rows, cols);
	while (Math.max(pyramid.at(-1).rows, pyramid.at(-1).cols) > EDGE) pyramid.push(halved(pyramid.at(-1)));
	dropTiles();
}

/** The part of the map that is not unknown: [column, row from the top, columns, rows]. */
export function knownPart() {
	return known;
}

/** Forget the drawn tiles, for instance where the colours changed. */
export function dropTiles() {
	tiles.clear();
}

/** Class of the cell at a grid place: 0 unknown or outside, 1 free, 2 occupied. */
export function classAt(column, down) {
	const [level] = pyramid;
	if (!level || column < 0 || down < 0 || column >= level.cols || down >= level.rows) return 0;
	return level.cells[Math.floor(down) * level.cols + Math.floor(column)];
}

/** Paint the tiles in sight. */
export function paintTiles(pen, ratio) {
	if (!pyramid.length) return;
	const k = Math.max(0, Math.min(pyramid.length - 1, Math.floor(Math.log2(1 / (view.scale * ratio)) + 0.35)));
	const level = pyramid[k];
	const pixel = view.scale * 2 ** k;
	const whole = (value) => Math.round(value * ratio) / ratio;
	pen.imageSmoothingEnabled = pixel * ratio < 2.5;
	const step = EDGE * pixel;
	const lastColumn = Math.min(Math.ceil(level.cols / EDGE), Math.ceil((view.width - view.x) / step));
	const lastRow = Math.min(Math.ceil(level.rows / EDGE), Math.ceil((view.height - view.y) / step));
	for (let row = Math.max(0, Math.floor(-view.y / step)); row < lastRow; row++)
		for (let column = Math.max(0, Math.floor(-view.x / step)); column < lastColumn; column++) {
			const tile = tileOf(k, row, column);
			const [x, y] = [view.x + column * step, view.y + row * step];
			const [left, top] = [whole(x), whole(y)]; // whole pixels, so that no seam shows between tiles
			pen.drawImage(tile, left, top, whole(x + tile.width * pixel) - left, whole(y + tile.height * pixel) - top);
		}
}

function knownBox(cells, rows, cols) {
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

function halved({ cells, rows, cols }) {
	const [half, wide] = [Math.ceil(rows / 2), Math.ceil(cols / 2)];
	const out = new Uint8Array(half * wide);
	for (let row = 0; row < half; row++) {
		const upper = 2 * row * cols;
		const lower = Math.min(2 * row + 1, rows - 1) * cols;
		for (let column = 0; column < wide; column++) {
			const left = 2 * column;
			const right = left + 1 < cols ? left + 1 : left;
			const [a, b, c, d] = [cells[upper + left], cells[upper + right], cells[lower + left], cells[lower + right]];
			const above = a > b ? a : b;
			const below = c > d ? c : d;
			out[row * wide + column] = above > below ? above : below;
		}
	}
	return { cells: out, rows: half, cols: wide };
}

function tileOf(k, row, column) {
	const key = `${k}/${row}/${column}`;
	const tile = tiles.get(key) ?? drawnTile(pyramid[k], row, column);
	tiles.delete(key);
	tiles.set(key, tile);
	if (tiles.size > KEPT) tiles.delete(tiles.keys().next().value);
	return tile;
}

function drawnTile({ cells, rows, cols }, row, column) {
	const canvas = document.createElement("canvas");
	canvas.width = Math.min(EDGE, cols - column * EDGE);
	canvas.height = Math.min(EDGE, rows - row * EDGE);
	const pen = canvas.getContext("2d");
	const image = pen.createImageData(canvas.width, canvas.height);
	const words = new Uint32Array(image.data.buffer);
	const colours = [word(palette.ground), 0, word(palette.wall)];
	for (let y = 0; y < canvas.height; y++) {
		const from = (row * EDGE + y) * cols + column * EDGE;
		for (let x = 0; x < canvas.width; x++) words[y * canvas.width + x] = colours[cells[from + x]];
	}
	pen.putImageData(image, 0, 0);
	return canvas;
}

function word(hex) {
	const value = parseInt(hex.slice(1), 16);
	return ((255 << 24) | ((value & 255) << 16) | (value & 0xff00) | (value >> 16)) >>> 0;
}
