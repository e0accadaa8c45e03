// SPDX-License-Identifier: Apache-2.0
// The material of what was picked. Materials are the scene's: a change is a patch, which everybody sees who renders the scene.
import { postJson } from './api.js';

const kFields = [
  { name: 'base_color', kind: 'vector', help: 'linear RGB', unit: '' }, { name: 'metallic', kind: 'number', min: 0, max: 1 },
  { name: 'roughness', kind: 'number', min: 0, max: 1 }, { name: 'emission', kind: 'vector', help: 'linear radiance', unit: 'W/(m^2 sr)' },
];

// Patches of a scene one after the other; of those that wait the latest values win.
export class Patches {
  // `done(info)` after each; `failed(error)`.
  constructor(done, failed) {
    this.waiting = new Map();  // scene -> materials
    this.busy = false;
    this.done = done;
    this.failed = failed;
  }
  async material(scene, name, values) {
    const materials = this.waiting.get(scene) ?? {};
    materials[name] = { ...materials[name], ...values };
    this.waiting.set(scene, materials);
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.waiting.size) {
        const [id, next] = this.waiting.entries().next().value;
        this.waiting.delete(id);
        this.done(await postJson(`/v1/scenes/${encodeURIComponent(id)}/patch`, { materials: next }));
      }
    } catch (error) {
      this.waiting.clear();
      this.failed(error);
    } finally { this.busy = false; }
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
