// The socket: of each kind one question is under way and the newest waits; the connection comes back after a break.
import { complain, job, link, say } from "./state.js";

const PAUSES = [0.3, 0.7, 1.5, 3, 5, 8, 12]; // seconds before the next try
const lanes = new Map(); // kind -> {current, waiting}
const pending = new Map(); // id -> question
let socket = null;
let lastId = 0;
let tries = 0;
let handlers = {};

/** Open the socket and keep it open; `listeners` take events by name. */
export function startLink(listeners) {
	handlers = listeners;
	openSocket();
	document.addEventListener("visibilitychange", () => document.hidden || isLinked() || openSocket());
}

/** Whether the server can be asked now. */
export function isLinked() {
	return socket?.readyState === WebSocket.OPEN;
}

/** Ask the server; the promise ends with the answer, or with null if a newer question took its place. */
export function ask(kind, content = {}, onProgress = null) {
	return new Promise((resolve, reject) => {
		const question = { kind, content, resolve, reject, onProgress };
		const lane = laneOf(kind);
		if (!lane.current || kind === "change") send(question); // no change is skipped
		else {
			lane.waiting?.resolve(null);
			lane.waiting = question;
		}
	});
}

/** Ask a question that takes long: it shows its progress and can be cancelled. */
export async function work(kind, content, show) {
	if (job.value) return;
	job.value = { kind, done: 0, total: 0 };
	try {
		const answer = await ask(kind, content, ({ done, total }) => (job.value = { kind, done, total }));
		if (answer?.cancelled) say("Cancelled.");
		else if (answer) show(answer);
	} catch (error) {
		complain(error);
	}
	job.value = null;
}

/** Cancel the question of a kind that is under way. */
export function cancel(kind) {
	const { current } = laneOf(kind);
	if (current) transmit({ do: "cancel", id: ++lastId, of: current.id });
}

/** Bytes of an address of the server, or null if a newer state is on its way. */
export async function fetchBytes(address) {
	const answer = await fetch(address);
	if (!answer.ok) throw new Error(`The server answered ${answer.status} for ${address}.`);
	if (answer.status === 204) return null;
	return new Uint8Array(await answer.arrayBuffer());
}

function laneOf(kind) {
	if (!lanes.has(kind)) lanes.set(kind, { current: null, waiting: null });
	return lanes.get(kind);
}

function send(question) {
	if (!isLinked()) return question.reject(new Error("The server does not answer. Try again when it is back."));
	question.id = ++lastId;
	laneOf(question.kind).current = question;
	pending.set(question.id, question);
	return transmit({ do: question.kind, id: question.id, ...question.content });
}

function transmit(message) {
	if (isLinked()) socket.send(JSON.stringify(message));
}

function openSocket() {
	if (socket && socket.readyState < WebSocket.CLOSING) return;
	const address = new URL("socket", document.baseURI);
	address.protocol = address.protocol.replace("http", "ws");
	socket = new WebSocket(address);
	socket.addEventListener("open", () => (tries = 0));
	socket.addEventListener("message", ({ data }) => receive(JSON.parse(data)));
	socket.addEventListener("close", lose);
}

function receive(message) {
	if (message.event) return handlers[message.event]?.(message);
	const question = pending.get(message.progress ?? message.re);
	if (!question) return undefined;
	if (message.progress !== undefined) return question.onProgress?.(message);
	pending.delete(question.id);
	const lane = laneOf(question.kind);
	if (lane.current === question) {
		lane.current = null;
		const next = lane.waiting;
		lane.waiting = null;
		if (next) send(next);
	}
	if (message.stale) return question.resolve(null);
	return message.error ? question.reject(new Error(message.error)) : question.resolve(message);
}

function lose() {
	link.value = "offline";
	for (const question of pending.values()) question.reject(new Error("The connection to the server was lost."));
	for (const { waiting } of lanes.values()) waiting?.resolve(null);
	pending.clear();
	lanes.clear();
	setTimeout(openSocket, 1000 * PAUSES[Math.min(tries++, PAUSES.length - 1)]);
}
