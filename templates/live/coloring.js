// What members are coloured by: a value for each member, a scale, and the numbers at its ends.

const largest = (values) => {
  let most = 0;
  for (const value of values) if (Number.isFinite(value)) most = Math.max(most, Math.abs(value));
  return most;
};

/** Write a value for each member into `out`, which it returns. */
function fill(out, valueOf) {
  for (let e = 0; e < out.length; e++) out[e] = valueOf(e);
  return out;
}

/** The ways to colour the members of a model, by name. */
export function buildColorings(model) {
  const { area, use, peak } = model;
  const scale = model.tensionOnly.every(Boolean) ? "onesided" : "diverging"; // nets of cables know no compression
  const found = { kind: { label: "kind", unit: "", scale: null, values: () => null } };
  found.tension = {
    label: "tension", meaning: scale === "diverging" ? "tension, compression negative" : "tension", unit: "N", scale,
    limit: largestRatio(peak, null),
    values: (state) => state.tension,
  };
  found.density = {
    label: "force density", unit: "N/m", scale, limit: largestRatio(peak, model.restLength),
    values: (state, out) => fill(out, (e) => state.tension[e] / state.length[e]),
  };
  if (area.some((value) => value > 0)) {
    const stress = (state, out) => fill(out, (e) => (area[e] > 0 ? state.tension[e] / area[e] : NaN));
    found.stress = { label: "stress", unit: "Pa", scale, limit: largestRatio(peak, area), values: stress };
  }
  if (use) {
    found.use = { label: "use of capacity", meaning: "used part of the limits", unit: "", scale: "sequential", limit: 1, over: true, values: (state) => state.use };
  }
  if (model.shapes.length) {
    found.mode = { label: "motion in the mode", meaning: "motion, 100 % is the largest of a node", unit: "", scale: "sequential", limit: 1, values: modeValues };
  }
  return found;
}

/** Widen the scales of a running model for tensions that its first picture did not know, or let them reach just these;
    `usual` [N] where all are 0. */
export function widenScales(colorings, model, tension, usual, isNew = false) {
  const isKnown = largest(tension) > 0 || (!isNew && colorings.tension.limit > 0);
  const shown = isKnown ? tension : new Float64Array(tension.length).fill(usual);
  for (const [name, divisor] of [["tension", null], ["density", model.restLength], ["stress", model.area]]) {
    const coloring = colorings[name];
    if (coloring) coloring.limit = Math.max(isNew ? 0 : coloring.limit, largestRatio(shown, divisor));
  }
}

/** The largest known tension over a number of its member, such as its area; numbers that are 0 are left out. */
function largestRatio(tension, divisor) {
  let most = 0;
  for (let e = 0; e < tension.length; e++) {
    const value = Math.abs(tension[e]) / (divisor ? divisor[e] : 1);
    if (Number.isFinite(value) && value > most) most = value;
  }
  return most;
}

/** How far the middle of each member moves in the shown mode, the largest node moving by 1. */
function modeValues(state, out) {
  const { shape, ends } = state;
  if (!shape) return out.fill(NaN);
  return fill(out, (e) => {
    const i = 3 * ends[2 * e];
    const j = 3 * ends[2 * e + 1];
    return Math.hypot(shape[i] + shape[j], shape[i + 1] + shape[j + 1], shape[i + 2] + shape[j + 2]) / 2;
  });
}

/** Write the colours (r, g, b, style) of all members; style 255 is a full line, 0 a dashed one. Returns whether values lie
    beyond the scale, which its ends then say. */
export function paintMembers(out, coloring, state, model, palette, scratch) {
  const values = coloring.values(state, scratch);
  const scale = coloring.scale && palette[coloring.scale];
  const isDiverging = coloring.scale === "diverging";
  const limit = coloring.limit > 0 ? coloring.limit : 1;
  let isBeyond = false;
  for (let e = 0; e < model.memberCount; e++) {
    const place = 4 * e;
    let color = model.isBar[e] ? palette.bar : palette.cable;
    let first = 0;
    if (values) {
      const part = isDiverging ? 0.5 + (0.5 * values[e]) / limit : values[e] / limit;
      if (Number.isNaN(values[e])) color = palette.unknown;
      else if (coloring.over && part > 1 + 1e-9) color = palette.over;
      else {
        isBeyond ||= Math.abs(values[e]) > 1.02 * limit;
        color = scale;
        first = 3 * Math.round(255 * Math.min(Math.max(part, 0), 1));
      }
    }
    if (state.slack[e]) {
      color = palette.slack;
      first = 0;
    }
    out[place] = color[first];
    out[place + 1] = color[first + 1];
    out[place + 2] = color[first + 2];
    out[place + 3] = state.slack[e] ? 0 : 255;
  }
  return isBeyond;
}
