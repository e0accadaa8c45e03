// SPDX-License-Identifier: Apache-2.0
// Files that the page gives the server, by their SHA-256: sent once, from where an earlier try broke off (docs/live.md).
import { ApiError } from './api.js';

async function call(path, options = {}) {
  const token = sessionStorage.getItem('gobo-token');
  let response;
  try {
    response = await fetch(path, { ...options, headers: { ...options.headers, ...(token ? { Authorization: 'Bearer ' + token } : {}) } });
  } catch { throw new ApiError('OFFLINE', 'the server does not answer', 0); }
  if (response.ok) return response.json();
  const text = await response.text();
  let error;
  try { error = JSON.parse(text).error; } catch { error = { code: 'UNKNOWN', message: text }; }
  throw new ApiError(error.code, error.message, response.status);
}

// Resolves to the digest, 64 hex digits, once the server has the whole file.
export async function putBlob(file) {
  const bytes = await file.arrayBuffer();
  const digest = [...new Uint8Array(await crypto.subtle.digest('SHA-256', bytes))].map((b) => b.toString(16).padStart(2, '0')).join('');
  const address = `/v1/blobs/${digest}?bytes=${bytes.byteLength}`;
  const has = Number((await call(address)).received ?? 0);
  if (has < bytes.byteLength)
    await call(`${address}&offset=${has}`, { method: 'POST', headers: { 'Content-Type': 'application/octet-stream' }, body: bytes.slice(has) });
  return digest;
}

// `done(digest, name)` for each environment map that is dropped onto `target`; `failed(ApiError)`.
export function acceptMaps(target, done, failed) {
  target.addEventListener('dragover', (e) => {
    if (![...e.dataTransfer.types].includes('Files')) return;
    e.preventDefault();
    e.dataTransfer.dropEffect = 'copy';
  });
  target.addEventListener('drop', async (e) => {
    const file = e.dataTransfer.files[0];
    if (!file) return;
    e.preventDefault();
    try {
      if (!/\.(hdr|exr)$/i.test(file.name)) throw new ApiError('INVALID_ARGUMENT', `${file.name}: drop an .hdr or .exr to light the scene with it`, 400);
      done(await putBlob(file), file.name);
    } catch (error) { failed(error instanceof ApiError ? error : new ApiError('UNKNOWN', String(error), 0)); }
  });
}
