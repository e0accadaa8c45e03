// SPDX-License-Identifier: Apache-2.0
// What was picked: the controls of its material, and a handle that moves it. Both are the scene's: a change is a patch, which everybody sees who renders the scene.
import { postJson } from './api.js';
import { Handles } from './handles.js';

const kFields = [
  { name: 'base_color', kind: 'vector', help: 'linear RGB', unit: '' }, { name: 'metallic', kind: 'number', min: 0, max: 1 },
  { name: 'roughness', kind: 'number', min: 0, max: 1 }, { name: 'emission', kind: 'vector', help: 'linear radiance', unit: 'W/(m^2 sr)' },
];

// Patches of a scene one after the other; of those that wait the latest values win, and ways add up.
export class Patches {
  // `done(info)` after each; `failed(error)`.
  constructor(done, failed) {
    this.waiting = new Map();  // scene -> {materials, instances}
    this.busy = false;
    this.done = done;
    this.failed = failed;
  }
  material(scene, name, values) {
    const { materials } = this.of(scene);
    materials[name] = { ...materials[name], ...values };
    return this.send();
  }
  // `way`: metres, {x, y, z}.
  move(scene, name, way) {
    const { instances } = this.of(scene), had = instances[name]?.moved_by;
    instances[name] = { moved_by: Object.fromEntries(['x', 'y', 'z'].map((a) => [a, way[a] + (had?.[a] ?? 0)])) };
    return this.send();
  }
  of(scene) {
    if (!this.waiting.has(scene)) this.waiting.set(scene, { materials: {}, instances: {} });
    return this.waiting.get(scene);
  }
  async send() {
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.waiting.size) {
        const [id, next] = this.waiting.entries().next().value;
        this.waiting.delete(id);
        this.done(await postJson(`/v1/scenes/${encodeURIComponent(id)}/patch`, next));
      }
    } catch (error) {
      this.waiting.clear();
      this.failed(error);
    } finally { this.busy = false; }
  }
}

// The handle of the picked object, at the point that was picked. Dragged, or by its keys, the object moves with it.
export class Grip {
  constructor(stage, patches) {
    this.patches = patches;
    this.thing = null;
    this.handles = new Handles(stage, { select() {}, move: (name, position) => this.moved(position) }, 'Object');
  }
  // `name` '' or `at` null: nothing that could be moved.
  hold(scene, name, at, matrices) {
    this.thing = name && at ? { scene, name, position: at } : null;
    this.refresh(matrices);
  }
  refresh(matrices) {
    this.handles.show(this.thing ? [{ name: this.thing.name, position: this.thing.position }] : [], matrices, this.thing?.name);
  }
  moved(position) {
    const { scene, name, position: from } = this.thing;
    this.thing.position = position;
    this.patches.move(scene, name, { x: position.x - from.x, y: position.y - from.y, z: position.z - from.z });
  }
}

// Controls of a material, in `root`; `Panel`: the class that makes them.
export function showMaterial(root, Panel, scene, name, patches) {
  if (!name) return root.replaceChildren();
  const values = {};
  const panel = new Panel({ messages: { Material: { fields: kFields } } }, values, (path) => {
    const value = values[path[0]];
    if (value !== undefined) patches.material(scene, name, { [path[0]]: value });
  });
  const group = panel.group(`Material: ${name}`, panel.fields('Material', []), true);
  group.id = 'material';
  root.replaceChildren(group);
}
