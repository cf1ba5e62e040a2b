// Canvas, camera and ground: orbit, zoom, fit, follow; draws a frame only when something changed.

import { THREE, OrbitControls } from "three";

const FIELD = 35; // degrees of the view, from bottom to top
const RAISE = 26; // pixels by which the picture stands above the middle, for the legend below it
const MANY = 1000; // members from which edges are not smoothed
const SLOW = 34; // ms of a frame above which fewer pixels are drawn

export function buildStage(canvas, model) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: model.memberCount < MANY, preserveDrawingBuffer: false });
  renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(FIELD, 1, model.size / 500, model.size * 500);
  const view = model.scene.view;
  camera.up.set(...model.scene.up);
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  controls.dampingFactor = 0.12;
  const ground = buildGround(model);
  scene.add(ground.mesh);

  const stage = {
    renderer, scene, camera, controls, canvas, model, follow: false,
    dirty: true, ratio: Math.min(window.devicePixelRatio || 1, 2), isStill: true, gridStep: ground.step,
    before: [], after: [], resized: [],
    times: [], work: [],
  };
  controls.addEventListener("change", () => (stage.dirty = true));
  stage.show = (palette) => {
    renderer.setClearColor(new THREE.Color(palette.css.paper).convertLinearToSRGB(), 1);
    ground.mesh.material.color.set(palette.css.grid).convertLinearToSRGB();
    stage.dirty = true;
  };
  stage.fit = (nodes) => {
    fit(stage, nodes, null);
  };
  stage.reset = (nodes) => {
    fit(stage, nodes, view);
  };
  stage.followTo = (nodes) => moveWith(stage, nodes);
  stage.resize = () => resize(stage);
  new ResizeObserver(stage.resize).observe(canvas.parentElement);
  stage.resize();
  return stage;
}

/** Put the camera where all points are seen, along `view`, or as it looks now; also when it turns about `up`. */
function fit(stage, nodes, view) {
  const { camera, controls, model } = stage;
  const swings = controls.enableDamping;
  controls.enableDamping = false; // a turn that still swings out ends here
  controls.update();
  const box = new THREE.Box3();
  const point = new THREE.Vector3();
  for (let k = 0; k < nodes.length; k += 3) box.expandByPoint(point.set(nodes[k], nodes[k + 1], nodes[k + 2]));
  const center = box.getCenter(new THREE.Vector3());
  const direction = view ? new THREE.Vector3(...view) : camera.position.clone().sub(controls.target);
  direction.normalize();
  const right = new THREE.Vector3().crossVectors(camera.up, direction).normalize();
  const up = new THREE.Vector3().crossVectors(direction, right);
  const tanY = Math.tan((camera.fov * Math.PI) / 360);
  const tanX = tanY * camera.aspect;
  let distance = 0;
  const turns = !model.scene.is_planar;
  for (let k = 0; k < nodes.length; k += 3) {
    point.set(nodes[k], nodes[k + 1], nodes[k + 2]).sub(center);
    const [x, y, z] = turns ? turned(point, camera.up, direction) : [right, up, direction].map((axis) => point.dot(axis));
    distance = Math.max(distance, z + Math.abs(x) / tanX, z + Math.abs(y) / tanY);
  }
  const { clientHeight } = stage.canvas;
  const room = clientHeight > 4 * RAISE ? clientHeight / (clientHeight - 2 * RAISE) : 1;
  distance = Math.max((turns ? 1.08 : 1.16) * room * distance, 0.2 * model.size);
  camera.near = distance / 300;
  camera.far = distance * 60 + 10 * model.reach;
  camera.updateProjectionMatrix();
  camera.position.copy(center).addScaledVector(direction, distance);
  controls.target.copy(center);
  controls.minDistance = 0.02 * model.size;
  controls.maxDistance = 40 * Math.max(model.size, model.reach);
  controls.update();
  controls.enableDamping = swings;
  stage.followed = null;
  stage.dirty = true;
}

/** The largest sideways, upward and forward places of a point while the camera turns about `axis`. */
function turned(point, axis, direction) {
  const height = point.dot(axis);
  const radius = Math.sqrt(Math.max(point.lengthSq() - height * height, 0));
  const rise = axis.dot(direction);
  const flat = Math.sqrt(Math.max(1 - rise * rise, 0));
  return [radius, Math.abs(height) * flat, 0.8 * radius * flat + Math.abs(height * rise)];
}

/** Move the camera with the middle of the structure. */
function moveWith(stage, nodes) {
  if (!stage.follow) {
    stage.followed = null;
    return;
  }
  const middle = [0, 0, 0];
  for (let i = 0; i < nodes.length; i++) middle[i % 3] += (3 * nodes[i]) / nodes.length;
  if (stage.followed) {
    const step = new THREE.Vector3(...middle.map((value, axis) => value - stage.followed[axis]));
    stage.camera.position.add(step);
    stage.controls.target.add(step);
  }
  stage.followed = middle;
}

function resize(stage) {
  const { renderer, camera, canvas } = stage;
  const { clientWidth: width, clientHeight: height } = canvas.parentElement;
  if (!width || !height) return;
  const ratio = stage.isStill ? Math.min(window.devicePixelRatio || 1, 2) : stage.ratio;
  renderer.setPixelRatio(ratio);
  renderer.setSize(width, height, false);
  camera.aspect = width / height;
  camera.setViewOffset(width, height, 0, RAISE, width, height);
  const pixelSize = (2 * Math.tan((camera.fov * Math.PI) / 360)) / height;
  for (const call of stage.resized) call(pixelSize, ratio / pixelSize);
  stage.dirty = true;
}

/** Draw one frame if anything changed; returns whether it did. */
export function drawFrame(stage) {
  stage.controls.update();
  if (!stage.dirty) return false;
  stage.dirty = false;
  const start = performance.now();
  stage.renderer.render(stage.scene, stage.camera);
  for (const call of stage.after) call();
  stage.work.push(performance.now() - start);
  if (stage.work.length > 240) stage.work.shift();
  return true;
}

/** A picture that stands still has all pixels, also where those of a motion have fewer. */
export function rest(stage, isStill) {
  if (stage.isStill === isStill) return;
  stage.isStill = isStill;
  if (stage.ratio < Math.min(window.devicePixelRatio || 1, 2)) resize(stage);
}

/** Remember the time between frames of a motion, and draw fewer pixels where frames take long. */
export function noteFrame(stage, elapsed) {
  if (elapsed > 1000) return;
  stage.times.push(elapsed);
  if (stage.times.length > 240) stage.times.shift();
  if (stage.times.length % 20 || stage.ratio <= 0.6) return;
  const recent = stage.times.slice(-20).sort((a, b) => a - b)[10];
  if (recent > SLOW) {
    stage.ratio = Math.max(0.6, stage.ratio * 0.8);
    resize(stage);
  }
}

/** A grid on the ground, or behind a planar structure, with a round step. */
function buildGround(model) {
  const { low, high, size, scene } = model;
  const rough = size / 8;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= rough);
  const [first, second] = scene.ground;
  const across = 3 - first - second;
  const level = scene.is_planar ? (low[across] + high[across]) / 2 : low[across] - scene.ground_gap * size;
  const range = (axis) => [Math.floor(low[axis] / step - 1) * step, Math.ceil(high[axis] / step + 1) * step];
  const points = [];
  const line = (axis, other) => {
    const [from, to] = range(axis);
    const [start, end] = range(other);
    const count = Math.min(Math.round((end - start) / step), 400);
    for (let k = 0; k <= count; k++) {
      const ends = [new Array(3).fill(level), new Array(3).fill(level)];
      ends[0][axis] = from;
      ends[1][axis] = to;
      ends[0][other] = ends[1][other] = start + k * step;
      points.push(...ends[0], ...ends[1]);
    }
  };
  line(first, second);
  line(second, first);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
  const mesh = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ toneMapped: false }));
  mesh.renderOrder = -2;
  if (scene.is_planar) mesh.material.depthWrite = false;
  return { mesh, step };
}
