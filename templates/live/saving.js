// Pictures (PNG) and films (WebM, or MP4 where the browser records no other) of what is seen, with its scale.

import { drawFrame, setStill } from "live/stage";

const byId = (id) => document.getElementById(id);
const FILMS = ["video/webm;codecs=vp9", "video/webm", "video/mp4"];
const RATE = 30; // pictures a second of a film

export function buildSaving(app) {
  const { stage, model } = app;
  const sheet = document.createElement("canvas");
  const name = model.scene.title.replace(/[^\w.-]+/g, "_") || "structure";
  let recorder = null;

  const compose = () => {
    const { canvas, width } = stage;
    const pen = sheet.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(canvas, 0, 0, sheet.width, sheet.height);
    const names = byId("names");
    if (!names.hidden) pen.drawImage(names, 0, 0, sheet.width, sheet.height);
    pen.scale(sheet.width / width, sheet.width / width);
    drawScale(pen, app);
  };
  const draw = (ratio) => {
    sheet.width = Math.round(ratio * stage.width);
    sheet.height = Math.round(ratio * stage.height);
    app.refresh();
    stage.dirty = true;
    drawFrame(stage);
    compose();
  };
  app.savePicture = () => {
    setStill(stage, true);
    draw(stage.restRatio);
    sheet.toBlob((blob) => download(blob, `${name}.png`), "image/png");
  };
  /** Start or end a film; that of a recorded motion shows all of it, at the chosen speed, and ends with it. */
  app.film = () => {
    if (recorder) {
      recorder.stop();
      return;
    }
    const type = FILMS.find((item) => window.MediaRecorder?.isTypeSupported(item));
    if (!type) {
      byId("film").title = "this browser records no films";
      byId("film").disabled = true;
      return;
    }
    const { player } = app;
    const parts = [];
    draw(stage.ratio);
    recorder = new MediaRecorder(sheet.captureStream(RATE), { mimeType: type, videoBitsPerSecond: 8e6 });
    recorder.ondataavailable = ({ data }) => parts.push(data);
    recorder.onstop = () => {
      recorder = null;
      stage.after = stage.after.filter((call) => call !== compose);
      byId("film").setAttribute("aria-pressed", false);
      download(new Blob(parts, { type }), `${name}.${type.includes("mp4") ? "mp4" : "webm"}`);
    };
    recorder.onstart = () => {
      stage.after.push(compose);
      if (player?.duration) player.seek(player.first);
      player?.play();
    };
    byId("film").setAttribute("aria-pressed", true);
    recorder.start();
    app.filmEnds = () => recorder?.state === "recording" && player.duration > 0 && player.time > player.last && app.film();
  };
  byId("picture").onclick = () => app.savePicture();
  byId("film").onclick = () => app.film();
}

/** Let the reader save a file. */
export function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Write the legend, the scale bar and the time, which are no part of the canvas, where the page shows them. */
function drawScale(pen, { coloring, palette, moves }) {
  const box = byId("stage").getBoundingClientRect();
  const write = (item, align = "left") => {
    const range = document.createRange();
    range.selectNodeContents(item.lastChild ?? item);
    const { left, right, top } = range.getBoundingClientRect();
    pen.textAlign = align;
    pen.fillText(item.textContent, (align === "left" ? left : right) - box.left, top - box.top);
  };
  const fill = (item, style) => {
    const { left, top, width, height } = item.getBoundingClientRect();
    pen.fillStyle = style;
    pen.fillRect(left - box.left, top - box.top, width, height);
  };
  pen.font = "13px system-ui, sans-serif";
  pen.textBaseline = "top";
  if (coloring.scale) {
    const { left, right } = byId("scale").getBoundingClientRect();
    const colors = pen.createLinearGradient(left - box.left, 0, right - box.left, 0);
    const table = palette[coloring.scale];
    for (let k = 0; k < 256; k += 15) colors.addColorStop(k / 255, `rgb(${table[3 * k]} ${table[3 * k + 1]} ${table[3 * k + 2]})`);
    fill(byId("scale"), colors);
  }
  for (const item of document.querySelectorAll("#legend li i")) fill(item, getComputedStyle(item).backgroundColor);
  const bar = byId("measure").firstElementChild;
  fill(bar, palette.css.ink);
  pen.fillStyle = palette.css.ink;
  for (const item of document.querySelectorAll("#legend li, #measure span, #scale-name, #scale-low, #scale-middle")) if (item.offsetParent) write(item);
  if (coloring.scale) write(byId("scale-high"), "right");
  if (moves) pen.fillText(byId("clock").textContent, 90, 16);
}
