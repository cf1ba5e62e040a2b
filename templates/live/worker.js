// The compiled model in a worker: integrates at the pace of the clock, with forces of the pointer. A classic script
// without imports, since import maps do not reach workers.
"use strict";

const BUDGET = 14; // ms of integration between two messages
const SLICE = 1 / 120; // s of the model in one call
const RAMP = 1 / 60; // s of the wall over which a pull goes to a new point and strength, in straight lines
const CALL = 8; // ms that one call may take: its number of steps follows from what steps have taken
const MOST_STEPS = 20000; // trial steps of one call
const BACKLOG = 0.15; // s of the wall that are made up for after a pause of the machine
const WINDOW = 1000; // ms over which the speed is measured

const COUNTS = 6;
// The structs of a run without events and of a profile as C for wasm32 lays them out: numbers of eight bytes, and the
// integer of a run that is the address of its profile.
const RUN = 8;
const PROFILE = 4;
const PROFILE_OF_RUN = 6;

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
  const states = 2 * n + (engine.sizes.internal ?? 0); // coordinates, velocities, internal states
  reserve("state", states);
  for (const [name, size] of Object.entries(engine.sizes)) reserve(name, size);
  for (const [name, { size }] of Object.entries(engine.functions)) reserve(`out_${name}`, size);
  for (const name of ["time", "step", "n_sampled", "sample_time"]) reserve(name, 1);
  reserve("counts", COUNTS);
  reserve("run", RUN);
  const pulled = 3 + engine.axes.length; // numbers of a pull
  const inputs = engine.profile?.inputs ?? [];
  const driven = inputs.length + pulled;
  const pieces = 2 + (engine.profile?.time.length ?? 0); // at most
  reserve("profile", PROFILE);
  reserve("profile_place", driven);
  reserve("profile_time", pieces + 1);
  reserve("profile_coefficient", 2 * pieces * driven);
  reserve("vibration", 3);
  reserve("sample_state", states);
  reserve("sample_tension", Math.max(...engine.methods.map((method) => method.tensions.length)));
  reserve("work", Math.max(...engine.methods.map((method) => method.work_size)));
  const missing = top - exports.memory.buffer.byteLength;
  if (missing > 0) exports.memory.grow(Math.ceil(missing / 65536));
  const arrays = Object.fromEntries(Object.entries(places).map(([name, [address, count]]) => [
    name, new Float64Array(exports.memory.buffer, address, count),
  ]));
  const view = (Kind, name) => new Kind(exports.memory.buffer, places[name][0], (8 * places[name][1]) / Kind.BYTES_PER_ELEMENT);
  const counts = view(BigInt64Array, "counts");
  const sampled = view(BigInt64Array, "n_sampled");
  const run = view(Int32Array, "run");
  const address = (name) => places[name][0];
  const pointers = ["place", "time", "coefficient"].map((name) => address(`profile_${name}`));
  const profile = view(Int32Array, "profile");
  profile.set([2, 0, 1, driven, ...pointers, 0]); // pieces of degree 1, of which `drive` states the number
  const ofPull = Array.from({ length: pulled }, (_, k) => engine.pull.place + k);
  view(Int32Array, "profile_place").set([...inputs.map((input) => engine.profile.place + input), ...ofPull]);
  const method = engine.methods.find(({ name }) => name === engine.method);
  return { engine, exports, arrays, counts, sampled, run, address, n, method, profile, pace: 0.05 };
}

function reset() {
  const { engine, arrays, n } = model;
  for (const [name, values] of Object.entries(engine.nominal)) arrays[name].set(values);
  arrays.state.set(engine.nominal.coordinate, 0);
  arrays.state.set(engine.nominal.velocity, n);
  arrays.state.set(engine.nominal.internal ?? [], 2 * n);
  arrays.time[0] = 0;
  restart();
  model.status = 0;
  model.paces = [];
  model.pull = null;
  Object.assign(model, { steps: 0, rejected: 0 });
}

/** Let the next call choose its first step: something has jumped. */
function restart() {
  model.arrays.step[0] = 0;
  model.counts.fill(0n);
  model.run.fill(0);
  model.hasTensions = false;
}

/** One call of the integrator; counts its steps. The implicit method computes the tensions of stiff members,
    which positions cannot tell. */
function integrate(end, isTimed) {
  const { engine, exports, arrays, counts, run, sampled, address, method } = model;
  const tally = method.is_stiff ? counts : new BigInt64Array(run.buffer, run.byteOffset, 3);
  const rejectedSteps = () => (method.is_stiff ? tally[1] + tally[2] : tally[1]);
  const before = [tally[0], rejectedSteps()];
  const most = isTimed ? Math.min(MOST_STEPS, Math.max(4, Math.round(CALL / model.pace))) : MOST_STEPS;
  const head = [end, engine.rtol, engine.atol, BigInt(most), address("time"), address("step"), address("state"),
    ...method.arguments.map(address)];
  if (model.pull?.isReleased && arrays.time[0] >= model.pull.end) model.pull = null;
  run[PROFILE_OF_RUN] = model.pull || engine.profile ? address("profile") : 0;
  sampled[0] = 0n;
  const start = performance.now();
  let status = 0;
  if (method.is_stiff) {
    arrays.sample_time[0] = end;
    status = exports[`${method.symbol}_run`](...head, 1n, address("sample_time"), address("sample_state"),
      address("sample_tension"), address("n_sampled"), 0, address("counts"), address("vibration"), address("run"), address("work"));
    model.hasTensions = sampled[0] === 1n;
  } else {
    status = exports[`${method.symbol}_run`](...head, 0n, 0, 0, address("n_sampled"), address("run"), address("work"));
  }
  if (engine.profile) setInputs();
  const [steps, rejected] = [Number(tally[0] - before[0]), Number(rejectedSteps() - before[1])];
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
  arrays.velocity.set(arrays.state.subarray(n, 2 * n));
  arrays.internal?.set(arrays.state.subarray(2 * n));
  const status = exports[symbol](...inputs.map(address), address(`out_${name}`));
  return status === 0 ? arrays[`out_${name}`] : arrays[`out_${name}`].fill(NaN);
}

/** Positions of all nodes [m]: stated ones, with the free coordinates in their places. */
function positions() {
  const { engine, arrays } = model;
  if (engine.functions.node_position) return Float64Array.from(compute("node_position"));
  const places = Float64Array.from(engine.stated_position);
  engine.coordinate_place.forEach((place, k) => (places[place] = arrays.state[k]));
  return attach(places);
}

/** Velocities of all nodes [m/s]. */
function velocities() {
  const { engine, arrays, n } = model;
  if (engine.functions.node_velocity) return Float64Array.from(compute("node_velocity"));
  const rates = new Float64Array(engine.stated_position.length);
  engine.coordinate_place.forEach((place, k) => (rates[place] = arrays.state[n + k]));
  return attach(rates);
}

/** Fill in the points of rigid bodies, constant combinations of the nodes that carry them. */
function attach(vectors) {
  for (const { corner, point, weights } of model.engine.bodies) {
    point.forEach((node, k) => {
      for (let c = 0; c < 3; c++) vectors[3 * node + c] = corner.reduce((sum, from, j) => sum + weights[k][j] * vectors[3 * from + c], 0);
    });
  }
  return vectors;
}

/** Numbers of the pull at a time: node, spring constant, damping constant, point along the modelled axes. */
function pullAt(time) {
  const { from, to, start, end } = model.pull;
  const part = Math.min(1, (time - start) / (end - start));
  return from.map((value, k) => value + part * (to[k] - value));
}

/** Let the pull go from what it is to what it shall be, null for none, along straight lines. The integrator follows
    them: forces do not jump, which would make stiff bars vibrate. */
function setPull(pull) {
  const { arrays, engine } = model;
  const start = arrays.time[0];
  const now = model.pull && pullAt(start);
  if (!pull && !now) return;
  const to = pull
    ? [pull.node, pull.stiffness, pull.damping, ...engine.axes.map((axis) => pull.target[axis])]
    : [now[0], 0, 0, ...now.slice(3)];
  const goesOn = now?.[0] === to[0];
  const from = goesOn ? now : [to[0], 0, 0, ...to.slice(3)];
  const end = start + RAMP * Math.min(1, model.speed);
  model.pull = { from, to, start, end, isReleased: !pull };
  drive();
  if (!goesOn) restart();
}

/** Of each input that follows a profile, value and rate at its knot before a time, and the time since then. */
function inputsOver(time) {
  const { time: knots, values } = model.engine.profile;
  const k = Math.max(knots.findLastIndex((knot) => knot <= time), 0);
  const length = knots[k + 1] - knots[k]; // NaN behind the last knot
  return values.map((row) => [row[k], length > 0 ? (row[k + 1] - row[k]) / length : 0, time - knots[k]]);
}

/** Give inputs their values of now, for tensions and energies. */
function setInputs() {
  const { arrays, engine } = model;
  inputsOver(arrays.time[0]).forEach(([value, rate, since], k) => (arrays.input[engine.profile.inputs[k]] = value + rate * since));
}

/** State what the integrator follows from now on: inputs along their profile, the pull along its ramp. */
function drive() {
  if (model.engine.profile) setInputs();
  const { arrays, engine, profile, pull } = model;
  const start = arrays.time[0];
  const kinks = [...(engine.profile?.time ?? []), ...(pull ? [pull.end] : [])].filter((time) => time > start);
  const times = [...new Set([start, ...kinks])].sort((one, other) => one - other);
  const still = new Array(3 + engine.axes.length).fill(0);
  const rows = times.map((time) => {
    const inputs = engine.profile ? inputsOver(time) : [];
    const now = pull ? pullAt(time) : still;
    const rates = pull && time < pull.end ? pull.from.map((value, j) => (pull.to[j] - value) / (pull.end - pull.start)) : still;
    return [...inputs.map(([value, rate, since]) => value + rate * since), ...now, ...inputs.map(([, rate]) => rate), ...rates];
  });
  profile[0] = times.length;
  arrays.profile_time.set([...times, 1e300]);
  arrays.profile_coefficient.set(rows.flat());
}

/** Force of the pull on its node [N], along the modelled axes. */
function forceOf(nodes) {
  const [node, stiffness, damping, ...point] = pullAt(model.arrays.time[0]);
  const rates = velocities();
  return model.engine.axes.map((axis, k) => stiffness * (point[k] - nodes[3 * node + axis]) - damping * rates[3 * node + axis]);
}

/** Integrate to a time of the model; returns whether it got there. */
function integrateTo(time, deadline) {
  const { arrays } = model;
  while (model.status === 0 && arrays.time[0] < time) {
    model.status = integrate(Math.min(time, arrays.time[0] + SLICE), deadline < Infinity);
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
  const pull = model.pull ? forceOf(nodes) : [];
  postMessage({
    answer, nodes, tension, kinetic, total, pull, force: Math.hypot(...pull), time: arrays.time[0], status: model.status,
    text: textOf(model), speed: measureSpeed(), running: model.running,
    steps: model.steps, rejected: model.rejected, method: model.method.name,
  }, [nodes.buffer, tension.buffer]);
}

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

/** Refuse an order before it changes anything. */
function check(isGood, allowed) {
  if (!isGood) throw new RangeError(`allowed: ${allowed}`);
}

const areNumbers = (values, count) => values?.length === count && Array.from(values).every((value) => typeof value === "number");

const ORDERS = {
  build({ engine, bytes }) {
    model = { ...buildModel(engine, bytes), running: false, speed: 1 };
    reset();
    if (engine.profile) drive();
  },
  run: ({ isOn }) => run(isOn),
  speed({ speed }) {
    check(Number.isFinite(speed) && speed > 0, "a speed above 0");
    model.speed = speed;
    run(model.running);
  },
  method({ name }) {
    const { methods } = model.engine;
    check(methods.some((method) => method.name === name), `the method ${methods.map((method) => method.name).join(" or ")}`);
    model.method = methods.find((method) => method.name === name);
    model.pace = 0.05;
    model.paces = [];
    restart();
  },
  set({ name, values }) {
    const { changeable, sizes } = model.engine;
    check(changeable.includes(name), `the name of an argument, one of ${changeable.join(", ")}`);
    check(areNumbers(values, sizes[name]), `${sizes[name]} numbers for ${name}`);
    model.arrays[name].set(values);
    restart();
  },
  pull({ pull }) {
    const count = model.engine.stated_position.length / 3;
    check(pull === null || (Number.isInteger(pull?.node) && pull.node >= 0 && pull.node < count), `null, or a node from 0 to ${count - 1}`);
    check(pull === null || (areNumbers(pull.target, 3) && areNumbers([pull.stiffness, pull.damping], 2)), "numbers: target of 3, stiffness, damping");
    setPull(pull);
  },
  reset() {
    run(false);
    const kept = model.engine.changeable.map((name) => [name, Float64Array.from(model.arrays[name])]);
    reset();
    for (const [name, values] of kept) model.arrays[name].set(values);
    if (model.engine.profile) drive();
  },
  advance({ time }) {
    check(Number.isFinite(time), "a time [s]");
    run(false);
    while (model.status === 0 && !integrateTo(time, Infinity));
  },
  state() {},
};

onmessage = ({ data }) => {
  const { order, answer } = data;
  try {
    check(Object.hasOwn(ORDERS, order), `the order ${Object.keys(ORDERS).join(", ")}`);
    ORDERS[order](data);
  } catch (error) {
    postMessage({ answer, refused: `${order}: ${error.message}` });
    return;
  }
  if (order !== "build" || answer) report(answer ?? null);
};
