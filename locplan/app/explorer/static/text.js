// Numbers and judgements in words.

const GAP = "\u202f";

/** Metres, with one decimal up to 100. */
export function metres(value, decimals = value < 100 ? 1 : 0) {
	return `${value.toFixed(decimals)}${GAP}m`;
}

/** Centimetres with about two digits that count. */
export function centimetres(value) {
	return `${value.toFixed(value < 10 ? 1 : 0)}${GAP}cm`;
}

/** An error in metres with two digits, as sentences of a choice have it. */
export function errorMetres(value) {
	return `${value < 99.5 ? value.toPrecision(2) : value.toFixed(0)}${GAP}m`;
}

/** A number with few digits, as a tick or a value. */
export function short(value) {
	if (value === 0) return "0";
	const size = Math.abs(value);
	if (size >= 100) return value.toFixed(0);
	if (size >= 10) return String(Number(value.toFixed(1)));
	if (size >= 0.01) return String(Number(value.toPrecision(2)));
	const [digit, power] = value.toExponential(0).split("e-");
	return `${digit}·10⁻${[...power].map((each) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[each]).join("")}`;
}

/** A layer's value as people read it. */
export function layerValue(layer, value) {
	const shown = value * (layer.factor ?? 1);
	const number = shown !== 0 && Math.abs(shown) < 10 ** -(layer.decimals ?? 1) ? short(shown) : shown.toFixed(layer.decimals ?? 1);
	return withUnit(number, layer.unit);
}

/** A layer's title with its unit. */
export function titleWithUnit({ title, unit }) {
	return unit && unit !== "1" ? `${title} [${unit}]` : title;
}

// Degrees stand close to their number.
function withUnit(number, unit) {
	if (!unit || unit === "1") return String(number);
	if (unit === "deg" || unit === "°") return `${number}°`;
	return `${number}${GAP}${unit}`;
}

/** What a degeneracy means, in words. */
export function degeneracyWords(u) {
	if (u < 0.1) return "matches well";
	if (u < 0.35) return "matches fairly well";
	if (u < 0.7) return "uncertain";
	if (u < 0.95) return "very uncertain";
	return "as good as featureless";
}

/** How the two paths compare, in a sentence. */
export function comparison(aware, shortest) {
	const longer = aware.length - shortest.length;
	const less = shortest.degenerate - aware.degenerate;
	if (longer < 0.05 && less < 0.05) return "The shortest path is also the one preferred.";
	return `${metres(Math.max(0, longer))} longer, ${Math.max(0, less).toFixed(1)} fewer degenerate metres.`;
}

/** Ticks of a logarithmic or linear scale within [low, high], few enough to read. */
export function ticks(low, high, isLog, most = 5) {
	if (!(high > low)) return [low];
	return isLog && low > 0 ? logTicks(low, high, most) : evenTicks(low, high, most);
}

function evenTicks(low, high, most) {
	const raw = (high - low) / most;
	const power = 10 ** Math.floor(Math.log10(raw));
	const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= raw) ?? 10);
	const found = [];
	for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(12)));
	return found;
}

function logTicks(low, high, most) {
	for (const factors of [[1, 2, 5], [1, 3], [1]]) {
		const found = [];
		for (let k = Math.floor(Math.log10(low)); k <= Math.ceil(Math.log10(high)); k++)
			for (const factor of factors) {
				const tick = factor * 10 ** k;
				if (tick >= low * 0.999 && tick <= high * 1.001) found.push(Number(tick.toPrecision(6)));
			}
		if (found.length <= most && found.length >= 2) return found;
		if (factors.length === 1 && found.length > 1) return found.filter((_, k) => k % Math.ceil(found.length / most) === 0);
	}
	return [low, high];
}
