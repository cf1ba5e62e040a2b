// What is said of a member or a node: rows of a name and a value.

import { prefixOf, short, withUnit } from "live/numbers";

/** The force in whose unit loads and reactions are written [N]: the end of the scale. */
const largestForce = ({ peak, scene }) => peak.reduce((most, force) => Math.max(most, force), 0) || scene.largest_load;

/** Rows about a member at the shown moment. */
export function memberFacts(model, state, e) {
  const [i, j] = [model.ends[2 * e], model.ends[2 * e + 1]];
  const tension = state.tension[e];
  const rows = [
    ["nodes", `${model.nodeNames[i]}, ${model.nodeNames[j]}`],
    ["length", withUnit(state.length[e], "m", 5)],
    ["rest length", withUnit(model.restLength[e], "m", 5)],
    ["tension", withUnit(tension, "N", 4)],
    ["force density", withUnit(tension / state.length[e], "N/m", 4)],
  ];
  if (model.area[e] > 0) rows.push(["stress", withUnit(tension / model.area[e], "Pa", 4)]);
  if (state.use && Number.isFinite(state.use[e])) rows.push(["use of capacity", `${short(100 * state.use[e])} %`]);
  if (model.radius[e] > 0) rows.push(["radius", withUnit(model.radius[e], "m")]);
  return rows;
}

/** Rows about a node at the shown moment; positions are those of the scene's own origin. */
export function nodeFacts(model, state, k) {
  const place = [0, 1, 2].map((axis) => state.nodes[3 * k + axis] + model.origin[axis]);
  const rows = ["x", "y", "z"].map((axis, c) => [axis, withUnit(place[c], "m", 6)]);
  const [size, prefix] = prefixOf(largestForce(model));
  const vector = (values) => Array.from(values, (value) => short(value / size)).join(", ");
  const load = model.load.slice(3 * k, 3 * k + 3);
  if (load.some((value) => value !== 0)) rows.push([`load [${prefix}N]`, vector(load)]);
  const held = ["x", "y", "z"].filter((_, axis) => model.anchored[3 * k + axis]);
  if (held.length) rows.push(["anchored", held.join(", ")]);
  const row = model.held.indexOf(k);
  if (row >= 0 && state.reaction) rows.push([`reaction [${prefix}N]`, vector(state.reaction.slice(3 * row, 3 * row + 3))]);
  return rows;
}

/** What kind of member this is, in a word or two. */
export function memberKind(model, state, e) {
  if (model.isBar[e]) return Number.isNaN(state.tension[e]) ? "bar, tension unknown" : "bar";
  return state.slack[e] ? "cable, slack" : "cable";
}

/** Name, kind and rows of what is picked. */
export function describe(model, state, picked) {
  if (picked.member !== undefined) {
    const e = picked.member;
    return { name: model.memberNames[e], kind: memberKind(model, state, e), rows: memberFacts(model, state, e) };
  }
  return { name: model.nodeNames[picked.node], kind: "node", rows: nodeFacts(model, state, picked.node) };
}

/** Write a description into an element. */
export function writeFacts(place, { name, kind, rows }) {
  const head = document.createElement("h3");
  head.textContent = name;
  const sub = document.createElement("small");
  sub.textContent = kind;
  head.append(" ", sub);
  const list = document.createElement("dl");
  for (const [term, value] of rows) {
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    dt.textContent = term;
    dd.textContent = value;
    list.append(dt, dd);
  }
  place.replaceChildren(head, list);
}
