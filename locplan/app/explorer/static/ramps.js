// The colours of the field, and the tables that turn a texture's bytes into colours.

// Every sixteenth colour of matplotlib's magma.
const STOPS = "0000040a08221d114736106b51127c6a1c818326819c2e7fb73779d0416fe75263f56b5cfc8961fea772fec488fde2a3fcfdbf";
// The ends are left out: they would vanish in walls and ground.
const ENDS = { light: [0.985, 0.13], dark: [0.14, 0.97] };

function stopOf(k) {
	const text = STOPS.slice(6 * k, 6 * k + 6);
	return [0, 2, 4].map((at) => parseInt(text.slice(at, at + 2), 16));
}

/** Colour [r, g, b] of a share 0..1, small values light on a light page and dark on a dark one. */
export function rampColour(theme, share) {
	const [first, last] = ENDS[theme];
	const at = 16 * (first + (last - first) * Math.min(1, Math.max(0, share)));
	const k = Math.min(15, Math.floor(at));
	const low = stopOf(k);
	const high = stopOf(k + 1);
	return low.map((value, channel) => Math.round(value + (at - k) * (high[channel] - value)));
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
export function colourTable(layer, theme) {
	const table = new Uint32Array(256);
	for (let byte = 1; byte < 256; byte++) {
		const [red, green, blue] = rampColour(theme, shareOf(layer, valueOfByte(layer, byte), layer.anchors));
		table[byte] = (255 << 24) | (blue << 16) | (green << 8) | red;
	}
	return table;
}

/** The colours as a CSS gradient. */
export function rampGradient(theme) {
	const colours = Array.from({ length: 25 }, (_, k) => `rgb(${rampColour(theme, k / 24).join(" ")})`);
	return `linear-gradient(90deg, ${colours.join(", ")})`;
}
