// Equilibria and a motion of the mast, in node.
//
// Usage: node main.mjs FOLDER [MOTOR]
// FOLDER: what `tensegrity-codegen build ../mast.toml --target wasm32 --out FOLDER` wrote
// MOTOR [m] is added to the rest length of the cable with the motor; default 0.03
import { readFile } from "node:fs/promises";
import { join } from "node:path";

import { Mast } from "./mast.mjs";
import { listRows, readLength, USAGE } from "./rows.mjs";

const [folder, text = "0.03", ...more] = process.argv.slice(2);
const motor = readLength(text);
if (folder === undefined || motor === undefined || more.length > 0) {
  console.error(`usage: node main.mjs FOLDER [MOTOR]: ${USAGE}`);
  process.exit(2);
}
try {
  const manifest = JSON.parse(await readFile(join(folder, "manifest.json"), "utf-8"));
  const mast = await Mast.load(await readFile(join(folder, "mast.wasm")), manifest);
  for (const row of listRows(mast, motor)) console.log(row);
} catch (error) {
  console.error(`error: ${error.message}`);
  process.exit(1);
}
