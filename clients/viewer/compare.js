// SPDX-License-Identifier: Apache-2.0
// What a picture is held against: the path-traced reference of the same view and lights, and the certificate's interval.
import { renderAll } from './api.js';

// The request with every approximation taken out, and without what only whole pictures can have.
export function plain(request) {
  const out = structuredClone(request);
  for (const name of ['shadows', 'certificate', 'halt', 'window', 'encoding', 'scheduling', 'outputs']) delete out[name];
  for (const light of Object.values(out.lights ?? {})) delete light.shadow;
  for (const name of ['extract_lights', 'area_lights', 'area_lights_if_worth', 'transfer', 'subtractive']) delete out.environment?.[name];
  for (const name of ['denoise', 'filters']) delete out[name];
  return out;
}

// What the camera sees first is of a moment: the middle of the shutter's time.
export function moment(request) {
  const out = plain(request), open = out.camera?.shutter_s;
  if (!open) return out;
  for (const name of ['shutter_s', 'shutter_slices']) delete out.camera[name];
  return { ...out, time_s: (out.time_s ?? 0) + open / 2 };
}

// Behind every edit, and of a session of its own: an edit does not end it.
export const reference = (request, spp, signal, shown) => renderAll({
  ...plain(request), ...(request.window ? { window: request.window } : {}), halt: { spp }, encoding: { format: 'RAW_HALF' }, scheduling: { priority: 'BATCH', ladder: false },
}, signal, shown);

// The picture that has come, without its noise: as many samples, traced again, for a filter wants its light apart; behind all edits and everybody's pictures.
export const withoutNoise = (request, reply, signal, shown) => renderAll({
  ...request, halt: { spp: reply.resolved.halt.spp }, denoise: { auto: { fast: true } }, encoding: reply.images[0].format === 'RAW_HALF' ? { format: 'RAW_HALF' } : { format: 'JPEG', jpeg_quality: 90 },
  scheduling: { priority: 'BATCH', ladder: false },
}, signal, shown);

// One line about how wrong the picture is.
export async function certificate(request, settings, signal) {
  const { reply } = await renderAll({ ...request, outputs: ['beauty'], certificate: settings ?? {}, encoding: { format: 'JPEG' }, scheduling: { priority: 'NORMAL', ladder: false } }, signal);
  const c = reply.certificate ?? {}, digits = (x) => Number((x ?? 0).toPrecision(3)).toString();
  return [`RMSE ${digits(c.rmse)}, 95 % interval ${digits(c.rmse_low)} to ${digits(c.rmse_high)}; ${c.pixels ?? 0} pixels path traced at ${c.spp ?? 0} samples`,
    ...(c.not_covered ?? []).map((name) => `not covered: ${name}`)].join('; ');
}
