// Names of nodes and members over the picture.

import { projectNodes } from "live/picking";

const MOST = 160; // names at once

export function buildLabels(canvas, stage, model) {
  const labels = { kind: "none", palette: null, omitted: false };
  const places = new Float64Array(3 * model.nodeCount);
  const named = { members: model.memberNames, nodes: model.nodeNames.slice(0, model.shownCount) };
  const wish = () => Object.keys(named).filter((kind) => labels.kind === kind || labels.kind === "all");
  /** A canvas over the picture costs time in every frame: it is there only while something stands on it. */
  labels.draw = (nodes) => {
    const kinds = wish();
    const isNeeded = kinds.length > 0 || Boolean(labels.hasMore?.());
    if (canvas.hidden === isNeeded) canvas.hidden = !isNeeded;
    if (!isNeeded) return;
    const { width, height } = stage;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    if (!kinds.length) return;
    projectNodes(stage, nodes, places);
    const isSeen = ([x, y, depth]) => depth > 0 && x > 0 && x < width && y > 0 && y < height;
    const pen = penOf(ratio);
    labels.omitted = false;
    let line = 24;
    for (const kind of kinds) {
      const isNodes = kind === "nodes";
      const [placeOf, shift] = isNodes ? [at, 9] : [middle, 0];
      const shown = Array.from(named[kind].keys()).filter((k) => isSeen(placeOf(k)));
      if (shown.length > MOST) {
        labels.omitted = true;
        write(pen, `${shown.length} names of ${kind}: zoom in until at most ${MOST} are in the picture`, 16, line, "left");
        line += 18;
        continue;
      }
      for (const k of shown) write(pen, named[kind][k], placeOf(k)[0] + shift, placeOf(k)[1] - shift, isNodes ? "left" : "center");
    }
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
