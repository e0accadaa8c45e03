// SPDX-License-Identifier: Apache-2.0
// An orbiting camera: eye and target, turned by pointers, wheel and keys.

const sub = (a, b) => a.map((x, i) => x - b[i]);
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => a.map((x) => x / (length(a) || 1));

export class Orbit {
  // `matrix`: worldToCamera as EXR has it, for row vectors: x right, y up, z forward.
  constructor(matrix, bounds) {
    const centre = add(bounds.min, bounds.max).map((x) => x / 2), size = length(sub(bounds.max, bounds.min)) || 1;
    if (matrix) {
      const row = (i) => matrix.slice(4 * i, 4 * i + 3), t = row(3);
      this.eye = [0, 1, 2].map((i) => -dot(t, row(i)));
      const forward = [0, 1, 2].map((i) => row(i)[2]);
      const along = dot(sub(centre, this.eye), forward);
      this.target = add(this.eye, forward, along > 0.05 * size ? along : 0.5 * size);
    } else {
      this.target = centre;
      this.eye = add(centre, [0.5, 0.4, 1], size);
    }
  }
  turn(dx, dy) {
    const arm = sub(this.eye, this.target), r = length(arm);
    const azimuth = Math.atan2(arm[0], arm[2]) - dx;
    const height = Math.max(-1.55, Math.min(1.55, Math.asin(Math.max(-1, Math.min(1, arm[1] / r))) + dy));
    this.eye = add(this.target, [Math.cos(height) * Math.sin(azimuth), Math.sin(height), Math.cos(height) * Math.cos(azimuth)], r);
  }
  pan(dx, dy) {
    const forward = sub(this.target, this.eye), right = unit(cross(forward, [0, 1, 0])), up = unit(cross(right, forward)), r = length(forward);
    for (const end of ['eye', 'target']) this[end] = add(add(this[end], right, -dx * r), up, dy * r);
  }
  dolly(factor) {
    this.eye = add(this.target, sub(this.eye, this.target), factor);
  }
  // worldToCamera of where it is now.
  matrix() {
    const forward = unit(sub(this.target, this.eye)), right = unit(cross(forward, [0, 1, 0])), up = cross(right, forward), axes = [right, up, forward];
    return [...[0, 1, 2].flatMap((i) => [...axes.map((a) => a[i]), 0]), ...axes.map((a) => -dot(this.eye, a)), 1];
  }
  // What it is in a request's camera.
  settings() {
    const vector = (v) => { const [x, y, z] = v.map((c) => Number(c.toPrecision(7))); return { x, y, z }; };  // what a float holds
    return { position: vector(this.eye), look_at: vector(this.target), up: { x: 0, y: 1, z: 0 } };
  }
}

const product = (a, b) => Array.from({ length: 16 }, (_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + a[(i & 12) + k] * b[4 * k + (i & 3)], 0));
function inverse(m) {  // of a rotation and a translation
  const r = [0, 1, 2].map((i) => [0, 1, 2].map((j) => m[4 * j + i])), t = m.slice(12, 15);
  return [...r.flatMap((row) => [...row, 0]), ...[0, 1, 2].map((j) => -(t[0] * r[0][j] + t[1] * r[1][j] + t[2] * r[2][j])), 1];
}
// The matrices of a camera with the same lens that stands elsewhere.
export function moved(matrices, worldToCamera) {
  return { worldToCamera, worldToNDC: product(worldToCamera, product(inverse(matrices.worldToCamera), matrices.worldToNDC)) };
}

// `on`: {orbit(): the Orbit or null, moved(), home(), turnSky(degrees), pick(x, y): 0 to 1 from the top left corner}
export function steer(canvas, on) {
  const pointers = new Map();
  let still = null;  // a press that has not become a drag
  canvas.addEventListener('pointerdown', (e) => {
    canvas.setPointerCapture(e.pointerId);
    pointers.set(e.pointerId, [e.clientX, e.clientY]);
    still = pointers.size === 1 && e.button === 0 ? [e.clientX, e.clientY] : null;
  });
  canvas.addEventListener('pointerup', (e) => {
    pointers.delete(e.pointerId);
    if (!still) return;
    const box = canvas.getBoundingClientRect();
    on.pick((still[0] - box.left) / box.width, (still[1] - box.top) / box.height);
    still = null;
  });
  canvas.addEventListener('pointercancel', (e) => {
    pointers.delete(e.pointerId);
    still = null;
  });
  canvas.addEventListener('pointermove', (e) => {
    const before = pointers.get(e.pointerId), o = on.orbit();
    if (!before || !o) return;
    if (still && Math.hypot(e.clientX - still[0], e.clientY - still[1]) < 4) return;
    still = null;
    const scale = 1 / canvas.clientHeight, dx = (e.clientX - before[0]) * scale, dy = (e.clientY - before[1]) * scale;
    const other = [...pointers].find(([id]) => id !== e.pointerId);
    pointers.set(e.pointerId, [e.clientX, e.clientY]);
    if (e.altKey) return on.turnSky(dx * 180);
    if (other) {  // two fingers: their distance dollies, what they share pans
      const far = (p) => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]) || 1;
      o.dolly(far(before) / far([e.clientX, e.clientY]));
      o.pan(dx / 2, dy / 2);
    } else if (e.shiftKey || e.buttons & 4) o.pan(dx, dy);
    else o.turn(dx * 4, dy * 4);
    on.moved();
  });
  canvas.addEventListener('wheel', (e) => {
    e.preventDefault();
    if (!on.orbit()) return;
    on.orbit().dolly(Math.exp(Math.max(-120, Math.min(120, e.deltaY)) * 0.002));
    on.moved();
  }, { passive: false });
  canvas.addEventListener('keydown', (e) => {
    const o = on.orbit(), step = 0.1;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (!o || e.ctrlKey || e.metaKey) return;
    if (e.altKey) {
      if (!arrow?.[0]) return;
      on.turnSky(5 * arrow[0]);
    } else if (e.key === 'Enter') on.pick(0.5, 0.5);
    else if (e.key === 'Home') on.home();
    else {
      if (arrow) o[e.shiftKey ? 'pan' : 'turn'](arrow[0] * step, arrow[1] * step);
      else if (e.key === '+' || e.key === '=') o.dolly(0.9);
      else if (e.key === '-') o.dolly(1 / 0.9);
      else return;
      on.moved();
    }
    e.preventDefault();
  });
}
