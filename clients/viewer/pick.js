// SPDX-License-Identifier: Apache-2.0
// What is in a pixel: its ids, of a window of one pixel, and their names, which the scene lists in the same order.
import { renderAll } from './api.js';
import { plain } from './compare.js';

// `x`, `y`: pixel of the whole picture. {object, material}: names, '' where one has none; null: the background.
export async function pick(request, scene, x, y) {
  const { reply, bytes } = await renderAll({
    ...plain(request), outputs: ['object_id', 'material_id'], halt: { spp: 1 }, view_samples: 1, window: { x, y, width: 1, height: 1 },
    encoding: { format: 'RAW_FLOAT' }, scheduling: { priority: 'INTERACTIVE', ladder: false },
  });
  const ids = {}, view = new DataView(bytes.buffer, bytes.byteOffset);
  let at = 0;
  for (const image of reply.images) {
    ids[image.output] = view.getFloat32(at, true);
    at += Number(image.bytes);
  }
  if (!(ids.object_id >= 0)) return null;
  return { object: scene.instance_names?.[ids.object_id] ?? '', material: scene.material_names?.[ids.material_id] ?? '' };
}
