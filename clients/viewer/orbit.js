// SPDX-License-Identifier: Apache-2.0
// An orbiting camera: eye and target, turned by pointers, wheel and keys. Says `changed(camera)`; null: the scene's own again.

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
    this.home = { eye: this.eye, target: this.target };
    this.own = true;  // nothing has been moved
  }
  reset() {
    Object.assign(this, this.home);
    this.own = true;
  }
  turn(dx, dy) {
    const arm = sub(this.eye, this.target), r = length(arm);
    const azimuth = Math.atan2(arm[0], arm[2]) - dx;
    const height = Math.max(-1.55, Math.min(1.55, Math.asin(Math.max(-1, Math.min(1, arm[1] / r))) + dy));
    this.eye = add(this.target, [Math.cos(height) * Math.sin(azimuth), Math.sin(height), Math.cos(height) * Math.cos(azimuth)], r);
    this.own = false;
  }
  pan(dx, dy) {
    const forward = sub(this.target, this.eye), right = unit(cross(forward, [0, 1, 0])), up = unit(cross(right, forward)), r = length(forward);
    for (const end of ['eye', 'target']) this[end] = add(add(this[end], right, -dx * r), up, dy * r);
    this.own = false;
  }
  dolly(factor) {
    this.eye = add(this.target, sub(this.eye, this.target), factor);
    this.own = false;
  }
  settings() {
    const vector = ([x, y, z]) => ({ x, y, z });
    return this.own ? null : { position: vector(this.eye), look_at: vector(this.target), up: { x: 0, y: 1, z: 0 } };
  }
}

export function steer(canvas, orbit, changed) {
  const pointers = new Map();
  canvas.addEventListener('pointerdown', (e) => {
    canvas.setPointerCapture(e.pointerId);
    pointers.set(e.pointerId, [e.clientX, e.clientY]);
  });
  for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, (e) => pointers.delete(e.pointerId));
  canvas.addEventListener('pointermove', (e) => {
    const before = pointers.get(e.pointerId);
    if (!before || !orbit()) return;
    const scale = 1 / canvas.clientHeight, dx = (e.clientX - before[0]) * scale, dy = (e.clientY - before[1]) * scale;
    const other = [...pointers].find(([id]) => id !== e.pointerId);
    if (other) {  // two fingers: their distance dollies, what they share pans
      const far = (p) => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]) || 1;
      orbit().dolly(far(before) / far([e.clientX, e.clientY]));
      orbit().pan(dx / 2, dy / 2);
    } else if (e.shiftKey || e.buttons & 4) orbit().pan(dx, dy);
    else orbit().turn(dx * 4, dy * 4);
    pointers.set(e.pointerId, [e.clientX, e.clientY]);
    changed();
  });
  canvas.addEventListener('wheel', (e) => {
    e.preventDefault();
    if (!orbit()) return;
    orbit().dolly(Math.exp(Math.max(-120, Math.min(120, e.deltaY)) * 0.002));
    changed();
  }, { passive: false });
  canvas.addEventListener('keydown', (e) => {
    const o = orbit(), step = 0.1;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (!o || e.ctrlKey || e.altKey || e.metaKey) return;
    if (arrow) o[e.shiftKey ? 'pan' : 'turn'](arrow[0] * step, arrow[1] * step);
    else if (e.key === '+' || e.key === '=') o.dolly(0.9);
    else if (e.key === '-') o.dolly(1 / 0.9);
    else if (e.key === 'Home') o.reset();
    else return;
    e.preventDefault();
    changed();
  });
}
