// Small meshes, and many copies of one as a single mesh.

import { THREE } from "three";

const newGeometry = (attributes, index) => {
  const geometry = new THREE.BufferGeometry();
  for (const [name, [values, size]] of Object.entries(attributes)) {
    geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(values), size));
  }
  geometry.setIndex(index);
  return geometry;
};

/** Return `count` copies of a geometry as one, where attributes of copies have `size` numbers a copy. Software and
    some graphics drivers draw instances one by one; this is one draw for them, too. */
export function repeat(base, attributes, count) {
  const geometry = new THREE.BufferGeometry();
  const vertices = base.attributes.position.count;
  for (const [name, { array, itemSize }] of Object.entries(base.attributes)) {
    const values = new Float32Array(count * array.length);
    for (let k = 0; k < count; k++) values.set(array, k * array.length);
    geometry.setAttribute(name, new THREE.BufferAttribute(values, itemSize));
  }
  for (const [name, [rows, size]] of Object.entries(attributes)) {
    const values = new Float32Array(count * vertices * size);
    for (let k = 0; k < count * vertices; k++) {
      const copy = Math.floor(k / vertices) * size;
      for (let c = 0; c < size; c++) values[k * size + c] = rows[copy + c];
    }
    geometry.setAttribute(name, new THREE.BufferAttribute(values, size));
  }
  const index = base.index ? Array.from(base.index.array) : Array.from({ length: vertices }, (_, k) => k);
  const all = new Uint32Array(count * index.length);
  for (let k = 0; k < count; k++) {
    for (let i = 0; i < index.length; i++) all[k * index.length + i] = index[i] + k * vertices;
  }
  geometry.setIndex(new THREE.BufferAttribute(all, 1));
  base.dispose();
  return geometry;
}

/** A capsule: a unit sphere whose upper half belongs to the second node; `sides` around, `rings` a half. */
export function capsule(sides, rings) {
  const points = [];
  const halves = [];
  const index = [];
  const levels = [];
  for (let k = 0; k <= rings; k++) levels.push([-Math.PI / 2 + (k / rings) * (Math.PI / 2), 0]);
  for (let k = 0; k <= rings; k++) levels.push([(k / rings) * (Math.PI / 2), 1]);
  for (const [angle, half] of levels) {
    for (let s = 0; s < sides; s++) {
      const turn = (2 * Math.PI * s) / sides;
      points.push(Math.cos(angle) * Math.cos(turn), Math.cos(angle) * Math.sin(turn), Math.sin(angle));
      halves.push(half);
    }
  }
  for (let k = 0; k + 1 < levels.length; k++) {
    for (let s = 0; s < sides; s++) {
      const [a, b] = [k * sides + s, k * sides + ((s + 1) % sides)];
      index.push(a, b, a + sides, b, b + sides, a + sides);
    }
  }
  return newGeometry({ position: [points, 3], half_: [halves, 1] }, index);
}

/** A ribbon: along from 0 to 1, across from -1 to 1. */
export function ribbon() {
  return newGeometry({ position: [[0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0], 3] }, [0, 1, 2, 0, 2, 3]);
}

/** A pyramid with its tip at the origin, its base below. */
export function pyramid() {
  const geometry = new THREE.ConeGeometry(0.62, 1, 4, 1).rotateX(Math.PI / 2).translate(0, 0, -0.5).toNonIndexed();
  geometry.computeVertexNormals();
  const { position, normal } = geometry.attributes;
  return newGeometry({ position: [position.array, 3], normal: [normal.array, 3] }, null);
}

/** An arrow of unit size: a shaft of radius 1 and a head of radius 1, each from z = 0 to 1. */
export function arrow(sides) {
  const shaft = new THREE.CylinderGeometry(1, 1, 1, sides, 1, true).rotateX(Math.PI / 2).translate(0, 0, 0.5).toNonIndexed();
  const head = new THREE.ConeGeometry(1, 1, sides).rotateX(Math.PI / 2).translate(0, 0, 0.5).toNonIndexed();
  const joined = (name) => [...shaft.attributes[name].array, ...head.attributes[name].array];
  const counts = [shaft.attributes.position.count, head.attributes.position.count];
  const isHead = [...new Array(counts[0]).fill(0), ...new Array(counts[1]).fill(1)];
  return newGeometry({ position: [joined("position"), 3], normal: [joined("normal"), 3], isHead: [isHead, 1] }, null);
}
