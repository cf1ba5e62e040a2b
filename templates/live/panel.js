// Controls beside the picture: colours and their scale, labels, modes, transport, help.

import { gradient } from "live/palette";
import { short, withUnit } from "live/numbers";
import { buildSaving } from "live/saving";

const byId = (id) => document.getElementById(id);

/** Connect all controls of the page with the viewer. */
export function buildPanel(app) {
  fillSelect(byId("color"), Object.entries(app.colorings).map(([name, { label }]) => [name, label]));
  byId("color").onchange = (event) => app.colorBy(event.target.value);
  byId("labels").onchange = (event) => app.labelBy(event.target.value);
  byId("width").onchange = (event) => app.widthBy(event.target.value);
  byId("fit").onclick = () => app.fit();
  const from = byId("from");
  fillSelect(from, [["", "view"], ...app.views.map((name) => [name, name === "first" ? "first view" : name])]);
  from.onchange = () => {
    app.lookFrom(from.value);
    from.value = ""; // the camera may turn on from there
  };
  byId("turn").onclick = () => app.turnAround(!app.isTurning);
  byId("turn").hidden = app.model.scene.is_planar;
  byId("start").onclick = () => app.player.play();
  buildSaving(app);
  byId("theme").onclick = () => app.toggleTheme();
  byId("help-button").onclick = () => app.toggleHelp();
  byId("follow").onchange = (event) => app.followBy(event.target.checked);
  byId("arrows").onchange = (event) => app.showArrows(event.target.checked);
  byId("arrows-row").hidden = !app.arrows;
  byId("follow-row").hidden = !app.moves;
  connectModes(app);
  connectPlayer(app);
}

export function fillSelect(select, options) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
}

function connectModes(app) {
  const { modes } = app.model.scene;
  byId("modes-box").hidden = !modes.length && !app.model.scene.modes_note;
  byId("modes-note").textContent = app.model.scene.modes_note;
  byId("mode").parentElement.hidden = byId("amplitude-row").hidden = !modes.length;
  fillSelect(byId("mode"), [["", "none"], ...modes.map(({ label }, k) => [String(k), label])]);
  byId("mode").onchange = ({ target }) => app.showMode(target.value === "" ? null : Number(target.value));
  byId("amplitude").oninput = ({ target }) => app.setAmplitude(Number(target.value));
}

function connectPlayer(app) {
  const { player } = app;
  byId("transport").hidden = byId("start").hidden = !player?.duration;
  if (!player?.duration) return;
  byId("play").onclick = () => player.toggle();
  const slider = byId("time");
  slider.oninput = () => {
    player.pause();
    player.seek(player.first + (Number(slider.value) / 10000) * player.duration);
  };
  const speed = byId("speed");
  fillSelect(speed, player.speeds.map((value) => [value, `${short(value)} ×`]));
  speed.value = player.speed;
  speed.onchange = () => (player.speed = Number(speed.value));
}

/** Show the clock. */
export function showClock(app) {
  const { player } = app;
  if (!player?.duration) return;
  byId("time").value = Math.round((10000 * (player.shown - player.first)) / player.duration);
  byId("clock").textContent = `${player.shown.toFixed(app.digits)} s`;
  byId("play").setAttribute("aria-label", player.isPlaying ? "pause" : "play");
  byId("play").classList.toggle("playing", player.isPlaying);
  if (player.isPlaying) byId("start").hidden = true;
}

/** Show the scale of the present colours. */
export function showScale(app) {
  const { coloring, palette } = app;
  const bar = byId("scale");
  const signed = coloring.scale === "diverging";
  byId("scale-box").hidden = !coloring.scale;
  byId("kinds").hidden = Boolean(coloring.scale);
  if (coloring.scale) bar.style.background = gradient(palette[coloring.scale]);
  byId("scale-name").textContent = coloring.meaning ?? coloring.label;
  const end = (value) => (coloring.unit ? withUnit(value, coloring.unit) : `${short(100 * value)} %`);
  const [low, high] = app.isBeyond ? ["≤ ", "≥ "] : ["", ""];
  byId("scale-low").textContent = signed ? `${low}−${end(coloring.limit)}` : "0";
  byId("scale-middle").textContent = signed ? "0" : "";
  byId("scale-high").textContent = `${high}${signed ? "+" : ""}${end(coloring.limit)}`;
  bar.classList.toggle("beyond", app.isBeyond);
  bar.classList.toggle("signed", signed);
  const notes = [];
  if (app.isBeyond) notes.push(["none", "some values lie beyond the scale"]);
  if (app.hasSlack) notes.push(["slack", "slack cable", true]);
  if (app.hasUnknown && coloring.scale) notes.push(["unknown", coloring.unit ? "not known" : "no limit, or not known"]);
  if (app.coloringName === "use") notes.push(["over", "above its limit"]);
  const { unknown_reactions: lacking } = app.model.scene;
  const forces = app.arrows?.forces ?? { load: 0, reaction: 0 };
  const like = app.colorings.tension.limit || Math.max(forces.load, forces.reaction);
  const upTo = (force) => `up to ${withUnit(force, "N", 3, like)}`;
  const least = app.arrows?.shortest ? `, arrows at least ${withUnit(app.arrows.shortest, "m", 2)}` : "";
  if (app.arrows?.hasLoads) notes.push(["load", forces.load > 0 ? `load ${upTo(forces.load)}${least}` : "load"]);
  if (forces.reaction > 0) notes.push(["reaction", `reaction ${upTo(forces.reaction)}${lacking ? `, ${lacking} unknown` : ""}`]);
  else if (app.arrows?.hasReactions && lacking) notes.push(["none", `reactions unknown (${lacking})`]);
  byId("keys").replaceChildren(...notes.map(([color, text, dashed]) => {
    const row = document.createElement("li");
    const stroke = document.createElement("i");
    stroke.style[dashed ? "borderTop" : "background"] = dashed ? `3px dashed ${palette.css[color]}` : palette.css[color];
    row.append(...(palette.css[color] ? [stroke] : []), text);
    return row;
  }));
  byId("kind-bar").style.background = palette.css.bar;
  byId("kind-cable").style.background = palette.css.cable;
}
