// Recorded drives over the field: a track whose scans are matched with the map, a time slider, play and pause.
import { byId, hear, make, setOptions, write } from "./dom.js";
import { fetchLayer } from "./data.js";
import { keepMoving, repaint } from "./frames.js";
import { stepAt } from "./lines.js";
import { ask, cancel, work } from "./link.js";
import { colourSpan, rampColour, rampGradient, shareOf } from "./ramps.js";
import { announce, complain } from "./say.js";
import { model, on } from "./store.js";
import { haloedDot, haloedPath, traceDisc, writeAt } from "./strokes.js";
import { latticeValue, shownLayer, textureAt } from "./texture.js";
import { centimetres, clock, layerValue } from "./text.js";
import { palette } from "./theme.js";
import { gridOf, screenAngle, screenOf } from "./view.js";

const ANYWHERE = { name: "sigma", scale: "log", anchors: [0.02, 1] }; // the scale of deviations [m] without a field
const APART = 9; // pixels between the dots of a track, at least
let field = { digest: null, bytes: null }; // the field's position deviation, to be compared with

/** List the drives. */
export function startDrives() {
	const drives = model.about.drives ?? [];
	byId("drives-group").hidden = !drives.length || model.shared;
	setOptions(byId("drive"), [{ value: "", label: "none" }, ...drives.map((drive, k) => ({ value: k, label: `${drive.name} (${drive.duration === null ? `${drive.scans} scans` : clock(drive.duration)})` }))]);
	hear("drive", "change", chooseDrive);
	hear("play", "click", togglePlay);
	hear("drive-time", "input", () => setTime(byId("drive-time").valueAsNumber));
	hear("drive-match", "click", matchDrive);
	for (const id of ["ramp", "stretch"]) hear(id, "change", showScale);
	for (const topic of ["state", "theme"]) on(topic, followField);
}

/** Play or pause the drive that is shown. */
export function togglePlay() {
	const drive = model.drive;
	if (!drive) return;
	if (drive.plays) return pause();
	if (drive.time >= drive.t.at(-1)) drive.time = drive.t[0];
	drive.plays = true;
	drive.seen = null;
	byId("play").setAttribute("aria-label", "Pause");
	keepMoving((now) => playOn(drive, now));
}

/** Draw the track, what is unlike the map, and the robot. */
export function paintDrive(pen) {
	const drive = model.drive;
	if (!drive) return;
	const upTo = stepAt(drive.time, drive.t);
	haloedPath(pen, drive.xy, { colour: palette.drive, width: 1.5, dash: [2, 4] });
	haloedPath(pen, drive.xy.slice(0, upTo + 1), { colour: palette.drive, width: 3 });
	paintDeviations(pen, drive);
	if (drive.believed) paintBelief(pen, drive, drive.believed[upTo], drive.sees[upTo]);
	for (let k = 0; k <= upTo; k++) if (drive.unlike?.[k]) writeAt(pen, "×", ...screenOf(...drive.xy[k]), palette.mark, "center", "700 18px");
	drawRobot(pen, drive.xy[upTo], drive.heading[upTo], palette.drive);
}

// Where the robot believes to be, and the scan, put there.
function paintBelief(pen, drive, [x, y, heading], scan) {
	const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
	for (const [ahead, left] of scan) haloedDot(pen, ...screenOf(x + cos * ahead - sin * left, y + sin * ahead + cos * left), 2, palette.mark);
	drawRobot(pen, [x, y], heading, palette.mark);
}

// Dots in the colours of the field's deviation.
function paintDeviations(pen, { sd, xy }) {
	const layer = deviationLayer();
	const span = colourSpan(layer, model.stretch);
	let [x, y] = [-Infinity, 0];
	xy.forEach((place, k) => {
		if (!Number.isFinite(sd[k])) return;
		const [px, py] = screenOf(...place);
		if (Math.hypot(px - x, py - y) < APART) return;
		[x, y] = [px, py];
		for (const [radius, colour] of [[4.5, palette.drive], [3.2, `rgb(${rampColour(model.ramp, palette.theme, shareOf(layer, sd[k], span)).join(" ")})`]]) {
			traceDisc(pen, px, py, radius);
			pen.fillStyle = colour;
			pen.fill();
		}
	});
}

function drawRobot(pen, place, heading, colour) {
	const [px, py] = screenOf(...place);
	const angle = screenAngle(heading);
	pen.beginPath();
	pen.moveTo(px + 20 * Math.cos(angle), py + 20 * Math.sin(angle));
	pen.lineTo(px + 9 * Math.cos(angle + 2), py + 9 * Math.sin(angle + 2));
	pen.lineTo(px + 9 * Math.cos(angle - 2), py + 9 * Math.sin(angle - 2));
	pen.closePath();
	pen.fillStyle = colour;
	pen.fill();
	haloedDot(pen, px, py, 7, colour);
}

async function chooseDrive() {
	pause();
	cancel("match");
	model.drive = null;
	showScale();
	const number = byId("drive").value;
	byId("drives-group").querySelector(".player").hidden = number === "";
	write("drive-note", "");
	repaint("overlay");
	if (number === "") return;
	try {
		const found = await ask("drive", { drive: Number(number) });
		if (!found || byId("drive").value !== number) return;
		begin(found);
		followField();
		matchDrive();
	} catch (error) {
		complain(error);
	}
}

/** Show a drive that was steered by the filter: the robot, what it believes, and what it sees. */
export function showSteered(found) {
	pause();
	cancel("match");
	byId("drive").value = "";
	Object.assign(byId("drives-group"), { hidden: false, open: true });
	byId("drives-group").querySelector(".player").hidden = false;
	begin({ ...found, sd: [] });
	showScale();
	togglePlay();
}

function begin(found) {
	model.drive = { ...found, timed: found.timed !== false, xy: found.x.map((x, k) => [x, found.y[k]]), time: found.t[0], plays: false };
	const slider = byId("drive-time");
	[slider.min, slider.max] = [found.t[0], found.t.at(-1)];
	setTime(found.t[0]);
}

function setTime(time) {
	const drive = model.drive;
	if (!drive) return;
	drive.time = time;
	const k = stepAt(time, drive.t);
	byId("drive-time").value = time;
	const unlike = drive.unlike?.[k] ? "; the scan is unlike the map" : "";
	const when = drive.timed ? `${clock(time - drive.t[0])} of ${clock(drive.t.at(-1) - drive.t[0])}` : `scan ${k + 1} of ${drive.t.length}`;
	byId("drive-time").setAttribute("aria-valuetext", when);
	const count = drive.unlike?.filter(Boolean).length;
	write("drive-note", `${drive.what ? `${drive.what}. ` : ""}${[when, wordsAt(drive, k)].filter(Boolean).join(": ")}${unlike}.${count ? ` ${count} of ${drive.t.length} scans are unlike the map (crosses).` : ""}`);
	repaint("overlay");
}

// What the layer shown, the scan and the field say at a pose.
function wordsAt(drive, k) {
	const layer = shownLayer();
	const value = layer && layer.name !== "sigma" ? textureAt(...gridOf(...drive.xy[k])) : null;
	const said = fieldAt(drive.xy[k]);
	const words = value === null ? [] : [`${layer.title.toLowerCase()} ${layerValue(layer, value)}`];
	if (Number.isFinite(drive.sd[k])) words.push(`position deviation measured ${centimetres(100 * drive.sd[k])}`);
	else if (drive.believed) words.push(`believes to be ${centimetres(100 * Math.hypot(drive.believed[k][0] - drive.xy[k][0], drive.believed[k][1] - drive.xy[k][1]))} away`);
	else if (drive.matched) words.push("too few returns to measure the deviation");
	if (said !== null) words.push(`field says ${centimetres(100 * said)}`);
	return words.join(", ");
}

function deviationLayer() {
	return model.state?.layers.find((layer) => layer.name === "sigma") ?? ANYWHERE;
}

function fieldAt(place) {
	return field.bytes && model.state.lattice ? latticeValue(field.bytes, deviationLayer(), ...gridOf(...place)) : null;
}

// The field or the map has changed: other values are compared with.
async function followField() {
	if (!model.drive) return;
	const digest = model.state.field?.digest ?? null;
	if (digest !== field.digest) {
		field = { digest, bytes: null };
		const bytes = digest && (await fetchLayer(digest, "sigma").catch(() => null)); // null: a newer state is on its way
		if (digest !== field.digest) return;
		field = { digest: bytes && digest, bytes }; // what failed is fetched again
	}
	showScale();
	setTime(model.drive?.time);
}

// Matching begins by itself, in the background; by the button only after it was cancelled, or the map edited.
async function matchDrive() {
	const drive = model.drive;
	drive.matching = true;
	showScale();
	await work("match", "Matching the drive's scans", { drive: Number(byId("drive").value) }, (answer) => Object.assign(drive, answer, { matched: answer.map }), "");
	drive.matching = false;
	if (model.drive !== drive) return;
	showScale();
	setTime(drive.time);
	if (drive.matched) announce(byId("drive-scale").textContent);
}

// The colours of the dots, and the medians of what was measured and of what the field says there.
function showScale() {
	const drive = model.drive;
	const isOld = drive?.matched && drive.matched !== model.state.map.digest;
	byId("drive-match").hidden = !drive || drive.believed || drive.matching || Boolean(drive.matched && !isOld);
	byId("drive-scale").hidden = !drive?.matched;
	if (!drive?.matched) return;
	const layer = deviationLayer();
	const [low, high] = colourSpan(layer, model.stretch).map((each) => centimetres(100 * each));
	const colours = make("i");
	colours.style.background = rampGradient(model.ramp, palette.theme);
	const both = drive.xy.map((place, k) => [drive.sd[k], fieldAt(place)]).filter(([measured]) => Number.isFinite(measured));
	const said = both.map((pair) => pair[1]).filter((value) => value !== null);
	const medians = both.length ? ` Median measured ${centimetres(100 * median(both.map((pair) => pair[0])))}${said.length ? `, of the field ${centimetres(100 * median(said))}` : ""}.` : " No scan has enough returns.";
	byId("drive-scale").replaceChildren("Dots: measured deviation, from ", make("span", {}, low, " ", colours, ` to ${high}.`), `${medians}${isOld ? " The map was edited since." : ""}`);
	repaint("overlay");
}

function median(values) {
	const sorted = [...values].sort((one, other) => one - other);
	return (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2;
}

function playOn(drive, now) {
	if (!drive.plays || model.drive !== drive) return false;
	if (drive.seen !== null) setTime(Math.min(drive.t.at(-1), drive.time + ((now - drive.seen) / 1000) * parseFloat(byId("drive-speed").value)));
	drive.seen = now;
	if (drive.time < drive.t.at(-1)) return true;
	pause();
	return false;
}

function pause() {
	if (model.drive) model.drive.plays = false;
	byId("play").setAttribute("aria-label", "Play");
}
