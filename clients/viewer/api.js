// SPDX-License-Identifier: Apache-2.0
// The server's HTTP interface (docs/live.md): JSON calls, and the frames of a progressive render.

export class ApiError extends Error {
  constructor(code, message, status) {
    super(message);
    this.code = code;
    this.status = status;
  }
}

// The token comes in the address' fragment, which no server sees, and does not stay there for others to copy.
const fragment = new URLSearchParams(location.hash.slice(1));
if (fragment.has('token')) {
  sessionStorage.setItem('gobo-token', fragment.get('token'));
  fragment.delete('token');
  history.replaceState(null, '', location.pathname + (fragment.size ? '#' + fragment : ''));
}
export const asked = fragment;
export const setToken = (token) => sessionStorage.setItem('gobo-token', token);

async function call(path, body, signal) {
  const token = sessionStorage.getItem('gobo-token');
  const headers = token ? { Authorization: 'Bearer ' + token } : {};
  if (body !== undefined) headers['Content-Type'] = 'application/json';
  let response;
  try {
    response = await fetch(path, { method: body === undefined ? 'GET' : 'POST', headers, body: body === undefined ? undefined : JSON.stringify(body), signal });
  } catch (error) {
    if (error.name === 'AbortError') throw error;
    throw new ApiError('OFFLINE', 'the server does not answer', 0);
  }
  if (response.ok) return response;
  const text = await response.text();
  let error;
  try { error = JSON.parse(text).error; } catch { error = { code: 'UNKNOWN', message: text }; }
  throw new ApiError(error.code, error.message, response.status);
}

export const getJson = async (path) => (await call(path)).json();
export const postJson = async (path, body) => (await call(path, body)).json();
export const postBytes = async (path, body) => (await call(path, body)).arrayBuffer();

// Yields {progress}, {snapshot | reply, bytes: Uint8Array, ms: how long these took to come}; a frame is a 32-bit length, JSON, and the bytes that it announces.
export async function* renderFrames(request, signal) {
  const reader = (await call('/v1/render/stream', request, signal)).body.getReader();
  let held = new Uint8Array(0), over = false;
  const need = async (n) => {
    while (held.length < n && !over) {
      let part;
      try { part = await reader.read(); } catch (error) {
        if (error.name === 'AbortError') throw error;
        throw new ApiError('OFFLINE', 'the connection to the server was lost', 0);
      }
      if (part.done) { over = true; break; }
      const joined = new Uint8Array(held.length + part.value.length);
      joined.set(held);
      joined.set(part.value, held.length);
      held = joined;
    }
    return held.length >= n;
  };
  const take = (n) => {
    const bytes = held.subarray(0, n);
    held = held.subarray(n);
    return bytes;
  };
  while (await need(4)) {
    const size = new DataView(held.buffer, held.byteOffset).getUint32(0, true);
    if (!await need(4 + size)) break;
    take(4);
    const frame = JSON.parse(new TextDecoder().decode(take(size)));
    if (frame.error) throw new ApiError(frame.error.code, frame.error.message, 200);
    const begun = performance.now();
    if (!await need(frame.bytes)) break;
    yield { ...frame, bytes: take(frame.bytes), ms: performance.now() - begun };
    if (frame.reply) return;
  }
  throw new ApiError('OFFLINE', 'the connection to the server was lost', 0);
}

// {worldToCamera, worldToNDC} of the request's camera, sixteen numbers each, for row vectors, as the header of an EXR of one pixel has them. Camera: x right,
// y up, z forward; NDC: x and y 0 to 1 from the picture's top left corner.
export async function cameraMatrices(request) {
  const tiny = { ...request, outputs: ['depth'], view_samples: 1, window: { x: 0, y: 0, width: 1, height: 1 }, encoding: { format: 'EXR' }, scheduling: { priority: 'INTERACTIVE' } };
  const data = new Uint8Array(await postBytes('/v1/render', tiny));
  const view = new DataView(data.buffer), out = {};
  const text = (at) => { let end = at; while (data[end]) ++end; return new TextDecoder().decode(data.subarray(at, end)); };
  for (let at = 8; at < data.length && data[at];) {
    const name = text(at), type = text(at + name.length + 1);
    at += name.length + type.length + 2;
    const size = view.getInt32(at, true);
    at += 4;
    if (name.startsWith('worldTo') && size === 64) out[name] = Array.from({ length: 16 }, (_, i) => view.getFloat32(at + 4 * i, true));
    at += size;
  }
  return out;
}

// The pictures of a whole stream: `shown(reply, bytes)` for each of them; the last reply.
export async function renderAll(request, signal, shown) {
  for await (const frame of renderFrames(request, signal)) {
    if (frame.snapshot ?? frame.reply) await shown?.(frame.snapshot ?? frame.reply, frame.bytes);
    if (frame.reply) return { reply: frame.reply, bytes: frame.bytes };
  }
  return null;
}
