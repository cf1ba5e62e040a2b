// Loads at their nodes and reactions at supports, as arrows; the longest has a quarter of the structure's size.

import { THREE } from "three";
import { supportSize } from "live/meshes";
import { arrow, repeat } from "live/shapes";
import { ARROW_FRAGMENT, ARROW_VERTEX } from "live/shaders";

const LONGEST = 0.24;
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
  const scale = Math.min(scaleOf(longest, largestLoad(model, loaded)), scaleOf(longest, model.scene.largest_reaction));
  const put = (nodes, place, node, force, first, factor, gap) => {
    let size = 0;
    for (let c = 0; c < 3; c++) {
      const value = factor * force[first + c];
      rows[8 * place + 4 + c] = Number.isFinite(value) ? value : 0;
      size += rows[8 * place + 4 + c] ** 2;
    }
    const away = 1 + gap / (Math.sqrt(size) || 1);
    for (let c = 0; c < 3; c++) rows[8 * place + c] = nodes[3 * node + c] - away * rows[8 * place + 4 + c];
  };
  return {
    mesh,
    points: () => Array.from({ length: count }, (_, k) => Array.from(rows.subarray(8 * k, 8 * k + 3))).flat(),
    hasLoads: loaded.length > 0, hasReactions: model.held.length > 0,
    color(palette) {
      uniforms.loadColor.value.set(...palette.load.map((value) => value / 255));
      uniforms.reactionColor.value.set(...palette.reaction.map((value) => value / 255));
    },
    /** A load ends at its node, a reaction too: both push the node from outside. */
    show(state) {
      loaded.forEach((node, k) => put(state.nodes, k, node, model.load, 3 * node, scale, 0.012 * model.size));
      model.held.forEach((node, k) => put(state.nodes, loaded.length + k, node, state.reaction, 3 * k, scale, support));
      texture.needsUpdate = true;
    },
  };
}

const scaleOf = (length, largest) => (largest > 0 ? length / largest : Infinity);

function largestLoad(model, loaded) {
  if (model.scene.largest_load !== undefined) return model.scene.largest_load;
  return Math.max(0, ...loaded.map((k) => Math.hypot(...model.load.slice(3 * k, 3 * k + 3))));
}
