// Directions of the axes in a corner of the picture, and a scale bar that holds where the camera looks.

import { THREE } from "three";
import { roundUp, withUnit } from "live/numbers";
import { AXES_FRAGMENT, AXES_VERTEX } from "live/shaders";
import { pixelAt } from "live/stage";

const SHORTEST = 44; // pixels of the scale bar
// Strokes of the letters, from corner to corner of a box of 2 by 2.
const LETTERS = [
  [-1, -1, 1, 1, -1, 1, 1, -1],
  [-1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, -1],
  [-1, 1, 1, 1, 1, 1, -1, -1, -1, -1, 1, -1],
];

export function showMeasures({ stage, model, arrows, colorings }) {
  const axes = buildAxes(model);
  stage.scene.add(axes);
  stage.resized.push(() => axes.material.uniforms.size.value.set(stage.width, stage.height));
  const [bar, text] = document.getElementById("measure").children;
  let shown = 0;
  stage.after.push(() => {
    const pixel = pixelAt(stage);
    if (Math.abs(pixel - shown) < 1e-3 * pixel) return;
    shown = pixel;
    const length = roundUp(SHORTEST * pixel);
    bar.style.width = `${Math.round(length / pixel)}px`;
    const force = arrows?.scale ? `, arrows ${withUnit(length / arrows.scale, "N", 3, colorings.tension.limit || undefined)}` : "";
    const words = withUnit(length, "m") + force;
    if (text.textContent !== words) text.textContent = words;
  });
  return axes;
}

/** Arms and letters as lines of the picture itself: elements over it would take time in every frame that turns. */
function buildAxes({ scene }) {
  const arms = [];
  const strokes = [];
  for (const axis of scene.axes) {
    const unit = [0, 1, 2].map((k) => Number(k === axis));
    arms.push(0, 0, 0, ...unit);
    strokes.push(0, 0, 0, 0);
    const letter = LETTERS[axis];
    for (let k = 0; k < letter.length; k += 2) {
      arms.push(...unit.map((value) => 1.35 * value));
      strokes.push(letter[k], letter[k + 1]);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(arms), 3));
  geometry.setAttribute("stroke", new THREE.BufferAttribute(new Float32Array(strokes), 2));
  const uniforms = { size: { value: new THREE.Vector2(1, 1) }, ink: { value: new THREE.Vector3() } };
  const material = new THREE.ShaderMaterial({
    glslVersion: THREE.GLSL3, vertexShader: AXES_VERTEX, fragmentShader: AXES_FRAGMENT, uniforms, depthTest: false, depthWrite: false,
  });
  const mesh = new THREE.LineSegments(geometry, material);
  mesh.frustumCulled = false;
  mesh.renderOrder = 1;
  return mesh;
}
