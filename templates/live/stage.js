// Canvas, camera and ground: orbit, zoom, fit, follow; draws a frame only when something changed.

import { THREE, OrbitControls } from "three";
import { roundUp } from "live/numbers";

const FIELD = 35; // degrees of the view, from bottom to top
const FLAT_FIELD = 0.1; // of a parallel projection: from so far away that lines stay parallel to a pixel
const NARROW = 800; // pixels of width below which the picture leaves the height of the buttons free, too
const PICTURE = 0.5; // part of the height that it has at least
const MANY = 1000; // members from which edges are not smoothed
const SLOW = 34; // ms of a frame above which simpler shapes, then fewer pixels are drawn
const FAST = 18; // ms of a frame below which more pixels are drawn again
const STILL = 250; // ms without a change after which the picture is drawn with all pixels and shapes
const LEAST = 0.6; // pixels a pixel of the page

export function buildStage(canvas, model) {
  const isSoftware = hasNoCard();
  const renderer = new THREE.WebGLRenderer({ canvas, context: newContext(canvas, model, isSoftware) });
  renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(FIELD, 1, model.size / 500, model.size * 500);
  camera.up.set(...model.scene.up);
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  controls.dampingFactor = 0.12;
  const ground = buildGround(model);
  scene.add(ground);

  const stage = {
    renderer, scene, camera, controls, canvas, model, follow: false,
    dirty: true, ratio: fullRatio(), restRatio: isSoftware ? 2 : fullRatio(), isStill: true,
    isSimple: false, canSimplify: false, lastChange: 0, lastTick: null,
    before: [], after: [], resized: [],
    times: [], work: [], recent: [],
  };
  controls.addEventListener("change", () => (stage.dirty = true));
  controls.addEventListener("start", () => (stage.isFitted = false));
  stage.show = (palette) => {
    renderer.setClearColor(new THREE.Color(palette.css.paper).convertLinearToSRGB(), 1);
    ground.material.color.set(palette.css.grid).convertLinearToSRGB();
    stage.dirty = true;
  };
  stage.fit = (nodes) => fit(stage, nodes, null);
  /** Look at all points along a direction, by default that of the start; isFlat: in parallel projection. */
  stage.look = (nodes, direction = model.scene.view, isFlat = model.scene.is_flat) => {
    camera.fov = isFlat ? FLAT_FIELD : FIELD;
    resize(stage);
    fit(stage, nodes, direction);
  };
  stage.followTo = (nodes) => moveWith(stage, nodes);
  stage.resize = () => resize(stage);
  new ResizeObserver(stage.resize).observe(canvas.parentElement);
  stage.resize();
  return stage;
}

/** Whether pictures are drawn by the processor, without a graphics card. */
function hasNoCard() {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? context.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|basic render/i.test(name);
}

/** A context whose picture covers what is behind it: browsers need not blend it with the page. Without a graphics card
    smooth edges take longer than all else: there the picture has more pixels when it stands still. */
function newContext(canvas, model, isSoftware) {
  const antialias = model.memberCount < MANY && !isSoftware;
  const context = canvas.getContext("webgl2", { alpha: false, antialias, stencil: false });
  if (!context) throw new Error("the browser has no WebGL 2, or it is switched off");
  return context;
}

/** Put the camera where all points are seen, along `view`, or as it looks now; also when it turns about `up`. */
function fit(stage, structure, view) {
  const { camera, controls, model } = stage;
  const nodes = withGround(structure, model);
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
  const seen = { right, up, direction, axis: camera.up, tanX, tanY: tanY / stage.room }; // free of legend and buttons
  const reachOf = model.scene.is_planar ? standing : turning;
  let distance = 0;
  for (let k = 0; k < nodes.length; k += 3) {
    point.set(nodes[k], nodes[k + 1], nodes[k + 2]).sub(center);
    distance = Math.max(distance, reachOf(point, seen));
  }
  const away = Math.tan((FIELD * Math.PI) / 360) / tanY; // how many times farther a parallel projection stands
  distance = Math.max((model.scene.is_planar ? 1.16 : 1.08) * distance, 0.2 * away * model.size);
  stage.far = (60 * distance) / away + 10 * model.reach;
  camera.position.copy(center).addScaledVector(direction, distance);
  controls.target.copy(center);
  controls.minDistance = 0.02 * away * model.size;
  controls.maxDistance = 40 * away * Math.max(model.size, model.reach);
  controls.update();
  controls.enableDamping = swings;
  stage.followed = null;
  stage.isFitted = true;
  stage.dirty = true;
}

/** The points, and those of the scene's ground below them where it is near. */
function withGround(nodes, { scene, size }) {
  if (!scene.plane) return nodes;
  const { normal, offset } = scene.plane;
  const below = [];
  for (let k = 0; k < nodes.length; k += 3) {
    const height = nodes[k] * normal[0] + nodes[k + 1] * normal[1] + nodes[k + 2] * normal[2] - offset;
    if (Math.abs(height) < NEAR_GROUND * size) below.push(...normal.map((value, axis) => nodes[k + axis] - height * value));
  }
  return [...nodes, ...below];
}

/** How far the camera must be to see a point. */
function standing(point, { right, up, direction, tanX, tanY }) {
  const [x, y, z] = [right, up, direction].map((axis) => point.dot(axis));
  return z + Math.max(Math.abs(x) / tanX, Math.abs(y) / tanY);
}

/** How far the camera must be to see a point from all sides, turning about `axis`. */
function turning(point, { direction, axis, tanX, tanY }) {
  const height = point.dot(axis);
  const radius = Math.sqrt(Math.max(point.lengthSq() - height * height, 0));
  const rise = axis.dot(direction);
  const flat = Math.sqrt(Math.max(1 - rise * rise, 0));
  const across = height * rise + radius * Math.hypot(flat, 1 / tanX);
  const upright = (s) => s * radius * flat + height * rise + Math.abs(height * flat - s * radius * rise) / tanY;
  return Math.max(across, upright(1), upright(-1));
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
  const ratio = stage.isStill ? stage.restRatio : stage.ratio;
  const isResized = stage.width !== width || stage.height !== height;
  Object.assign(stage, { width, height });
  renderer.setPixelRatio(ratio);
  renderer.setSize(width, height, false);
  camera.aspect = width / height;
  const heightOf = (id) => document.getElementById(id).offsetHeight + 12;
  const [above, below] = [width < NARROW ? heightOf("camera") : 0, heightOf("legend")];
  const part = Math.min(1, ((1 - PICTURE) * height) / (above + below));
  stage.room = height / (height - part * (above + below));
  camera.setViewOffset(width, height, 0, (part * (below - above)) / 2, width, height);
  const pixelSize = (2 * Math.tan((camera.fov * Math.PI) / 360)) / height;
  for (const call of stage.resized) call(pixelSize, ratio / pixelSize);
  if (isResized && stage.isFitted) stage.refit?.();
  stage.dirty = true;
}

/** Depths that are drawn: all that lies so far around where the camera looks. */
function setDepths({ camera, controls, far }) {
  const distance = camera.position.distanceTo(controls.target);
  camera.near = Math.max(distance / 300, distance - far);
  camera.far = distance + far;
  camera.updateProjectionMatrix();
}

/** Draw one frame if anything changed; returns whether it did. */
export function drawFrame(stage) {
  stage.controls.update();
  if (!stage.dirty) return false;
  stage.dirty = false;
  setDepths(stage);
  const start = performance.now();
  const simple = stage.isSimple && !stage.isStill;
  for (const call of stage.before) call(simple, pixelAt(stage) / stage.renderer.getPixelRatio());
  stage.renderer.render(stage.scene, stage.camera);
  for (const call of stage.after) call();
  keep(stage.work, performance.now() - start);
  return true;
}

/** Metres of one pixel of the page where the camera looks. */
export function pixelAt({ camera, controls, height }) {
  const distance = camera.position.distanceTo(controls.target);
  return (2 * distance * Math.tan((camera.fov * Math.PI) / 360)) / height;
}

/** Note whether the picture changes in this tick. A picture that stands still has all its pixels and shapes. */
export function noteTick(stage, now, isMoving) {
  stage.controls.update();
  const isChanging = isMoving || stage.dirty;
  if (isChanging) {
    if (stage.lastTick !== null) noteFrame(stage, now - stage.lastTick);
    stage.lastChange = now;
  }
  stage.lastTick = isChanging ? now : null;
  setStill(stage, now - stage.lastChange > STILL);
}

/** Draw a picture that stands still with all pixels and shapes, one that moves with those that the machine can do. */
export function setStill(stage, isStill) {
  if (stage.isStill === isStill) return;
  stage.isStill = isStill;
  if (stage.ratio < stage.restRatio) resize(stage);
  else if (stage.isSimple) stage.dirty = true;
}

const fullRatio = () => Math.min(window.devicePixelRatio || 1, 2);

function keep(list, value) {
  list.push(value);
  if (list.length > 600) list.shift();
}

/** Remember the time between frames of a motion; draw less where they take long. */
function noteFrame(stage, elapsed) {
  if (elapsed > 1000) return;
  keep(stage.times, elapsed);
  stage.recent.push(elapsed);
  if (stage.recent.length < 20) return;
  const median = stage.recent.sort((a, b) => a - b)[10];
  stage.recent.length = 0;
  stage.calm = median < FAST ? (stage.calm ?? 0) + 1 : 0;
  if (median > SLOW && stage.canSimplify && !stage.isSimple) stage.isSimple = true;
  else if (median > SLOW && stage.ratio > LEAST) setRatio(stage, Math.max(LEAST, 0.8 * stage.ratio));
  else if (stage.calm >= 6 && stage.ratio < fullRatio()) setRatio(stage, Math.min(fullRatio(), stage.ratio / 0.8));
}

function setRatio(stage, ratio) {
  stage.ratio = ratio;
  stage.calm = 0;
  resize(stage);
}

const LEVEL = 1e-9; // of a normal across the upward axis: the ground is level below it
const AROUND = 4; // sizes of ground beyond the motion
const NEAR_GROUND = 2; // sizes from which on the picture leaves the ground out

/** Where the ground lies along the axis across it, or the plane of a planar structure; null on a slope. */
export function groundLevel({ low, high, size, scene }) {
  const across = 3 - scene.ground[0] - scene.ground[1];
  if (scene.plane && !scene.is_planar) {
    const isLevel = scene.plane.normal.every((value, axis) => axis === across || Math.abs(value) < LEVEL);
    return isLevel ? scene.plane.offset / scene.plane.normal[across] : null;
  }
  return scene.is_planar ? (low[across] + high[across]) / 2 : low[across] - scene.ground_gap * size;
}

/** The plane of the scene's ground: a grid, or from its side a line with strokes below it. */
function planeLines({ low, high, size, reach, scene }) {
  const normal = new THREE.Vector3(...scene.plane.normal);
  const sideways = new THREE.Vector3(...(scene.is_planar ? scene.view : scene.up));
  if (!scene.is_planar && Math.abs(normal.dot(sideways)) > 1 - LEVEL) sideways.set(0, 1, 0);
  const first = new THREE.Vector3().crossVectors(sideways, normal).normalize();
  const second = new THREE.Vector3().crossVectors(normal, first);
  const middle = new THREE.Vector3(...low.map((value, axis) => (value + high[axis]) / 2));
  middle.addScaledVector(normal, scene.plane.offset - middle.dot(normal));
  const step = Math.max(roundUp(size / 8), reach / 100);
  const count = Math.ceil((reach / 2 + AROUND * size) / step);
  const at = (x, y, up = 0) => middle.clone().addScaledVector(first, x * step).addScaledVector(second, y * step)
    .addScaledVector(normal, up * step).toArray();
  const points = [];
  if (scene.is_planar) {
    points.push(...at(-count, 0), ...at(count, 0));
    for (let k = -count; k < count; k++) points.push(...at(k, 0), ...at(k + 0.5, 0, -0.5));
    return points;
  }
  for (let k = -count; k <= count; k++) points.push(...at(k, -count), ...at(k, count), ...at(-count, k), ...at(count, k));
  return points;
}

/** A grid below the structure, or behind a planar one, with a round step. */
function gridLines(model) {
  const { low, high, size, scene } = model;
  const step = roundUp(size / 8);
  const [first, second] = scene.ground;
  const level = groundLevel(model);
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
  return points;
}

/** The lines of the ground that the scene states, else of a grid. */
function buildGround(model) {
  const points = model.scene.plane ? planeLines(model) : gridLines(model);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
  const mesh = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ toneMapped: false, depthWrite: false }));
  mesh.renderOrder = -3;
  return mesh;
}
