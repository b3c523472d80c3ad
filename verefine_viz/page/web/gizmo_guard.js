// A press that misses a handle of the edited pose by a few pixels does not turn the 3D view. Of viser's own parts it reads
// the camera and the node of the handles, and holds the camera (scene3d/viser_page.py).

const REACH_PX = 26; // what can be grasped ends about 17 px from a line
const GIZMO = "/cam/gizmo";
const RING = 0.65; // radius of the arcs that turn, of the length of an axis: drei's PivotControls
const STEPS = 12;

// 4×4 by columns, times a point.
/** @type {(m: number[], point: number[]) => number[]} */
const times = (m, [x, y, z, w]) => [0, 1, 2, 3].map((i) => m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i] * w);
const unit = (v) => v.map((x) => x / Math.hypot(...v));

/**
 * Points of the handles on the screen of viser's window [CSS px], `size` px long: along three axes and three arcs.
 * @returns {number[][]}
 */
export function handlePoints(window, size) {
  const viser = window.__viserMutable;
  const node = viser?.nodeRefFromName?.[GIZMO];
  const { camera } = viser ?? {};
  if (!node || !camera) return [];
  const m = node.matrixWorld.elements;
  const middle = [m[12], m[13], m[14]];
  const axes = [0, 4, 8].map((i) => unit([m[i], m[i + 1], m[i + 2]]));
  const depth = -times(camera.matrixWorldInverse.elements, [...middle, 1])[2];
  const { innerWidth: w, innerHeight: h } = window;
  const length = (size * 2 * Math.tan((camera.fov * Math.PI) / 360) * depth) / h;
  const seen = (offset) => {
    const at = times(camera.matrixWorldInverse.elements, [...middle.map((x, i) => x + length * offset[i]), 1]);
    const [x, y, , q] = times(camera.projectionMatrix.elements, at);
    return [((x / q + 1) / 2) * w, ((1 - y / q) / 2) * h];
  };
  const shares = Array.from({ length: STEPS + 1 }, (_, i) => i / STEPS);
  return axes.flatMap((axis, i) => shares.flatMap((share) => {
    const [c, s] = [Math.cos((share * Math.PI) / 2), Math.sin((share * Math.PI) / 2)];
    const next = axes[(i + 1) % 3];
    return [seen(axis.map((x) => share * x)), seen(axis.map((x, j) => RING * (c * x + s * next[j])))];
  }));
}

/**
 * Guards viser's window; `sizeOf` gives the length of the handles.
 * @param {() => number} sizeOf
 */
export function guardGizmo(window, sizeOf) {
  /** @type {{ enabled: boolean } | null} */
  let held = null;
  window.addEventListener("pointerdown", (event) => {
    const controls = window.__viserMutable?.cameraControl;
    const isNear = (/** @type {number[]} */ [x, y]) => Math.hypot(x - event.clientX, y - event.clientY) <= REACH_PX;
    if (!controls?.enabled || !handlePoints(window, sizeOf()).some(isNear)) return;
    held = controls;
    held.enabled = false;
  }, true);
  const release = () => {
    if (held) held.enabled = true;
    held = null;
  };
  for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, release, true);
}
