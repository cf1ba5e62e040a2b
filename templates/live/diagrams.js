// The linked diagrams of a recorded motion: energies, and tensions of a few members.

import { buildPlot, writeLegend } from "live/plots";

const LINES = 5; // members that have a line at once

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
  const fill = () => {
    const { palette } = app;
    for (const plot of Object.values(plots)) plot.palette = palette;
    plots.energy?.set(energies(model, palette));
    plots.tension.set(tensions(model, palette, busiest, app.chosen?.member));
    for (const plot of Object.values(plots)) writeLegend(plot);
  };
  app.paletteChanged = fill;
  app.choiceChanged = fill;
  fill();
  return {
    show() {
      for (const plot of Object.values(plots)) plot.at(player.shown, app.state.frame);
    },
  };
}

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
  return known.sort((a, b) => high[b] - low[b] - (high[a] - low[a]) || a - b).slice(0, LINES);
}
