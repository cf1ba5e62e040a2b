// Pull a node: a press on it hangs a spring between the node and the pointer, until it is released.

import { THREE } from "three";
import { projectNodes } from "live/picking";

const NEAR = { mouse: 22, touch: 34 }; // pixels between pointer and node

export function letPull(app) {
  const { stage, model, state, engine } = app;
  const { canvas } = stage;
  const { axes } = model.scene;
  const places = new Float64Array(3 * model.nodeCount);
  const plane = new THREE.Plane();
  const ray = new THREE.Raycaster();
  app.pullStrength = 1;
  app.pull = null;

  const isFree = (k) => axes.some((axis) => !model.anchored[3 * k + axis]);
  const inside = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const nodeAt = ([x, y], reach) => {
    projectNodes(stage, state.nodes, places);
    let [best, least] = [null, reach];
    for (let k = 0; k < model.shownCount; k++) {
      const distance = Math.hypot(places[3 * k] - x, places[3 * k + 1] - y);
      if (places[3 * k + 2] > 0 && distance < least && isFree(k)) [best, least] = [k, distance];
    }
    return best;
  };
  const pointOf = ([x, y]) => {
    const { clientWidth: width, clientHeight: height } = canvas;
    ray.setFromCamera(new THREE.Vector2((2 * x) / width - 1, 1 - (2 * y) / height), stage.camera);
    return ray.ray.intersectPlane(plane, new THREE.Vector3());
  };
  const send = () => {
    const { mass, stiffness } = engine.described.pull;
    const strength = stiffness * app.pullStrength;
    const target = app.pull.point.toArray().map((value, axis) => value + model.origin[axis]);
    const damping = 0.5 * Math.sqrt(strength * mass);
    engine.send("pull", { pull: { node: app.pull.node, target, stiffness: strength, damping } });
  };

  canvas.addEventListener("pointerdown", (event) => {
    if (app.pull) event.stopImmediatePropagation(); // a second finger
    if (event.button !== 0 || app.pull) return;
    const node = nodeAt(inside(event), NEAR[event.pointerType] ?? NEAR.mouse);
    if (node === null) return;
    event.stopImmediatePropagation();
    canvas.setPointerCapture(event.pointerId);
    stage.controls.enabled = false;
    const start = new THREE.Vector3(...state.nodes.slice(3 * node, 3 * node + 3));
    plane.setFromNormalAndCoplanarPoint(stage.camera.getWorldDirection(new THREE.Vector3()), start);
    app.pull = { node, point: start, pointer: event.pointerId };
    app.hovered = null;
    document.getElementById("tip").hidden = true;
    app.choose({ node });
    send();
    if (engine.last.status === 0) app.player.play();
  }, { capture: true });
  canvas.addEventListener("pointermove", (event) => {
    if (event.pointerId !== app.pull?.pointer) return;
    const point = pointOf(inside(event));
    if (!point) return;
    app.pull.point = point;
    send();
    stage.dirty = true;
  });
  const release = (event) => {
    if (event.pointerId !== app.pull?.pointer) return;
    app.pull = null;
    stage.controls.enabled = true;
    engine.send("pull", { pull: null });
    stage.dirty = true;
  };
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(name, release);
  app.labels.hasMore = () => app.pull !== null;
  stage.after.push(() => app.pull && drawPull(app, places));
}

/** A line from the node to the pointer, over the picture. */
function drawPull(app, places) {
  const { stage, state, palette, pull } = app;
  projectNodes(stage, state.nodes, places);
  const target = projectNodes(stage, pull.point.toArray(), new Float64Array(3));
  const pen = document.getElementById("names").getContext("2d");
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.strokeStyle = pen.fillStyle = palette.css.load;
  pen.lineWidth = 2.5;
  pen.setLineDash([6, 4]);
  pen.beginPath();
  pen.moveTo(places[3 * pull.node], places[3 * pull.node + 1]);
  pen.lineTo(target[0], target[1]);
  pen.stroke();
  pen.setLineDash([]);
  pen.beginPath();
  pen.arc(target[0], target[1], 6, 0, 2 * Math.PI);
  pen.fill();
}
