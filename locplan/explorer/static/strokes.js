// Lines with a halo, so that they stand out on every colour.
import { palette } from "./theme.js";
import { screenOf } from "./view.js";

/** Trace a polyline of world points on a context. */
export function tracePath(context, xy) {
  context.beginPath();
  xy.forEach(([x, y], k) => {
    const [px, py] = screenOf(x, y);
    if (k) context.lineTo(px, py);
    else context.moveTo(px, py);
  });
}

/** Stroke a path with a halo. */
export function haloedPath(context, xy, { colour, width = 3.5, dash = [], faint = 1 }) {
  if (!xy?.length) return;
  context.save();
  context.lineJoin = "round";
  context.lineCap = dash.length ? "butt" : "round";
  context.globalAlpha = faint;
  tracePath(context, xy);
  context.strokeStyle = palette.halo;
  context.lineWidth = width + 3.5;
  context.stroke();
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.restore();
}

/** A dot with a halo at a screen place. */
export function haloedDot(context, px, py, radius, colour) {
  context.beginPath();
  context.arc(px, py, radius, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.fill();
  context.lineWidth = 2.5;
  context.strokeStyle = palette.halo;
  context.stroke();
}

/** A number in a disc at a screen place. */
export function numberedDot(context, px, py, text, colour) {
  haloedDot(context, px, py, 10, colour);
  context.fillStyle = palette.halo;
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, px, py + 0.5);
}
