// Lines over time with a cursor: energies, and tensions of some members. A press moves the clock.

import { short, ticksBetween, withUnit } from "live/numbers";

const LONG_NAME = 9; // letters from which each line of the legend has a row of its own
const MARGIN = { left: 52, right: 10, top: 8, bottom: 22 }; // at least; on the left as much as the labels take
const FONT = "11.5px system-ui, sans-serif";

/** One diagram on a canvas; series: [{name, values, color}] over `times`. */
export function buildPlot(canvas, legend, { times, unit, describe, seek }) {
  const plot = { canvas, legend, times, series: [], palette: null, cursor: times[0], range: null, left: MARGIN.left };
  plot.set = (series, least = 0) => {
    plot.series = series;
    plot.range = rangeOf(series, least);
    plot.draw();
  };
  const mark = canvas.nextElementSibling;
  plot.draw = () => {
    drawPlot(plot, unit);
    plot.point(plot.cursor);
  };
  /** Move the cursor, which is no part of the drawing: nothing is drawn again. */
  plot.point = (time) => {
    plot.cursor = time;
    mark.hidden = times.length < 2;
    if (plot.width) mark.style.transform = `translateX(${placeOf(plot, time).toFixed(1)}px)`;
  };
  /** Write the values of sample `k` into the legend. */
  plot.writeValues = (k) => {
    plot.series.forEach((line, row) => {
      const place = legend.children[row]?.lastElementChild;
      const text = write(plot, line.values[k], unit);
      if (place && place.textContent !== text) place.textContent = text;
    });
  };
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", describe);
  const move = (event) => {
    const box = canvas.getBoundingClientRect();
    const inside = box.width - plot.left - MARGIN.right;
    const part = (event.clientX - box.left - plot.left) / inside;
    seek(times[0] + Math.min(Math.max(part, 0), 1) * (times.at(-1) - times[0]));
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    move(event);
  });
  canvas.addEventListener("pointermove", (event) => event.buttons && move(event));
  new ResizeObserver(plot.draw).observe(canvas);
  return plot;
}

/** Write the legend of a plot: a stroke, a name and the value at the cursor for each line. */
export function writeLegend(plot) {
  plot.legend.classList.toggle("long", plot.series.some(({ name }) => name.length > LONG_NAME));
  plot.legend.replaceChildren(...plot.series.map((line) => {
    const row = document.createElement("li");
    const stroke = document.createElement("i");
    stroke.style.background = line.color;
    const name = document.createElement("span");
    name.textContent = name.title = line.name;
    row.append(stroke, name, document.createElement("b"));
    return row;
  }));
}

/** The range of all values; one that is smaller than `least`, such as rounding, does not fill the diagram. */
function rangeOf(series, least) {
  let [low, high] = [Infinity, -Infinity];
  for (const { values } of series) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return [0, 1];
  if (high - low < least) [low, high] = [(low + high - least) / 2, (low + high + least) / 2];
  if (low > 0 && low < 0.5 * high) low = 0;
  const size = Math.max(Math.abs(low), Math.abs(high));
  const room = high - low > 1e-6 * size ? 0.06 * (high - low) : 0.1 * size || 1;
  return [low === 0 ? 0 : low - room, high + room];
}

/** Where a time stands on the canvas [px]. */
function placeOf({ times, width, left }, time) {
  const [start, end] = [times[0], times.at(-1)];
  return left + ((time - start) / (end - start || 1)) * (width - left - MARGIN.right);
}

function drawPlot(plot, unit) {
  const { canvas, times, series, palette, range } = plot;
  const { clientWidth: width, clientHeight: height } = canvas;
  plot.width = width;
  if (!width || !palette || !range) return;
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  if (times.length < 2) {
    pen.fillStyle = palette.css.muted;
    pen.textAlign = "center";
    pen.fillText("lines over time come with the run", width / 2, height / 2);
    return;
  }
  const widths = ticksBetween(range[0], range[1], 6).map((value) => pen.measureText(write(plot, value, unit)).width);
  plot.left = Math.max(MARGIN.left, Math.ceil(Math.max(...widths)) + 9);
  const x = (time) => placeOf(plot, time);
  const y = (value) => height - MARGIN.bottom - ((value - range[0]) / (range[1] - range[0])) * (height - MARGIN.top - MARGIN.bottom);
  drawAxes(pen, plot, { x, y, width, height, unit });
  for (const line of series) strokeLine(pen, line, times, x, y);
}

/** A value in the unit that suits the whole diagram. */
const write = ({ range }, value, unit) => withUnit(value, unit, 3, Math.max(...range.map(Math.abs)));

function drawAxes(pen, plot, { x, y, width, height, unit }) {
  const { palette, range, times, left } = plot;
  pen.fillStyle = palette.css.muted;
  pen.strokeStyle = palette.css.grid;
  pen.lineWidth = 1;
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (const value of ticksBetween(range[0], range[1], 6)) {
    pen.beginPath();
    pen.moveTo(left, y(value));
    pen.lineTo(width - MARGIN.right, y(value));
    pen.stroke();
    pen.fillText(write(plot, value, unit), left - 5, y(value));
  }
  pen.textBaseline = "top";
  const ticks = ticksBetween(times[0], times.at(-1), Math.max(2, width / 90));
  ticks.forEach((time, k) => {
    pen.textAlign = x(time) > width - 30 ? "right" : k === 0 && x(time) < left + 12 ? "left" : "center";
    pen.fillText(`${short(time)} s`, x(time), height - MARGIN.bottom + 6);
  });
}

/** Draw a line; where samples are denser than pixels, the least and the largest of each pixel. */
function strokeLine(pen, line, times, x, y) {
  pen.strokeStyle = line.color;
  pen.lineWidth = 1.7;
  pen.setLineDash(line.dash ?? []);
  pen.lineJoin = "round";
  pen.beginPath();
  let isDown = false;
  let column = null;
  let [low, high] = [0, 0];
  for (let k = 0; k < times.length; k++) {
    const value = line.values[k];
    if (!Number.isFinite(value)) {
      isDown = false;
      continue;
    }
    const here = x(times[k]);
    if (isDown && Math.round(here) === column && value >= low && value <= high) continue;
    if (Math.round(here) !== column) [low, high] = [value, value];
    column = Math.round(here);
    [low, high] = [Math.min(low, value), Math.max(high, value)];
    if (isDown) pen.lineTo(here, y(value));
    else pen.moveTo(here, y(value));
    isDown = true;
  }
  pen.stroke();
  pen.setLineDash([]);
}
