// One requestAnimationFrame for the whole page: parts say that they are stale, and are painted once a frame.

const painters = new Map();
const stale = new Set();
const moving = new Set();
const afterwards = [];
let asked = 0;

/** Name a part and the function that paints it; parts are painted in the order in which they were named. */
export function paints(part, painter) {
	painters.set(part, painter);
}

/** Mark parts as stale. */
export function repaint(...parts) {
	for (const part of parts) stale.add(part);
	askFrame();
}

/** Call `step(milliseconds)` before each frame until it returns false. */
export function keepMoving(step) {
	moving.add(step);
	askFrame();
}

/** Call `done` once, after the next frame was painted. */
export function afterPaint(done) {
	afterwards.push(done);
	askFrame();
}

function askFrame() {
	if (!asked) asked = requestAnimationFrame(paintFrame);
}

function paintFrame(now) {
	asked = 0;
	for (const step of [...moving]) if (step(now) === false) moving.delete(step);
	for (const [part, painter] of painters) if (stale.delete(part)) painter(now);
	for (const done of afterwards.splice(0)) done();
	if (moving.size) askFrame();
}
