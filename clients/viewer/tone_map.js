// SPDX-License-Identifier: Apache-2.0
// The display transform of renderer/formulas/tone_map.glsl.h and base/transfer.h, for pictures that come as half floats. Written once, as JavaScript
// that is GLSL too once `function f(x)` reads `float f(float x)` and `const` reads `float`: numbers have a point, there are no loops and no objects.

const min = Math.min, max = Math.max, pow = Math.pow;

function toneInput(x) { return x > 0.0 ? min(x, 1.0e9) : 0.0; }
function toneLinear(x) { return min(toneInput(x), 1.0); }
function toneReinhard(x) { const y = toneInput(x); return y / (1.0 + y); }
function toneFilmic(x) { const y = toneInput(x); return min((y * (2.51 * y + 0.03)) / (y * (2.43 * y + 0.59) + 0.14), 1.0); }
function unitRange(x) { return min(max(x, 0.0), 1.0); }
function acesCurve(x) { return (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081); }
function acesRow(r, g, b, p, q, s) {
  const x = acesCurve(0.59719 * r + 0.35458 * g + 0.04823 * b);
  const y = acesCurve(0.07600 * r + 0.90834 * g + 0.01566 * b);
  const z = acesCurve(0.02840 * r + 0.13383 * g + 0.83777 * b);
  return unitRange(p * x + q * y + s * z);
}
function toneAcesRed(r, g, b) { return acesRow(toneInput(r), toneInput(g), toneInput(b), 1.60475, -0.53108, -0.07367); }
function toneAcesGreen(r, g, b) { return acesRow(toneInput(r), toneInput(g), toneInput(b), -0.10208, 1.10813, -0.00605); }
function toneAcesBlue(r, g, b) { return acesRow(toneInput(r), toneInput(g), toneInput(b), -0.00327, -0.07276, 1.07602); }
function toneNeutral(c, r, g, b) {
  const x = toneInput(c);
  const low = min(toneInput(r), min(toneInput(g), toneInput(b)));
  const high = max(toneInput(r), max(toneInput(g), toneInput(b)));
  const offset = low < 0.08 ? low - 6.25 * low * low : 0.04;
  const peak = high - offset;
  const compressed = 1.0 - 0.0576 / (max(peak, 0.76) - 0.52);
  const grey = 1.0 - 1.0 / (0.15 * (max(peak, 0.76) - compressed) + 1.0);
  const scaled = (x - offset) * (compressed / max(peak, 0.76));
  return unitRange(peak < 0.76 ? x - offset : scaled + (compressed - scaled) * grey);
}
function toSrgb(x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055; }
// False colour of a difference: black, violet, orange, white.
function heatRed(t) { return unitRange(2.0 * t); }
function heatGreen(t) { return unitRange(1.6 * t - 0.6); }
function heatBlue(t) { return unitRange(min(2.0 * t, 0.9 - 1.2 * t)) + unitRange(5.0 * t - 4.0); }

// Channel `c` of the colour r, g, b as the display shows it; `curve`: an index into kCurves.
function displayed(curve, c, r, g, b, channel) {
  return toSrgb(
    curve < 0.5 ? toneLinear(c) :
    curve < 1.5 ? toneReinhard(c) :
    curve < 2.5 ? toneFilmic(c) :
    curve < 3.5 ? (channel < 0.5 ? toneAcesRed(r, g, b) : channel < 1.5 ? toneAcesGreen(r, g, b) : toneAcesBlue(r, g, b)) :
    toneNeutral(c, r, g, b));
}

const kAll = [toneInput, toneLinear, toneReinhard, toneFilmic, unitRange, acesCurve, acesRow, toneAcesRed, toneAcesGreen, toneAcesBlue, toneNeutral, toSrgb,
  heatRed, heatGreen, heatBlue, displayed];

export const kCurves = ['LINEAR', 'REINHARD', 'FILMIC', 'ACES', 'PBR_NEUTRAL'];
export { displayed, heatBlue, heatGreen, heatRed };

// The same functions for a fragment shader.
export const glsl = kAll.map((f) => String(f)
  .replace(/^function (\w+)\(([^)]*)\)/, (_, name, list) => `float ${name}(${list.split(',').map((p) => 'float ' + p.trim()).join(', ')})`)
  .replaceAll('const ', 'float ')).join('\n');

// 65536 halves as numbers.
let table = null;
export function halves() {
  return table ??= Float32Array.from({ length: 65536 }, (_, h) => {
    const sign = h & 0x8000 ? -1 : 1, exponent = h >> 10 & 31, mantissa = h & 1023;
    return sign * (exponent === 0 ? mantissa * 2 ** -24 : exponent === 31 ? (mantissa ? NaN : Infinity) : (1 + mantissa / 1024) * 2 ** (exponent - 15));
  });
}

// What renderer/plan/auto_exposure.h chooses for a picture whose exposure is not given; null: none.
export function chosenExposure(picture) {
  const { data, channels } = picture, value = halves(), pixels = picture.width * picture.height;
  const step = Math.floor((pixels + 65535) / 65536) | 1;
  let sum = 0, n = 0;
  for (let p = 0; p < pixels; p += step) {
    const at = p * channels;
    const y = 0.2126 * value[data[at]] + 0.7152 * value[data[at + 1]] + 0.0722 * value[data[at + 2]];
    if (!(y > 0) || !Number.isFinite(y)) continue;
    sum += Math.log2(y);
    ++n;
  }
  const mean = sum / n;
  if (n === 0 || (mean >= -7 && mean <= 1)) return null;
  return Math.max(-32, Math.min(32, Math.round((-2.473931188332412 - mean) * 4) / 4));
}
