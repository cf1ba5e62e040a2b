// The last seconds of a running model, for the diagrams.

import { spreadTension } from "live/model";
import { buildPlot, writeLegend } from "live/plots";

const SPAN = 12; // seconds
const LINES = 4;
const ROUNDING = 1e-9; // of the energy

export function buildRecorder(app) {
  const { model } = app;
  const byId = (id) => document.getElementById(id);
  const times = [0];
  const rows = { kinetic: [], potential: [], total: [] };
  const tensions = [];
  const options = (unit, describe) => ({ times, unit, describe, seek: () => {} });
  const energy = buildPlot(byId("energy"), byId("energy-legend"), options("J", "energy of the last seconds"));
  const tension = buildPlot(byId("tension"), byId("tension-legend"), options("N", "tension of the last seconds"));
  byId("tension-note").textContent = "the largest";
  let members = chooseMembers(app, app.engine.last);
  const series = () => {
    const { lines, css } = app.palette;
    energy.palette = tension.palette = app.palette;
    energy.series = [
      { name: "kinetic", values: rows.kinetic, color: lines[0] },
      { name: "potential", values: rows.potential, color: lines[1] },
      { name: "total", values: rows.total, color: css.ink, dash: [6, 3] },
    ];
    tension.series = members.map((e, k) => ({
      name: model.memberNames[e], values: tensions.map((row) => row[e]), color: lines[k],
    }));
  };
  const legends = () => {
    series();
    writeLegend(energy);
    writeLegend(tension);
  };
  const recorder = {
    add(state) {
      if (!rows.kinetic.length) times.length = 0;
      // Back to the start, or the same moment with other values
      while (times.length && state.time <= times.at(-1)) for (const list of [times, ...Object.values(rows), tensions]) list.pop();
      recorder.largest = Math.max(recorder.largest ?? 0, Math.abs(state.total));
      recorder.start ??= state.total - state.kinetic;
      times.push(state.time);
      rows.kinetic.push(state.kinetic);
      rows.potential.push(state.total - state.kinetic - recorder.start);
      rows.total.push(state.total - recorder.start);
      tensions.push(spreadTension(model, state.tension));
      while (state.time - times[0] > SPAN) for (const list of [times, ...Object.values(rows), tensions]) list.shift();
    },
    show() {
      series();
      for (const plot of [energy, tension]) {
        plot.set(plot.series, plot === energy ? ROUNDING * recorder.largest : 0);
        plot.point(times.at(-1));
        plot.writeValues(times.length - 1);
      }
    },
  };
  app.choiceChanged = () => {
    members = chooseMembers(app, app.engine.last);
    legends();
    recorder.show();
  };
  app.paletteChanged = () => {
    legends();
    recorder.show();
  };
  legends();
  recorder.add(app.engine.last);
  return recorder;
}

/** The members with the largest tensions, a chosen one first. */
function chooseMembers(app, last) {
  const tension = spreadTension(app.model, last.tension);
  const chosen = app.chosen?.member;
  const order = Array.from(tension.keys()).filter((e) => Number.isFinite(tension[e]) && e !== chosen);
  order.sort((a, b) => Math.abs(tension[b]) - Math.abs(tension[a]) || a - b);
  const first = chosen === undefined || chosen >= tension.length ? [] : [chosen];
  return [...first, ...order].slice(0, LINES);
}
