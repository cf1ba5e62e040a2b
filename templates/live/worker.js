// The compiled model in a worker: integrates at the pace of the clock, with forces of the pointer. A classic script
// without imports, since import maps do not reach workers.
"use strict";

const BUDGET = 14; // ms of integration between two messages
const SLICE = 1 / 120; // s of the model in one call; shorter while a node is pulled
const PULLED = 1 / 400;
const CALL = 8; // ms that one call may take: its number of steps follows from what steps have taken
const MOST_STEPS = 20000; // trial steps of one call
const BACKLOG = 0.15; // s of the wall that are made up for after a pause of the machine
const WINDOW = 1000; // ms over which the speed is measured

const COUNTS = 6;

const FARTHEST = 1e6; // sizes of the structure; a motion that goes farther has lost its meaning
const UNSTABLE = -1; // status of the page itself; the others are those of the C library

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
  for (const name of ["time", "step", "n_sampled", "sample_time"]) reserve(name, 1);
  reserve("counts", COUNTS);
  reserve("vibration", 3);
  reserve("sample_state", 2 * n);
  reserve("sample_tension", Math.max(...engine.methods.map((method) => method.tensions.length)));
  reserve("work", Math.max(...engine.methods.map((method) => method.work_size)));
  const missing = top - exports.memory.buffer.byteLength;
  if (missing > 0) exports.memory.grow(Math.ceil(missing / 65536));
  const arrays = Object.fromEntries(Object.entries(places).map(([name, [address, count]]) => [
    name, new Float64Array(exports.memory.buffer, address, count),
  ]));
  const counts = new BigInt64Array(exports.memory.buffer, places.counts[0], COUNTS);
  const sampled = new BigInt64Array(exports.memory.buffer, places.n_sampled[0], 1);
  const address = (name) => places[name][0];
  const method = engine.methods.find(({ name }) => name === engine.method);
  return { engine, exports, arrays, counts, sampled, address, n, method, pace: 0.05 };
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
  model.counts.fill(0n);
  model.hasTensions = false;
}

/** One call of the integrator; counts its steps. The implicit method computes the tensions of stiff members,
    which positions cannot tell. */
function integrate(end, isTimed) {
  const { engine, exports, arrays, counts, sampled, address, method } = model;
  const before = [counts[0], counts[1] + counts[2]];
  const most = isTimed ? Math.min(MOST_STEPS, Math.max(4, Math.round(CALL / model.pace))) : MOST_STEPS;
  const head = [end, engine.rtol, engine.atol, BigInt(most), address("time"), address("step"), address("state"),
    ...method.arguments.map(address)];
  const start = performance.now();
  let status = 0;
  if (method.is_stiff) {
    arrays.sample_time[0] = end;
    sampled[0] = 0n;
    status = exports[method.symbol](...head, 1n, address("sample_time"), address("sample_state"),
      address("sample_tension"), address("n_sampled"), address("counts"), address("vibration"), address("work"));
    model.hasTensions = sampled[0] === 1n;
  } else {
    before.fill(0n);
    counts.fill(0n);
    status = exports[method.symbol](...head, 0n, 0, 0, address("n_sampled"), address("counts"),
      address("counts") + 8, address("work"));
  }
  const [steps, rejected] = [Number(counts[0] - before[0]), Number(counts[1] + counts[2] - before[1])];
  model.steps += Math.max(steps, 0);
  model.rejected += Math.max(rejected, 0);
  const tried = Math.max(steps + rejected, 1);
  model.pace += 0.3 * ((performance.now() - start) / tried - model.pace); // ms of a step
  return status;
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
  if (model.method.is_stiff) restart();
}

/** Integrate to a time of the model; returns whether it got there. */
function integrateTo(time, deadline) {
  const { arrays } = model;
  while (model.status === 0 && arrays.time[0] < time) {
    const before = arrays.time[0];
    const isPulled = model.pull !== null;
    const end = Math.min(time, before + (isPulled ? PULLED : SLICE));
    if (isPulled) kick((end - before) / 2);
    const status = integrate(end, deadline < Infinity);
    if (status !== 0) model.status = status;
    if (isPulled && model.status === 0) kick((arrays.time[0] - before) / 2);
    if (performance.now() > deadline) break;
  }
  return arrays.time[0] >= time;
}

/** Stop a motion that has left all bounds, before its numbers become infinite. */
function checkBounds(nodes, total) {
  if (model.status !== 0 || !model.running) return;
  const { stated_position: stated, size } = model.engine;
  const isNear = (value, i) => Math.abs(value - stated[i]) < FARTHEST * size;
  if (Number.isFinite(total) && nodes.every(isNear)) return;
  model.status = UNSTABLE;
  model.running = false;
}

const textOf = ({ engine, status }) =>
  status === UNSTABLE ? "unstable: the motion has left all bounds" : engine.statuses[status] ?? `status ${status}`;

/** Post the present state; `answer` is the number of the request that asked for it. */
function report(answer) {
  const { arrays } = model;
  const nodes = positions();
  const tension = Float64Array.from(compute("member_tension"));
  if (model.hasTensions) model.method.tensions.forEach((member, k) => (tension[member] = arrays.sample_tension[k]));
  const [kinetic, total] = ["kinetic_energy", "total_energy"].map((name) => compute(name)[0]);
  checkBounds(nodes, total);
  const force = model.pull ? forceOf(model.pull, nodes) : 0;
  postMessage({
    answer, nodes, tension, kinetic, total, force, time: arrays.time[0], status: model.status,
    text: textOf(model), speed: measureSpeed(), running: model.running,
    steps: model.steps, rejected: model.rejected, method: model.method.name,
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

function tick(loop) {
  if (!model.running || loop !== model.loop) return;
  const wall = performance.now();
  const wished = model.base.time + ((wall - model.base.wall) / 1000) * model.speed;
  const isThere = integrateTo(wished, wall + BUDGET);
  const now = performance.now();
  const time = model.arrays.time[0];
  const late = (model.base.time - time) / model.speed + (now - model.base.wall) / 1000;
  if (late > BACKLOG) model.base = { wall: now - 1000 * BACKLOG, time }; // what was missed before is not made up for
  model.paces.push({ wall: now, time });
  while (now - model.paces[0].wall > WINDOW) model.paces.shift();
  if (model.status !== 0) model.running = false;
  report(null);
  if (isThere) setTimeout(tick, 8, loop);
  else next.port2.postMessage(loop); // without the least delay of timers
}

const next = new MessageChannel();
next.port1.onmessage = ({ data }) => tick(data);

function run(isOn) {
  const starts = isOn && !model.running && model.status === 0;
  model.running = isOn && model.status === 0;
  model.base = { wall: performance.now(), time: model.arrays.time[0] };
  model.paces = [];
  if (starts) tick((model.loop = (model.loop ?? 0) + 1));
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
  method({ name }) {
    model.method = model.engine.methods.find((method) => method.name === name);
    model.pace = 0.05;
    model.paces = [];
    restart();
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
