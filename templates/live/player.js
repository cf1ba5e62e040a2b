// The clock of a recorded motion: play, pause, scrub, speed.

import { locate } from "live/model";

const SPEEDS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
const COMFORT = [1.5, 25]; // seconds that a motion takes on the screen, if it can be chosen

export function buildPlayer(model, changed) {
  const [first, last] = [model.time[0], model.time[model.time.length - 1]];
  const duration = last - first;
  const player = {
    time: first, first, last, duration, isPlaying: false,
    speeds: SPEEDS, speed: comfortable(duration),
    play() {
      if (!duration) return;
      if (player.time >= last) player.time = first;
      player.isPlaying = true;
      changed();
    },
    pause() {
      player.isPlaying = false;
      changed();
    },
    toggle: () => (player.isPlaying ? player.pause() : player.play()),
    /** Go to a time; what lies outside of the motion is its start or end. */
    seek(time) {
      player.time = Math.min(Math.max(time, first), last);
      changed();
    },
    /** Go to a sample by its number. */
    seekFrame(k) {
      player.seek(model.time[Math.min(Math.max(k, 0), model.frameCount - 1)]);
    },
    /** Advance by `seconds` on the wall; a motion starts again a moment after its end. */
    advance(seconds) {
      if (!player.isPlaying) return false;
      const next = player.time + seconds * player.speed;
      player.time = next > last + 0.4 * player.speed ? first : next;
      return true;
    },
    /** Number of the sample before or at the present time. */
    get frame() {
      return locate(model.time, player.shown)[0];
    },
    get shown() {
      return Math.min(player.time, last);
    },
  };
  return player;
}

/** Real time where the motion is neither short nor long, else the speed that makes it so. */
function comfortable(duration) {
  if (!duration || (duration >= COMFORT[0] && duration <= COMFORT[1])) return 1;
  const wanted = duration < COMFORT[0] ? duration / COMFORT[0] : duration / COMFORT[1];
  const fitting = SPEEDS.filter((speed) => (duration < COMFORT[0] ? speed <= wanted * 1.0001 : speed >= wanted));
  return duration < COMFORT[0] ? fitting.at(-1) ?? SPEEDS[0] : fitting[0] ?? SPEEDS.at(-1);
}
