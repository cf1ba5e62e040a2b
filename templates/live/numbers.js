// Numbers as people read them.

const FLAT = 1e-9; // part of the values below which a range has no ticks of its own
const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]];

/** Return a number with a unit, its prefix chosen by its size, or that of `like`: 0.0123 m -> "12.3 mm". */
export function withUnit(value, unit, digits = 3, like = value) {
  if (Number.isNaN(value)) return "unknown";
  if (!unit) return short(value, digits);
  if (!Number.isFinite(value) || value === 0) return `${value} ${unit}`;
  const [size, prefix] = prefixOf(like);
  return `${short(value / size, digits)} ${prefix}${unit}`;
}

/** Return size and letter of the prefix of a number. */
export function prefixOf(value) {
  const size = Math.abs(value);
  if (!size || size >= 1e12) return [1, ""];
  return PREFIXES.find(([least]) => size >= 0.9995 * least) ?? PREFIXES.at(-1);
}

/** Return a number with so many significant digits, without an exponent where it is short. */
export function short(value, digits = 3) {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "unknown" : String(value);
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(digits - 1).replace("e+", "e");
  return String(Number(value.toPrecision(digits)));
}

/** Return the next of 1, 2, 5 times a power of ten. */
export function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= value);
}

/** Return round values between two ends, about `count` of them. */
export function ticksBetween(low, high, count) {
  const rough = (high - low) / Math.max(count, 1);
  if (!(rough > FLAT * Math.max(Math.abs(low), Math.abs(high)))) return [low];
  const step = roundUp(rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}
