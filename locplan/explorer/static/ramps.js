// Colour ramps, and the tables that turn a texture's bytes into colours.

// Every sixteenth colour of matplotlib's maps.
const STOPS = {
	magma: "0000040a08221d114736106b51127c6a1c818326819c2e7fb73779d0416fe75263f56b5cfc8961fea772fec488fde2a3fcfdbf",
	viridis: "44015448186a472d7b4240863b528b33638d2c728e26828e21918c1fa08828ae803fbc735ec96284d44baddc30d8e219fde725",
	cividis: "00224e002e6a1a386f32436d434e6c535a6d61656f6f70737d7c788c88789b9476aba072bcae6ccdbb63dec958f0d846fee838",
};
// The ends are left out: they would vanish in walls and ground.
const ENDS = { light: { magma: [0.985, 0.13], viridis: [0.98, 0.04], cividis: [0.97, 0.06] }, dark: { magma: [0.14, 0.97], viridis: [0.06, 0.97], cividis: [0.08, 0.97] } };

function stopOf(name, k) {
	const text = STOPS[name].slice(6 * k, 6 * k + 6);
	return [0, 2, 4].map((at) => parseInt(text.slice(at, at + 2), 16));
}

/** Colour [r, g, b] of a share 0..1 of a ramp, small values light on a light page and dark on a dark one. */
export function rampColour(name, theme, share) {
	const [first, last] = ENDS[theme][name];
	const at = 16 * (first + (last - first) * Math.min(1, Math.max(0, share)));
	const k = Math.min(15, Math.floor(at));
	const low = stopOf(name, k);
	const high = stopOf(name, k + 1);
	return low.map((value, channel) => Math.round(value + (at - k) * (high[channel] - value)));
}

/** The part of a layer's scale that its colours span: its anchors, or the range present on the map; its worst value is the last. */
export function colourSpan(layer, stretch) {
	if (!stretch || !layer.present || layer.present[0] === layer.present[1]) return layer.anchors;
	return layer.present;
}

/** Share 0..1 at which a value stands between two ends of a layer's scale. */
export function shareOf(layer, value, [low, high]) {
	if (layer.scale !== "log") return (value - low) / (high - low);
	return Math.log(Math.max(value, 1e-12) / low) / Math.log(high / low);
}

/** The value that a byte of a texture stands for. */
export function valueOfByte(layer, byte) {
	const [low, high] = layer.anchors;
	const share = (byte - 1) / 254;
	return layer.scale === "log" ? low * (high / low) ** share : low + share * (high - low);
}

/** A table of 256 colours (ABGR words) for the bytes of a texture; 0 is clear. */
export function colourTable(layer, name, theme, stretch) {
	const span = colourSpan(layer, stretch);
	const table = new Uint32Array(256);
	for (let byte = 1; byte < 256; byte++) {
		const [red, green, blue] = rampColour(name, theme, shareOf(layer, valueOfByte(layer, byte), span));
		table[byte] = (255 << 24) | (blue << 16) | (green << 8) | red;
	}
	return table;
}

/** A CSS gradient of a ramp. */
export function rampGradient(name, theme) {
	const colours = Array.from({ length: 25 }, (_, k) => `rgb(${rampColour(name, theme, k / 24).join(" ")})`);
	return `linear-gradient(90deg, ${colours.join(", ")})`;
}
