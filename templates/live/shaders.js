// GLSL of members, nodes, supports and arrows. Positions of nodes and colours of members are textures, so that
// a new state costs two uploads, whatever the number of members.

const READ = `
precision highp float;
precision highp int;
uniform highp sampler2D nodes;
uniform highp sampler2D colors;
uniform highp sampler2D widths;
vec3 nodeAt(float index) {
  int k = int(index + 0.5), w = textureSize(nodes, 0).x;
  return texelFetch(nodes, ivec2(k % w, k / w), 0).xyz;
}
vec4 colorAt(float index) {
  int k = int(index + 0.5), w = textureSize(colors, 0).x;
  return texelFetch(colors, ivec2(k % w, k / w), 0);
}
float radiusAt(float index) {
  int k = int(index + 0.5), w = textureSize(widths, 0).x;
  return texelFetch(widths, ivec2(k % w, k / w), 0).x;
}
mat3 frameAlong(vec3 w) {
  vec3 other = abs(w.z) < 0.8 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0);
  vec3 u = normalize(cross(other, w));
  return mat3(u, cross(w, u), w);
}
`;

// One light from above the left shoulder of the observer, one weak from below; normals are those of the view.
const LIGHT = `
vec3 shade(vec3 color, vec3 normal) {
  float key = max(dot(normal, normalize(vec3(-0.45, 0.75, 0.6))), 0.0);
  float fill = max(dot(normal, normalize(vec3(0.6, -0.5, 0.35))), 0.0);
  float shine = pow(max(dot(normal, normalize(vec3(-0.25, 0.45, 0.86))), 0.0), 28.0);
  return color * (0.56 + 0.46 * key + 0.12 * fill) + 0.13 * shine;
}
`;

/** Bars: capsules whose two halves sit at the two nodes. */
export const BAR_VERTEX = `${READ}
in float half_;
in vec3 member;
uniform float growth, leastBar;
out vec3 viewNormal;
out vec4 color;
void main() {
  vec3 a = nodeAt(member.x), b = nodeAt(member.y), along = b - a;
  float length_ = length(along);
  mat3 frame = frameAlong(length_ > 0.0 ? along / length_ : vec3(0.0, 0.0, 1.0));
  vec3 center = mix(a, b, half_);
  float depth = -(viewMatrix * vec4(center, 1.0)).z;
  float r = max(radiusAt(member.z), leastBar * depth) + growth * depth;
  vec3 normal_ = frame * position;
  viewNormal = mat3(viewMatrix) * normal_;
  color = colorAt(member.z);
  gl_Position = projectionMatrix * viewMatrix * vec4(center + r * normal_, 1.0);
}`;
export const BAR_FRAGMENT = `precision highp float;
in vec3 viewNormal;
in vec4 color;
out vec4 outColor;
uniform vec4 plain;
${LIGHT}
void main() {
  vec3 lit = plain.a > 0.5 ? plain.rgb : shade(color.rgb, normalize(viewNormal));
  outColor = vec4(lit, 1.0);
}`;

/** Rigid bodies: their four nodes are `first` and the three after it. */
export const BODY_VERTEX = `${READ}
in float first;
in vec4 place, outward;
out vec3 viewNormal;
void main() {
  vec3 a = nodeAt(first);
  mat3 edges = mat3(nodeAt(first + 1.0) - a, nodeAt(first + 2.0) - a, nodeAt(first + 3.0) - a);
  viewNormal = mat3(viewMatrix) * (edges * outward.yzw);
  gl_Position = projectionMatrix * viewMatrix * vec4(a + edges * place.yzw, 1.0);
}`;
export const BODY_FRAGMENT = `precision highp float;
in vec3 viewNormal;
out vec4 outColor;
uniform vec3 fill;
${LIGHT}
void main() { outColor = vec4(shade(fill, normalize(viewNormal)), 1.0); }`;

/** Cables: ribbons that turn to the observer and are lit as tubes; dashed where slack. */
export const CABLE_VERTEX = `${READ}
in vec3 member;
uniform float growth, least, leastSeen;
out vec3 sideNormal;
out vec3 frontNormal;
out float across;
out float along_;
out float seen;
out vec4 color;
void main() {
  vec3 a = (viewMatrix * vec4(nodeAt(member.x), 1.0)).xyz, b = (viewMatrix * vec4(nodeAt(member.y), 1.0)).xyz;
  vec3 d = b - a, center = mix(a, b, position.x);
  vec3 side = cross(d, center);
  float size = length(side);
  side = size > 1e-12 ? side / size : vec3(1.0, 0.0, 0.0);
  vec4 painted = colorAt(member.z);
  float depth = -center.z, radius = radiusAt(member.z);
  seen = clamp(radius / (least * depth), leastSeen, 1.0);
  float r = (max(radius, least * depth) + growth * depth) * (painted.a < 0.5 && growth == 0.0 ? 0.7 : 1.0);
  across = position.y;
  along_ = position.x * length(d) / max(r, 1e-12);
  sideNormal = side;
  vec3 front = cross(side, d);
  frontNormal = normalize(dot(front, center) > 0.0 ? -front : front);
  color = painted;
  gl_Position = projectionMatrix * vec4(center + side * position.y * r, 1.0);
}`;
export const CABLE_FRAGMENT = `precision highp float;
in vec3 sideNormal;
in vec3 frontNormal;
in float across;
in float along_;
in float seen;
in vec4 color;
out vec4 outColor;
uniform vec4 plain;
uniform vec3 paper;
${LIGHT}
void main() {
  if (plain.a < 0.5 && color.a < 0.5 && mod(along_, 11.0) > 6.5) discard;
  vec3 normal_ = normalize(sideNormal * across + frontNormal * sqrt(max(1.0 - across * across, 0.0)));
  outColor = vec4(plain.a > 0.5 ? plain.rgb : mix(paper, shade(color.rgb, normal_), seen), 1.0);
}`;

/** Cables as lines, where a slow picture moves: one vertex an end. */
export const LINE_VERTEX = `${READ}
in vec4 row;
uniform float least, seenLine;
uniform vec3 paper;
out float along_;
out vec4 color;
void main() {
  vec3 a = nodeAt(row.x), b = nodeAt(row.y);
  vec4 place = viewMatrix * vec4(mix(a, b, row.w), 1.0);
  color = colorAt(row.z);
  along_ = color.a < 0.5 ? row.w * distance(a, b) / max(-least * place.z, 1e-12) : 0.0;
  color.rgb = mix(paper, 0.92 * color.rgb, seenLine);
  gl_Position = projectionMatrix * place;
}`;
export const LINE_FRAGMENT = `precision highp float;
in float along_;
in vec4 color;
out vec4 outColor;
void main() {
  if (mod(along_, 11.0) > 6.5) discard;
  outColor = vec4(color.rgb, 1.0);
}`;

/** Shadows of members straight below them on the ground, as flat ribbons. */
export const SHADOW_VERTEX = `${READ}
in vec3 member;
uniform float least, level;
void main() {
  vec2 a = nodeAt(member.x).xy, b = nodeAt(member.y).xy, d = b - a;
  vec4 place = viewMatrix * vec4(mix(a, b, position.x), level, 1.0);
  float r = max(radiusAt(member.z), -least * place.z), size = length(d);
  vec2 side = size > r ? vec2(-d.y, d.x) * (r / size) : vec2(0.0, r);
  gl_Position = projectionMatrix * (place + viewMatrix * vec4(position.y * side, 0.0, 0.0));
}`;
export const SHADOW_FRAGMENT = `precision highp float;
uniform vec3 shadow;
out vec4 outColor;
void main() { outColor = vec4(shadow, 1.0); }`;

/** Nodes: round points that are lit as spheres. */
export const NODE_VERTEX = `${READ}
in float node;
uniform float radius, least, pixels;
void main() {
  vec4 place = viewMatrix * vec4(nodeAt(node), 1.0);
  float depth = -place.z, r = max(radius, least * depth);
  place.z += 1.4 * r;
  gl_Position = projectionMatrix * place;
  gl_PointSize = 2.0 * r * pixels / max(depth - r, 1e-9);
}`;
export const NODE_FRAGMENT = `precision highp float;
uniform vec3 fill, rim;
out vec4 outColor;
${LIGHT}
void main() {
  vec2 p = vec2(2.0, -2.0) * (gl_PointCoord - 0.5);
  float r2 = dot(p, p);
  if (r2 > 1.0) discard;
  vec3 normal_ = vec3(p, sqrt(1.0 - r2));
  outColor = vec4(r2 > 0.62 ? rim : shade(fill, normal_), 1.0);
}`;

/** Supports: pyramids whose tips are the anchored nodes. */
export const SUPPORT_VERTEX = `${READ}
in vec2 support;
uniform float size;
uniform vec3 up;
out vec3 viewNormal;
out float isPartly;
void main() {
  mat3 frame = frameAlong(up);
  viewNormal = mat3(viewMatrix) * (frame * normal);
  isPartly = support.y;
  gl_Position = projectionMatrix * viewMatrix * vec4(nodeAt(support.x) + size * (frame * position), 1.0);
}`;
export const SUPPORT_FRAGMENT = `precision highp float;
in vec3 viewNormal;
in float isPartly;
uniform vec3 fill, partly;
out vec4 outColor;
${LIGHT}
void main() { outColor = vec4(shade(isPartly > 0.5 ? partly : fill, normalize(viewNormal)), 1.0); }`;

/** Axes in the upper left corner: arms of 24 pixels and letters of 6. */
export const AXES_VERTEX = `precision highp float;
in vec2 stroke;
uniform vec2 size;
void main() {
  vec2 place = vec2(42.0, size.y - 44.0) + 24.0 * (mat3(viewMatrix) * position).xy + 3.0 * stroke;
  gl_Position = vec4(2.0 * place / size - 1.0, 0.0, 1.0);
}`;
export const AXES_FRAGMENT = `precision highp float;
uniform vec3 ink;
out vec4 outColor;
void main() { outColor = vec4(ink, 1.0); }`;

/** Arrows: a shaft and a head along a vector; the head is at \`end\`. */
export const ARROW_VERTEX = `${READ}
in float isHead;
in vec2 row;
uniform float thinnest, least;
uniform highp sampler2D arrows;
uniform vec3 loadColor, reactionColor;
out vec3 viewNormal;
out vec3 shown;
void main() {
  int k = int(row.x + 0.5), w = textureSize(arrows, 0).x / 2;
  vec3 start = texelFetch(arrows, ivec2(2 * (k % w), k / w), 0).xyz;
  vec3 vector = texelFetch(arrows, ivec2(2 * (k % w) + 1, k / w), 0).xyz;
  float length_ = length(vector), thickness = max(thinnest, -least * (viewMatrix * vec4(start, 1.0)).z);
  float head = min(6.5 * thickness, 0.6 * length_);
  mat3 frame = frameAlong(length_ > 0.0 ? vector / length_ : vec3(0.0, 0.0, 1.0));
  float z = isHead > 0.5 ? length_ - head + position.z * head : position.z * (length_ - head);
  vec3 local = vec3(position.xy * thickness * (isHead > 0.5 ? head / (2.6 * thickness) : 1.0), z);
  viewNormal = mat3(viewMatrix) * (frame * normal);
  shown = row.y > 0.5 ? reactionColor : loadColor;
  gl_Position = projectionMatrix * viewMatrix * vec4(start + frame * local, length_ > 0.0 ? 1.0 : 0.0);
}`;
export const ARROW_FRAGMENT = `precision highp float;
in vec3 viewNormal;
in vec3 shown;
out vec4 outColor;
${LIGHT}
void main() { outColor = vec4(shade(shown, normalize(viewNormal)), 1.0); }`;
