// SPDX-License-Identifier: Apache-2.0
// Mutants of a valid glTF: every JSON member in every wrong way once per kind of place, accessor data, containers. Deterministic.
import {asText, glb} from './files.mjs';

const kJson = 0x4e4f534a, kBin = 0x004e4942;
const componentSize = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4};
const componentCount = {SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT2: 4, MAT3: 9, MAT4: 16};

/** Wrong values for a value: [kind, value]. */
function wrong(value) {
  if (typeof value === 'number')
    return [['string', '7'], ['null', null], ['negative', -1], ['zero', 0], ['fraction', value + 0.5], ['next', value + 1], ['past', 1000000], ['huge', 1e300], ['list', [value]]];
  if (typeof value === 'string') return [['number', 7], ['empty', ''], ['bogus', 'BOGUS'], ['list', [value]]];
  if (typeof value === 'boolean') return [['string', 'true'], ['number', 1]];
  if (Array.isArray(value)) {
    const out = [['object', {}], ['number', 3], ['empty', []]];
    if (value.length) out.push(['short', value.slice(0, -1)], ['twice', [...value, value[value.length - 1]]]);
    if (value.length && typeof value[0] === 'number') out.push(['text', [...value.slice(0, -1), 'x']], ['scaled', value.map((v) => v * 3)]);
    return out;
  }
  return [['list', []], ['text', 'x'], ['bare', {}]];
}

/** Every place: [path, value, parent]. Data URIs, extras and `asset.generator` are left alone. */
function* places(value, path = []) {
  if (path.length) yield [path, value];
  if (value === null || typeof value !== 'object') return;
  for (const key of Object.keys(value)) {
    if (key === 'extras') continue;
    yield* places(value[key], [...path, Array.isArray(value) ? Number(key) : key]);
  }
}
const template = (path) => path.map((p) => (typeof p === 'number' ? '*' : /^(.*_)\d+$/.test(p) && !p.startsWith('KHR') && !p.startsWith('EXT') ? p.replace(/\d+$/, 'n') : p)).join('/');

function withChange(json, path, change) {
  const copy = structuredClone(json);
  let at = copy;
  for (const p of path.slice(0, -1)) at = at[p];
  change(at, path[path.length - 1]);
  return copy;
}

/** JSON-level mutants: {name, text}; `taken` holds what earlier bases have given. */
export function* jsonMutants(base, taken) {
  const fresh = (name) => !taken.has(name) && taken.add(name);
  const emit = (name, json) => ({name, text: asText({json, buffers: base.buffers})});
  for (const [path, value] of places(base.json)) {
    if (path[0] === 'buffers' && path[2] === 'uri') continue;
    const t = template(path), inList = typeof path[path.length - 1] === 'number';
    if (!inList && fresh(`${t} delete`)) yield emit(`${t} delete`, withChange(base.json, path, (at, key) => delete at[key]));
    for (const [kind, bad] of wrong(value))
      if (fresh(`${t} ${kind}`)) yield emit(`${t} ${kind}`, withChange(base.json, path, (at, key) => { at[key] = bad; }));
    if (value !== null && typeof value === 'object' && !Array.isArray(value) && path[path.length - 2] !== 'extensions' && fresh(`${t} undeclared`))
      yield emit(`${t} undeclared`, withChange(base.json, path, (at, key) => { (at[key].extensions ??= {}).KHR_not_declared = {}; }));
  }
  for (const [name, json] of additions(base.json)) if (fresh(name)) yield emit(name, json);
}

/** What no change of one member makes: members that exclude each other, lists that are missing, references in a ring. */
function* additions(json) {
  const change = (f) => { const copy = structuredClone(json); try { return f(copy) === false ? null : copy; } catch { return null; } };   // this base lacks what it changes
  const tries = {
    'required unknown': (j) => { j.extensionsUsed = [...(j.extensionsUsed ?? []), 'KHR_none']; j.extensionsRequired = [...(j.extensionsRequired ?? []), 'KHR_none']; },
    'required not used': (j) => { j.extensionsRequired = ['KHR_materials_unlit']; },
    'used twice': (j) => { if (!j.extensionsUsed?.length) return false; j.extensionsUsed.push(j.extensionsUsed[0]); },
    'all used deleted': (j) => { if (!j.extensionsUsed) return false; delete j.extensionsUsed; delete j.extensionsRequired; },
    'scene without scenes': (j) => { delete j.scenes; j.scene = 0; },
    'node matrix and translation': (j) => { if (!j.nodes) return false; Object.assign(j.nodes[0], {matrix: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], translation: [1, 0, 0]}); },
    'node sheared matrix': (j) => { if (!j.nodes || j.animations) return false; for (const k of ['translation', 'rotation', 'scale']) delete j.nodes[0][k]; j.nodes[0].matrix = [1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]; },
    'node projective matrix': (j) => { if (!j.nodes || j.animations) return false; for (const k of ['translation', 'rotation', 'scale']) delete j.nodes[0][k]; j.nodes[0].matrix = [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]; },
    'node its own child': (j) => { if (!j.nodes) return false; j.nodes[0].children = [0]; },
    'nodes in a ring': (j) => { if ((j.nodes?.length ?? 0) < 2) return false; j.nodes[0].children = [1]; j.nodes[1].children = [0]; },
    'child shared': (j) => { if ((j.nodes?.length ?? 0) < 3) return false; j.nodes[0].children = [2]; j.nodes[1].children = [2]; },
    'scene lists a child': (j) => { const i = j.nodes?.findIndex((n) => n.children?.length); if (i === undefined || i < 0) return false; j.scenes[0].nodes.push(j.nodes[i].children[0]); },
    'scene lists a node twice': (j) => { if (!j.scenes?.[0]?.nodes) return false; j.scenes[0].nodes.push(j.scenes[0].nodes[0]); },
    'node rotation not unit': (j) => { if (!j.nodes) return false; delete j.nodes[0].matrix; j.nodes[0].rotation = [0, 0, 0, 2 / 3]; },
    'node skin without mesh': (j) => { if (!j.skins) return false; const n = j.nodes.find((x) => x.mesh === undefined); if (!n) return false; n.skin = 0; },
    'node weights without mesh': (j) => { if (!j.nodes) return false; delete j.nodes[0].mesh; j.nodes[0].weights = [1]; },
    'node weights too many': (j) => { const n = j.nodes?.find((x) => x.mesh !== undefined); if (!n) return false; n.weights = [1, 0, 1, 0, 1]; },
    'mesh weights too many': (j) => { if (!j.meshes) return false; j.meshes[0].weights = [1, 0, 1, 0, 1]; },
    'image uri and view': (j) => { if (!j.images || !j.bufferViews) return false; const i = j.images[0]; if (i.uri) { i.bufferView = 0; i.mimeType = 'image/png'; } else i.uri = 'a.png'; },
    'image missing file': (j) => { if (!j.images) return false; delete j.images[0].bufferView; j.images[0].uri = 'missing.png'; },
    'image unknown kind': (j) => { if (!j.images) return false; delete j.images[0].bufferView; delete j.images[0].mimeType; j.images[0].uri = 'data:image/bmp;base64,Qk0='; },
    'image not a picture': (j) => { if (!j.images) return false; delete j.images[0].bufferView; delete j.images[0].mimeType; j.images[0].uri = 'data:image/png;base64,AAAAAAAAAAAAAAAAAAAA'; },
    'image wrong mime type': (j) => { if (!j.images?.[0].mimeType) return false; j.images[0].mimeType = j.images[0].mimeType === 'image/png' ? 'image/jpeg' : 'image/png'; },
    'view stride 260': (j) => { if (!j.bufferViews) return false; j.bufferViews[0].byteStride = 260; },
    'view stride of indices': (j) => { const p = j.meshes?.[0].primitives[0]; if (p?.indices === undefined) return false; const a = j.accessors[p.indices]; if (a.bufferView === undefined) return false; j.bufferViews[a.bufferView].byteStride = 4; },
    'attribute unknown': (j) => { const p = j.meshes?.[0].primitives[0]; if (!p) return false; p.attributes.NORMALS = p.attributes.POSITION; },
    'attribute set skipped': (j) => { const p = j.meshes?.[0].primitives[0]; if (p?.attributes.TEXCOORD_0 === undefined) return false; p.attributes.TEXCOORD_2 = p.attributes.TEXCOORD_0; },
    'attribute of indices': (j) => { const p = j.meshes?.[0].primitives[0]; if (p?.indices === undefined) return false; p.attributes._X = p.indices; },
    'indices of positions': (j) => { const p = j.meshes?.[0].primitives[0]; if (!p) return false; p.indices = p.attributes.POSITION; },
    'joints without weights': (j) => { const p = j.meshes?.[0].primitives[0]; if (p?.attributes.WEIGHTS_0 === undefined) return false; delete p.attributes.WEIGHTS_0; },
    'primitives differ in targets': (j) => { const m = j.meshes?.find((x) => x.primitives[0].targets); if (!m) return false; const p = structuredClone(m.primitives[0]); p.targets.pop(); if (!p.targets.length) delete p.targets; m.primitives.push(p); },
    'target of no attribute': (j) => { const m = j.meshes?.find((x) => x.primitives[0].targets); if (!m) return false; m.primitives[0].targets[0].COLOR_0 = m.primitives[0].targets[0].POSITION; },
    'sampler of another path': (j) => { if (!j.animations?.[0].channels.length) return false; const c = j.animations[0].channels[0]; c.target.path = c.target.path === 'rotation' ? 'scale' : 'rotation'; },
    'channels of one target': (j) => { if (!j.animations?.[0].channels.length) return false; j.animations[0].channels.push(structuredClone(j.animations[0].channels[0])); },
    'animated weights without targets': (j) => { if (!j.animations?.[0].channels.length || j.meshes?.some((m) => m.primitives.some((p) => p.targets))) return false; j.animations[0].channels[0].target.path = 'weights'; },
    'version 3.0': (j) => { j.asset.version = '3.0'; },
    'version 2.5': (j) => { j.asset.version = '2.5'; },
    'least version above version': (j) => { j.asset.minVersion = '2.1'; },
    'normalized floats': (j) => { const a = j.accessors?.find((x) => x.componentType === 5126); if (!a) return false; a.normalized = true; },
  };
  for (const [name, f] of Object.entries(tries)) { const out = change(f); if (out) yield [name, out]; }
}

/** Accessor data: {name, text}. */
export function* dataMutants(base, taken) {
  const fresh = (name) => !taken.has(name) && taken.add(name);
  const roles = roleOf(base.json);
  for (const [i, a] of (base.json.accessors ?? []).entries()) {
    const view = base.json.bufferViews?.[a.bufferView], bytes = base.buffers[view?.buffer];
    if (!bytes || a.sparse || view.extensions) continue;
    const unit = componentSize[a.componentType], n = componentCount[a.type];
    if (!unit || n > 16) continue;
    const stride = view.byteStride ?? unit * n, start = (view.byteOffset ?? 0) + (a.byteOffset ?? 0), role = roles[i] ?? 'unused';
    const put = (element, component, value) => {
      const copy = Buffer.from(bytes), at = start + element * stride + component * unit;
      if (unit === 4 && a.componentType === 5126) copy.writeFloatLE(value, at);
      else if (unit === 4) copy.writeUInt32LE(value >>> 0, at);
      else if (unit === 2) copy.writeUInt16LE(value & 0xffff, at);
      else copy.writeUInt8(value & 0xff, at);
      return copy;
    };
    const values = a.componentType === 5126 ? {nan: NaN, infinite: Infinity, 'minus infinite': -Infinity, two: 2, zero: 0, negative: -0.5, huge: 1e30, denormal: 1e-40}
                                            : {restart: 0xffffffff, past: a.count + 1000, zero: 0, one: 1, 'one less': 0xfffffffe};
    for (const [kind, value] of Object.entries(values))
      for (const element of [0, a.count - 1]) {
        const name = `data of ${role} ${element ? 'last' : 'first'} ${kind}`;
        if (!fresh(name)) continue;
        const buffers = base.buffers.map((b, k) => (k === view.buffer ? put(element, element ? n - 1 : 0, value) : b));
        yield {name, text: asText({json: base.json, buffers})};
      }
  }
}

/** What accessors are used for: "POSITION", "indices", "animation input", ... */
function roleOf(json) {
  const role = {};
  for (const m of json.meshes ?? [])
    for (const p of m.primitives ?? []) {
      if (p.indices !== undefined) role[p.indices] = `indices mode ${p.mode ?? 4}`;
      for (const [k, v] of Object.entries(p.attributes ?? {})) role[v] = `${k} ${json.accessors[v]?.componentType}`;
      for (const t of p.targets ?? []) for (const [k, v] of Object.entries(t)) role[v] = `target ${k}`;
    }
  for (const s of json.skins ?? []) if (s.inverseBindMatrices !== undefined) role[s.inverseBindMatrices] = 'inverse bind matrices';
  for (const a of json.animations ?? [])
    for (const c of a.channels ?? []) {
      const s = a.samplers[c.sampler];
      role[s.input] = 'key times';
      role[s.output] = `values of ${c.target.path} ${s.interpolation ?? 'LINEAR'}`;
    }
  return role;
}

/** Containers and text: {name, bytes, ext}. One base is enough. */
export function* containerMutants(base) {
  const pad = (b, by) => Buffer.concat([b, Buffer.alloc((4 - (b.length % 4)) % 4, by)]);
  const json = structuredClone(base.json), bin = pad(base.buffers[0], 0);
  json.buffers = [{byteLength: base.buffers[0].length}];
  const text = pad(Buffer.from(JSON.stringify(json)), 0x20), chunks = [[kJson, text], [kBin, bin]];
  const plain = Buffer.from(asText(base));
  const out = (name, bytes, ext = 'glb') => ({name: `container ${name}`, bytes, ext});
  yield out('valid', glb(chunks));
  yield out('magic', glb(chunks, {magic: 0x46546c68}));
  yield out('version 1', glb(chunks, {version: 1}));
  yield out('version 3', glb(chunks, {version: 3}));
  yield out('length + 4', glb(chunks, {length: text.length + bin.length + 32}));
  yield out('length - 4', glb(chunks, {length: text.length + bin.length + 24}));
  yield out('length 8', glb(chunks, {length: 8}));
  yield out('two BIN chunks', glb([...chunks, [kBin, bin]]));
  yield out('two JSON chunks', glb([[kJson, text], [kJson, text], [kBin, bin]]));
  yield out('BIN first', glb([[kBin, bin], [kJson, text]]));
  yield out('BIN third', glb([[kJson, text], [0x41424344, Buffer.from('abcd')], [kBin, bin]]));
  yield out('unknown chunk last', glb([...chunks, [0x41424344, Buffer.from('abcd')]]));
  yield out('no BIN', glb([[kJson, text]]));
  yield out('empty BIN', glb([[kJson, text], [kBin, Buffer.alloc(0)]]));
  yield out('empty JSON', glb([[kJson, Buffer.alloc(0)], [kBin, bin]]));
  yield out('BIN too short', glb([[kJson, text], [kBin, bin.subarray(0, bin.length - 4)]]));
  yield out('BIN too long', glb([[kJson, text], [kBin, Buffer.concat([bin, Buffer.alloc(8)])]]));
  yield out('BIN chunk past the end', glb([[kJson, text], [kBin, bin, bin.length + 400]]));
  yield out('JSON chunk past the end', glb([[kJson, text, 1 << 24], [kBin, bin]]));
  yield out('JSON chunk unaligned', glb([[kJson, Buffer.concat([text, Buffer.from(' ')])], [kBin, bin]]));
  yield out('BIN chunk unaligned', glb([[kJson, text], [kBin, Buffer.concat([bin, Buffer.alloc(1)])]]));
  yield out('extra data', Buffer.concat([glb(chunks), Buffer.from('tail')]));
  for (const n of [0, 3, 8, 12, 16, 19, 40]) yield out(`cut to ${n}`, glb(chunks).subarray(0, n));
  yield out('cut in the BIN header', glb(chunks).subarray(0, text.length + 24));
  yield out('duplicate key', Buffer.from(plain.toString().replace('{', '{"scene":0,"scene":0,')), 'gltf');
  yield out('duplicate key in an object', Buffer.from(plain.toString().replace('"asset":{', '"asset":{"version":"2.0",')), 'gltf');
  yield out('byte order mark', Buffer.concat([Buffer.from([0xef, 0xbb, 0xbf]), plain]), 'gltf');
  yield out('bad UTF-8', Buffer.from(plain.toString('latin1').replace('"asset":{', '"asset":{"generator":"\xff\xfe",'), 'latin1'), 'gltf');
  yield out('overlong UTF-8', Buffer.from(plain.toString('latin1').replace('"asset":{', '"asset":{"generator":"\xc0\xaf",'), 'latin1'), 'gltf');
  yield out('lone surrogate', Buffer.from(plain.toString().replace('"asset":{', '"asset":{"generator":"\\ud800",')), 'gltf');
  yield out('NaN in JSON', Buffer.from(plain.toString().replace('"asset":{', '"asset":{"extras":NaN,')), 'gltf');
  yield out('comma at the end', Buffer.from(plain.toString().replace(/}$/, ',}')), 'gltf');
  yield out('garbage after', Buffer.concat([plain, Buffer.from('{}')]), 'gltf');
  yield out('a list', Buffer.from('[]'), 'gltf');
  yield out('empty', Buffer.alloc(0), 'gltf');
  const escaped = [...base.buffers[0]].map((b) => `%${b.toString(16).padStart(2, '0')}`).join('');
  for (const [name, uri] of [['escaped data URI', `data:application/octet-stream,${escaped}`], ['data URI without a kind', `data:,${escaped}`], ['data URI of text', `data:text/plain,${escaped}`],
                             ['data URI bad base64', 'data:application/octet-stream;base64,@@@@'], ['missing buffer file', 'missing.bin'], ['bad escape in a uri', 'a%zz.bin']])
    yield out(name, Buffer.from(JSON.stringify({...json, buffers: [{byteLength: base.buffers[0].length, uri}]})), 'gltf');
}
