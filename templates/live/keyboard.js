// Keys: each has a button or a control on the page, too.

const STEP = 0.08; // radians of one press of an arrow key

export function listenToKeys(app) {
  const keys = {
    " ": () => app.player?.toggle(),
    k: () => app.player?.toggle(),
    ",": () => app.player?.seekFrame(app.player.frame - 1),
    ".": () => app.player?.seekFrame(app.player.frame + 1),
    Home: () => app.player?.seekFrame(0),
    End: () => app.player?.seekFrame(app.model.frameCount - 1),
    f: () => app.fit(),
    r: () => app.reset(),
    v: () => app.nextView(),
    u: () => app.turnAround(!app.isTurning),
    w: () => app.nextWidth(),
    p: () => app.savePicture(),
    c: () => app.nextColoring(),
    l: () => app.nextLabels(),
    t: () => app.toggleTheme(),
    m: () => app.nextMode(),
    a: () => app.toggleArrows(),
    o: () => app.toggleFollow(),
    "+": () => app.orbit(0, 0, 1 / 1.15),
    "=": () => app.orbit(0, 0, 1 / 1.15),
    "-": () => app.orbit(0, 0, 1.15),
    ArrowLeft: () => app.orbit(-STEP, 0, 1),
    ArrowRight: () => app.orbit(STEP, 0, 1),
    ArrowUp: () => app.orbit(0, -STEP, 1),
    ArrowDown: () => app.orbit(0, STEP, 1),
    Escape: () => app.choose(null),
    "?": () => app.toggleHelp(),
    ...app.moreKeys,
  };
  window.addEventListener("keydown", (event) => {
    const isInput = ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName);
    const isButton = event.target.tagName === "BUTTON" || event.target.tagName === "SUMMARY";
    if (event.ctrlKey || event.metaKey || event.altKey || (isInput && event.key !== "Escape")) return;
    if (isButton && (event.key === " " || event.key === "Enter")) return;
    const call = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (!call) return;
    event.preventDefault();
    call();
  });
}
