// The structure as meshes: bars, cables, nodes, supports, and the rim around what is chosen.

import { THREE } from "three";
import { capsule, pyramid, repeat, ribbon } from "live/shapes";
import { groundLevel } from "live/stage";
import * as glsl from "live/shaders";

// Sides and rings of the capsules of so many bars at most.
const FINENESS = [[24, 20, 6], [100, 14, 4], [600, 10, 3], [Infinity, 8, 2]];
const SIMPLER = 1500; // members of a kind from which simpler shapes stand for them while a slow picture moves
const THIN = [1.5, 4]; // pixels of radius below which a line stands for a cable, a ribbon for a bar
const THINNEST = 1; // pixels, half of what a member has at least
const CROWD = 400; // members above which bars need no more than cables, and thin cables fade: many would make patterns
const FADED = 0.6; // of its colour that the thinnest cable keeps
const SHADOWS = 600; // members up to which shadows are drawn
const RIM = 2.5; // pixels around what is chosen

const material = (vertexShader, fragmentShader, uniforms, more = {}) =>
  new THREE.ShaderMaterial({ glslVersion: THREE.GLSL3, vertexShader, fragmentShader, uniforms, ...more });

const drawn = (geometry, shader, order = 0) => {
  const mesh = new THREE.Mesh(geometry, shader);
  mesh.frustumCulled = false;
  mesh.renderOrder = order;
  return mesh;
};

/** Radii that members are drawn with [m]: the stated ones, else some that suit the size, the number and the largest
    force of the motion. */
function sectionRadii(model) {
  const crowd = Math.min(1, Math.max(0.18, (45 / Math.max(model.memberCount, 1)) ** 0.4));
  const thinnest = model.radius.reduce((least, radius, e) => (model.isBar[e] && radius ? Math.min(least, radius) : least), Infinity);
  const usual = [
    Math.min(0.0032 * crowd * model.size, 0.006 * model.usualLength, 0.4 * thinnest), // below stated bars
    Math.min(0.011 * crowd * model.size, 0.02 * model.usualLength),
  ];
  const middle = [0, 1].map((kind) => {
    const forces = model.peak.filter((force, e) => force > 0 && model.isBar[e] === kind).sort();
    return forces[forces.length >> 1] ?? 1;
  });
  const factor = (e) => Math.min(Math.max(Math.sqrt((model.peak[e] || middle[model.isBar[e]]) / middle[model.isBar[e]]), 0.6), 1.6);
  return Float32Array.from(model.radius, (radius, e) => radius || factor(e) * usual[model.isBar[e]]);
}

/** Build the meshes; `show(palette)` colours what is not coloured member by member. */
export function buildMeshes(model, textures) {
  const sections = sectionRadii(model);
  const { radii } = textures;
  radii.set(sections);
  textures.showWidths();
  const shared = {
    ...textures.uniforms, least: { value: 0 }, leastBar: { value: 0 }, growth: { value: 0 },
    leastSeen: { value: model.memberCount > CROWD ? FADED : 1 }, seenLine: { value: 1 }, paper: { value: new THREE.Vector3() },
  };
  const lit = { ...shared, plain: { value: new THREE.Vector4(0, 0, 0, 0) } };
  const rim = { ...shared, growth: { value: 0 }, plain: { value: new THREE.Vector4(0, 0, 0, 1) } };
  const group = new THREE.Group();
  const kinds = [];
  for (const kind of [1, 0]) {
    const chosen = Array.from({ length: model.memberCount }, (_, e) => e).filter((e) => model.isBar[e] === kind);
    if (!chosen.length) continue;
    const fine = memberMesh(model, chosen, kind, lit, THREE.FrontSide);
    group.add(fine);
    if (chosen.length > SIMPLER) kinds.push({ kind, chosen, fine, simple: null, thickest: largestOf(chosen, radii) });
  }
  const bodies = bodyMesh(model, shared);
  if (bodies) group.add(bodies);
  const { mesh: nodes, uniforms: nodeUniforms } = nodeMesh(model, shared, radii);
  group.add(nodes);
  const supports = supportMesh(model, shared);
  if (supports) group.add(supports.mesh);
  const shadows = shadowMesh(model, shared);
  if (shadows) group.add(shadows);
  const most = [0, 1].map((kind) => sections.reduce((largest, radius, e) => Math.max(largest, model.isBar[e] === kind ? radius : 0), 0));
  let outline = null;

  return {
    group, radii, nodes, shared, canSimplify: kinds.length > 0,
    thinnestBar: sections.reduce((least, radius, e) => (model.isBar[e] ? Math.min(least, radius) : least), Infinity),
    /** Widths by section, or by force: areas as the part of `limit` [N] that members carry. */
    widen(tension, limit) {
      for (let e = 0; e < radii.length; e++) {
        const part = tension ? Math.abs(tension[e]) / limit : NaN;
        radii[e] = Number.isFinite(part) ? most[model.isBar[e]] * Math.min(Math.max(Math.sqrt(part), 0.15), 1.5) : sections[e];
      }
      textures.showWidths();
    },
    /** Let simpler shapes stand for many members that are thin, and leave out many small nodes; pixel: metres of one pixel
        where the camera looks. */
    simplify(isOn, pixel) {
      for (const row of kinds) {
        const isSimple = isOn && row.thickest < THIN[row.kind] * pixel;
        if (isSimple && !row.simple) group.add((row.simple = simpleMesh(model, row, lit)));
        shared.seenLine.value = Math.min(Math.max(row.thickest / (THINNEST * pixel), shared.leastSeen.value), 1);
        row.fine.visible = !isSimple;
        if (row.simple) row.simple.visible = isSimple;
      }
      nodes.visible = !(model.nodeCount > CROWD && nodeUniforms.radius.value < 2.5 * pixel); // their rims would make patterns
    },
    show(palette) {
      const unit = (color) => color.map((value) => value / 255);
      rim.plain.value.set(...unit(palette.ink), 1);
      shared.paper.value.set(...unit(palette.paper));
      shadows?.material.uniforms.shadow.value.set(...unit(palette.shadow));
      bodies?.material.uniforms.fill.value.set(...unit(palette.body));
      nodeUniforms.fill.value.set(...unit(palette.node));
      nodeUniforms.rim.value.set(...unit(palette.isDark ? palette.paper : palette.ink));
      if (!supports) return;
      supports.uniforms.fill.value.set(...unit(palette.support));
      supports.uniforms.partly.value.set(...unit(palette.partly));
    },
    /** pixelSize: metres of one pixel at a distance of 1 m; pixels: its inverse on the drawing buffer. */
    resize(pixelSize, pixels) {
      shared.least.value = THINNEST * pixelSize;
      shared.leastBar.value = (model.memberCount > CROWD ? 1 : 1.5) * THINNEST * pixelSize;
      rim.growth.value = RIM * pixelSize;
      nodeUniforms.pixels.value = pixels;
    },
    choose(member) {
      if (outline) {
        group.remove(outline);
        outline.geometry.dispose();
        outline.material.dispose();
        outline = null;
      }
      if (member === null) return;
      const side = model.isBar[member] ? THREE.BackSide : THREE.DoubleSide;
      outline = memberMesh(model, [member], model.isBar[member], rim, side);
      outline.material.depthWrite = false;
      outline.renderOrder = -1;
      group.add(outline);
    },
  };
}

const largestOf = (chosen, radii) => chosen.reduce((most, e) => Math.max(most, radii[e]), 0);

/** Bars as ribbons, cables as lines of one pixel. */
function simpleMesh(model, { kind, chosen }, uniforms) {
  if (kind) return memberMesh(model, chosen, 0, uniforms, THREE.DoubleSide);
  const geometry = new THREE.BufferGeometry();
  const rows = Float32Array.from(chosen.flatMap((e) => [0, 1].flatMap((end) => [model.ends[2 * e], model.ends[2 * e + 1], e, end])));
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array((3 * rows.length) / 4), 3));
  geometry.setAttribute("row", new THREE.BufferAttribute(rows, 4));
  const mesh = new THREE.LineSegments(geometry, material(glsl.LINE_VERTEX, glsl.LINE_FRAGMENT, uniforms));
  mesh.frustumCulled = false;
  return mesh;
}

const copies = (model, base, chosen) =>
  repeat(base, { member: [chosen.flatMap((e) => [model.ends[2 * e], model.ends[2 * e + 1], e]), 3] }, chosen.length);

function memberMesh(model, chosen, kind, uniforms, side) {
  const base = kind ? capsule(...FINENESS.find(([most]) => chosen.length <= most).slice(1)) : ribbon();
  const geometry = copies(model, base, chosen);
  const shader = kind
    ? material(glsl.BAR_VERTEX, glsl.BAR_FRAGMENT, uniforms, { side })
    : material(glsl.CABLE_VERTEX, glsl.CABLE_FRAGMENT, uniforms, { side: THREE.DoubleSide });
  return drawn(geometry, shader);
}

/** Surfaces of rigid bodies: each vertex is a constant combination of the four nodes that carry its body. */
function bodyMesh(model, shared) {
  const { body_first: first, body_place: place, body_normal: normal, body_triangle: triangle } = model.channels;
  if (!first) return null;
  const geometry = new THREE.BufferGeometry();
  const put = (name, values, size) => geometry.setAttribute(name, new THREE.BufferAttribute(Float32Array.from(values), size));
  put("position", new Float32Array(3 * first.rows), 3);
  put("first", first.values, 1);
  put("place", place.values, 4);
  put("outward", normal.values, 4);
  geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(triangle.values), 1));
  const uniforms = { ...shared, fill: { value: new THREE.Vector3() } };
  return drawn(geometry, material(glsl.BODY_VERTEX, glsl.BODY_FRAGMENT, uniforms));
}

/** What members shade of the ground, where there are few of them. */
function shadowMesh(model, shared) {
  const level = groundLevel(model);
  if (model.memberCount > SHADOWS || model.scene.is_planar || level === null) return null;
  const uniforms = { ...shared, level: { value: level }, shadow: { value: new THREE.Vector3() } };
  const geometry = copies(model, ribbon(), Array.from({ length: model.memberCount }, (_, e) => e));
  const more = { side: THREE.DoubleSide, depthWrite: false };
  return drawn(geometry, material(glsl.SHADOW_VERTEX, glsl.SHADOW_FRAGMENT, uniforms, more), -2);
}

function nodeMesh(model, shared, radii) {
  const most = radii.reduce((largest, radius, e) => Math.max(largest, model.isBar[e] ? radius : 1.6 * radius), 0);
  const geometry = new THREE.BufferGeometry();
  const count = model.shownCount;
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  geometry.setAttribute("node", new THREE.BufferAttribute(Float32Array.from({ length: count }, (_, k) => k), 1));
  const uniforms = {
    ...shared, radius: { value: 1.12 * most }, pixels: { value: 1 },
    fill: { value: new THREE.Vector3() }, rim: { value: new THREE.Vector3() },
  };
  const mesh = new THREE.Points(geometry, material(glsl.NODE_VERTEX, glsl.NODE_FRAGMENT, uniforms));
  mesh.frustumCulled = false;
  return { mesh, uniforms };
}

/** Height of a support [m]; many of them are smaller. */
export function supportSize(model) {
  const { axes } = model.scene;
  const count = model.nodeNames.filter((_, k) => axes.some((axis) => model.anchored[3 * k + axis])).length;
  const crowd = Math.min(1, Math.max(0.25, (24 / Math.max(count, 1)) ** 0.4));
  return Math.min(0.042 * crowd * model.size, 0.14 * model.usualLength);
}

function supportMesh(model, shared) {
  const axes = model.scene.axes;
  const rows = [];
  for (let k = 0; k < model.nodeCount; k++) {
    const held = axes.filter((axis) => model.anchored[3 * k + axis]).length;
    if (held) rows.push(k, held < axes.length ? 1 : 0);
  }
  if (!rows.length) return null;
  const uniforms = {
    ...shared, size: { value: supportSize(model) }, up: { value: new THREE.Vector3(...model.scene.up) },
    fill: { value: new THREE.Vector3() }, partly: { value: new THREE.Vector3() },
  };
  const geometry = repeat(pyramid(), { support: [rows, 2] }, rows.length / 2);
  return { mesh: drawn(geometry, material(glsl.SUPPORT_VERTEX, glsl.SUPPORT_FRAGMENT, uniforms)), uniforms };
}
