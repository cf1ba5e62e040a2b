// The viewer: one state of the structure, drawn in the way that the controls ask for.

import { THREE } from "three";
import { buildArrows } from "live/arrows";
import { buildColorings, paintMembers } from "live/coloring";
import { buildLabels } from "live/labels";
import { watchView } from "live/leaving";
import { showMeasures } from "live/measures";
import { buildMeshes } from "live/meshes";
import { buildModes } from "live/modes";
import { motionPoints, newState } from "live/model";
import { paletteOf } from "live/palette";
import { buildPicker } from "live/picking";
import { buildStage, drawFrame, noteTick, setStill } from "live/stage";
import { newTextures } from "live/textures";
import { showScale } from "live/panel";

const byId = (id) => document.getElementById(id);
const darkness = matchMedia("(prefers-color-scheme: dark)");

/** Build everything that is drawn; `read(app)` fills the state for the present time. */
export function buildViewer(model, read) {
  const canvas = byId("view");
  const state = newState(model);
  const textures = newTextures(model);
  const stage = buildStage(canvas, model);
  const meshes = buildMeshes(model, textures);
  const arrows = buildArrows(model, meshes);
  stage.scene.add(meshes.group);
  if (arrows) stage.scene.add(arrows.mesh);
  stage.resized.push(meshes.resize);
  stage.canSimplify = meshes.canSimplify;
  stage.before.push(meshes.simplify);
  const app = {
    model, state, textures, stage, meshes, arrows, read,
    colorings: buildColorings(model), coloringName: "tension", chosen: null, hovered: null,
    widthName: "section", isTurning: false, isBeyond: false, labels: buildLabels(byId("names"), stage, model), modes: buildModes(model),
    picker: buildPicker(stage, model, meshes.radii),
    isStale: true, updates: [], hasSlack: false, moreHooks: {}, moreKeys: {},
    scratch: new Float64Array(model.memberCount),
    changed: () => (app.isStale = true),
    refresh: () => app.isStale && update(app),
  };
  if (!(app.colorings.tension.limit > 0)) app.coloringName = "kind";
  stage.after.push(() => app.labels.draw(state.nodes));
  addLooks(app);
  addCamera(app);
  watchView(app);
  app.axes = showMeasures(app);
  setTheme(app, document.documentElement.dataset.theme ?? (darkness.matches ? "dark" : "light"));
  darkness.addEventListener("change", () => {
    if (!document.documentElement.dataset.theme) setTheme(app, darkness.matches ? "dark" : "light");
  });
  return app;
}

function setTheme(app, theme) {
  app.palette = paletteOf(theme);
  app.labels.palette = app.palette;
  app.stage.show(app.palette);
  app.meshes.show(app.palette);
  app.axes.material.uniforms.ink.value.set(...app.palette.ink.map((value) => value / 255));
  app.arrows?.color(app.palette);
  app.paletteChanged?.();
  app.changed();
  showScale(app);
}

/** What the controls, keys and tests call to change how the structure looks. */
function addLooks(app) {
  const { meshes } = app;
  Object.defineProperty(app, "coloring", { get: () => app.colorings[app.coloringName] });
  app.colorBy = (name) => {
    app.coloringName = name;
    byId("color").value = name;
    app.changed();
    showScale(app);
  };
  const after = (names, name) => names[(names.indexOf(name) + 1) % names.length];
  app.widthBy = (name) => {
    app.widthName = name;
    byId("width").value = name;
    if (name === "section") meshes.widen(null);
    app.changed();
  };
  app.nextWidth = () => app.widthBy(app.widthName === "section" ? "force" : "section");
  app.nextColoring = () => app.colorBy(after(Object.keys(app.colorings), app.coloringName));
  app.labelBy = (kind) => {
    app.labels.kind = kind;
    byId("labels").value = kind;
    app.changed();
  };
  app.nextLabels = () => app.labelBy(after(["none", "nodes", "members", "all"], app.labels.kind));
  app.toggleTheme = () => {
    const theme = app.palette.isDark ? "light" : "dark";
    document.documentElement.dataset.theme = theme;
    setTheme(app, theme);
  };
  app.toggleHelp = () => {
    const help = byId("help");
    if (help.open) help.close();
    else help.showModal();
  };
  app.showArrows = (isOn) => {
    if (app.arrows) app.arrows.mesh.visible = isOn;
    byId("arrows").checked = isOn;
    app.changed();
  };
  app.toggleArrows = () => app.showArrows(!byId("arrows").checked);
  app.showMode = (k) => {
    app.player?.pause();
    app.modes.choose(k);
    byId("mode").value = k === null ? "" : String(k);
    app.changed();
  };
  app.nextMode = () => {
    const count = app.model.scene.modes.length;
    const next = app.modes.chosen === null ? 0 : app.modes.chosen + 1;
    if (count) app.showMode(next < count ? next : null);
  };
  app.setAmplitude = (value) => {
    app.modes.amplitude = value;
    app.changed();
  };
}

// Directions to the observer of views in parallel projection; one that is null has perspective.
const VIEWS = { perspective: null, top: [0, -1e-4, 1], front: [0, -1, 0], side: [1, 0, 0], iso: [1, -1, 1] };
const TURN = 0.5; // radians a second of the turntable

/** The camera: fit, reset, views, follow, orbit. */
function addCamera(app) {
  const { stage, state } = app;
  const points = (whole) => {
    app.refresh();
    const arrows = app.arrows?.mesh.visible ? app.arrows.points() : [];
    return [whole ? motionPoints(app.model) : Array.from(state.nodes), Array.from(arrows)].flat();
  };
  const aim = (place, whole) => {
    place(points(whole));
    stage.followTo(state.nodes); // a camera that follows does so from here on
    stage.refit = () => aim(stage.fit, whole); // a window of another size, a phone that is turned
  };
  app.fit = () => aim(stage.fit, false);
  app.reset = () => aim((nodes) => stage.look(nodes), !stage.follow);
  app.from = "first";
  /** Look from "first", or a name of VIEWS. */
  app.lookFrom = (name) => {
    app.from = name;
    if (name === "first") app.reset();
    else aim((nodes) => stage.look(nodes, VIEWS[name] ?? app.model.scene.space, VIEWS[name] !== null), !stage.follow);
  };
  app.views = ["first", ...(app.model.scene.is_planar ? [] : Object.keys(VIEWS))];
  app.nextView = () => app.lookFrom(app.views[(app.views.indexOf(app.from) + 1) % app.views.length]);
  app.turnAround = (isOn) => {
    app.isTurning = isOn;
    byId("turn").setAttribute("aria-pressed", isOn);
  };
  app.turnBy = (seconds) => app.isTurning && app.orbit(TURN * seconds, 0, 1);
  app.followBy = (isOn) => {
    stage.follow = isOn;
    byId("follow").checked = isOn;
    byId("follow-note").hidden = true;
    if (isOn) app.fit();
    app.changed();
  };
  app.toggleFollow = () => app.followBy(!stage.follow);
  app.orbit = (turn, tilt, zoom) => {
    const { camera, controls } = stage;
    const offset = camera.position.clone().sub(controls.target);
    const side = new THREE.Vector3().crossVectors(camera.up, offset).normalize();
    offset.applyAxisAngle(camera.up, turn);
    side.applyAxisAngle(camera.up, turn);
    const angle = offset.angleTo(camera.up);
    const limited = Math.min(Math.max(angle + tilt, 0.02), Math.PI - 0.02) - angle;
    offset.applyAxisAngle(side, limited).multiplyScalar(zoom);
    camera.position.copy(controls.target).add(offset);
    if (zoom !== 1) stage.isFitted = false;
    controls.update();
    stage.dirty = true;
  };
  app.project = () => {
    app.refresh();
    app.picker.pick(state.nodes, -1e9, -1e9);
    return app.picker.places;
  };
}

/** Bring the picture up to the present time of the state. */
export function update(app) {
  const start = performance.now();
  const { state, model, textures } = app;
  app.read(app);
  app.modes.apply(state);
  app.stage.followTo(state.nodes);
  textures.showNodes(state.nodes);
  const isBeyond = paintMembers(textures.paint, app.coloring, state, model, app.palette, app.scratch);
  textures.showColors();
  if (app.widthName === "force") app.meshes.widen(state.tension, app.colorings.tension.limit);
  app.arrows?.show(state);
  const hasSlack = app.hasSlack || state.slack.includes(1);
  const hasUnknown = state.tension.some(Number.isNaN);
  if (hasSlack !== app.hasSlack || hasUnknown !== app.hasUnknown || isBeyond !== app.isBeyond) {
    Object.assign(app, { hasSlack, hasUnknown, isBeyond });
    showScale(app);
  }
  app.stage.dirty = true;
  app.isStale = false;
  app.updates.push(performance.now() - start);
  if (app.updates.length > 240) app.updates.shift();
}

/** Run: `advance(seconds)` moves the clocks and says whether they move. */
export function run(app, advance) {
  let last = null;
  const tick = (now) => {
    const seconds = last === null ? 0 : Math.min((now - last) / 1000, 0.25);
    const isMoving = advance(seconds);
    app.turnBy(seconds);
    last = now;
    noteTick(app.stage, now, isMoving || app.isStale);
    if (isMoving || app.isStale) update(app);
    drawFrame(app.stage);
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
  app.measure = (frames) => measure(app, frames);
  app.coverage = () => coverage(app);
}

/** Update and draw so many frames while the camera turns; milliseconds of each, with all that the GPU does. */
function measure(app, frames) {
  const gl = app.stage.renderer.getContext();
  const pixel = new Uint8Array(4);
  setStill(app.stage, false);
  const found = { total: [], script: [], width: gl.drawingBufferWidth, height: gl.drawingBufferHeight };
  for (let k = 0; k < frames; k++) {
    const start = performance.now();
    app.orbit(0.02, 0, 1);
    update(app);
    drawFrame(app.stage);
    found.script.push(performance.now() - start);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits for the picture
    found.total.push(performance.now() - start);
  }
  return found;
}

function coverage(app) {
  const gl = app.stage.renderer.getContext();
  app.stage.dirty = true;
  drawFrame(app.stage);
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const pixels = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const paper = app.palette.paper;
  let count = 0;
  for (let k = 0; k < pixels.length; k += 4) {
    if (Math.abs(pixels[k] - paper[0]) + Math.abs(pixels[k + 1] - paper[1]) + Math.abs(pixels[k + 2] - paper[2]) > 90) count++;
  }
  return count / (width * height);
}
