// SPDX-License-Identifier: Apache-2.0
// The lights of the scene and those added to it: a list, the controls of the chosen one, handles in the picture.
import { Handles } from './handles.js';
import { Lamp } from './lamp.js';

const kPlaced = new Set(['point', 'spot', 'rect', 'disk', 'sphere']);
const vector = (v) => ({ x: v?.x ?? 0, y: v?.y ?? 0, z: v?.z ?? 0 });

// What a new light is like in a scene of this size.
function fresh(kind, at, size) {
  const area = { intensity: 10, direction: { x: 0, y: -1, z: 0 } }, side = Number((0.15 * size).toPrecision(3));
  return { kind, ...{
    POINT: { intensity: Number((0.5 * size * size).toPrecision(3)) }, SPOT: { intensity: Number((0.5 * size * size).toPrecision(3)), direction: { x: 0, y: -1, z: 0 } },
    DIRECTIONAL: { intensity: 3, direction: { x: -0.4, y: -1, z: -0.3 } }, RECT: { ...area, width: side, height: side }, DISK: { ...area, radius: side / 2 },
    SPHERE: { intensity: 10, radius: side / 3 },
  }[kind], ...(kind === 'DIRECTIONAL' ? {} : { position: at }) };
}

export class Lights {
  // `root`: #lights; `stage`: #handles; `lamp`: #lamp; `on`: {changed(path), place(): {point, size} for a new light, filter()}
  constructor(root, stage, lamp, on) {
    this.root = root;
    this.on = on;
    this.list = root.querySelector('#light');
    this.group = root.querySelector('#light-fields');
    this.handles = new Handles(stage, {
      select: (name) => this.select(name, true),
      move: (name, p) => this.edit(name, 'position', Object.fromEntries(Object.entries(p).map(([a, v]) => [a, Number(v.toPrecision(7))]))),
    });
    this.stage = stage;
    this.lamp = new Lamp(lamp, (name, gain) => this.edit(name, 'gain', gain));
    this.list.addEventListener('change', () => this.select(this.list.value, true));
    root.querySelector('#add-light').addEventListener('click', () => this.add(root.querySelector('#new-light').value));
    root.querySelector('#drop-light').addEventListener('click', () => this.drop());
  }

  // A new scene or a new start.
  build(panel, scene) {
    this.panel = panel;
    this.scene = scene;
    this.selected = null;
    this.fill();
    this.select(this.all()[0]?.name ?? null);
  }

  all() {
    const edits = this.panel.get(['lights']) ?? {}, own = this.scene.lights ?? [];
    const added = Object.entries(edits).filter(([name, e]) => e.kind && !own.some((l) => l.name === name)).map(([name, e]) => ({ name, kind: e.kind.toLowerCase(), added: true }));
    return [...own, ...added].map((l) => ({ ...l, position: vector(edits[l.name]?.position ?? l.position) }));
  }

  fill() {
    this.list.replaceChildren(...this.all().map((l) => new Option(`${l.name} (${l.kind})`, l.name)));
    this.list.disabled = !this.list.options.length;
  }

  edit(name, field, value) {
    this.panel.put(['lights', name, field], value);
    this.on.changed(['lights', name, field]);
  }

  // `open`: somebody wants its controls.
  select(name, open = false) {
    const group = this.group.firstElementChild;
    if (name !== null && name === this.selected) {
      if (open && group) group.open = true;
      return this.refresh();
    }
    this.selected = name;
    const light = this.all().find((l) => l.name === name);
    this.list.value = name ?? '';
    this.root.querySelector('#drop-light').hidden = !light?.added;
    const fields = light ? this.panel.fields('LightEdit', ['lights', name], new Set(light.added ? [] : ['kind'])) : [];
    this.group.replaceChildren(...(light ? [this.panel.group(`Light: ${name}`, fields, open)] : []));
    this.on.filter();
    this.refresh();
  }

  // Handles and lamp as the request is now; `matrices` null: not to be seen.
  refresh(matrices = this.matrices) {
    this.matrices = matrices;
    this.handles.show(this.all().filter((l) => kPlaced.has(l.kind)), matrices, this.selected);
    this.lamp.show(this.selected, this.panel.get(['lights', this.selected, 'gain']));
    // Next to the handle, if that is to be seen and the picture is large enough not to vanish behind it.
    const handle = this.handles.buttons.get(this.selected), seen = Boolean(handle && !handle.hidden) && matchMedia('(min-width: 761px)').matches, lamp = this.lamp.root;
    const home = seen ? this.stage : this.group.parentElement;
    if (lamp.parentElement !== home) seen ? home.append(lamp) : home.insertBefore(lamp, this.group);
    lamp.classList.toggle('floating', seen);
    if (!seen) return lamp.removeAttribute('style');
    const [x, y] = [parseFloat(handle.style.left), parseFloat(handle.style.top)];  // per cent
    const beside = (t) => `calc(${t}% + 16px)`;
    Object.assign(lamp.style, x > 50 ? { left: 'auto', right: beside(100 - x) } : { left: beside(x), right: 'auto' });
    Object.assign(lamp.style, y > 50 ? { top: 'auto', bottom: `${100 - y}%` } : { top: `${y}%`, bottom: 'auto' });
  }

  add(kind) {
    const { point, size } = this.on.place(), taken = new Set(this.all().map((l) => l.name));
    let n = 1;
    while (taken.has(`${kind.toLowerCase()}${n}`)) ++n;
    const name = `${kind.toLowerCase()}${n}`;
    this.panel.put(['lights', name], fresh(kind, point, size));
    this.fill();
    this.select(name, true);
    this.on.changed(['lights', name]);
  }

  drop() {
    const name = this.selected;
    this.panel.put(['lights', name], undefined);
    this.selected = null;
    this.fill();
    this.select(this.all()[0]?.name ?? null);
    this.on.changed(['lights', name]);
  }
}
