// Numbers in words.

const GAP = "\u202f";

/** Metres, with one decimal below 100. */
export function metres(value, decimals = value < 100 ? 1 : 0) {
	return `${value.toFixed(decimals)}${GAP}m`;
}

/** Centimetres, with about two digits. */
export function centimetres(value) {
	return `${value.toFixed(value < 10 ? 1 : 0)}${GAP}cm`;
}

/** An error in metres, with two digits. */
export function errorMetres(value) {
	return Number.isFinite(value) ? `${value < 9.95 ? value.toFixed(2) : value.toFixed(0)}${GAP}m` : "–";
}

/** A share in percent. */
export function percent(share) {
	return Number.isFinite(share) ? `${(100 * share).toFixed(0)}${GAP}%` : "–";
}

/** An interval of numbers that `format` writes without their units. */
export function interval([low, high], format) {
	return `[${[low, high].map((value) => format(value).split(GAP)[0]).join(", ")}]`;
}

/** How well a scan fixes the position at a degeneracy. */
export function degeneracyText(u) {
	if (u < 0.1) return "A scan fixes the position well";
	if (u < 0.35) return "A scan fixes the position fairly well";
	if (u < 0.7) return "A scan leaves the position uncertain";
	return u < 0.95 ? "A scan leaves the position very uncertain" : "A scan does not fix the position";
}

/** Ticks of a linear scale from 0 to `high`. */
export function ticks(high, most) {
	const power = 10 ** Math.floor(Math.log10(high / most));
	const step = power * [10, 5, 2, 1].find((factor) => factor * power <= (1.5 * high) / most);
	return Array.from({ length: Math.floor(high / step + 1e-9) + 1 }, (_, k) => Number((k * step).toPrecision(12)));
}
