// window.tensegrity: what tests and curious readers can ask and do. Positions are those of the scene [m].

export function exposeHook(app) {
  const { model, stage, state } = app;
  /** Refuse what the page does not know, before it changes anything. */
  const check = (isGood, allowed) => {
    if (!isGood) throw new RangeError(`allowed: ${allowed}`);
  };
  const isIndex = (value, count) => Number.isInteger(value) && value >= 0 && value < count;
  const areFinite = (...values) => values.every(Number.isFinite);
  const inScene = (nodes) => Array.from(nodes, (value, i) => value + model.origin[i % 3]);
  window.tensegrity = {
    ready: true,
    app,
    get names() {
      return { nodes: [...model.nodeNames], members: [...model.memberNames] };
    },
    get frames() {
      return model.frameCount;
    },
    get rounding() {
      return model.scene.rounding;
    },
    get time() {
      return app.time;
    },
    get state() {
      app.refresh();
      return {
        time: app.time, frame: state.frame, positions: inScene(state.nodes),
        tensions: Array.from(state.tension), lengths: Array.from(state.length), slack: Array.from(state.slack),
      };
    },
    get camera() {
      return { position: inScene(stage.camera.position.toArray()), target: inScene(stage.controls.target.toArray()) };
    },
    get colors() {
      app.refresh();
      return Array.from(app.textures.paint.subarray(0, 4 * model.memberCount));
    },
    get timing() {
      return { frames: [...stage.times], work: [...stage.work], update: [...app.updates], ratio: stage.ratio,
        isSimple: stage.isSimple && !stage.isStill };
    },
    forgetTimes() {
      for (const list of [stage.times, stage.work, app.updates]) list.length = 0;
    },
    get chosen() {
      return app.chosen;
    },
    get coloring() {
      return app.coloringName;
    },
    seekFrame: (k) => {
      check(isIndex(k, model.frameCount), `the number of a sample, 0 to ${model.frameCount - 1}`);
      app.player.seekFrame(k);
    },
    seek: (time) => {
      check(areFinite(time), "a time [s]");
      app.player.seek(time);
    },
    play: () => app.player.play(),
    pause: () => app.player.pause(),
    orbit: (turn, tilt, zoom = 1) => {
      check(areFinite(turn, tilt, zoom) && zoom > 0, "angles [rad], and a factor of the distance above 0");
      app.orbit(turn, tilt, zoom);
    },
    lookFrom: (name) => {
      check(app.views.includes(name), app.views.join(", "));
      app.lookFrom(name);
    },
    colorBy: (name) => {
      check(Object.hasOwn(app.colorings, name), Object.keys(app.colorings).join(", "));
      app.colorBy(name);
    },
    showMode: (k) => {
      check(k === null || isIndex(k, model.scene.modes.length), `null, or the number of a mode below ${model.scene.modes.length}`);
      app.showMode(k);
    },
    choose: (picked) => {
      const { member, node } = picked ?? {};
      const isKnown = isIndex(member, model.memberCount) || (member === undefined && isIndex(node, model.nodeCount));
      check(picked === null || isKnown, "null, {member} or {node} with an index");
      app.choose(picked);
    },
    /** Where a node stands on the screen [px]. */
    place: (node) => {
      check(isIndex(node, model.nodeCount), `the number of a node, 0 to ${model.nodeCount - 1}`);
      const places = app.project();
      return [places[3 * node], places[3 * node + 1]];
    },
    /** Spin the camera for so many frames and return the milliseconds of each. */
    measure: (frames) => app.measure(frames),
    /** Return what is drawn as numbers: the part of the picture that is not paper. */
    coverage: () => app.coverage(),
  };
  Object.defineProperties(window.tensegrity, Object.getOwnPropertyDescriptors(app.moreHooks));
}
