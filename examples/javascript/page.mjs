// The page: its slider moves the motor, and the picture and the table show the equilibrium.
import { Mast } from "./mast.mjs";
import { listRows, readLength, USAGE } from "./rows.mjs";

const find = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";

// Positions [m] of all nodes: those of the scene, with the free coordinates in their places.
function placeNodes(mast, coordinate) {
  const position = mast.nodePosition.map((values) => [...values]);
  mast.coordinateNodeAxis.forEach(([node, axis], k) => {
    position[node][axis] = coordinate[k];
  });
  return position;
}

// Seen from the front, somewhat from above; in millimetres, y down.
function project([x, y, z]) {
  const [right, away] = [0.6 * x + 0.8 * y, -0.8 * x + 0.6 * y]; // turned about the vertical axis
  return [1000 * right, -1000 * (z * 0.94 + away * 0.34)];
}

function draw(mast, coordinate, tension) {
  const points = placeNodes(mast, coordinate).map(project);
  const lines = mast.connectivity.map(([first, second], k) => {
    const line = document.createElementNS(SVG, "line");
    const [[x1, y1], [x2, y2]] = [points[first], points[second]];
    for (const [key, value] of Object.entries({ x1, y1, x2, y2 })) line.setAttribute(key, value.toFixed(2));
    line.setAttribute("class", describe(mast, k, tension[k]));
    return line;
  });
  find("picture").replaceChildren(...lines);
}

function describe(mast, k, tension) {
  if (mast.memberNames[k].startsWith("bar")) return "bar";
  return tension > 0 ? "cable" : "slack";
}

function fillTable(mast, tension) {
  const rows = mast.memberNames.map((name, k) => {
    const row = document.createElement("tr");
    const state = { bar: tension[k] < 0 ? "compressed" : "stretched", cable: "taut", slack: "slack" };
    for (const text of [name, `${tension[k].toFixed(3)} N`, state[describe(mast, k, tension[k])]]) {
      row.append(Object.assign(document.createElement("td"), { textContent: text }));
    }
    return row;
  });
  find("tensions").replaceChildren(...rows);
}

// Show the equilibrium for one value of the motor [m]; an error of the library is shown in its place.
function show(mast, rest, motor) {
  find("value").textContent = `${(1000 * motor).toFixed(0)} mm`;
  try {
    const coordinate = mast.findEquilibrium(rest, motor);
    const tension = mast.memberTension(coordinate, motor);
    draw(mast, coordinate, tension);
    fillTable(mast, tension);
    find("rows").textContent = [...listRows(mast, motor)].join("\n");
    find("error").textContent = "";
  } catch (error) {
    find("rows").textContent = "";
    find("error").textContent = `error: ${error.message}`;
  }
}

async function main() {
  const text = new URLSearchParams(location.search).get("motor") ?? "0.03";
  const motor = readLength(text);
  if (motor === undefined) throw new Error(`usage: ?motor=MOTOR: ${USAGE}`);
  const manifest = await (await fetch("manifest.json")).json();
  const mast = await Mast.load(await (await fetch("mast.wasm")).arrayBuffer(), manifest);
  const rest = mast.findEquilibrium(mast.nominalCoordinate, 0);
  find("motor").value = motor;
  find("motor").addEventListener("input", (event) => show(mast, rest, event.target.valueAsNumber));
  show(mast, rest, motor);
}

try {
  await main();
} catch (error) {
  find("error").textContent = `error: ${error.message}`;
}
find("done").hidden = false;
