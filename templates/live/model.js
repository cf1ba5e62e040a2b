// The structure, and its state at a moment: positions, tensions, lengths, which cables are slack.

import { readChannels } from "live/channels";

const MOST_POINTS = 100_000; // of a motion into whose view the camera is put

/** Everything of the scene that does not move. */
export function buildModel(scene, buffers) {
  const channels = readChannels(scene, buffers);
  const list = (name) => (channels[name] ? Array.from(channels[name].values) : []);
  const model = {
    scene, channels,
    nodeCount: scene.nodes.length,
    shownCount: scene.shown, // without the nodes that carry rigid bodies, which are the last ones
    memberCount: scene.members.length,
    nodeNames: scene.nodes,
    memberNames: scene.members,
    ends: channels.connectivity.values,
    isBar: channels.is_bar.values,
    tensionOnly: channels.tension_only.values,
    radius: channels.radius.values,
    restLength: channels.rest_length.values,
    area: channels.area.values,
    anchored: channels.anchored.values,
    load: channels.load.values,
    time: channels.time.values,
    position: channels.node_position,
    tension: channels.member_tension,
    use: channels.use,
    reaction: channels.reaction,
    loadMotion: channels.load_motion, // of loads that change with time, at the nodes `loaded`
    loaded: list("loaded"),
    origin: scene.origin,
    shapes: scene.modes,
    held: list("held"),
    strandOf: list("strand_of"), // of each line the member of the library, where cables pass rings
  };
  model.frameCount = model.position.rows;
  Object.assign(model, boxOf(model));
  model.peak = largestTensions(model.tension);
  const lengths = Float64Array.from(model.restLength).filter((length) => length > 0).sort();
  model.usualLength = lengths.length ? lengths[lengths.length >> 1] : model.size;
  return model;
}

/** The largest force of each member in the whole motion [N], 0 where none is known. */
function largestTensions(tension) {
  const row = new Float64Array(tension.width);
  const peak = new Float64Array(tension.width);
  for (let k = 0; k < tension.rows; k++) {
    tension.read(k, row);
    for (let e = 0; e < row.length; e++) if (Math.abs(row[e]) > peak[e]) peak[e] = Math.abs(row[e]);
  }
  return peak;
}

/** The box of all positions, and its size. */
function boxOf(model) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  const start = { low: [...low], high: [...high] };
  const row = new Float64Array(3 * model.nodeCount);
  const step = Math.max(1, Math.floor(model.frameCount / 50));
  for (let k = 0; k < model.frameCount; k += step) {
    model.position.read(k, row);
    for (let i = 0; i < row.length; i++) {
      low[i % 3] = Math.min(low[i % 3], row[i]);
      high[i % 3] = Math.max(high[i % 3], row[i]);
    }
    if (k === 0) Object.assign(start, { low: [...low], high: [...high] });
  }
  const diagonal = (box) => Math.hypot(...box.high.map((value, k) => value - box.low[k])) || 1;
  return { low, high, size: diagonal(start), start, reach: diagonal({ low, high }) };
}

/** Positions of all nodes in the whole motion, or in samples spread over a long one. */
export function motionPoints(model) {
  const row = new Float64Array(3 * model.nodeCount);
  const step = Math.max(1, Math.ceil((model.frameCount * model.nodeCount) / MOST_POINTS));
  const points = [];
  const add = (k) => {
    model.position.read(k, row);
    for (const value of row) points.push(value);
  };
  for (let k = 0; k < model.frameCount; k += step) add(k);
  if ((model.frameCount - 1) % step) add(model.frameCount - 1);
  return points;
}

/** A state to be filled for a moment. */
export function newState(model) {
  const { nodeCount, memberCount } = model;
  return {
    time: 0, frame: 0,
    nodes: new Float64Array(3 * nodeCount),
    tension: new Float64Array(memberCount),
    length: new Float64Array(memberCount),
    slack: new Uint8Array(memberCount),
    use: model.use ? new Float64Array(memberCount) : null,
    reaction: model.reaction ? new Float64Array(model.reaction.width) : null,
    shape: null,
    ends: model.ends,
    next: { nodes: new Float64Array(3 * nodeCount), tension: new Float64Array(memberCount) },
  };
}

/** Return the sample before or at a time, and how far the time lies towards the next one. */
export function locate(times, time) {
  let low = 0;
  let high = times.length - 1;
  if (!(time > times[0])) return [0, 0];
  if (time >= times[high]) return [high, 0];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return [low, (time - times[low]) / (times[high] - times[low])];
}

/** Set the state to a time of the recorded motion, between samples by straight lines. */
export function readState(model, state, time) {
  const [k, part] = locate(model.time, time);
  state.time = time;
  state.frame = k;
  model.position.read(k, state.nodes);
  model.tension.read(k, state.tension);
  if (state.use) model.use.read(k, state.use);
  if (state.reaction) model.reaction.read(k, state.reaction);
  if (model.loadMotion) readLoads(model, k);
  if (part > 0) {
    const { nodes, tension } = state.next;
    model.position.read(k + 1, nodes);
    model.tension.read(k + 1, tension);
    for (let i = 0; i < nodes.length; i++) state.nodes[i] += part * (nodes[i] - state.nodes[i]);
    for (let e = 0; e < tension.length; e++) state.tension[e] += part * (tension[e] - state.tension[e]);
  }
  measure(model, state);
}

/** Set the loads to those of a sample. */
function readLoads(model, k) {
  model.loaded.forEach((node, place) => {
    for (let c = 0; c < 3; c++) model.load[3 * node + c] = model.loadMotion.at(k, 3 * place + c);
  });
}

/** Tensions of the lines of the page: those of the members of a library, or of the cables they are strands of. */
export function spreadTension(model, tension) {
  return model.strandOf.length ? Float64Array.from(model.strandOf, (member) => tension[member]) : tension;
}

/** Lengths, and which cables are slack: without tension, and not just at their rest length. */
export function measure(model, state) {
  const { ends, restLength, tensionOnly } = model;
  const { nodes, tension, length, slack } = state;
  const noise = 4 * model.scene.rounding.node_position;
  for (let e = 0; e < length.length; e++) {
    const i = 3 * ends[2 * e];
    const j = 3 * ends[2 * e + 1];
    length[e] = Math.hypot(nodes[i] - nodes[j], nodes[i + 1] - nodes[j + 1], nodes[i + 2] - nodes[j + 2]);
    const isTaut = Math.abs(length[e] - restLength[e]) <= 1e-6 * restLength[e] + noise;
    slack[e] = tensionOnly[e] && tension[e] <= 0 && !isTaut ? 1 : 0;
  }
}
