// Shapes of nets whose force densities are stated: linear equations D x = p, with D = C^T diag(q) C of the members'
// differences C (Schek 1974), solved by L d L^T within the envelope of D.

const SINGULAR = 1e-11; // smallest pivot over the largest force density

/** Return the positions of all nodes [x, y, z, ...], null where these densities do not determine them.
    net: count, ends, anchored, axes, and an order of the nodes in which neighbours are near to each other;
    density: of the members; held: positions, of which those of anchored nodes count; force: on the nodes. */
export function findShape(net, density, held, force) {
  const found = Float64Array.from(held);
  const known = new Map(); // factors, by the nodes that are free along an axis
  for (const axis of net.axes) {
    const free = Array.from(net.order).filter((node) => !net.anchored[3 * node + axis]);
    const key = free.join();
    if (!known.has(key)) known.set(key, factorise(net, density, free));
    const factors = known.get(key);
    if (!factors) return null;
    const { row } = factors;
    const right = Float64Array.from(free, (node) => force[3 * node + axis]);
    density.forEach((q, e) => {
      const [i, j] = [net.ends[2 * e], net.ends[2 * e + 1]];
      if (row[i] >= 0 && row[j] < 0) right[row[i]] += q * held[3 * j + axis];
      if (row[j] >= 0 && row[i] < 0) right[row[j]] += q * held[3 * i + axis];
    });
    substitute(factors, right);
    free.forEach((node, k) => (found[3 * node + axis] = right[k]));
  }
  return found;
}

/** Return the factors of D of the free nodes, null where it is singular. `lower[i]` holds columns first[i] to i - 1. */
function factorise(net, density, free) {
  const row = new Int32Array(net.count).fill(-1);
  free.forEach((node, k) => (row[node] = k));
  const pairs = Array.from(density, (_, e) => [row[net.ends[2 * e]], row[net.ends[2 * e + 1]]].sort((a, b) => a - b));
  const first = free.map((_, k) => k);
  for (const [low, high] of pairs) if (low >= 0) first[high] = Math.min(first[high], low);
  const lower = first.map((start, k) => new Float64Array(k - start));
  const diagonal = new Float64Array(free.length);
  pairs.forEach(([low, high], e) => {
    if (high >= 0) diagonal[high] += density[e];
    if (low < 0) return;
    diagonal[low] += density[e];
    lower[high][low - first[high]] -= density[e];
  });
  for (let i = 0; i < free.length; i++) {
    const own = lower[i];
    for (let j = first[i]; j < i; j++) {
      for (let k = Math.max(first[i], first[j]); k < j; k++) own[j - first[i]] -= own[k - first[i]] * lower[j][k - first[j]];
    }
    for (let j = first[i]; j < i; j++) {
      const scaled = own[j - first[i]] / diagonal[j];
      diagonal[i] -= scaled * own[j - first[i]];
      own[j - first[i]] = scaled;
    }
  }
  const most = density.reduce((largest, q) => Math.max(largest, Math.abs(q)), 0);
  return diagonal.every((pivot) => Math.abs(pivot) > SINGULAR * most) ? { row, first, lower, diagonal } : null;
}

/** Replace the right side by the solution. */
function substitute({ first, lower, diagonal }, right) {
  for (let i = 0; i < right.length; i++) lower[i].forEach((value, k) => (right[i] -= value * right[first[i] + k]));
  for (let i = 0; i < right.length; i++) right[i] /= diagonal[i];
  for (let i = right.length - 1; i >= 0; i--) lower[i].forEach((value, k) => (right[first[i] + k] -= value * right[i]));
}
