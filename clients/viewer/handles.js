// SPDX-License-Identifier: Apache-2.0
// Lights, and an object, in the picture: a button each where it stands. Dragged, it moves in the plane through it that faces the camera; arrow keys do the same, Page Up
// and Page Down move it away and nearer.

const kMost = 64;  // the strongest; more would hide the picture

// A point (x, y, z) by a matrix for row vectors: four numbers.
const by = (m, p) => [0, 1, 2, 3].map((c) => p.x * m[c] + p.y * m[4 + c] + p.z * m[8 + c] + m[12 + c]);
const moved = (p, axis, t) => ({ x: p.x + t * axis[0], y: p.y + t * axis[1], z: p.z + t * axis[2] });

// Where a point is in the picture, 0 to 1 from its top left corner; null: behind the camera.
export function project(matrices, p) {
  const [x, y, , w] = by(matrices.worldToNDC, p);
  return w > 1e-6 ? [x / w, y / w] : null;
}

const axis = (m, column) => [m[column], m[4 + column], m[8 + column]];  // right, up, forward in the world

// The point that is (dx, dy) pictures beside `p` and as far from the camera's plane.
export function shifted(matrices, p, dx, dy) {
  const right = axis(matrices.worldToCamera, 0), up = axis(matrices.worldToCamera, 1), at = project(matrices, p);
  const a = project(matrices, moved(p, right, 1)), b = project(matrices, moved(p, up, 1));
  if (!at || !a || !b) return p;
  return moved(moved(p, right, dx / (a[0] - at[0])), up, dy / (b[1] - at[1]));
}

export class Handles {
  // `on`: {select(name), move(name, position)}; `kind`: Light or Object
  constructor(root, on, kind = 'Light') {
    this.root = root;
    this.on = on;
    this.kind = kind;
    this.lights = [];
    this.matrices = null;
    this.buttons = new Map();
  }

  // `lights`: [{name, kind, position, power}]; `matrices` null: nobody knows where they are in the picture.
  show(lights, matrices, selected) {
    const strength = (l) => (l.power?.x ?? 0) + (l.power?.y ?? 0) + (l.power?.z ?? 0);
    this.lights = lights.length > kMost ? [...lights].sort((a, b) => strength(b) - strength(a)).slice(0, kMost) : lights;
    this.matrices = matrices;
    for (const [name, button] of this.buttons) {
      if (this.lights.some((l) => l.name === name)) continue;
      button.remove();
      this.buttons.delete(name);
    }
    for (const light of this.lights) {
      const button = this.buttons.get(light.name) ?? this.make(light);
      this.place(button, light);
      button.ariaPressed = String(light.name === selected);
    }
  }

  place(button, light) {
    const at = this.matrices && project(this.matrices, light.position);
    button.hidden = !at || at.some((v) => !(v >= 0 && v <= 1));
    if (button.hidden) return;
    button.style.left = `${100 * at[0]}%`;
    button.style.top = `${100 * at[1]}%`;
  }

  make(light) {
    const button = Object.assign(document.createElement('button'), { type: 'button', className: `handle ${this.kind.toLowerCase()}`, title: light.name });
    button.ariaLabel = `${this.kind} ${light.name}: drag or arrow keys move it, Page Up and Page Down away and nearer`;
    button.dataset[this.kind.toLowerCase()] = light.name;
    const now = () => this.lights.find((l) => l.name === light.name);
    const move = (position) => {
      now().position = position;
      this.place(button, now());
      this.on.move(light.name, position);
    };
    let grip = null;
    button.addEventListener('pointerdown', (e) => {
      button.setPointerCapture(e.pointerId);
      grip = { x: e.clientX, y: e.clientY, from: now().position, matrices: this.matrices };
      this.on.select(light.name);
      e.preventDefault();
      button.focus();
    });
    button.addEventListener('pointermove', (e) => {
      if (!grip) return;
      const box = this.root.getBoundingClientRect();
      move(shifted(grip.matrices, grip.from, (e.clientX - grip.x) / box.width, (e.clientY - grip.y) / box.height));
    });
    for (const end of ['pointerup', 'pointercancel']) button.addEventListener(end, () => { grip = null; });
    button.addEventListener('click', () => this.on.select(light.name));
    button.addEventListener('keydown', (e) => {
      const step = { ArrowLeft: [-0.02, 0], ArrowRight: [0.02, 0], ArrowUp: [0, -0.02], ArrowDown: [0, 0.02] }[e.key], away = { PageUp: 1, PageDown: -1 }[e.key];
      if (!this.matrices || (!step && !away)) return;
      e.preventDefault();
      const p = now().position;
      if (step) return move(shifted(this.matrices, p, ...step));
      const depth = by(this.matrices.worldToCamera, p)[2];
      move(moved(p, axis(this.matrices.worldToCamera, 2), away * 0.05 * Math.max(Math.abs(depth), 1e-3)));
    });
    this.root.append(button);
    this.buttons.set(light.name, button);
    return button;
  }
}
