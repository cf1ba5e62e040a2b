// What the program and the page print of the mast: a quantity, a name, a value and its unit in each line.

export const USAGE = "MOTOR is a length in metres, such as 0.03";

// Return the length that a text states, undefined where it states none.
export function readLength(text) {
  if (text.toLowerCase() === "nan") return NaN;
  const value = Number(text);
  return text.trim() === "" || Number.isNaN(value) ? undefined : value;
}

// Yield the lines for one value of the motor [m].
export function* listRows(mast, motor) {
  const rest = mast.findEquilibrium(mast.nominalCoordinate, 0);
  yield* rows("tension_at_rest", mast.memberNames, mast.memberTension(rest, 0), "N");
  const moved = mast.findEquilibrium(rest, motor);
  yield* rows("tension_moved", mast.memberNames, mast.memberTension(moved, motor), "N");
  yield* rows("position_moved", mast.coordinateNames, moved, "m");
  yield* listMotion(mast, rest, motor);
}

function* listMotion(mast, rest, motor) {
  const times = [0.05, 0.1, 0.15, 0.2];
  const start = new Float64Array(2 * rest.length); // velocities are zero
  start.set(rest);

  const motion = mast.integrate(start, motor, times);
  yield `energy start ${mast.totalEnergy(start, motor).toPrecision(12)} J`;
  for (const [k, time] of times.entries()) {
    yield* rows(`motion_${time.toFixed(2)}s`, mast.coordinateNames, motion.samples[k], "m");
  }
  for (const { time, member, isTaut } of motion.events) {
    yield `${isTaut ? "taut" : "slack"} ${member} ${time.toPrecision(12)} s`;
  }
  yield `energy end ${mast.totalEnergy(motion.end, motor).toPrecision(12)} J`;
}

function* rows(quantity, names, values, unit) {
  for (const [k, name] of names.entries()) {
    yield `${quantity} ${name} ${values[k].toPrecision(12)} ${unit}`;
  }
}
