// Small helpers for elements. Styles go through CSSOM only: the page's policy forbids style attributes.

/** The html element, which bears the page's state. */
export const root = document.documentElement;

/** The element of an id. */
export function byId(id) {
	return document.getElementById(id);
}

/** Put words into the element of an id. */
export function write(id, text) {
	byId(id).textContent = text;
}

/** Call a listener when something happens to the element of an id. */
export function hear(id, kind, listener) {
	byId(id).addEventListener(kind, listener);
}

/** A new element with properties, attributes (those with a dash, and role) and children. */
export function make(tag, properties = {}, ...children) {
	const element = document.createElement(tag);
	for (const [key, value] of Object.entries(properties)) {
		if (key.includes("-") || key === "role") element.setAttribute(key, value);
		else element[key] = value;
	}
	element.append(...children);
	return element;
}

/** Replace the options of a select; each choice is {value, label}. */
export function setOptions(select, choices, chosen) {
	const text = JSON.stringify(choices);
	if (select.dataset.choices !== text) {
		select.replaceChildren(...choices.map(({ value, label }) => make("option", { value, textContent: label })));
		select.dataset.choices = text;
	}
	if (chosen !== undefined && chosen !== null) select.value = chosen;
}

/** A canvas that fills its element at the screen's resolution; returns the pen, scaled to CSS pixels. */
export function fittedContext(canvas) {
	const ratio = Math.min(window.devicePixelRatio || 1, 2);
	const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
	const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
	if (canvas.width !== width || canvas.height !== height) {
		canvas.width = width;
		canvas.height = height;
	}
	const pen = canvas.getContext("2d");
	pen.setTransform(ratio, 0, 0, ratio, 0, 0);
	return pen;
}

/** What is remembered under a name, or null; storage may be forbidden. */
export function remembered(name) {
	try {
		return localStorage.getItem(`locplan-${name}`);
	} catch {
		return null;
	}
}

/** Remember a text under a name, where the browser allows it. */
export function remember(name, text) {
	try {
		localStorage.setItem(`locplan-${name}`, text);
	} catch {
		// A page that may not remember works all the same.
	}
}
