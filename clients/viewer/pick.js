// SPDX-License-Identifier: Apache-2.0
// What is in a pixel: its ids, of a window of one pixel, and their names, which the scene lists in the same order.
import { renderAll } from './api.js';
import { moment } from './compare.js';

// `x`, `y`: pixel of the whole picture. {object, material, at}: names, '' where one has none, and the point {x, y, z} that was hit; null: the background.
export async function pick(request, scene, x, y) {
  const { reply, bytes } = await renderAll({
    ...moment(request), outputs: ['object_id', 'material_id', 'position'], halt: { spp: 1 }, view_samples: 1, window: { x, y, width: 1, height: 1 },
    encoding: { format: 'RAW_FLOAT' }, scheduling: { priority: 'INTERACTIVE', ladder: false },
  });
  const found = {}, view = new DataView(bytes.buffer, bytes.byteOffset);
  let at = 0;
  for (const image of reply.images) {
    found[image.output] = Array.from({ length: image.channels.length }, (_, c) => view.getFloat32(at + 4 * c, true));
    at += Number(image.bytes);
  }
  const [object] = found.object_id, [material] = found.material_id, [px, py, pz] = found.position;
  if (!(object >= 0)) return null;
  return { object: scene.instance_names?.[object] ?? '', material: scene.material_names?.[material] ?? '', at: { x: px, y: py, z: pz } };
}
