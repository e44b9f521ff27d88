// Geometry of paths: lengths, places along them, the place nearest to a point.

const lengths = new WeakMap();

// Length of a path from its start to each of its points [m].
function alongPath(xy) {
	let found = lengths.get(xy);
	if (!found) {
		found = [0];
		for (let k = 1; k < xy.length; k++) found.push(found[k - 1] + Math.hypot(xy[k][0] - xy[k - 1][0], xy[k][1] - xy[k - 1][1]));
		lengths.set(xy, found);
	}
	return found;
}

/** Point of a path after `s` metres, or null past its end. */
export function pointAlong(xy, s) {
	const along = alongPath(xy);
	if (!xy.length || s < 0 || s > along.at(-1) + 1e-6) return null;
	let k = 1;
	while (k < along.length - 1 && along[k] < s) k++;
	if (along.length < 2) return xy[0];
	const part = Math.min(1, (s - along[k - 1]) / Math.max(along[k] - along[k - 1], 1e-12));
	return [0, 1].map((axis) => xy[k - 1][axis] + part * (xy[k][axis] - xy[k - 1][axis]));
}

/** The nearest place of a path to a point: {s, distance, point}. */
export function nearestAlong(xy, [x, y]) {
	const along = alongPath(xy);
	let best = { s: 0, distance: Infinity, point: xy[0] };
	for (let k = 1; k < xy.length; k++) {
		const [ax, ay] = xy[k - 1];
		const [dx, dy] = [xy[k][0] - ax, xy[k][1] - ay];
		const square = dx * dx + dy * dy;
		const part = square ? Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / square)) : 0;
		const point = [ax + part * dx, ay + part * dy];
		const distance = Math.hypot(x - point[0], y - point[1]);
		if (distance < best.distance) best = { s: along[k - 1] + part * (along[k] - along[k - 1]), distance, point };
	}
	return best;
}

/** Index of the first of some rising numbers that is at least `s`, or the last. */
export function stepAt(s, steps) {
	let low = 0;
	let high = steps.length - 1;
	while (low < high) {
		const middle = (low + high) >> 1;
		if (steps[middle] < s) low = middle + 1;
		else high = middle;
	}
	return low;
}
