// Equilibria and a motion of the mast, in node.
//
// Usage: node main.mjs FOLDER [MOTOR]
// FOLDER: what `tensegrity-codegen build ../mast.toml --target wasm32 --out FOLDER` wrote
// MOTOR [m] is added to the rest length of the cable with the motor; default 0.03
import { readFile } from "node:fs/promises";
import { join } from "node:path";

import { Mast } from "./mast.mjs";

function printRows(quantity, names, values, unit) {
  names.forEach((name, k) => console.log(`${quantity} ${name} ${values[k].toPrecision(12)} ${unit}`));
}

function printMotion(mast, rest, motor) {
  const times = [0.05, 0.1, 0.15, 0.2];
  const start = new Float64Array(2 * rest.length); // velocities are zero
  start.set(rest);

  const motion = mast.integrate(start, motor, times);
  console.log(`energy start ${mast.totalEnergy(start, motor).toPrecision(12)} J`);
  times.forEach((time, k) => printRows(`motion_${time.toFixed(2)}s`, mast.coordinateNames, motion.samples[k], "m"));
  for (const { time, member, isTaut } of motion.events) {
    console.log(`${isTaut ? "taut" : "slack"} ${member} ${time.toPrecision(12)} s`);
  }
  console.log(`energy end ${mast.totalEnergy(motion.end, motor).toPrecision(12)} J`);
}

// Return the length that a text states, undefined where it states none.
function readLength(text) {
  if (text.toLowerCase() === "nan") return NaN;
  const value = Number(text);
  return text.trim() === "" || Number.isNaN(value) ? undefined : value;
}

const [folder, text = "0.03", ...more] = process.argv.slice(2);
const motor = readLength(text);
if (folder === undefined || motor === undefined || more.length > 0) {
  console.error("usage: node main.mjs FOLDER [MOTOR]: MOTOR is a length in metres, such as 0.03");
  process.exit(2);
}
try {
  const manifest = JSON.parse(await readFile(join(folder, "manifest.json"), "utf-8"));
  const mast = await Mast.load(await readFile(join(folder, "mast.wasm")), manifest);
  const rest = mast.findEquilibrium(mast.nominalCoordinate, 0);
  printRows("tension_at_rest", mast.memberNames, mast.memberTension(rest, 0), "N");
  const moved = mast.findEquilibrium(rest, motor);
  printRows("tension_moved", mast.memberNames, mast.memberTension(moved, motor), "N");
  printRows("position_moved", mast.coordinateNames, moved, "m");
  printMotion(mast, rest, motor);
} catch (error) {
  console.error(`error: ${error.message}`);
  process.exit(1);
}
