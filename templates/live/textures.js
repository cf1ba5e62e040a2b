// Positions of nodes, colours and radii of members as textures, which all meshes share.

import { THREE } from "three";

const sideOf = (count) => Math.max(1, Math.ceil(Math.sqrt(count)));

/** Return uniforms `nodes`, `colors` and `widths`, with functions that upload new contents. */
export function newTextures(model) {
  const nodeSide = sideOf(model.nodeCount);
  const places = new Float32Array(4 * nodeSide * nodeSide);
  const nodes = new THREE.DataTexture(places, nodeSide, nodeSide, THREE.RGBAFormat, THREE.FloatType);
  const colorSide = sideOf(model.memberCount);
  const paint = new Uint8Array(4 * colorSide * colorSide);
  const colors = new THREE.DataTexture(paint, colorSide, colorSide, THREE.RGBAFormat, THREE.UnsignedByteType);
  const radii = new Float32Array(colorSide * colorSide);
  const widths = new THREE.DataTexture(radii, colorSide, colorSide, THREE.RedFormat, THREE.FloatType);
  nodes.needsUpdate = colors.needsUpdate = true;
  return {
    uniforms: { nodes: { value: nodes }, colors: { value: colors }, widths: { value: widths } },
    paint,
    radii: radii.subarray(0, model.memberCount),
    showWidths() {
      widths.needsUpdate = true;
    },
    showColors() {
      colors.needsUpdate = true;
    },
    showNodes(values) {
      for (let k = 0; k < model.nodeCount; k++) {
        places[4 * k] = values[3 * k];
        places[4 * k + 1] = values[3 * k + 1];
        places[4 * k + 2] = values[3 * k + 2];
      }
      nodes.needsUpdate = true;
    },
  };
}
