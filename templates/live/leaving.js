// A note in the picture where no part of the structure is in it: how to find it again.

const byId = (id) => document.getElementById(id);

export function watchView(app) {
  const { stage, state } = app;
  const note = byId("left");
  byId("left-fit").onclick = () => app.fit();
  byId("left-follow").onclick = () => app.followBy(true);
  stage.after.push(() => {
    const isLost = isOutside(stage.camera, state.nodes);
    if (note.hidden === isLost) note.hidden = !isLost;
  });
}

/** Whether all points lie beyond one side of what the camera sees; so do all lines between them. */
function isOutside(camera, nodes) {
  const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).elements;
  let sides = 63; // a bit for each side beyond which all points so far lie
  for (let k = 0; k < nodes.length && sides; k += 3) {
    const [x, y, z, w] = [0, 1, 2, 3].map((row) => m[row] * nodes[k] + m[row + 4] * nodes[k + 1] + m[row + 8] * nodes[k + 2] + m[row + 12]);
    sides &= (x < -w) | ((x > w) << 1) | ((y < -w) << 2) | ((y > w) << 3) | ((z < -w) << 4) | ((z > w) << 5);
  }
  return sides !== 0;
}
