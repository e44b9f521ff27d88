// The socket: one question of a kind under way and the newest waiting; progress, cancel, and coming back after a break.
import { byId, hear, make } from "./dom.js";
import { tell } from "./store.js";
import { complain, setStatus, toast } from "./say.js";

const WAITS = [0.3, 0.7, 1.5, 3, 5, 8, 12]; // seconds before the next try
const PATIENCE = 2000; // milliseconds after which the rate is believed
const lanes = new Map(); // kind -> {current, waiting}
const pending = new Map(); // id -> question
let socket = null;
let lastId = 0;
let tries = 0;
let timer = 0;
let lastBeat = 0;
let wasOpen = false;

/** Open the socket and keep it open. */
export function startLink() {
	hear("retry", "click", reopen);
	document.addEventListener("visibilitychange", () => document.hidden || wakeUp());
	lastBeat = Date.now();
	setInterval(wakeUp, 5000);
	openSocket();
}

/**
 * Ask the server. The promise ends with the answer, with null where a newer question of its kind took its place, and
 * with {cancelled: true} where it was cancelled.
 */
export function ask(kind, content = {}, onProgress = null) {
	return new Promise((resolve, reject) => {
		const question = { kind, content, resolve, reject, onProgress };
		const lane = laneOf(kind);
		if (lane.current) {
			lane.waiting?.resolve(null);
			lane.waiting = question;
		} else send(question);
	});
}

/**
 * Ask for long work anew: it is listed with its progress and a button that cancels it. `show` gets the answer, if there
 * is one; what went wrong is told, and also that it was cancelled, unless there are no words for that.
 */
export async function work(kind, title, content, show, cancelled = "Cancelled.") {
	cancel(kind);
	const stop = make("button", { className: "plain", textContent: "Cancel", "aria-label": `Cancel: ${title}` });
	stop.addEventListener("click", () => {
		stop.disabled = true;
		cancel(kind);
	});
	const row = taskRow(kind, title, stop);
	try {
		const answer = await ask(kind, content, (message) => showProgress(row, title, message));
		if (!answer?.cancelled) await (answer && show(answer));
		else if (cancelled) toast(cancelled);
	} catch (error) {
		complain(error);
	} finally {
		row.remove();
	}
}

/** Ask a short question; what went wrong is told. */
export async function tryAsking(kind, content, show) {
	try {
		const answer = await ask(kind, content);
		if (answer) await show?.(answer);
	} catch (error) {
		complain(error);
	}
}

/** Show work that the server does unasked, or take it away where `message` is null. */
export function showWork(kind, title, message) {
	const known = byId("tasks").querySelector(`[data-kind="${kind}"]`);
	if (!message) known?.remove();
	else showProgress(known ?? taskRow(kind, title), title, message);
}

function taskRow(kind, title, ...buttons) {
	const row = make("li", { className: "card" }, make("span", { textContent: title }), make("progress", { max: 1, "aria-label": title }), ...buttons);
	row.dataset.kind = kind;
	byId("tasks").append(row);
	return row;
}

function showProgress(row, title, { done, total, doing }) {
	if (total) row.querySelector("progress").value = done / total;
	const words = timeLeft(row, done, total) ?? doing;
	if (words) row.querySelector("span").textContent = `${title}: ${words}`;
}

// Time left in words by the rate since the first step, or null; another part of the work begins anew.
function timeLeft(row, done, total) {
	const now = performance.now();
	const { first, last } = row;
	row.last = { done, total };
	if (!first?.done || total !== last.total || done < last.done) row.first = { done, now };
	const left = ((total - done) * (now - row.first.now)) / (done - row.first.done) / 1000;
	if (now - row.first.now < PATIENCE || !(left >= 1)) return null;
	return left < 60 ? `${Math.round(left)} s left` : `${Math.round(left / 60)} min left`;
}

/** Cancel the question of a kind that is under way, and drop the one waiting. */
export function cancel(kind) {
	const lane = laneOf(kind);
	lane.waiting?.resolve({ cancelled: true });
	lane.waiting = null;
	interrupt(kind);
}

/** Cancel the question of a kind that is under way, if its content is such; the one waiting comes next. */
export function interrupt(kind, isSuch = () => true) {
	const { current } = laneOf(kind);
	if (!current || current.stopped || !isSuch(current.content)) return;
	current.stopped = true;
	transmit({ do: "cancel", id: ++lastId, of: current.id });
}

/** Whether the server can be asked now. */
export function isLinked() {
	return socket?.readyState === WebSocket.OPEN;
}

function laneOf(kind) {
	if (!lanes.has(kind)) lanes.set(kind, { current: null, waiting: null });
	return lanes.get(kind);
}

function send(question) {
	if (!isLinked()) {
		question.reject(new Error("The server is not connected: try again when it is back."));
		return;
	}
	question.id = ++lastId;
	laneOf(question.kind).current = question;
	pending.set(question.id, question);
	transmit({ do: question.kind, id: question.id, ...question.content });
}

function transmit(message) {
	if (isLinked()) socket.send(JSON.stringify(message));
}

function openSocket() {
	clearTimeout(timer);
	const address = new URL("socket", document.baseURI);
	address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
	socket = new WebSocket(address);
	socket.addEventListener("open", linked);
	socket.addEventListener("message", ({ data }) => receive(JSON.parse(data)));
	socket.addEventListener("close", lost);
}

function linked() {
	tries = 0;
	setStatus("loading", wasOpen ? "Connected again" : "");
	wasOpen = true;
}

function receive(message) {
	if (message.event) return tell(`event:${message.event}`, message);
	const isProgress = message.progress !== undefined;
	const question = pending.get(isProgress ? message.progress : message.re);
	if (!question) return undefined;
	if (isProgress) return question.onProgress?.(message);
	finish(question);
	if (message.stale) return question.resolve(null);
	return message.error ? question.reject(new Error(message.error)) : question.resolve(message);
}

function finish(question) {
	pending.delete(question.id);
	const lane = laneOf(question.kind);
	if (lane.current !== question) return;
	lane.current = null;
	const next = lane.waiting;
	lane.waiting = null;
	if (next) send(next);
}

function lost() {
	const open = [...pending.values(), ...[...lanes.values()].map((lane) => lane.waiting).filter(Boolean)];
	pending.clear();
	lanes.clear();
	for (const question of open) question.resolve(question.onProgress ? { cancelled: true, lost: true } : null);
	tell("lost");
	tryLater();
}

async function tryLater() {
	clearTimeout(timer);
	const wait = WAITS[Math.min(tries++, WAITS.length - 1)];
	setStatus("offline", "The server does not answer. Trying again …");
	timer = setTimeout(reopen, 1000 * wait);
	if (tries < 3) return;
	const refused = await fetch("about", { cache: "no-store" }).then((answer) => answer.status === 403, () => false);
	if (refused && !isLinked()) setStatus("offline", "The server was started anew: open the address that it printed.");
}

function reopen() {
	if (socket && socket.readyState < WebSocket.CLOSING) return;
	openSocket();
}

// A machine that slept leaves a socket that looks open: a long gap between beats gives it away.
function wakeUp() {
	const gap = Date.now() - lastBeat;
	lastBeat = Date.now();
	if (document.hidden) return;
	if (gap > 90_000 && isLinked()) socket.close();
	else if (socket?.readyState === WebSocket.CLOSED && gap > 20_000) reopen();
}
