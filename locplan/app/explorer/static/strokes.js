// Lines with a halo, so that they stand out on every colour.
import { palette } from "./theme.js";
import { screenOf } from "./view.js";

/** Trace a polyline of world points on a pen. */
export function tracePath(pen, xy) {
	pen.beginPath();
	xy.forEach(([x, y], k) => {
		const [px, py] = screenOf(x, y);
		if (k) pen.lineTo(px, py);
		else pen.moveTo(px, py);
	});
}

/** Trace a circle. */
export function traceDisc(pen, px, py, radius) {
	pen.beginPath();
	pen.arc(px, py, radius, 0, 2 * Math.PI);
}

/** Stroke what was traced, with a halo. */
export function haloedStroke(pen, colour, width, dash = [], halo = 2) {
	pen.strokeStyle = palette.halo;
	pen.lineWidth = width + halo;
	pen.stroke();
	pen.strokeStyle = colour;
	pen.lineWidth = width;
	pen.setLineDash(dash);
	pen.stroke();
	pen.setLineDash([]);
}

/** Stroke a path with a halo. */
export function haloedPath(pen, xy, { colour, width = 3.5, dash = [] }) {
	if (!xy?.length) return;
	pen.lineJoin = "round";
	pen.lineCap = dash.length ? "butt" : "round";
	tracePath(pen, xy);
	haloedStroke(pen, colour, width, dash, 3.5);
}

/** A dot with a halo at a screen place. */
export function haloedDot(pen, px, py, radius, colour) {
	traceDisc(pen, px, py, radius);
	pen.fillStyle = colour;
	pen.fill();
	pen.lineWidth = 2.5;
	pen.strokeStyle = palette.halo;
	pen.stroke();
}

/** A number in a disc at a screen place. */
export function numberedDot(pen, px, py, text, colour) {
	haloedDot(pen, px, py, 10, colour);
	writeAt(pen, text, px, py + 0.5, palette.halo, "center", "600 12px");
}

/** Write words at a screen place, narrower where they would take more than `most` pixels. */
export function writeAt(pen, text, px, py, fillStyle, textAlign = "left", font = "12px", most = undefined) {
	Object.assign(pen, { fillStyle, textAlign, textBaseline: "middle", font: `${font} system-ui, sans-serif` });
	pen.fillText(text, px, py, most);
}
