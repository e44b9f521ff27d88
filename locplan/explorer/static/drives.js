// Recorded drives over the field: a track coloured by the filter's deviation, a time slider, play and pause.
import { byId, hear, setOptions, write } from "./dom.js";
import { fetchDrive } from "./data.js";
import { keepMoving, repaint } from "./frames.js";
import { stepAt } from "./lines.js";
import { complain } from "./say.js";
import { model } from "./store.js";
import { haloedDot, haloedPath, writeAt } from "./strokes.js";
import { shownLayer, textureAt } from "./texture.js";
import { clock, layerValue, metres } from "./text.js";
import { palette } from "./theme.js";
import { gridOf, screenAngle, screenOf } from "./view.js";

/** List the drives. */
export function startDrives() {
	const drives = model.about.drives ?? [];
	byId("drives-group").hidden = !drives.length || model.shared;
	setOptions(byId("drive"), [{ value: "", label: "none" }, ...drives.map((drive, k) => ({ value: k, label: `${drive.name} (${clock(drive.duration)})` }))]);
	hear("drive", "change", chooseDrive);
	hear("play", "click", togglePlay);
	hear("drive-time", "input", () => setTime(byId("drive-time").valueAsNumber));
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
	for (let k = 0; k <= upTo; k++) if (drive.unlike?.[k]) writeAt(pen, "×", ...screenOf(...drive.xy[k]), palette.mark, "center", "700 18px");
	drawRobot(pen, drive, upTo);
}

function drawRobot(pen, drive, k) {
	const [px, py] = screenOf(...drive.xy[k]);
	const angle = screenAngle(drive.heading[k]);
	pen.beginPath();
	pen.moveTo(px + 20 * Math.cos(angle), py + 20 * Math.sin(angle));
	pen.lineTo(px + 9 * Math.cos(angle + 2), py + 9 * Math.sin(angle + 2));
	pen.lineTo(px + 9 * Math.cos(angle - 2), py + 9 * Math.sin(angle - 2));
	pen.closePath();
	pen.fillStyle = palette.drive;
	pen.fill();
	haloedDot(pen, px, py, 7, palette.drive);
}

async function chooseDrive() {
	pause();
	model.drive = null;
	const number = byId("drive").value;
	byId("drives-group").querySelector(".player").hidden = number === "";
	write("drive-note", "");
	repaint("overlay");
	if (number === "") return;
	try {
		const found = await fetchDrive(number);
		if (byId("drive").value !== number) return;
		model.drive = { ...found, timed: found.timed !== false, xy: found.x.map((x, k) => [x, found.y[k]]), time: found.t[0], plays: false };
		const slider = byId("drive-time");
		[slider.min, slider.max] = [found.t[0], found.t.at(-1)];
		setTime(found.t[0]);
	} catch (error) {
		complain(error);
	}
}

function setTime(time) {
	const drive = model.drive;
	if (!drive) return;
	drive.time = time;
	const k = stepAt(time, drive.t);
	byId("drive-time").value = time;
	const deviation = drive.sd?.[k];
	const layer = shownLayer();
	const value = layer && textureAt(...gridOf(...drive.xy[k]));
	const here = value === null ? "" : `: ${layer.title.toLowerCase()} ${layerValue(layer, value)}`;
	const unlike = drive.unlike?.[k] ? "; the scan is unlike the map" : "";
	const when = drive.timed ? `${clock(time - drive.t[0])} of ${clock(drive.t.at(-1) - drive.t[0])}` : `scan ${k + 1} of ${drive.t.length}`;
	byId("drive-time").setAttribute("aria-valuetext", when);
	const count = drive.unlike?.filter(Boolean).length;
	write("drive-note", `${when}${here}${Number.isFinite(deviation) ? `, matched with a deviation of ${metres(deviation, 2)}` : ""}${unlike}.${count ? ` ${count} of ${drive.t.length} scans are unlike the map (crosses).` : ""}`);
	repaint("overlay");
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
