// The chart along both paths; the pointer or the arrow keys mark a place on it and on the map.
import { computed, effect } from "@preact/signals";
import { along, lines, results, status } from "./state.js";
import { metres, ticks } from "./text.js";
import { palette, theme } from "./theme.js";

const LEFT = 44;
const RIGHT = 14;
const TOP = 8;
const BOTTOM = 20;
let chart = null;
let size = "";

// The lines of the chart: {s, values, band, name}. A drag keeps those of the last rest, since its answers have none.
let last = [];
const series = computed(() => {
	const { recommended, shortest, isSimulated } = lines.value;
	if (isSimulated) {
		const { along: errors } = results.simulated.value;
		last = ["shortest", "recommended"].filter((name) => errors[name]).map((name) => ({ name, s: errors[name].s, values: errors[name].median_cm, band: errors[name].high_cm }));
	} else if (!recommended && !shortest) last = [];
	else if (recommended?.profile || shortest?.profile) last = [["shortest", shortest], ["recommended", recommended]].filter(([, path]) => path?.profile?.sigma_cm.some(Number.isFinite)).map(([name, path]) => ({ name, s: path.profile.s, values: path.profile.sigma_cm }));
	return last;
});
const longest = computed(() => Math.max(0.1, ...series.value.map(({ s }) => s.at(-1) ?? 0)));

/** Title of the chart. */
export const profileTitle = computed(() => (lines.value.isSimulated ? "Error along the route" : "Uncertainty of the position along the route"));

/** Connect the canvas. */
export function startProfile(canvas) {
	chart = canvas;
	const metresAt = ({ offsetX }) => mark(((offsetX - LEFT) / (chart.clientWidth - LEFT - RIGHT)) * longest.value);
	chart.addEventListener("pointermove", metresAt);
	chart.addEventListener("pointerdown", metresAt);
	chart.addEventListener("pointerleave", () => (along.value = null));
	chart.addEventListener("blur", () => (along.value = null));
	chart.addEventListener("keydown", walk);
	new ResizeObserver(paint).observe(chart);
	effect(() => {
		theme.value;
		paint();
	});
	effect(() => chart.setAttribute("aria-valuemax", longest.value.toFixed(1)));
}

function mark(s) {
	along.value = Math.min(Math.max(s, 0), longest.value);
	chart.setAttribute("aria-valuenow", along.value.toFixed(1));
	const words = series.value.map(({ name, s: steps, values }) => `${name} ${values[stepAt(along.value, steps)]?.toFixed(0) ?? "unknown"} cm`);
	chart.setAttribute("aria-valuetext", `${metres(along.value)} along: ${words.join(", ")}`);
}

function walk(event) {
	const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
	const place = { Home: 0, End: longest.value }[event.key] ?? (step && (along.value ?? 0) + (step * longest.value) / 100);
	if (place === undefined) return;
	event.preventDefault();
	event.stopPropagation();
	mark(place);
}

// Index of the first step that reaches `s`.
function stepAt(s, steps) {
	const index = steps.findIndex((value) => value >= s);
	return index < 0 ? steps.length - 1 : index;
}

function paint() {
	const ratio = Math.min(window.devicePixelRatio || 1, 2);
	const [width, height] = [chart.clientWidth, chart.clientHeight];
	if (size !== `${width} ${height} ${ratio}`) [chart.width, chart.height, size] = [width * ratio, height * ratio, `${width} ${height} ${ratio}`];
	const pen = chart.getContext("2d");
	pen.setTransform(ratio, 0, 0, ratio, 0, 0);
	pen.clearRect(0, 0, width, height);
	const top = 1.05 * Math.max(1, ...series.value.flatMap(({ values, band }) => [...values, ...(band ?? [])]).filter(Number.isFinite));
	const across = (s) => LEFT + (s / longest.value) * (width - LEFT - RIGHT);
	const up = (value) => TOP + (1 - (value ?? 0) / top) * (height - TOP - BOTTOM);
	paintAxes(pen, { top, across, up, width, height });
	const trace = (s, values, from = s.length - 1, by = -1) => s.forEach((_, k) => pen.lineTo(across(s[by > 0 ? k : from - k]), up(values[by > 0 ? k : from - k])));
	for (const { name, s, values, band } of series.value) {
		const colour = name === "recommended" ? palette.route : palette.ink;
		pen.fillStyle = pen.strokeStyle = colour;
		pen.globalAlpha = 0.14;
		pen.beginPath();
		trace(s, values, 0, 1);
		if (band) trace(s, band);
		else trace([0, s.at(-1)], [0, 0]);
		pen.fill();
		pen.globalAlpha = 1;
		pen.beginPath();
		trace(s, values, 0, 1);
		pen.lineWidth = name === "recommended" ? 2.5 : 2;
		pen.setLineDash(name === "recommended" ? [] : [6, 4]);
		pen.stroke();
		pen.setLineDash([]);
	}
	if (along.value === null) return;
	pen.strokeStyle = palette.mark;
	pen.lineWidth = 1.5;
	pen.beginPath();
	pen.moveTo(across(along.value), TOP);
	pen.lineTo(across(along.value), height - BOTTOM);
	pen.stroke();
}

function paintAxes(pen, { top, across, up, width, height }) {
	Object.assign(pen, { strokeStyle: palette.line, fillStyle: palette.quiet, lineWidth: 1, font: "11px system-ui, sans-serif", textBaseline: "middle", textAlign: "right" });
	for (const tick of ticks(top, 2)) {
		pen.beginPath();
		pen.moveTo(LEFT, Math.round(up(tick)) + 0.5);
		pen.lineTo(width - RIGHT, Math.round(up(tick)) + 0.5);
		pen.stroke();
		pen.fillText(tick < 200 ? `${tick} cm` : `${tick / 100} m`, LEFT - 6, up(tick));
	}
	pen.textAlign = "center";
	if (status.plan.value !== "none") for (const tick of ticks(longest.value, Math.max(2, Math.min(10, width / 90)))) pen.fillText(`${tick} m`, across(tick), height - 9);
}
