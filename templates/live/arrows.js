// Loads at their nodes and reactions at supports, as arrows; the longest has a quarter of the structure's size.

import { THREE } from "three";
import { supportSize } from "live/meshes";
import { roundUp } from "live/numbers";
import { arrow, repeat } from "live/shapes";
import { ARROW_FRAGMENT, ARROW_VERTEX } from "live/shaders";

const LONGEST = 0.24;
const SHORTEST = 0.05; // the same of a load, however small beside reactions
const UPRIGHT = 0.7; // part of a force along the upward axis from which its arrow passes the mark of a support
const RATIO = 1e-6; // part of the longest arrow below which a force is rounding
const ROW = 512; // arrows of one row of the texture

/** meshes: those of the structure, whose bars are thicker than arrows. */
export function buildArrows(model, meshes) {
  const loaded = [...model.loaded];
  for (let k = 0; k < (model.loadMotion ? 0 : model.nodeCount); k++) {
    if (model.load[3 * k] || model.load[3 * k + 1] || model.load[3 * k + 2]) loaded.push(k);
  }
  const count = loaded.length + model.held.length;
  if (!count) return null;
  const sides = count > 200 ? 5 : 14;
  const crowd = Math.min(1, (24 / count) ** 0.5);
  const numbers = Array.from({ length: count }, (_, k) => [k, k < loaded.length ? 0 : 1]).flat();
  const geometry = repeat(arrow(sides), { row: [numbers, 2] }, count);
  // Two texels for each arrow, side by side: where it starts, and its vector.
  const width = Math.min(count, ROW);
  const height = Math.ceil(count / width);
  const rows = new Float32Array(4 * 2 * width * height);
  const texture = new THREE.DataTexture(rows, 2 * width, height, THREE.RGBAFormat, THREE.FloatType);
  const uniforms = {
    ...meshes.shared, thinnest: { value: Math.min(0.0042 * crowd * model.size, 0.6 * meshes.thinnestBar) }, arrows: { value: texture },
    loadColor: { value: new THREE.Vector3() }, reactionColor: { value: new THREE.Vector3() },
  };
  const material = new THREE.ShaderMaterial({
    glslVersion: THREE.GLSL3, vertexShader: ARROW_VERTEX, fragmentShader: ARROW_FRAGMENT, uniforms,
  });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.frustumCulled = false;
  const support = 1.1 * supportSize(model);
  const longest = LONGEST * crowd * model.size;
  const forces = { load: largestLoad(model, loaded), reaction: model.held.length ? model.scene.largest_reaction : 0 };
  const most = Math.max(forces.load, forces.reaction);
  const scale = most > 0 ? 1 / roundUp(most / longest) : 0; // metres of 1 N
  const shortest = SHORTEST * crowd * model.size;
  const beside = neighboursOf(model);
  const { up } = model.scene;
  /** An arrow that pushes its node against its members ends there, one that pulls starts there: both stand outside. */
  const put = (nodes, place, node, force, first, mark, least) => {
    const plain = [0, 1, 2].map((c) => (Number.isFinite(force[first + c]) ? scale * force[first + c] : 0));
    const bare = Math.hypot(...plain);
    const longer = bare > RATIO * longest ? Math.max(1, least / bare) : 1;
    const vector = plain.map((value) => longer * value);
    const size = Math.hypot(...vector) || 1;
    const pushes = dot(vector, inward(nodes, node, beside[node])) > 0;
    const gap = Math.abs(dot(vector, up)) > UPRIGHT * size ? mark : 0.012 * model.size;
    const from = pushes ? -1 - gap / size : gap / size;
    for (let c = 0; c < 3; c++) {
      rows[8 * place + c] = nodes[3 * node + c] + from * vector[c];
      rows[8 * place + 4 + c] = vector[c];
    }
  };
  return {
    mesh,
    forces, scale,
    /** Length to which small loads are lengthened; 0 if none is. */
    shortest: smallestLoad(model, loaded) * scale < shortest ? shortest : 0,
    /** Where arrows start and end. */
    points: () => Array.from({ length: count }, (_, k) => [0, 1].flatMap((end) => [0, 1, 2].map((c) => rows[8 * k + c] + end * rows[8 * k + 4 + c]))).flat(),
    hasLoads: loaded.length > 0, hasReactions: model.held.length > 0,
    color(palette) {
      uniforms.loadColor.value.set(...palette.load.map((value) => value / 255));
      uniforms.reactionColor.value.set(...palette.reaction.map((value) => value / 255));
    },
    show(state) {
      loaded.forEach((node, k) => put(state.nodes, k, node, model.load, 3 * node, 0.012 * model.size, shortest));
      model.held.forEach((node, k) => put(state.nodes, loaded.length + k, node, state.reaction, 3 * k, support, 0));
      texture.needsUpdate = true;
    },
  };
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

function neighboursOf({ nodeCount, memberCount, ends }) {
  const beside = Array.from({ length: nodeCount }, () => []);
  for (let e = 0; e < memberCount; e++) {
    beside[ends[2 * e]].push(ends[2 * e + 1]);
    beside[ends[2 * e + 1]].push(ends[2 * e]);
  }
  return beside;
}

/** The sum of the directions from a node along its members. */
function inward(nodes, node, others) {
  const sum = [0, 0, 0];
  for (const other of others) {
    const along = [0, 1, 2].map((c) => nodes[3 * other + c] - nodes[3 * node + c]);
    const length = Math.hypot(...along) || 1;
    for (let c = 0; c < 3; c++) sum[c] += along[c] / length;
  }
  return sum;
}

function largestLoad(model, loaded) {
  if (model.scene.largest_load !== undefined) return model.scene.largest_load;
  return Math.max(0, ...loaded.map((k) => Math.hypot(...model.load.slice(3 * k, 3 * k + 3))));
}

/** The smallest load [N]; of motions, in which loads change, 0. */
function smallestLoad(model, loaded) {
  return model.loadMotion ? 0 : Math.min(...loaded.map((k) => Math.hypot(...model.load.slice(3 * k, 3 * k + 3))));
}
