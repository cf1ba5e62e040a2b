// The compiled model in a worker: integrates at the pace of the clock, with forces of the pointer. A classic script
// without imports, since import maps do not reach workers.
"use strict";

const BUDGET = 14; // ms of integration between two messages
const SLICE = 1 / 120; // s of the model in one call; shorter while a node is pulled
const PULLED = 1 / 400;
const MOST_STEPS = 20000n; // trial steps of one call
const WINDOW = 1000; // ms over which the speed is measured

let model = null;

/** The module with its memory: arrays by name, and calls of its functions. */
function buildModel(engine, bytes) {
  const instance = new WebAssembly.Instance(new WebAssembly.Module(bytes), {});
  const { exports } = instance;
  exports._initialize();
  let top = Math.ceil(exports.__heap_base.value / 8) * 8;
  const places = {};
  const reserve = (name, count) => {
    places[name] = [top, count];
    top += 8 * Math.max(count, 1);
  };
  const n = engine.sizes.coordinate;
  reserve("state", 2 * n);
  for (const [name, size] of Object.entries(engine.sizes)) reserve(name, size);
  for (const [name, { size }] of Object.entries(engine.functions)) reserve(`out_${name}`, size);
  for (const name of ["time", "step", "n_sampled", "n_accepted", "n_rejected"]) reserve(name, 1);
  reserve("work", engine.work_size);
  const missing = top - exports.memory.buffer.byteLength;
  if (missing > 0) exports.memory.grow(Math.ceil(missing / 65536));
  const arrays = Object.fromEntries(Object.entries(places).map(([name, [address, count]]) => [
    name, new Float64Array(exports.memory.buffer, address, count),
  ]));
  const counts = new BigInt64Array(exports.memory.buffer, places.n_accepted[0], 2);
  const address = (name) => places[name][0];
  return { engine, exports, arrays, counts, address, n };
}

function reset() {
  const { engine, arrays, n } = model;
  for (const [name, values] of Object.entries(engine.nominal)) arrays[name].set(values);
  arrays.state.set(engine.nominal.coordinate, 0);
  arrays.state.set(engine.nominal.velocity, n);
  arrays.time[0] = 0;
  restart();
  model.status = 0;
  model.paces = [];
  model.pull = null;
  Object.assign(model, { steps: 0, rejected: 0, load: Float64Array.from(engine.nominal.node_load) });
}

/** Let the next call choose its first step: something has jumped. */
function restart() {
  model.arrays.step[0] = 0;
}

function compute(name) {
  const { engine, exports, arrays, address, n } = model;
  const { symbol, inputs } = engine.functions[name];
  arrays.coordinate.set(arrays.state.subarray(0, n));
  arrays.velocity.set(arrays.state.subarray(n));
  const status = exports[symbol](...inputs.map(address), address(`out_${name}`));
  return status === 0 ? arrays[`out_${name}`] : arrays[`out_${name}`].fill(NaN);
}

/** Positions of all nodes [m]: stated ones, with the free coordinates in their places. */
function positions() {
  const { engine, arrays } = model;
  if (engine.functions.node_position) return Float64Array.from(compute("node_position"));
  const places = Float64Array.from(engine.stated_position);
  engine.coordinate_place.forEach((place, k) => (places[place] = arrays.state[k]));
  return places;
}

/** Velocities of all nodes [m/s]. */
function velocities() {
  const { engine, arrays, n } = model;
  if (engine.functions.node_velocity) return Float64Array.from(compute("node_velocity"));
  const rates = new Float64Array(engine.stated_position.length);
  engine.coordinate_place.forEach((place, k) => (rates[place] = arrays.state[n + k]));
  return rates;
}

/** Change the velocities by the impulse over `duration` of a spring to the pointer and a damper at the pulled node. As
    an impulse the damper always takes energy, however fast bars vibrate; the motion between impulses is the model's. */
function kick(duration) {
  const { pull, arrays, engine, n } = model;
  const [now, rates] = [positions(), velocities()];
  const row = engine.axes.length * pull.node;
  const before = Float64Array.from(compute("acceleration"));
  engine.axes.forEach((axis, k) => {
    const place = 3 * pull.node + axis;
    arrays.node_load[row + k] += pull.stiffness * (pull.target[axis] - now[place]) - pull.damping * rates[place];
  });
  const after = compute("acceleration");
  for (let k = 0; k < n; k++) arrays.state[n + k] += duration * (after[k] - before[k]);
  arrays.node_load.set(model.load);
}

/** Integrate to a time of the model; returns whether it got there. */
function integrateTo(time, deadline) {
  const { engine, exports, arrays, counts, address } = model;
  while (model.status === 0 && arrays.time[0] < time) {
    const before = arrays.time[0];
    const isPulled = model.pull !== null;
    const end = Math.min(time, before + (isPulled ? PULLED : SLICE));
    if (isPulled) kick((end - before) / 2);
    const status = exports[engine.symbol](
      end, engine.rtol, engine.atol, MOST_STEPS, address("time"), address("step"), address("state"),
      ...engine.arguments.map(address), 0n, 0, 0, address("n_sampled"), address("n_accepted"), address("n_rejected"),
      address("work"),
    );
    model.steps += Number(counts[0]);
    model.rejected += Number(counts[1]);
    if (status !== 0) model.status = status;
    if (isPulled && model.status === 0) kick((arrays.time[0] - before) / 2);
    if (performance.now() > deadline) break;
  }
  return arrays.time[0] >= time;
}

/** Post the present state; `answer` is the number of the request that asked for it. */
function report(answer) {
  const { engine, arrays } = model;
  const nodes = positions();
  const tension = Float64Array.from(compute("member_tension"));
  const [kinetic, total] = ["kinetic_energy", "total_energy"].map((name) => compute(name)[0]);
  const force = model.pull ? forceOf(model.pull, nodes) : 0;
  postMessage({
    answer, nodes, tension, kinetic, total, force, time: arrays.time[0], status: model.status,
    text: engine.statuses[model.status] ?? `status ${model.status}`, speed: measureSpeed(), running: model.running,
    steps: model.steps, rejected: model.rejected,
  }, [nodes.buffer, tension.buffer]);
}

const forceOf = (pull, nodes) =>
  pull.stiffness * Math.hypot(...model.engine.axes.map((axis) => pull.target[axis] - nodes[3 * pull.node + axis]));

/** Simulated seconds a second of the wall, over the last second; null while nothing runs. */
function measureSpeed() {
  const { paces } = model;
  if (!model.running || paces.length < 2) return null;
  const [first, last] = [paces[0], paces[paces.length - 1]];
  return last.wall > first.wall ? (1000 * (last.time - first.time)) / (last.wall - first.wall) : null;
}

function tick() {
  if (!model.running) return;
  const wall = performance.now();
  const wished = model.base.time + ((wall - model.base.wall) / 1000) * model.speed;
  const isThere = integrateTo(wished, wall + BUDGET);
  const now = performance.now();
  const time = model.arrays.time[0];
  if (!isThere) model.base = { wall: now, time }; // what was missed is not made up for
  model.paces.push({ wall: now, time });
  while (now - model.paces[0].wall > WINDOW) model.paces.shift();
  if (model.status !== 0) model.running = false;
  report(null);
  setTimeout(tick, isThere ? 8 : 0);
}

function run(isOn) {
  const starts = isOn && !model.running && model.status === 0;
  model.running = isOn && model.status === 0;
  model.base = { wall: performance.now(), time: model.arrays.time[0] };
  model.paces = [];
  if (starts) tick();
}

const ORDERS = {
  build({ engine, bytes }) {
    model = { ...buildModel(engine, bytes), running: false, speed: 1 };
    reset();
  },
  run: ({ isOn }) => run(isOn),
  speed({ speed }) {
    model.speed = speed;
    run(model.running);
  },
  set({ name, values }) {
    if (name === "node_load") model.load.set(values);
    model.arrays[name].set(values);
    restart();
  },
  pull({ pull }) {
    model.pull = pull;
  },
  reset() {
    run(false);
    const { engine } = model;
    const kept = engine.changeable.map((name) => [name, Float64Array.from(model.arrays[name])]);
    const load = model.load;
    reset();
    for (const [name, values] of kept) model.arrays[name].set(values);
    model.load = load;
  },
  advance({ time }) {
    run(false);
    while (model.status === 0 && !integrateTo(time, Infinity));
  },
  state() {},
};

onmessage = ({ data }) => {
  ORDERS[data.order](data);
  if (data.order !== "build" || data.answer) report(data.answer ?? null);
};
