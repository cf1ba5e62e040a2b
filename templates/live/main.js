// Start: a structure, a recorded motion, or a running model.

import { buildDiagrams } from "live/diagrams";
import { letForm } from "live/forming";
import { exposeHook } from "live/hook";
import { listenToKeys } from "live/keyboard";
import { buildModel, readState } from "live/model";
import { short } from "live/numbers";
import { pace } from "live/pace";
import { buildPanel, showClock } from "live/panel";
import { buildPlayer } from "live/player";
import { listenToPointer, showChosen } from "live/pointer";
import { buildViewer, run, update } from "live/viewer";

const FAR = 4; // sizes of the structure above which a motion is too large for one view of it
const READABLE = 120; // ms between changes of numbers while the motion plays

export async function start(scene, buffers) {
  if (scene.engine) {
    const { startPlay } = await import("live/play");
    return startPlay(scene, buffers);
  }
  const model = buildModel(scene, buffers);
  const app = buildViewer(model, (viewer) => readState(model, viewer.state, viewer.time));
  app.player = buildPlayer(model, app.changed);
  app.moves = model.frameCount > 1;
  app.digits = digitsOf(model);
  Object.defineProperty(app, "time", { get: () => app.player.shown });
  buildPanel(app);
  listenToPointer(app);
  const diagrams = buildDiagrams(app);
  readState(model, app.state, app.time);
  if (scene.forming) letForm(app);
  app.colorBy(app.coloringName);
  app.stage.resize();
  update(app);
  app.reset();
  const first = scene.start ?? {};
  if (first.labels && first.labels !== "none") app.labelBy(first.labels);
  if (first.follow) app.followBy(true);
  else if (model.reach > FAR * model.size) followFar(app);
  const write = pace(() => {
    diagrams?.writeValues();
    showChosen(app);
  }, READABLE);
  let shown = null;
  run(app, (seconds) => {
    const isMoving = app.player.advance(seconds);
    app.filmEnds?.();
    if (app.modes.chosen !== null) app.modes.advance(seconds);
    const mark = `${app.player.shown} ${app.chosen?.member} ${app.chosen?.node} ${app.player.isPlaying} ${app.palette.isDark}`;
    if (mark !== shown) {
      shown = mark;
      queueMicrotask(() => {
        showClock(app);
        diagrams?.point();
        write(!app.player.isPlaying);
      });
    }
    return isMoving || app.modes.chosen !== null;
  });
  listenToKeys(app);
  exposeHook(app);
}

/** Let the camera follow a motion that is far larger than the structure, and say so. */
function followFar(app) {
  app.followBy(true);
  const note = document.getElementById("follow-note");
  note.textContent = `The motion is ${short(app.model.reach / app.model.size, 2)} times as large as the structure: the camera follows it.`;
  note.hidden = false;
}

/** Decimals of the clock that tell samples apart. */
function digitsOf(model) {
  if (model.frameCount < 2) return 3;
  const step = (model.time.at(-1) - model.time[0]) / (model.frameCount - 1);
  return Math.min(Math.max(Math.ceil(-Math.log10(step)), 0), 6);
}
