// The linked diagrams of a recorded motion: energies, and tensions of a few members.

import { buildPlot, writeLegend } from "live/plots";

const LINES = 5; // members that have a line at once
const ROUNDING = 1e-9; // of the energy: what is smaller is noise of the integration
const SAME = 0.015; // of the largest tension: lines that are nearer to each other are one
const MOST_TRIED = 400;

export function buildDiagrams(app) {
  const { model, player } = app;
  const box = document.getElementById("diagrams");
  if (model.frameCount < 2) {
    box.hidden = true;
    return null;
  }
  const byId = (id) => document.getElementById(id);
  const seek = (time) => {
    player.pause();
    player.seek(time);
  };
  const times = Array.from(model.time);
  const plots = {};
  if (model.channels.kinetic_energy) {
    plots.energy = buildPlot(byId("energy"), byId("energy-legend"), { times, unit: "J", describe: "energy over time", seek });
  } else byId("energy-box").hidden = true;
  plots.tension = buildPlot(byId("tension"), byId("tension-legend"), { times, unit: "N", describe: "tension over time", seek });
  const busiest = largestMembers(model);
  byId("tension-note").textContent = "of members where it varies most";
  const fill = () => {
    const { palette } = app;
    for (const plot of Object.values(plots)) plot.palette = palette;
    plots.energy?.set(energies(model, palette), ROUNDING * largestEnergy(model));
    plots.tension.set(tensions(model, palette, busiest, app.chosen?.member));
    for (const plot of Object.values(plots)) writeLegend(plot);
  };
  app.paletteChanged = fill;
  app.choiceChanged = fill;
  fill();
  return {
    point() {
      for (const plot of Object.values(plots)) plot.point(player.shown);
    },
    writeValues() {
      for (const plot of Object.values(plots)) plot.writeValues(app.state.frame);
    },
  };
}

const largestEnergy = ({ channels }) =>
  channels.total_energy.column(0).reduce((most, value) => Math.max(most, Math.abs(value)), 0);

function energies(model, palette) {
  const kinetic = model.channels.kinetic_energy.column(0);
  const total = model.channels.total_energy.column(0);
  const start = total[0] - kinetic[0];
  const potential = total.map((value, k) => value - kinetic[k] - start);
  const [blue, vermilion] = palette.lines;
  return [
    { name: "kinetic", values: kinetic, color: blue },
    { name: "potential", values: potential, color: vermilion },
    { name: "total", values: total.map((value) => value - total[0]), color: palette.css.ink, dash: [6, 3] },
  ];
}

/** The members whose tensions vary most, a chosen one first. */
function tensions(model, palette, busiest, chosen) {
  const members = chosen === undefined ? busiest : [chosen, ...busiest.filter((e) => e !== chosen)].slice(0, LINES);
  return members.map((e, k) => ({
    name: model.memberNames[e], values: model.tension.column(e), color: palette.lines[k % palette.lines.length],
  }));
}

function largestMembers(model) {
  const { tension, memberCount } = model;
  const low = new Float64Array(memberCount).fill(Infinity);
  const high = new Float64Array(memberCount).fill(-Infinity);
  const row = new Float64Array(memberCount);
  const step = Math.max(1, Math.floor(tension.rows / 200));
  for (let k = 0; k < tension.rows; k += step) {
    tension.read(k, row);
    for (let e = 0; e < memberCount; e++) {
      if (row[e] < low[e]) low[e] = row[e];
      if (row[e] > high[e]) high[e] = row[e];
    }
  }
  const known = Array.from({ length: memberCount }, (_, e) => e).filter((e) => high[e] >= low[e]);
  known.sort((a, b) => high[b] - low[b] - (high[a] - low[a]) || a - b);
  return chooseDistinct(known, tension);
}

/** The first members whose lines can be told apart: symmetric structures have many that lie on each other. */
function chooseDistinct(order, tension) {
  const rows = Array.from({ length: Math.min(tension.rows, 40) }, (_, k) => Math.floor((k * tension.rows) / Math.min(tension.rows, 40)));
  const courseOf = (e) => rows.map((k) => tension.at(k, e));
  const chosen = [];
  const courses = [];
  let size = 0;
  for (const e of order.slice(0, MOST_TRIED)) {
    const course = courseOf(e);
    size ||= Math.max(...course.map(Math.abs));
    if (courses.some((other) => other.every((value, k) => Math.abs(value - course[k]) <= SAME * size))) continue;
    chosen.push(e);
    courses.push(course);
    if (chosen.length === LINES) break;
  }
  return chosen;
}
