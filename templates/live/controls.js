// Controls of a running model: run, step, restart, speed, inputs, parameters, gravity, damping, the clock.

import { fillSelect } from "live/panel";
import { short, withUnit } from "live/numbers";

const byId = (id) => document.getElementById(id);
const SPEEDS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2];
const STEP = 1 / 60; // seconds of a single step

export function connectControls(app) {
  const { engine } = app;
  byId("transport").hidden = false;
  byId("time").hidden = true;
  byId("run-facts").hidden = byId("step").hidden = byId("restart").hidden = false;
  byId("controls-box").hidden = byId("start").hidden = byId("rescale").hidden = false;
  byId("rescale").onclick = () => app.rescale();
  app.singleStep = () => engine.send("advance", { time: engine.last.time + STEP });
  app.restart = () => engine.send("reset");
  byId("play").onclick = () => app.player.toggle();
  byId("step").onclick = app.singleStep;
  byId("restart").onclick = app.restart;
  const speed = byId("speed");
  fillSelect(speed, SPEEDS.map((value) => [value, `${short(value)} ×`]));
  speed.value = 1;
  speed.onchange = () => engine.send("speed", { speed: Number(speed.value) });
  connectMethods(engine);
  const box = byId("sliders");
  for (const slider of engine.described.sliders) box.append(buildSlider(app, slider));
  box.append(pullSlider(app));
}

const METHODS = { rk54: "rk54, explicit", radau: "radau, for stiff bars" };

/** The choice of the integrator, where the module has more than one. */
function connectMethods({ described, send }) {
  const select = byId("method");
  byId("method-row").hidden = described.methods.length < 2;
  fillSelect(select, described.methods.map(({ name }) => [name, METHODS[name] ?? name]));
  select.value = described.method;
  select.onchange = () => send("method", { name: select.value });
}

/** One slider: a number of an argument, or a factor of several. */
function buildSlider(app, slider) {
  const { engine } = app;
  const nominal = app.model.channels[`nominal_${slider.argument}`].values;
  const values = (app.values ??= {});
  values[slider.argument] ??= Float64Array.from(nominal);
  const show = (value) => (slider.unit ? withUnit(value, slider.unit) : `${short(value)} ×`);
  return sliderRow(slider.label, slider, show, (value) => {
    const now = values[slider.argument];
    for (const place of slider.places) now[place] = slider.is_factor ? value * (nominal[place] || slider.base) : value;
    engine.send("set", { name: slider.argument, values: Array.from(now) });
  });
}

function pullSlider(app) {
  const range = { low: -1.5, high: 1.5, value: 0 };
  return sliderRow("pull", range, (value) => `${short(10 ** value, 2)} ×`, (value) => (app.pullStrength = 10 ** value));
}

/** A slider with its label and value; a double click sets the value of the scene. */
export function sliderRow(label, { low, high, value }, show, call) {
  const row = document.createElement("label");
  const name = document.createElement("span");
  const input = document.createElement("input");
  const output = document.createElement("output");
  name.textContent = name.title = label;
  Object.assign(input, { type: "range", min: low, max: high, step: "any", value });
  input.dataset.name = label;
  output.textContent = show(value);
  const change = () => {
    const chosen = Number(input.value);
    output.textContent = show(chosen);
    call(chosen);
  };
  input.oninput = change;
  row.ondblclick = () => {
    input.value = value;
    change();
  };
  row.title = "double click: the value of the scene";
  row.append(name, input, output);
  return row;
}

const pace = (speed) => (speed < 0.1 ? short(speed, 2) : speed.toFixed(2));

/** What to try where the model runs slower than it should. */
function adviceOf({ engine }) {
  const others = engine.described.methods.filter(({ name }) => name !== engine.last.method);
  return others.length ? `too slow here: try the method ${others[0].name}` : "this machine is too slow";
}

/** Show the clock: simulated time, and how fast it runs against the wall. */
export function showRun(app) {
  const { last, failure } = app.engine;
  byId("clock").textContent = `${last.time.toFixed(2)} s`;
  byId("play").setAttribute("aria-label", last.running ? "pause" : "play");
  byId("play").classList.toggle("playing", last.running);
  if (last.running || last.time > 0) byId("start").hidden = true;
  const facts = byId("run-facts");
  const wished = Number(byId("speed").value);
  const isBehind = last.speed !== null && last.speed < 0.93 * wished;
  const isStopped = last.status !== 0 || Boolean(failure);
  facts.classList.toggle("stopped", isStopped);
  facts.classList.toggle("behind", isBehind || isStopped);
  if (failure) facts.textContent = `stopped: ${failure}`;
  else if (last.status !== 0) facts.textContent = `stopped at ${last.time.toFixed(4)} s, ${last.text}; restart begins again`;
  else if (!last.running) facts.textContent = "paused";
  else if (last.speed === null) facts.textContent = "running";
  else facts.textContent = `${pace(last.speed)} × real time${isBehind ? `, ${adviceOf(app)}` : ""}`;
  facts.title = `${last.method}: ${last.steps} steps, ${last.rejected} rejected`;
  if (app.pull) facts.textContent += `, pulled by ${withUnit(last.force, "N")}`;
}
