// Where the page's data come from: the server, or the content of a shared page.
import { fetchBytes } from "./link.js";
import { shared } from "./state.js";

/** The map, and what the server can do. */
export async function fetchAbout() {
	return shared ? shared.about : JSON.parse(new TextDecoder().decode(await fetchBytes("about")));
}

/** Classes of the cells of a map. */
export function fetchCells(digest) {
	return shared ? inflate(shared.cells) : fetchBytes(`cells/${digest}`);
}

/** Steps of a layer on its lattice. */
export function fetchLayer(digest, name) {
	return shared ? inflate(shared.layers[name]) : fetchBytes(`layers/${digest}/${name}`);
}

/** Save a file that the server keeps. */
export function saveDownload(key) {
	const anchor = document.createElement("a");
	anchor.href = new URL(`download/${key}`, document.baseURI).href;
	anchor.download = "";
	anchor.click();
}

const inflated = new Map();
function inflate(text) {
	if (!inflated.has(text)) {
		const stream = new Blob([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))]).stream();
		inflated.set(text, new Response(stream.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer().then((buffer) => new Uint8Array(buffer)));
	}
	return inflated.get(text);
}
