// Names of nodes and members over the picture.

import { projectNodes } from "live/picking";

const MOST = 160; // names at once

export function buildLabels(canvas, stage, model) {
  const labels = { kind: "none", palette: null, omitted: false };
  const places = new Float64Array(3 * model.nodeCount);
  const wish = () => (labels.kind === "nodes" ? model.nodeNames : labels.kind === "members" ? model.memberNames : []);
  /** A canvas over the picture costs time in every frame: it is there only while something stands on it. */
  labels.draw = (nodes) => {
    const names = wish();
    const isNeeded = names.length > 0 || Boolean(labels.hasMore?.());
    if (canvas.hidden === isNeeded) canvas.hidden = !isNeeded;
    if (!isNeeded) return;
    const { width, height } = stage;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    if (!names.length) return;
    projectNodes(stage, nodes, places);
    const isNodes = labels.kind === "nodes";
    const placeOf = isNodes ? at : middle;
    const isSeen = ([x, y, depth]) => depth > 0 && x > 0 && x < width && y > 0 && y < height;
    const shown = Array.from(names.keys()).filter((k) => isSeen(placeOf(k)));
    labels.omitted = shown.length > MOST;
    const pen = penOf(ratio);
    if (labels.omitted) write(pen, `${shown.length} names: zoom in until at most ${MOST} are in the picture`, 16, 24, "left");
    else for (const k of shown) write(pen, names[k], placeOf(k)[0] + (isNodes ? 9 : 0), placeOf(k)[1] - (isNodes ? 9 : 0), isNodes ? "left" : "center");
  };
  const penOf = (ratio) => {
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.font = "600 12px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    pen.lineWidth = 3.5;
    pen.strokeStyle = labels.palette.css.paper;
    pen.fillStyle = labels.palette.css.ink;
    return pen;
  };
  const write = (pen, text, x, y, align) => {
    pen.textAlign = align;
    pen.strokeText(text, x, y);
    pen.fillText(text, x, y);
  };
  const at = (k) => [places[3 * k], places[3 * k + 1], places[3 * k + 2]];
  const middle = (e) => {
    const [a, b] = [at(model.ends[2 * e]), at(model.ends[2 * e + 1])];
    return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, Math.min(a[2], b[2])];
  };
  return labels;
}
