// The map's place on the screen: grid coordinates (columns to the right, rows downwards from the top) in pixels.
import { model } from "./store.js";

/** Pixels a cell, and the screen place of the map's top left corner. */
export const view = { scale: 1, x: 0, y: 0, width: 1, height: 1 };
const MOST = 80;

/** Grid place [column, row from the top] of a world point. */
export function gridOf(x, y) {
	const { resolution, origin, rows } = model.about.map;
	const [cos, sin] = [Math.cos(origin[2]), Math.sin(origin[2])];
	const [dx, dy] = [x - origin[0], y - origin[1]];
	return [(cos * dx + sin * dy) / resolution, rows - (cos * dy - sin * dx) / resolution];
}

/** World point of a grid place. */
function worldOf(column, down) {
	const { resolution, origin, rows } = model.about.map;
	const [cos, sin] = [Math.cos(origin[2]), Math.sin(origin[2])];
	const [along, up] = [column * resolution, (rows - down) * resolution];
	return [origin[0] + cos * along - sin * up, origin[1] + sin * along + cos * up];
}

/** Screen place of a world point. */
export function screenOf(x, y) {
	const [column, down] = gridOf(x, y);
	return [view.x + column * view.scale, view.y + down * view.scale];
}

/** World point under a screen place. */
export function worldAt(px, py) {
	return worldOf((px - view.x) / view.scale, (py - view.y) / view.scale);
}

/** The world point of a part of the map, or of all of it, that is nearest to a world point. */
export function withinMap([x, y], part) {
	const [left, top, cols, rows] = part ?? [0, 0, model.about.map.cols, model.about.map.rows];
	const [column, down] = gridOf(x, y);
	const near = [Math.min(Math.max(column, left + 0.5), left + cols - 0.5), Math.min(Math.max(down, top + 0.5), top + rows - 0.5)];
	return near[0] === column && near[1] === down ? [x, y] : worldOf(...near);
}

/** Angle on the screen (clockwise from the right) of a heading in the world. */
export function screenAngle(heading) {
	return model.about.map.origin[2] - heading;
}

/** Pixels a metre. */
export function perMetre() {
	return view.scale / model.about.map.resolution;
}

/** Move the map by pixels; some of it stays in sight. */
export function panBy(dx, dy) {
	const { rows, cols } = model.about.map;
	const keep = 60;
	view.x = Math.min(view.width - keep, Math.max(keep - cols * view.scale, view.x + dx));
	view.y = Math.min(view.height - keep, Math.max(keep - rows * view.scale, view.y + dy));
}

/** Zoom by a factor about a screen place. */
export function zoomAt(px, py, factor) {
	const { rows, cols } = model.about.map;
	const least = 0.4 * Math.min(view.width / cols, view.height / rows);
	const scale = Math.min(Math.max(view.scale * factor, Math.min(least, 1)), MOST);
	const change = scale / view.scale;
	view.x = px - (px - view.x) * change;
	view.y = py - (py - view.y) * change;
	view.scale = scale;
	panBy(0, 0);
}

/** Show a part of the map, or all of it, between insets {left, top, right, bottom} in pixels. */
export function fitMap(insets, part) {
	const [column, down, cols, rows] = part ?? [0, 0, model.about.map.cols, model.about.map.rows];
	const wide = Math.max(60, view.width - insets.left - insets.right);
	const high = Math.max(60, view.height - insets.top - insets.bottom);
	view.scale = Math.min(wide / cols, high / rows, MOST / 4);
	view.x = insets.left + (wide - cols * view.scale) / 2 - column * view.scale;
	view.y = insets.top + (high - rows * view.scale) / 2 - down * view.scale;
}

/** A length of 1, 2 or 5 times a power of ten that takes at most `most` pixels: {words, pixels}. */
export function scaleBar(most) {
	const room = most / perMetre();
	const power = 10 ** Math.floor(Math.log10(room));
	const length = power * [5, 2, 1].find((factor) => factor * power <= room);
	return { words: length < 1 ? `${Math.round(100 * length)} cm` : `${length} m`, pixels: length * perMetre() };
}
