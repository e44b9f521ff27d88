// Positions: between the world and the map's own axes, and along paths. Maps may be turned in the world.
import { about } from "./state.js";

/** Place [m] along the axes of the map, from its lower left corner, of a world position. */
export function toPlane([x, y]) {
	const [x0, y0, yaw] = about.value.map.origin;
	const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
	return [cos * (x - x0) + sin * (y - y0), cos * (y - y0) - sin * (x - x0)];
}

/** World position of a place of the map. */
export function toWorld([across, up]) {
	const [x0, y0, yaw] = about.value.map.origin;
	const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
	return [x0 + cos * across - sin * up, y0 + sin * across + cos * up];
}

/** Width and height of the map [m]. */
export function mapSize() {
	const { rows, cols, resolution } = about.value.map;
	return [cols * resolution, rows * resolution];
}

/** Distance between two positions. */
export function distance(a, b) {
	return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

/** Length of a polyline. */
export function lengthOf(xy) {
	return xy.reduce((sum, point, k) => (k ? sum + distance(xy[k - 1], point) : 0), 0);
}

/** Position after `s` metres of a polyline, or null past its end. */
export function pointAlong(xy, s) {
	let left = s;
	for (let k = 1; k < xy.length; k++) {
		const step = distance(xy[k - 1], xy[k]);
		if (left <= step + 1e-6) return [0, 1].map((axis) => xy[k - 1][axis] + (xy[k][axis] - xy[k - 1][axis]) * (step ? Math.min(1, left / step) : 0));
		left -= step;
	}
	return null;
}

/** The place of a polyline nearest to a position: {s, distance}. */
export function nearestAlong(xy, [x, y]) {
	let [best, s] = [{ s: 0, distance: Infinity }, 0];
	for (let k = 1; k < xy.length; k++) {
		const [[ax, ay], [bx, by]] = [xy[k - 1], xy[k]];
		const step = distance(xy[k - 1], xy[k]);
		const part = step ? Math.min(1, Math.max(0, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / step ** 2)) : 0;
		const apart = Math.hypot(x - ax - part * (bx - ax), y - ay - part * (by - ay));
		if (apart < best.distance) best = { s: s + part * step, distance: apart };
		s += step;
	}
	return best;
}

/** Width and height of a polygon along the axes of the map [m]. */
export function boxSize(polygon) {
	const plane = polygon.map(toPlane);
	return [0, 1].map((axis) => Math.max(...plane.map((at) => at[axis])) - Math.min(...plane.map((at) => at[axis])));
}
