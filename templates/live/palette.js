// Colours of members: scales that are told apart with any kind of colour vision, light and dark.

const hex = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));

/** Return a table of 256 colours (r, g, b) between anchors at equal distances. */
function table(anchors) {
  const colors = anchors.map(hex);
  const out = new Uint8Array(256 * 3);
  for (let k = 0; k < 256; k++) {
    const place = (k / 255) * (colors.length - 1);
    const low = Math.min(Math.floor(place), colors.length - 2);
    for (let c = 0; c < 3; c++) {
      out[3 * k + c] = Math.round(colors[low][c] + (place - low) * (colors[low + 1][c] - colors[low][c]));
    }
  }
  return out;
}

// Compression blue, none grey, tension vermilion, as in the pictures of this package, or its half for nets; cividis of J. R. Nunez,
// C. R. Anderton and R. S. Renslow (2018) for what starts at zero.
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const SCALES = {
  light: {
    diverging: table(["#07305f", "#1f78b4", "#8f969e", "#e8772e", "#8c2d04"]),
    onesided: table(["#8f969e", "#e8772e", "#8c2d04"]),
    sequential: table([...CIVIDIS.slice(0, 5), "#85804f", "#9a8400"]), // visible on white to its end
  },
  dark: {
    diverging: table(["#9fd3ff", "#3f93d2", "#6f7780", "#ef8a45", "#ffd0a3"]),
    onesided: table(["#6f7780", "#ef8a45", "#ffd0a3"]),
    sequential: table(["#31568f", ...CIVIDIS.slice(2)]),
  },
};
const FIXED = {
  light: { bar: "#33506e", body: "#4d6480", cable: "#d55e00", slack: "#8c949c", unknown: "#a8890b", over: "#cc2f7b", ink: "#1f2933",
    paper: "#ffffff", grid: "#d9dee3", node: "#f4f6f8", muted: "#5c6670", support: "#5c6670", partly: "#7f8891",
    load: "#b0478a", reaction: "#00805c", shadow: "#e9ecef" },
  dark: { bar: "#a9bfd6", body: "#8fa6c0", cable: "#f28e45", slack: "#7d8791", unknown: "#f2e2a0", over: "#ff6db3", ink: "#e6eaee",
    paper: "#14181d", grid: "#333c46", node: "#dfe5ea", muted: "#a3adb8", support: "#d3dae1", partly: "#a9b3bd",
    load: "#e3a0c6", reaction: "#34c99c", shadow: "#0b0e11" },
};
const LINES = {
  light: ["#0072b2", "#d55e00", "#009e73", "#9a5cf5", "#86301b", "#3e4b60"],
  dark: ["#56b0ea", "#f28e45", "#34c99c", "#9560ff", "#b0603a", "#dfe5ea"],
};

/** Return the colours of a theme, "light" or "dark"; single ones as (r, g, b) of 0 to 255. */
export function paletteOf(theme) {
  const fixed = Object.fromEntries(Object.entries(FIXED[theme]).map(([name, text]) => [name, hex(text)]));
  return { ...fixed, css: FIXED[theme], lines: LINES[theme], ...SCALES[theme], isDark: theme === "dark" };
}

/** Return a scale as a CSS gradient from left to right. */
export function gradient(scale) {
  const stops = [];
  for (let k = 0; k < 256; k += 15) stops.push(`rgb(${scale[3 * k]} ${scale[3 * k + 1]} ${scale[3 * k + 2]})`);
  return `linear-gradient(to right, ${stops.join(", ")})`;
}
