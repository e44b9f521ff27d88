// One layer of the field as a picture: bytes on the lattice, dilated beside walls and coloured here.
import { colourTable, valueOfByte } from "./ramps.js";
import { model } from "./store.js";
import { palette } from "./theme.js";
import { view } from "./view.js";

const OPACITY = 0.9;
let bytes = null; // as served
let spread = null; // dilated two steps, so that smoothing reaches the walls
let shape = { rows: 0, cols: 0 };
let picture = null;

/** Take the bytes of a layer (row 0 on top), or null for none. */
export function setTexture(values, lattice) {
	bytes = values;
	spread = null;
	picture = null;
	if (!values) return;
	shape = { rows: lattice.rows, cols: lattice.cols };
	spread = dilated(dilated(values, shape), shape);
	colourTexture();
}

/** Colour the texture anew, for instance where the theme changed. */
export function colourTexture() {
	const layer = shownLayer();
	if (!spread || !layer) return;
	const table = colourTable(layer, palette.theme);
	picture ??= document.createElement("canvas");
	picture.width = shape.cols;
	picture.height = shape.rows;
	const pen = picture.getContext("2d");
	const image = pen.createImageData(shape.cols, shape.rows);
	const words = new Uint32Array(image.data.buffer);
	for (let k = 0; k < spread.length; k++) words[k] = table[spread[k]];
	pen.putImageData(image, 0, 0);
}

/** The layer that is shown, as the state describes it. */
export function shownLayer() {
	const layers = model.state?.layers ?? [];
	return layers.find((layer) => layer.name === model.layer) ?? layers[0] ?? null;
}

/** Paint the field over the map's area. */
export function paintTexture(pen) {
	if (!picture) return;
	const [column, down, width, height] = textureBox();
	pen.save();
	pen.globalAlpha = OPACITY;
	pen.imageSmoothingEnabled = true;
	pen.drawImage(picture, view.x + column * view.scale, view.y + down * view.scale, width * view.scale, height * view.scale);
	pen.restore();
}

/** Value of the shown layer at a grid place, or null. */
export function textureAt(column, down) {
	const layer = shownLayer();
	return layer && bytes ? latticeValue(bytes, layer, column, down) : null;
}

/** Value of a layer's bytes at the lattice point nearest to a grid place, or null. */
export function latticeValue(values, layer, column, down) {
	const [left, top] = textureBox();
	const { stride_cells: stride, rows, cols } = model.state.lattice;
	const j = Math.floor((column - left) / stride);
	const i = Math.floor((down - top) / stride);
	if (i < 0 || j < 0 || i >= rows || j >= cols) return null;
	const byte = values[i * cols + j];
	return byte ? valueOfByte(layer, byte) : null;
}

// [column, row from the top, width, height] in cells; a texel's centre is its lattice point's cell centre.
function textureBox() {
	const { rows, cols, stride_cells: stride } = model.state.lattice;
	const left = 0.5 - stride / 2;
	const top = model.about.map.rows - (rows - 1) * stride - 0.5 - stride / 2;
	return [left, top, cols * stride, rows * stride];
}

function dilated(values, { rows, cols }) {
	const out = values.slice();
	for (let row = 0; row < rows; row++)
		for (let column = 0; column < cols; column++) {
			const at = row * cols + column;
			if (values[at]) continue;
			let [sum, count] = [0, 0];
			for (let y = Math.max(0, row - 1); y <= Math.min(rows - 1, row + 1); y++)
				for (let x = Math.max(0, column - 1); x <= Math.min(cols - 1, column + 1); x++) {
					const near = values[y * cols + x];
					if (near) {
						sum += near;
						count++;
					}
				}
			if (count) out[at] = Math.round(sum / count);
		}
	return out;
}
