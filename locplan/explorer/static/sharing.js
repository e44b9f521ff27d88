// Taking results away: the command, the Python, a picture, a shareable page, costmaps for Nav2.
import { byId, setOptions } from "./dom.js";
import { mapName, saveAddress, saveDownload } from "./data.js";
import { barTicks, drawBase } from "./layers.js";
import { ask, askLong } from "./link.js";
import { drawOverlay } from "./overlay.js";
import { rampColour } from "./ramps.js";
import { routeAsked } from "./route.js";
import { announce, complain, toast } from "./say.js";
import { model } from "./store.js";
import { numberedDot } from "./strokes.js";
import { shownLayer } from "./texture.js";
import { metres } from "./text.js";
import { palette } from "./theme.js";
import { scaleBar, screenOf, view } from "./view.js";

const FOOT = 92; // pixels of the legend under the picture

/** Connect the buttons. */
export function startSharing() {
  const { can = {}, distros = [] } = model.about;
  byId("copy-shell").addEventListener("click", () => copyText("shell", "Command"));
  byId("copy-python").addEventListener("click", () => copyText("python", "Python"));
  byId("picture").addEventListener("click", savePicture);
  byId("share").addEventListener("click", sharePage);
  byId("export").addEventListener("click", exportCostmap);
  setOptions(byId("distro"), distros.map((distro) => ({ value: distro, label: distro })), distros.includes("jazzy") ? "jazzy" : undefined);
  byId("export-row").hidden = !can.export;
  byId("save").hidden = !can.save;
  byId("export-note").textContent = can.export ? "" : "To export files for Nav2 or save maps, start locplan explore with a folder to write to.";
}

async function copyText(kind, title) {
  try {
    const answer = await ask("reproduce", routeAsked());
    if (!answer) return;
    document.documentElement.dataset.copied = answer[kind];
    try {
      await navigator.clipboard.writeText(answer[kind]);
      toast(`${title} copied.`);
      announce(`${title} copied.`);
    } catch {
      showText(title, answer[kind]);
    }
  } catch (error) {
    complain(error);
  }
}

// Where the browser forbids the clipboard, the text is shown selected.
function showText(title, text) {
  byId("text-title").textContent = title;
  byId("text-area").value = text;
  byId("text-box").showModal();
  byId("text-area").select();
}

async function sharePage() {
  const { start, goal, via, weight } = routeAsked();
  const look = { layer: model.layer, ramp: model.ramp, stretch: model.stretch, opacity: model.opacity, theme: palette.theme, start, goal, via, weight };
  try {
    const answer = await askLong("share", "Making a page to share", { view: look });
    if (!answer || answer.cancelled) return;
    saveDownload(answer.download);
    toast("The page is being downloaded.");
  } catch (error) {
    complain(error);
  }
}

async function exportCostmap() {
  try {
    const answer = await askLong("export", "Exporting for Nav2", { to: byId("export-to").value, distro: byId("distro").value, ...routeAsked() });
    if (!answer || answer.cancelled) return;
    byId("export-note").textContent = `${answer.files.length === 1 ? answer.files[0] + " is" : `${answer.files.length} files are`} in ${answer.folder}.`;
    toast(byId("export-note").textContent);
  } catch (error) {
    complain(error);
  }
}

function savePicture() {
  const ratio = 2;
  const canvas = document.createElement("canvas");
  canvas.width = view.width * ratio;
  canvas.height = (view.height + FOOT) * ratio;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.save();
  context.beginPath();
  context.rect(0, 0, view.width, view.height);
  context.clip();
  drawBase(context, ratio);
  drawOverlay(context, true);
  drawPins(context);
  context.restore();
  drawLegend(context);
  canvas.toBlob((blob) => {
    const address = URL.createObjectURL(blob);
    saveAddress(address, `${mapName()}.png`);
    setTimeout(() => URL.revokeObjectURL(address), 30000);
    toast("The picture is being saved.");
  }, "image/png");
}

function drawPins(context) {
  if (!model.start) return;
  model.via.forEach((via, k) => numberedDot(context, ...screenOf(...via), String(k + 1), palette.via));
  numberedDot(context, ...screenOf(...model.start), "A", palette.teal);
  numberedDot(context, ...screenOf(...model.goal), "B", palette.goal);
}

function drawLegend(context) {
  const top = view.height;
  context.fillStyle = palette.halo;
  context.fillRect(0, top, view.width, FOOT);
  context.fillStyle = palette.ink;
  context.textBaseline = "middle";
  drawScale(context, 20, top + 34);
  drawKeys(context, 190, top + 26);
  if (model.state.field) drawBar(context, Math.max(view.width - 300, 200), top + 26, Math.min(280, view.width - 220));
  context.font = "12px system-ui, sans-serif";
  context.fillStyle = palette.quiet;
  context.textAlign = "left";
  context.fillText(`${mapName()}   ${byId("field-note").textContent}   locplan ${model.about.version}`, 20, top + FOOT - 14);
}

function drawScale(context, x, y) {
  const bar = scaleBar(130);
  context.fillRect(x, y, bar.pixels, 2);
  context.fillRect(x, y - 6, 2, 8);
  context.fillRect(x + bar.pixels - 2, y - 6, 2, 8);
  context.font = "13px system-ui, sans-serif";
  context.textAlign = "left";
  context.fillText(bar.metres < 1 ? `${Math.round(100 * bar.metres)} cm` : metres(bar.metres, 0), x, y - 16);
}

function drawKeys(context, x, y) {
  const { aware, shortest } = model.plan ?? {};
  const rows = [["aware", aware, palette.teal, []], ["shortest", shortest, palette.ink, [8, 5]]].filter(([, path]) => path);
  rows.forEach(([name, path, colour, dash], k) => {
    context.beginPath();
    context.moveTo(x, y + 20 * k);
    context.lineTo(x + 34, y + 20 * k);
    context.setLineDash(dash);
    context.lineWidth = 3.5;
    context.strokeStyle = colour;
    context.stroke();
    context.setLineDash([]);
    context.textAlign = "left";
    context.fillStyle = palette.ink;
    context.fillText(`${name}: ${metres(path.length)}, ${metres(path.degenerate)} degenerate`, x + 44, y + 20 * k);
  });
}

function drawBar(context, x, y, width) {
  const layer = shownLayer();
  for (let k = 0; k < width; k++) {
    context.fillStyle = `rgb(${rampColour(model.ramp, palette.theme, k / (width - 1)).join(" ")})`;
    context.fillRect(x + k, y, 1.5, 10);
  }
  context.fillStyle = palette.ink;
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "left";
  context.fillText(`${layer.title}${layer.unit && layer.unit !== "1" ? ` [${layer.unit}]` : ""}`, x, y - 10);
  context.textAlign = "center";
  for (const { share, text } of barTicks(5)) context.fillText(text, x + share * width, y + 20);
}
