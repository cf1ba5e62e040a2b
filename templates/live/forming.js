// A net that is formed by sliders: force densities, loads, heights of supports; its numbers, and files to take away.

import { widenScales } from "live/coloring";
import { sliderRow } from "live/controls";
import { findShape } from "live/density";
import { measure } from "live/model";
import { short, withUnit } from "live/numbers";
import { showScale } from "live/panel";
import { showChosen } from "live/pointer";
import { download } from "live/saving";

const byId = (id) => document.getElementById(id);
const SHORTEST = 1e-6; // of the size: a shorter member has no direction

/** Connect a page with the sliders of a net; `app.read` then finds the shape. */
export function letForm(app) {
  const { model } = app;
  const { forming, up, axes } = model.scene;
  const values = (name) => model.channels[name].values;
  const start = values("form_position");
  const net = { count: model.nodeCount, ends: model.ends, anchored: model.anchored, axes, order: values("form_order") };
  const load = Float64Array.from(model.load);
  const axis = up.indexOf(1);
  const heights = model.held.filter((node) => model.anchored[3 * node + axis]).map((node) => start[3 * node + axis]);
  const base = Math.min(...heights);
  const factor = { groups: forming.groups.map(() => 1), all: 1, height: 1, load: 1 };
  app.formed = { positions: start, load: 1, problem: "" };

  app.read = () => {
    const density = Float64Array.from(values("form_group"), (k) => forming.groups[k].density * factor.groups[k] * factor.all);
    const held = start.map((value, i) => (i % 3 === axis && model.anchored[i] ? base + factor.height * (value - base) : value));
    const loads = load.map((value) => factor.load * value);
    const force = loads.map((value, i) => value + values("form_weight")[i]);
    const positions = findShape(net, density, held, force);
    const problem = positions ? show(app, positions, density, force) : "force densities of both signs cancel: no shape is determined";
    if (!problem) {
      model.load.set(loads);
      app.formed = { positions, load: factor.load };
    }
    app.formed.problem = problem;
    describe(app);
  };
  const box = byId("sliders");
  const add = (label, range, text, set) =>
    box.append(sliderRow(label, range, text, (value) => {
      set(value);
      app.changed();
    }));
  const tenfold = { low: -1, high: 1, value: 0 };
  const times = (value) => `${short(value)} ×`;
  forming.groups.forEach(({ label, density }, k) =>
    add(label, tenfold, (value) => withUnit(density * 10 ** value, "N/m"), (value) => (factor.groups[k] = 10 ** value)));
  add("prestress", tenfold, (value) => times(10 ** value), (value) => (factor.all = 10 ** value));
  const once = { low: 0, high: 3, value: 1 };
  if (heights.some((height) => height > base)) add("heights", once, times, (value) => (factor.height = value));
  if (load.some((value) => value !== 0)) add("loads", once, times, (value) => (factor.load = value));
  byId("controls-box").hidden = byId("formed").hidden = byId("rescale").hidden = false;
  app.rescale = () => widen(app, true);
  byId("rescale").onclick = app.rescale;
  app.moreKeys = { s: app.rescale };
  const name = model.scene.title.replace(/[^\w.-]+/g, "_");
  const save = { scene: [writeScene, ".toml"], nodes: [writeNodes, "_nodes.csv"], members: [writeMembers, "_members.csv"] };
  for (const [id, [write, ending]] of Object.entries(save)) {
    byId(`save-${id}`).onclick = () => download(new Blob([write(app)], { type: "text/plain" }), `${name}${ending}`);
  }
  app.moreHooks = {
    get formed() {
      app.refresh();
      return { problem: app.formed.problem, scene: writeScene(app), nodes: writeNodes(app), members: writeMembers(app) };
    },
  };
}

/** Put a shape into the state; return what is wrong with it, or "". */
function show(app, positions, density, force) {
  const { model, state } = app;
  const span = (e, c) => positions[3 * model.ends[2 * e + 1] + c] - positions[3 * model.ends[2 * e] + c];
  const length = density.map((_, e) => Math.hypot(span(e, 0), span(e, 1), span(e, 2)));
  const point = length.findIndex((value) => value < SHORTEST * model.size);
  if (point >= 0) return `${model.memberNames[point]} shrinks to a point`;
  const tension = density.map((q, e) => q * length[e]);
  const rest = tension.map((t, e) => restLength(app, e, length[e], t));
  const soft = rest.findIndex((value) => value <= 0);
  if (soft >= 0) return `${model.memberNames[soft]} is too soft for ${withUnit(tension[soft], "N")}`;
  model.restLength.set(rest);
  positions.forEach((value, i) => (state.nodes[i] = value - model.origin[i % 3]));
  state.tension.set(tension);
  const sum = Float64Array.from(force);
  for (let e = 0; e < density.length; e++) {
    for (let c = 0; c < 3; c++) {
      sum[3 * model.ends[2 * e] + c] += density[e] * span(e, c);
      sum[3 * model.ends[2 * e + 1] + c] -= density[e] * span(e, c);
    }
  }
  model.held.forEach((node, k) => {
    for (let c = 0; c < 3; c++) state.reaction[3 * k + c] = model.anchored[3 * node + c] ? -sum[3 * node + c] : 0;
  });
  measure(model, state);
  widen(app, false);
  return "";
}

/** The rest length with which a member has a tension at a length; NaN of laws that are not linear. */
function restLength({ model }, e, length, tension) {
  const stiffness = model.channels.axial_stiffness.values[e];
  const spring = model.channels.spring_constant.values[e];
  if (Number.isNaN(spring)) return NaN;
  if (stiffness > 0) return tension > -stiffness ? (length * stiffness) / (stiffness + tension) : 0;
  return spring > 0 ? length - tension / spring : length;
}

function widen(app, isNew) {
  widenScales(app.colorings, app.model, app.state.tension, 1, isNew);
  if (isNew) app.changed();
  showScale(app);
}

/** Write the numbers of the shape beside the picture. */
function describe(app) {
  const { model, state, formed } = app;
  const axis = model.scene.up.indexOf(1);
  const height = (k) => formed.positions[3 * k + axis];
  const free = Array.from(model.nodeNames.keys()).filter((k) => !model.anchored[3 * k + axis]).sort((a, b) => height(a) - height(b));
  const place = (k) => `${withUnit(height(k), "m")}, ${model.nodeNames[k]}`;
  const force = (e) => `${withUnit(state.tension[e], "N")}, ${model.memberNames[e]}`;
  const order = Array.from(state.tension.keys()).sort((a, b) => state.tension[a] - state.tension[b]);
  const reactions = model.held.map((_, k) => Math.hypot(...state.reaction.slice(3 * k, 3 * k + 3)));
  const most = reactions.indexOf(Math.max(...reactions));
  const rows = [
    ["largest force", force(order.at(-1))],
    ["least force", force(order[0])],
    ...(free.length ? [["highest node", place(free.at(-1))], ["lowest node", place(free[0])]] : []),
    ["length in all", withUnit(state.length.reduce((sum, value) => sum + value, 0), "m", 4)],
  ];
  if (most >= 0) rows.push(["reaction up to", `${withUnit(reactions[most], "N")}, ${model.nodeNames[model.held[most]]}`]);
  byId("form-problem").hidden = !formed.problem;
  byId("form-problem").textContent = formed.problem && `${formed.problem}; the last shape is shown.`;
  byId("form-facts").replaceChildren(...rows.flatMap(([term, value]) => {
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    dt.textContent = term;
    dd.textContent = value;
    return [dt, dd];
  }));
  showChosen(app);
}

const placeOf = ({ formed }, k) => Array.from(formed.positions.slice(3 * k, 3 * k + 3));

/** The scene in the present shape: positions, prestress and loads in its document, as TOML. */
function writeScene(app) {
  const { model, state, formed } = app;
  const scene = structuredClone(model.scene.forming.document);
  model.nodeNames.forEach((name, k) => (scene.nodes[name].position = placeOf(app, k)));
  model.memberNames.forEach((name, e) => {
    const member = scene.members[name];
    const isRigid = !model.channels.axial_stiffness.values[e] && model.channels.spring_constant.values[e] === 0;
    delete member.rest_length;
    if (isRigid) member.rest_length = state.length[e];
    else member.prestress = state.tension[e];
  });
  for (const item of scene.loads ?? []) item.force = item.force.map((value) => formed.load * value);
  const isTable = (value) => typeof value === "object" && !Array.isArray(value);
  const parts = Object.entries(scene);
  const plain = parts.filter(([, value]) => !isTable(value)).map(pair);
  const tables = parts.filter(([, value]) => isTable(value));
  return [...plain, ...tables.map(([key, value]) => `\n[${key}]\n${Object.entries(value).map(pair).join("\n")}`), ""].join("\n");
}

const pair = ([key, value]) => `${/^[\w-]+$/.test(key) ? key : JSON.stringify(key)} = ${toml(value)}`;

function toml(value) {
  if (Array.isArray(value)) return `[${value.map(toml).join(", ")}]`;
  if (typeof value === "object") return `{ ${Object.entries(value).map(pair).join(", ")} }`;
  return JSON.stringify(value);
}

const table = (rows) => rows.map((row) => row.map(cell).join(",")).join("\n") + "\n";
const cell = (value) => (/[",\n]/.test(value) ? `"${value.replaceAll('"', '""')}"` : value);

/** Nodes as the verb `import` reads them. */
function writeNodes(app) {
  const { model } = app;
  const held = (k) => ["x", "y", "z"].filter((_, axis) => model.anchored[3 * k + axis]).join("");
  const rows = model.nodeNames.map((name, k) => [name, ...placeOf(app, k), held(k), ...model.load.slice(3 * k, 3 * k + 3)]);
  return table([["node", "x", "y", "z", "anchored", "fx", "fy", "fz"], ...rows]);
}

/** Members with their numbers. */
function writeMembers({ model, state }) {
  const rows = model.memberNames.map((name, e) => [
    name, model.isBar[e] ? "bar" : "cable", model.nodeNames[model.ends[2 * e]], model.nodeNames[model.ends[2 * e + 1]],
    state.length[e], model.restLength[e], state.tension[e], state.tension[e] / state.length[e],
  ]);
  return table([["member", "kind", "node_i", "node_j", "length [m]", "rest_length [m]", "tension [N]", "force_density [N/m]"], ...rows]);
}
