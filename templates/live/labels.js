// Names of nodes and members over the picture.

import { projectNodes } from "live/picking";

const MOST = 160; // names at once

export function buildLabels(canvas, stage, model) {
  const labels = { kind: "none", palette: null, omitted: false };
  const places = new Float64Array(3 * model.nodeCount);
  const wish = () => (labels.kind === "nodes" ? model.nodeNames : labels.kind === "members" ? model.memberNames : []);
  labels.draw = (nodes) => {
    const { clientWidth: width, clientHeight: height } = stage.canvas;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const names = wish();
    labels.omitted = names.length > MOST;
    if (!names.length || labels.omitted) return;
    projectNodes(stage, nodes, places);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.font = "600 12px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    pen.lineWidth = 3.5;
    pen.strokeStyle = labels.palette.css.paper;
    pen.fillStyle = labels.palette.css.ink;
    names.forEach((name, k) => {
      const [x, y] = labels.kind === "nodes" ? at(k) : middle(k);
      const shift = labels.kind === "nodes" ? 9 : 0;
      pen.textAlign = labels.kind === "nodes" ? "left" : "center";
      pen.strokeText(name, x + shift, y - shift);
      pen.fillText(name, x + shift, y - shift);
    });
  };
  const at = (k) => [places[3 * k], places[3 * k + 1]];
  const middle = (e) => {
    const [a, b] = [at(model.ends[2 * e]), at(model.ends[2 * e + 1])];
    return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  };
  return labels;
}
