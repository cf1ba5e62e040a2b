// The mast in JavaScript: the C functions of mast.wasm with typed arrays, and errors instead of status numbers.
// Works in browsers, node and other programs; it imports nothing.

const ABI_VERSION = 3; // of the struct RUN below
const EVENT_CABLE = 1;
const MOST_EVENTS = 100;

// Fields of `mast_run` in the header: name, bytes. long long is aligned to 8 bytes, int and pointers to 4.
const RUN = [
  ["n_accepted", 8], ["n_rejected", 8], ["n_evaluations", 8], ["watch", 4], ["stop", 4], ["condition", 4],
  ["condition_data", 4], ["event", 4], ["most_events", 8], ["n_events", 8], ["is_stopped", 4], ["profile", 4],
  ["internal", 256], // what the integrator keeps between calls, and fields of later versions
];
const EVENT_BYTES = 24; // of `mast_event`: double time, int kind, which, direction

export class StatusError extends Error {
  constructor(name, status, text) {
    super(`${name}: ${text} (status ${status})`);
    this.name = "StatusError";
    this.status = status;
  }
}

export class Mast {
  // bytes: content of mast.wasm; manifest: content of manifest.json, with names, sizes and values of the scene
  static async load(bytes, manifest) {
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Mast(instance.exports, manifest);
  }

  constructor(library, manifest) {
    library._initialize();
    this.library = library;
    this.memberNames = manifest.member_name;
    this.coordinateNames = manifest.coordinate_name;
    this.connectivity = manifest.connectivity;
    this.nodePosition = manifest.node_position; // [m], of all nodes in the scene
    this.coordinateNodeAxis = manifest.coordinate_node_axis; // node and axis of each free coordinate
    this.workOf = Object.fromEntries(
      [...manifest.integrators, ...manifest.solvers].map((item) => [item.name, item.work_size]),
    );
    this.inputs = manifest.input_name;
    this.nominalCoordinate = Float64Array.from(manifest.arguments.find((item) => item.name === "coordinate").nominal);
    this.free = library.__heap_base.value; // from here on all memory is ours
    const version = this.view().getInt32(library.mast_descriptor.value, true);
    if (version !== ABI_VERSION) {
      throw new Error(`the library has version ${version} of the interface, not ${ABI_VERSION}`);
    }
  }

  // Equilibrium [m] with this value of the motor [m], near `start`.
  findEquilibrium(start, motor) {
    const tolerance = 1e-9; // [N], largest force that remains at a free coordinate
    const mostIterations = 50;
    return this.borrow((memory) => {
      const coordinate = memory.place(start);
      const work = memory.zeros(this.workOf.equilibrium);
      const report = memory.bytes(64); // mast_equilibrium_report
      this.call("mast_find_equilibrium", coordinate, memory.input(motor), tolerance, mostIterations, report, work);
      return memory.read(coordinate, start.length);
    });
  }

  // Tensions [N] of all members, positive in tension.
  memberTension(coordinate, motor) {
    return this.borrow((memory) => {
      const tension = memory.zeros(this.memberNames.length);
      this.call("mast_compute_member_tension", memory.place(coordinate), memory.input(motor), tension);
      return memory.read(tension, this.memberNames.length);
    });
  }

  // Energy [J] of a state: coordinates [m], then velocities [m/s].
  totalEnergy(state, motor) {
    return this.borrow((memory) => {
      const at = memory.place(state);
      const energy = memory.zeros(1);
      this.call("mast_compute_total_energy", at, at + 4 * state.length, memory.input(motor), energy);
      return memory.read(energy, 1)[0];
    });
  }

  // Motion from a state at time 0 to the last sample time; the motor has its value from the first moment on.
  integrate(start, motor, sampleTime) {
    const rtol = 1e-9, atol = 1e-12; // of each step; atol in m and m/s
    const mostSteps = 100000n; // long long is a BigInt
    return this.borrow((memory) => {
      const state = memory.place(start);
      const times = memory.place(sampleTime);
      const samples = memory.zeros(sampleTime.length * start.length);
      const sampled = memory.bytes(8);
      const time = memory.zeros(1), step = memory.zeros(1); // step 0: choose one
      const work = memory.zeros(this.workOf.rk853);
      const events = memory.bytes(MOST_EVENTS * EVENT_BYTES);
      const run = memory.struct(RUN, { watch: EVENT_CABLE, event: events, most_events: BigInt(MOST_EVENTS) });
      this.call(
        "mast_integrate_rk853_run", sampleTime.at(-1), rtol, atol, mostSteps, time, step, state, memory.input(motor),
        BigInt(sampleTime.length), times, samples, sampled, run.address, work,
      );
      if (this.view().getBigInt64(sampled, true) < sampleTime.length) {
        throw new Error(`the motion ended at ${memory.read(time, 1)[0]} s, after ${mostSteps} steps`);
      }
      const count = Math.min(Number(this.view().getBigInt64(run.address + run.offset.n_events, true)), MOST_EVENTS);
      return {
        samples: sampleTime.map((_, k) => memory.read(samples + 8 * k * start.length, start.length)),
        events: Array.from({ length: count }, (_, k) => this.readEvent(events + k * EVENT_BYTES)),
        end: memory.read(state, start.length),
      };
    });
  }

  readEvent(address) {
    const view = this.view();
    return {
      time: view.getFloat64(address, true),
      member: this.memberNames[view.getInt32(address + 12, true)],
      isTaut: view.getInt32(address + 16, true) > 0,
    };
  }

  // Call a function; StatusError where its status is not MAST_OK.
  call(name, ...given) {
    const callee = this.library[name];
    const status = callee(...given);
    if (status !== 0) {
      throw new StatusError(name, status, this.readText(this.library.mast_status_text(status)));
    }
  }

  readText(address) {
    const bytes = new Uint8Array(this.library.memory.buffer);
    return new TextDecoder().decode(bytes.subarray(address, bytes.indexOf(0, address)));
  }

  view() {
    return new DataView(this.library.memory.buffer);
  }

  // Run an action with memory that is free again afterwards.
  borrow(action) {
    return action(new Memory(this.library.memory, this.free, this.inputs));
  }
}

// Memory of the library, handed to its functions; it grows as needed.
class Memory {
  constructor(memory, free, inputs) {
    this.memory = memory;
    this.free = free;
    this.inputs = inputs;
  }

  // Address of zero bytes, divisible by 8.
  bytes(count) {
    const address = Math.ceil(this.free / 8) * 8;
    this.free = address + count;
    const missing = this.free - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / 65536));
    new Uint8Array(this.memory.buffer, address, count).fill(0);
    return address;
  }

  zeros(count) {
    return this.bytes(8 * count);
  }

  place(values) {
    const address = this.zeros(values.length);
    new Float64Array(this.memory.buffer, address, values.length).set(values);
    return address;
  }

  read(address, count) {
    return new Float64Array(this.memory.buffer, address, count).slice();
  }

  input(motor) {
    return this.place(this.inputs.map((name) => (name === "motor" ? motor : 0)));
  }

  // Place a C struct, zero but for `values`; offset: where each field begins.
  struct(fields, values) {
    const offset = {};
    let size = 0;
    for (const [name, bytes] of fields) {
      const alignment = bytes === 4 ? 4 : 8;
      offset[name] = Math.ceil(size / alignment) * alignment;
      size = offset[name] + bytes;
    }
    const address = this.bytes(size);
    const view = new DataView(this.memory.buffer, address, size);
    for (const [name, value] of Object.entries(values)) {
      if (typeof value === "bigint") view.setBigInt64(offset[name], value, true);
      else view.setInt32(offset[name], value, true);
    }
    return { address, offset };
  }
}
