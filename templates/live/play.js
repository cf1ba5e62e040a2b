// Start of a page with the compiled model inside: the clock runs in the worker, the picture follows.

import { startEngine } from "live/engine";
import { exposeHook } from "live/hook";
import { listenToKeys } from "live/keyboard";
import { widenScales } from "live/coloring";
import { buildModel, measure, spreadTension } from "live/model";
import { pace } from "live/pace";
import { buildPanel, showScale } from "live/panel";
import { listenToPointer, showChosen } from "live/pointer";
import { connectControls, showRun } from "live/controls";
import { letPull } from "live/pulling";
import { buildRecorder } from "live/recorder";
import { buildViewer, run, update } from "live/viewer";

const READABLE = 150; // ms between changes of texts and diagrams

export async function startPlay(scene, buffers) {
  const model = buildModel(scene, buffers);
  const app = buildViewer(model, readLast);
  let isNew = false;
  let recorder = null;
  const source = document.getElementById("worker").textContent;
  app.engine = await startEngine(describe(model), buffers.module, source, (state) => {
    isNew = true;
    recorder?.add(state);
  });
  app.moves = true;
  widenScales(app.colorings, model, spreadTension(model, app.engine.last.tension), scene.engine.usual_force);
  app.coloringName = "tension";
  app.player = playerOf(app);
  Object.defineProperty(app, "time", { get: () => app.engine.last.time });
  buildPanel(app);
  listenToPointer(app);
  letPull(app);
  connectControls(app);
  recorder = buildRecorder(app);
  readLast(app);
  app.colorBy(app.coloringName);
  app.stage.resize();
  update(app);
  app.reset();
  if (scene.start?.follow) app.followBy(true);
  const write = pace(() => {
    showRun(app);
    showChosen(app);
    recorder.show();
  }, READABLE);
  let mark = null;
  run(app, () => {
    const isMoving = isNew && app.engine.last.running;
    if (isNew) {
      isNew = false;
      app.changed();
      const { running, status } = app.engine.last;
      const now = `${running} ${status} ${app.pull !== null} ${app.chosen?.member} ${app.chosen?.node}`;
      const isUrgent = now !== mark || !running;
      mark = now;
      queueMicrotask(() => write(isUrgent));
    }
    return isMoving;
  });
  app.rescale = () => {
    widenScales(app.colorings, model, spreadTension(model, app.engine.last.tension), scene.engine.usual_force, true);
    app.changed();
    showScale(app);
  };
  app.moreKeys = { n: () => app.singleStep(), s: () => app.rescale(), Backspace: () => app.restart() };
  listenToKeys(app);
  app.moreHooks = {
    advance: (time) => app.engine.ask("advance", { time }),
    order: (order, more) => app.engine.ask(order, more),
    get run() {
      return app.engine.last;
    },
  };
  exposeHook(app);
  showRun(app);
}

/** What the worker must know: the description, with the values of the scene by the names of arguments. */
function describe(model) {
  const { engine } = model.scene;
  const list = (name) => Array.from(model.channels[name].values);
  const nominal = Object.fromEntries(Object.keys(engine.sizes).map((name) => [name, list(`nominal_${name}`)]));
  return { ...engine, nominal, coordinate_place: list("coordinate_place"), stated_position: list("stated_position") };
}

/** Put the last state of the worker into the picture. Members of bodies that are not in the library stay unknown. */
function readLast(app) {
  const { model, state } = app;
  const { nodes, tension, time } = app.engine.last;
  state.time = time;
  for (let i = 0; i < nodes.length; i++) state.nodes[i] = nodes[i] - model.origin[i % 3];
  state.tension.fill(NaN);
  state.tension.set(spreadTension(model, tension));
  state.reaction?.fill(NaN);
  measure(model, state);
}

/** What keys and buttons call; the names are those of a recorded motion. */
function playerOf(app) {
  const player = {
    duration: 0,
    get isPlaying() {
      return Boolean(app.engine.last?.running);
    },
    play: () => app.engine.send("run", { isOn: true }),
    pause: () => app.engine.send("run", { isOn: false }),
    toggle: () => (player.isPlaying ? player.pause() : player.play()),
    seek: () => {},
    seekFrame: () => {},
    frame: 0,
  };
  return player;
}
