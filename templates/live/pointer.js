// Hover and click: what is under the pointer, and what stays chosen.

import { describe, writeFacts } from "live/facts";

const byId = (id) => document.getElementById(id);
const STILL = { mouse: 5, touch: 14 }; // pixels that a click may move

const FINGER = 2; // times the reach of a mouse

export function listenToPointer(app) {
  const { canvas } = app.stage;
  const tip = byId("tip");
  let pressed = null;
  let pending = null;
  const inside = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const hover = () => {
    const place = pending;
    pending = null;
    if (app.pull) tip.hidden = true;
    if (!place || app.pull) return;
    app.hovered = app.picker.pick(app.state.nodes, ...place);
    tip.hidden = !app.hovered;
    canvas.style.cursor = app.hovered ? "pointer" : "";
    if (!app.hovered) return;
    const { width, height } = canvas.getBoundingClientRect();
    tip.style.left = `${Math.min(place[0] + 14, width - 190)}px`;
    tip.style.top = `${place[1] > height - 150 ? place[1] - 130 : place[1] + 16}px`;
    writeTip(app, tip);
  };
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons || event.pointerType === "touch") return;
    if (!pending) requestAnimationFrame(hover);
    pending = inside(event);
  });
  canvas.addEventListener("pointerleave", () => {
    tip.hidden = true;
    app.hovered = null;
  });
  canvas.addEventListener("pointerdown", (event) => {
    pressed = event.isPrimary ? inside(event) : null; // two fingers zoom
    tip.hidden = true;
  });
  canvas.addEventListener("pointerup", (event) => {
    const place = inside(event);
    const still = STILL[event.pointerType] ?? STILL.mouse;
    if (pressed && Math.hypot(place[0] - pressed[0], place[1] - pressed[1]) < still) {
      app.choose(app.picker.pick(app.state.nodes, ...place, event.pointerType === "touch" ? FINGER : 1));
    }
    pressed = null;
  });
  app.choose = (picked) => {
    app.chosen = picked;
    app.meshes.choose(picked?.member ?? null);
    byId("chosen").hidden = !picked;
    byId("hint").hidden = Boolean(picked);
    app.choiceChanged?.(picked);
    showChosen(app);
    app.stage.dirty = true;
  };
}

/** Write the facts of what is chosen, and of what the pointer is on. */
export function showChosen(app) {
  const place = byId("chosen");
  if (app.chosen) writeFacts(place, describe(app.model, app.state, app.chosen));
  if (app.hovered && !byId("tip").hidden) writeTip(app, byId("tip"));
}

function writeTip(app, tip) {
  const { name, kind, rows } = describe(app.model, app.state, app.hovered);
  const kept = app.hovered.member === undefined ? rows.slice(0, 4) : rows.filter(([term]) => /^(length|tension|force|stress)/.test(term));
  writeFacts(tip, { name, kind, rows: kept });
}
