// Builds dist/ out of src/: one page.js and one page.css, with the licences of the libraries in them.
import { createHash } from "node:crypto";
import { copyFileSync, existsSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

process.chdir(import.meta.dirname);

const { metafile } = await build({
	entryPoints: { page: "src/main.js" },
	bundle: true,
	minify: true,
	format: "iife",
	target: "es2022",
	outdir: "dist",
	metafile: true,
	legalComments: "none",
	banner: { js: banner(sourceDigest()) },
});
const libraries = [...new Set(Object.keys(metafile.inputs).map(libraryOf).filter(Boolean))].sort();
writeFileSync("dist/page.js", readFileSync("dist/page.js", "utf8").trimEnd() + `\n/*!\n${libraries.map(licence).join("\n\n")}\n*/\n`);
for (const file of ["index.html", "icon.svg"]) copyFileSync(file, `dist/${file}`);

// The digest of all sources, as tests/app/test_explorer_build.py computes it.
function sourceDigest() {
	const files = ["build.mjs", "icon.svg", "index.html", "package-lock.json", "package.json", ...readdirSync("src").map((name) => `src/${name}`)];
	const hash = createHash("sha256");
	for (const file of files.sort()) hash.update(`${file}\n`).update(readFileSync(file)).update("\n");
	return hash.digest("hex");
}

function banner(digest) {
	return `/* Built by build.mjs from sources with the digest ${digest} */`;
}

function libraryOf(input) {
	return input.match(/^node_modules\/((?:@[^/]+\/)?[^/]+)\//)?.[1];
}

function licence(library) {
	const { version, license } = JSON.parse(readFileSync(`node_modules/${library}/package.json`));
	const file = ["LICENSE", "LICENSE.md", "LICENSE.txt"].map((name) => `node_modules/${library}/${name}`).find(existsSync);
	const text = license === "Apache-2.0" || !file ? `Licence: ${license}` : readFileSync(file, "utf8").trim();
	return `${library} ${version}\n${text}`.replaceAll("*/", "* /");
}
