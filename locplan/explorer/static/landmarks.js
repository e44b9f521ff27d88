// Landmarks proposed for the route: numbered ghosts until they are accepted or dismissed.
import { byId } from "./dom.js";
import { drawStroke, sendStrokes } from "./editing.js";
import { repaint } from "./frames.js";
import { askLong, cancel } from "./link.js";
import { routeAsked } from "./route.js";
import { announce, complain, toast } from "./say.js";
import { model } from "./store.js";
import { numberedDot } from "./strokes.js";
import { palette } from "./theme.js";
import { screenOf } from "./view.js";

/** Connect the buttons. */
export function startLandmarks() {
  byId("landmarks-find").addEventListener("click", proposeLandmarks);
  byId("landmarks-accept").addEventListener("click", acceptLandmarks);
  byId("landmarks-drop").addEventListener("click", () => dropLandmarks(""));
}

/** Draw the ghosts. */
export function paintLandmarks(context) {
  model.landmarks?.strokes.forEach((stroke, k) => {
    drawStroke(context, stroke, 0.75);
    const [px, py] = screenOf(...stroke.points[0]);
    context.beginPath();
    context.arc(px, py, 9, 0, 2 * Math.PI);
    context.setLineDash([3, 3]);
    context.lineWidth = 2;
    context.strokeStyle = palette.ghost;
    context.stroke();
    context.setLineDash([]);
    numberedDot(context, px + 15, py - 15, String(k + 1), palette.ghost);
  });
}

/** Take the ghosts away. */
export function dropLandmarks(text) {
  model.landmarks = null;
  byId("landmarks-take").hidden = true;
  byId("landmarks-verdict").textContent = text;
  repaint("overlay");
}

async function proposeLandmarks() {
  cancel("landmarks");
  const { start, goal, via, weight } = routeAsked();
  const object = byId("object").value;
  const count = Math.min(20, Math.max(1, Math.round(byId("landmark-count").valueAsNumber || 3)));
  try {
    const answer = await askLong("landmarks", "Looking for places of landmarks", { start, goal, via, weight, object, count });
    if (answer?.cancelled) toast("Search for landmarks cancelled.");
    else if (answer) showLandmarks(answer, object);
  } catch (error) {
    complain(error);
  }
}

function showLandmarks(answer, object) {
  const tool = answer.tool ?? object.split(":")[0];
  const size = answer.size ?? object.split(":")[1].split("x").map(Number);
  const width = tool === "pole" || size.length < 2 ? size[0] : size;
  model.landmarks = { ...answer, strokes: answer.poses.map(([x, y, heading]) => ({ tool, points: [[x, y]], width, heading })) };
  byId("landmarks-verdict").textContent = answer.verdict;
  byId("landmarks-take").hidden = !answer.poses.length;
  announce(answer.verdict);
  repaint("overlay");
}

function acceptLandmarks() {
  const strokes = model.landmarks?.strokes ?? [];
  dropLandmarks("");
  if (strokes.length) sendStrokes(strokes.map(({ tool, points, width, heading }) => (tool === "pole" ? { tool, points, width } : { tool, points, width, heading })));
}
