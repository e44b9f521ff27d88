// Look-alike places: where a scan taken at a place would match as well, joined to it by lines.
import { byId } from "./dom.js";
import { repaint } from "./frames.js";
import { askLong, cancel } from "./link.js";
import { announce, complain } from "./say.js";
import { model } from "./store.js";
import { haloedDot, numberedDot } from "./strokes.js";
import { metres } from "./text.js";
import { palette } from "./theme.js";
import { screenAngle, screenOf } from "./view.js";

/** Connect the buttons. */
export function startTwins() {
  byId("twins-find").addEventListener("click", () => awaitPlace(!model.picking));
  byId("twins-clear").addEventListener("click", clearTwins);
  byId("twins-group").hidden = !canShowTwins();
}

/** Ask for the look-alikes of a world point. */
export async function showTwinsOf([x, y]) {
  awaitPlace(false);
  if (!canShowTwins()) return;
  cancel("twins");
  try {
    const answer = await askLong("twins", "Looking for look-alike places", { x, y });
    if (answer && !answer.cancelled) takeTwins(answer, [x, y]);
  } catch (error) {
    complain(error);
  }
}

/** Let the next click choose the place, or no longer. */
export function awaitPlace(waits) {
  model.picking = waits;
  byId("twins-find").setAttribute("aria-pressed", String(waits));
  byId("stage").classList.toggle("picking", waits);
}

/** Take the look-alikes away. */
export function clearTwins() {
  awaitPlace(false);
  model.twins = null;
  byId("twins-note").textContent = "";
  byId("twins-clear").hidden = true;
  repaint("overlay");
}

/** Draw the place, its look-alikes and the lines. */
export function paintTwins(context) {
  if (!model.twins) return;
  const from = screenOf(...model.twins.place);
  const places = model.twins.twins.map((twin) => ({ at: screenOf(twin.x, twin.y), angle: screenAngle(twin.heading ?? 0) }));
  context.save();
  for (const [colour, width, dash] of [[palette.halo, 4, []], [palette.twin, 1.8, [7, 4]]]) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dash);
    for (const { at } of places) {
      context.beginPath();
      context.moveTo(...from);
      context.lineTo(...at);
      context.stroke();
    }
  }
  context.restore();
  haloedDot(context, ...from, 7, palette.twin);
  places.forEach(({ at, angle }, k) => {
    context.beginPath();
    context.moveTo(...at);
    context.lineTo(at[0] + 20 * Math.cos(angle), at[1] + 20 * Math.sin(angle));
    context.lineWidth = 3;
    context.strokeStyle = palette.twin;
    context.stroke();
    numberedDot(context, ...at, String(k + 1), palette.twin);
  });
}

function canShowTwins() {
  return !model.shared && model.about.can?.twins !== false;
}

function takeTwins(answer, place) {
  model.twins = { ...answer, place };
  const count = answer.twins.length;
  const far = count ? ` The nearest is ${metres(Math.min(...answer.twins.map((twin) => Math.hypot(twin.x - place[0], twin.y - place[1]))))} away.` : "";
  byId("twins-note").textContent = count ? `${count === 1 ? "One place looks" : `${count} places look`} the same to the lidar.${far}` : "No other place looks like this one.";
  byId("twins-group").open = true;
  byId("twins-clear").hidden = false;
  announce(byId("twins-note").textContent);
  repaint("overlay");
}
