// Natural modes and mechanisms: the structure swings along one of them.

const SWING = 0.09; // of the structure's size, of the node that moves most
const PERIOD = 1.8; // seconds of one swing on the screen

export function buildModes(model) {
  const channel = model.channels.mode_shape;
  const modes = { chosen: null, phase: 0, amplitude: 1, shape: null };
  const base = new Float64Array(3 * model.nodeCount);
  modes.choose = (k) => {
    modes.chosen = k;
    modes.phase = 0;
    modes.shape = k === null ? null : channel.read(k, new Float64Array(3 * model.nodeCount));
  };
  modes.advance = (seconds) => {
    modes.phase += (2 * Math.PI * seconds) / PERIOD;
  };
  /** Move the nodes of a state by the shown mode; lengths and tensions stay those of the configuration. */
  modes.apply = (state) => {
    state.shape = modes.shape;
    if (!modes.shape) return;
    base.set(state.nodes);
    const size = SWING * modes.amplitude * model.size * Math.sin(modes.phase);
    for (let i = 0; i < base.length; i++) state.nodes[i] = base[i] + size * modes.shape[i];
  };
  return modes;
}
