// Arrays of the page: typed arrays as they were written, and rows of them as numbers.

const KINDS = {
  float64: Float64Array,
  float32: Float32Array,
  int32: Int32Array,
  int16: Int16Array,
  uint8: Uint8Array,
};
const UNKNOWN = -32768; // in int16: a number that is not known

/** An array over rows (samples, modes, ...), each of `width` numbers. */
export class Channel {
  constructor(described, buffer) {
    this.shape = described.shape;
    this.values = new KINDS[described.kind](buffer);
    this.scale = described.scale;
    this.offset = described.offset;
    this.rows = this.shape[0];
    this.width = this.shape.slice(1).reduce((count, size) => count * size, 1);
    this.isScaled = described.kind === "int16";
    if (this.isScaled) sumRows(this.values, this.rows, this.width);
  }

  /** Write row `k` as numbers into `out`, which it returns. */
  read(k, out) {
    const { values, width, scale, offset } = this;
    const first = k * width;
    if (!this.isScaled) {
      for (let i = 0; i < width; i++) out[i] = values[first + i];
      return out;
    }
    const period = scale.length;
    for (let i = 0; i < width; i++) {
      const value = values[first + i];
      out[i] = value === UNKNOWN ? NaN : value * scale[i % period] + offset[i % period];
    }
    return out;
  }

  /** Return the number at a row and a place of it. */
  at(k, i) {
    const value = this.values[k * this.width + i];
    if (!this.isScaled) return value;
    const period = this.scale.length;
    return value === UNKNOWN ? NaN : value * this.scale[i % period] + this.offset[i % period];
  }

  /** Return all numbers of one place, over the rows. */
  column(i) {
    return Float64Array.from({ length: this.rows }, (_, k) => this.at(k, i));
  }
}

/** Rows are written as differences from the row before, modulo 2^16, which an Int16Array adds. */
function sumRows(values, rows, width) {
  for (let i = width; i < rows * width; i++) values[i] += values[i - width];
}

/** Return the channels of a scene by their names. */
export function readChannels(scene, buffers) {
  const names = Object.keys(scene.channels);
  return Object.fromEntries(names.map((name) => [name, new Channel(scene.channels[name], buffers[name])]));
}
