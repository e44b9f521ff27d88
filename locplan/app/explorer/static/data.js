// Where the page's numbers come from: the server, or what a shareable page carries.
import { model } from "./store.js";

/** Whether this is a page that was shared: read-only, without a server. */
export function carried() {
	return window.LOCPLAN ?? null;
}

/** What the map and the program are. */
export async function fetchAbout() {
	return carried() ? carried().about : (await got("about")).json();
}

/** Classes of the map's cells. */
export async function fetchCells(digest) {
	return carried() ? inflated(carried().cells) : bytesOf(`data/cells/${digest}`);
}

/** Bytes of a layer on the lattice. */
export async function fetchLayer(digest, name) {
	if (carried()) return inflated(carried().layers[name]);
	return bytesOf(`data/layer/${digest}/${name}`);
}

/** Save a file that the server made. */
export function saveDownload(id) {
	saveAddress(new URL(`download/${id}`, document.baseURI).href, "");
}

/** Save what an address holds under a file name. */
export function saveAddress(href, name) {
	const link = document.createElement("a");
	link.href = href;
	link.download = name;
	link.click();
}

/** Name of the map without a folder or an ending. */
export function mapName() {
	return String(model.about?.map.name ?? "map").replace(/^.*[\\/]/, "").replace(/\.ya?ml$/, "");
}

async function got(address) {
	const answer = await fetch(address);
	if (!answer.ok) throw Object.assign(new Error(`The server answered ${answer.status} for ${address}.`), { status: answer.status });
	return answer;
}

async function bytesOf(address) {
	return new Uint8Array(await (await got(address)).arrayBuffer());
}

async function inflated(text) {
	const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
	const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
	return new Uint8Array(await new Response(stream).arrayBuffer());
}
