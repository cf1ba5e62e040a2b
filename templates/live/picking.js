// Which member or node is under the pointer: the nearest on the screen, in front where several are.

import { THREE } from "three";

const REACH = 8; // pixels around the pointer of a mouse

/** Return places of all nodes on the screen [px], and their depths [m], as (x, y, depth). */
export function projectNodes(stage, nodes, out) {
  const { camera, canvas } = stage;
  const { clientWidth: width, clientHeight: height } = canvas;
  const matrix = new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).elements;
  for (let k = 0; k < nodes.length; k += 3) {
    const [x, y, z] = [nodes[k], nodes[k + 1], nodes[k + 2]];
    const w = matrix[3] * x + matrix[7] * y + matrix[11] * z + matrix[15];
    out[k] = (0.5 + (0.5 * (matrix[0] * x + matrix[4] * y + matrix[8] * z + matrix[12])) / w) * width;
    out[k + 1] = (0.5 - (0.5 * (matrix[1] * x + matrix[5] * y + matrix[9] * z + matrix[13])) / w) * height;
    out[k + 2] = w;
  }
  return out;
}

export function buildPicker(stage, model, radii) {
  const places = new Float64Array(3 * model.nodeCount);
  const pixelsAt = (depth) => stage.canvas.clientHeight / (2 * Math.tan((stage.camera.fov * Math.PI) / 360) * depth);

  function pickNode(x, y, reach) {
    let best = null;
    let least = reach + 4;
    for (let k = 0; k < model.shownCount; k++) {
      if (places[3 * k + 2] <= 0) continue;
      const distance = Math.hypot(places[3 * k] - x, places[3 * k + 1] - y);
      if (distance < least) [best, least] = [k, distance];
    }
    return best;
  }

  function pickMember(x, y, reach) {
    let best = null;
    let score = Infinity;
    for (let e = 0; e < model.memberCount; e++) {
      const i = 3 * model.ends[2 * e];
      const j = 3 * model.ends[2 * e + 1];
      if (places[i + 2] <= 0 || places[j + 2] <= 0) continue;
      const [dx, dy] = [places[j] - places[i], places[j + 1] - places[i + 1]];
      const part = Math.min(1, Math.max(0, ((x - places[i]) * dx + (y - places[i + 1]) * dy) / (dx * dx + dy * dy || 1)));
      const depth = places[i + 2] + part * (places[j + 2] - places[i + 2]);
      const width = radii[e] * pixelsAt(depth);
      const gap = Math.max(0, Math.hypot(places[i] + part * dx - x, places[i + 1] + part * dy - y) - width);
      if (gap > reach) continue;
      const value = gap * 1e3 + depth / model.size;
      if (value < score) [best, score] = [e, value];
    }
    return best;
  }

  return {
    places,
    /** Return {node} or {member} at a place of the canvas [px], null where there is none; a reach of so many `times`. */
    pick(nodes, x, y, times = 1) {
      projectNodes(stage, nodes, places);
      const reach = REACH * times;
      const node = pickNode(x, y, reach);
      const member = pickMember(x, y, reach);
      if (node !== null && Math.hypot(places[3 * node] - x, places[3 * node + 1] - y) < reach) return { node };
      if (member !== null) return { member };
      return node === null ? null : { node };
    },
  };
}
