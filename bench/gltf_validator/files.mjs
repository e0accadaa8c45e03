// SPDX-License-Identifier: Apache-2.0
// glTF files as values: parsed from .gltf and .glb, made self-contained (data URIs), and put together again.
import fs from 'node:fs';
import path from 'node:path';

/** All .gltf and .glb below the folder, sorted. */
export function modelsBelow(folder) {
  const out = [];
  for (const entry of fs.readdirSync(folder, {withFileTypes: true})) {
    const full = path.join(folder, entry.name);
    if (entry.isDirectory()) out.push(...modelsBelow(full));
    else if (/\.(gltf|glb)$/.test(entry.name)) out.push(full);
  }
  return out.sort();
}

/** {json, bin} of a valid file; bin: the GLB chunk or null. */
export function parse(bytes) {
  if (bytes.length < 20 || bytes.readUInt32LE(0) !== 0x46546c67) return {json: JSON.parse(bytes.toString('utf8')), bin: null};
  const length = bytes.readUInt32LE(12), next = 20 + length;
  const bin = next + 8 <= bytes.length ? bytes.subarray(next + 8, next + 8 + bytes.readUInt32LE(next)) : null;
  return {json: JSON.parse(bytes.subarray(20, next).toString('utf8')), bin};
}

export const dataUri = (mime, bytes) => `data:${mime};base64,${Buffer.from(bytes).toString('base64')}`;

/** Bytes of a data URI or of the file that the URI names. */
export function resolve(uri, folder) {
  if (!uri.startsWith('data:')) return fs.readFileSync(path.join(folder, decodeURIComponent(uri)));
  const comma = uri.indexOf(',');
  return uri.slice(0, comma).endsWith(';base64') ? Buffer.from(uri.slice(comma + 1), 'base64') : Buffer.from(decodeURIComponent(uri.slice(comma + 1)), 'latin1');
}

const mimeOf = (bytes) => (bytes[0] === 0x89 ? 'image/png' : bytes[0] === 0xff ? 'image/jpeg' : bytes.subarray(0, 4).toString() === 'RIFF' ? 'image/webp' : 'image/ktx2');

/** The file without files beside it: {json, buffers}; buffers stay bytes, pictures become data URIs. */
export function selfContained(file) {
  const {json, bin} = parse(fs.readFileSync(file)), folder = path.dirname(file);
  const buffers = (json.buffers ?? []).map((b) => (b.uri === undefined ? bin ?? null : resolve(b.uri, folder)));
  for (const image of json.images ?? []) {
    if (image.uri === undefined || image.uri.startsWith('data:')) continue;
    const bytes = resolve(image.uri, folder);
    image.uri = dataUri(mimeOf(bytes), bytes);
  }
  return {json, buffers};
}

/** Text of a .gltf with its buffers inside. */
export function asText({json, buffers}) {
  const copy = structuredClone(json);
  buffers.forEach((b, i) => { if (b && copy.buffers?.[i] && typeof copy.buffers[i] === 'object') copy.buffers[i].uri = dataUri('application/octet-stream', b); });
  return JSON.stringify(copy);
}

/** A GLB of these chunks [[type, bytes], ...]; `head` changes its header. */
export function glb(chunks, head = {}) {
  const parts = [];
  for (const [type, bytes, declared] of chunks) {
    const h = Buffer.alloc(8);
    h.writeUInt32LE(declared ?? bytes.length, 0);
    h.writeUInt32LE(type, 4);
    parts.push(h, bytes);
  }
  const body = Buffer.concat(parts), header = Buffer.alloc(12);
  header.writeUInt32LE(head.magic ?? 0x46546c67, 0);
  header.writeUInt32LE(head.version ?? 2, 4);
  header.writeUInt32LE(head.length ?? body.length + 12, 8);
  return Buffer.concat([header, body]);
}
