// Poses as 16 numbers by rows [m], moved as a mouse over the image moves them; camera axes: x right, y down, z away.

/** @typedef {import("./messages.d.ts").Pose} Pose */

/** @type {(T: Pose) => number[]} */
export const origin = (T) => [T[3], T[7], T[11]];
/** @type {(point: number[], K: number[]) => number[]} */
export const project = ([x, y, z], K) => [(K[0] * x) / z + K[2], (K[4] * y) / z + K[5]];
/** @type {(pixel: number[], depth: number, K: number[]) => number[]} */
export const pointAt = ([u, v], depth, K) => [((u - K[2]) / K[0]) * depth, ((v - K[5]) / K[4]) * depth, depth];
/** @type {(a: number[], b: number[]) => number} */
export const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

/** @type {(T: Pose, by: number[]) => Pose} */
export function shifted(T, [x, y, z]) {
  const out = [...T];
  out[3] += x;
  out[7] += y;
  out[11] += z;
  return out;
}

// So many pixels to the right and down, at the depth of its origin.
export const dragged = (T, du, dv, K) => shifted(T, [(du * T[11]) / K[0], (dv * T[11]) / K[4], 0]);

// So many metres away along the ray through its origin, so that it stays where it is in the image.
export function receded(T, by) {
  const p = origin(T);
  const far = Math.hypot(...p);
  return far + by > 0.02 ? shifted(T, p.map((x) => (x / far) * by)) : T;
}

// Turned about an axis of the camera through its origin, by an angle [rad].
export function turned(T, axis, angle) {
  const n = Math.hypot(...axis);
  if (!n || !angle) return T;
  const [x, y, z] = axis.map((a) => a / n);
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  const d = 1 - c;
  const R = [c + x * x * d, x * y * d - z * s, x * z * d + y * s, y * x * d + z * s, c + y * y * d, y * z * d - x * s,
    z * x * d - y * s, z * y * d + x * s, c + z * z * d];
  const out = [...T];
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) out[4 * i + j] = R[3 * i] * T[j] + R[3 * i + 1] * T[4 + j] + R[3 * i + 2] * T[8 + j];
  }
  return orthonormal(out);
}

// Rounding must not add up over a long drag.
function orthonormal(T) {
  const column = (j) => [T[j], T[4 + j], T[8 + j]];
  const unit = (a) => a.map((x) => x / Math.hypot(...a));
  const a = unit(column(0));
  const b0 = column(1);
  const along = a[0] * b0[0] + a[1] * b0[1] + a[2] * b0[2];
  const b = unit(b0.map((x, i) => x - along * a[i]));
  const c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const out = [...T];
  for (let i = 0; i < 3; i++) [out[4 * i], out[4 * i + 1], out[4 * i + 2]] = [a[i], b[i], c[i]];
  return out;
}

// How far a pose is from another: mm and degrees.
export function between(from, to) {
  let trace = 0;
  for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) trace += from[4 * i + j] * to[4 * i + j];
  // Near 0 and 180° the cosine alone loses its digits: the sine comes from the antisymmetric part of the turn.
  const turn = (i, j) => [0, 1, 2].reduce((sum, k) => sum + to[4 * i + k] * from[4 * j + k], 0);
  const sine = Math.hypot(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1)) / 2;
  return { mm: 1000 * distance(origin(from), origin(to)), deg: (Math.atan2(sine, (trace - 1) / 2) * 180) / Math.PI };
}

// From one pose to another in six numbers, along the camera's axes or the object's own at first: mm, and a rotation
// vector in degrees.
export function displacement(from, to, axes) {
  const R = (i, j) => [0, 1, 2].reduce((sum, k) => sum + to[4 * i + k] * from[4 * j + k], 0);
  const { deg } = between(from, to);
  const way = [R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)];
  const n = Math.hypot(...way);
  const shift = [3, 7, 11].map((i) => 1000 * (to[i] - from[i]));
  const turn = way.map((x) => (n > 1e-9 ? (x / n) * deg : 0));
  return axes === "object" ? [inverse(from, shift), inverse(from, turn)] : [shift, turn];
}

export function displaced(from, shift, turn, axes) {
  const [way, about] = axes === "object" ? [rotated(from, shift), rotated(from, turn)] : [shift, turn];
  return shifted(turned(from, about, (Math.hypot(...turn) * Math.PI) / 180), way.map((mm) => mm / 1000));
}

const rotated = (T, v) => [0, 1, 2].map((i) => v.reduce((sum, x, j) => sum + T[4 * i + j] * x, 0));
const inverse = (T, v) => [0, 1, 2].map((j) => v.reduce((sum, x, i) => sum + T[4 * i + j] * x, 0));
