// SPDX-License-Identifier: Apache-2.0
// Pictures on a 2D canvas. Linear half floats get exposure and curve here, by WebGL2 or, where a browser has none, by the same formulas in JavaScript.
import { displayed, glsl, halves, heatBlue, heatGreen, heatRed, kCurves } from './tone_map.js';

// A picture is {width, height, data: Uint16Array, channels} (linear) or {width, height, bitmap} (as it is to be shown).

const curveOf = (tone) => Math.max(0, kCurves.indexOf(tone.curve ?? 'FILMIC'));

const vertex = `#version 300 es
out vec2 at;
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  at = vec2(0.5 + 0.5 * corner.x, 0.5 - 0.5 * corner.y);
  gl_Position = vec4(corner, 0.0, 1.0);
}`;
const fragment = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D a, b;
uniform bool aLinear, bLinear, difference;
uniform float aScale, bScale, aCurve, bCurve, gain, wipe;
in vec2 at;
out vec4 color;
${glsl}
vec3 shown(vec4 texel, bool isLinear, float scale, float curve) {
  vec3 c = texel.rgb * scale;
  return isLinear ? vec3(displayed(curve, c.r, c.r, c.g, c.b, 0.0), displayed(curve, c.g, c.r, c.g, c.b, 1.0), displayed(curve, c.b, c.r, c.g, c.b, 2.0)) : texel.rgb;
}
void main() {
  vec3 left = shown(texture(a, at), aLinear, aScale, aCurve), right = shown(texture(b, at), bLinear, bScale, bCurve);
  vec3 apart = abs(left - right);
  float t = unitRange(gain * max(apart.r, max(apart.g, apart.b)));
  color = vec4(difference ? vec3(heatRed(t), heatGreen(t), heatBlue(t)) : at.x < wipe ? left : right, 1.0);
}`;

class Gpu {
  constructor() {
    this.canvas = new OffscreenCanvas(1, 1);
    const gl = this.gl = this.canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error('no WebGL2');
    this.most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    const program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error('shader: ' + gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 2);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    this.place = (name) => gl.getUniformLocation(program, name);
    gl.uniform1i(this.place('a'), 0);
    gl.uniform1i(this.place('b'), 1);
    this.held = [null, null];
    this.textures = [gl.createTexture(), gl.createTexture()];
  }
  bind(unit, picture, width, height) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[unit]);
    if (this.held[unit] !== picture) {
      this.held[unit] = picture;
      if (picture.bitmap) gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, picture.bitmap);
      else {
        const [inside, format] = picture.channels === 4 ? [gl.RGBA16F, gl.RGBA] : [gl.RGB16F, gl.RGB];
        gl.texImage2D(gl.TEXTURE_2D, 0, inside, picture.width, picture.height, 0, format, gl.HALF_FLOAT, picture.data);
      }
      for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, axis, gl.CLAMP_TO_EDGE);
    }
    const filter = picture.width === width && picture.height === height ? gl.NEAREST : gl.LINEAR;  // between texels only where a pixel is
    for (const use of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, use, filter);
  }
  draw(context, width, height, view) {
    const gl = this.gl;
    if (gl.isContextLost()) throw new Error('the GPU was lost');
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    gl.viewport(0, 0, width, height);
    for (const [unit, name] of [[0, 'a'], [1, 'b']]) {
      this.bind(unit, view[name], width, height);
      gl.uniform1i(this.place(name + 'Linear'), view[name].bitmap ? 0 : 1);
      gl.uniform1f(this.place(name + 'Scale'), 2 ** view[name + 'Tone'].stops);
      gl.uniform1f(this.place(name + 'Curve'), curveOf(view[name + 'Tone']));
    }
    gl.uniform1i(this.place('difference'), view.difference ? 1 : 0);
    gl.uniform1f(this.place('gain'), view.gain);
    gl.uniform1f(this.place('wipe'), view.wipe);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    context.drawImage(this.canvas, 0, 0);
  }
}

class Cpu {
  // A picture at its own size as it is to be shown.
  shown(picture, tone) {
    if (picture.bitmap) return picture.bitmap;
    const { width, height, data, channels } = picture, image = new ImageData(width, height), value = halves(), scale = 2 ** tone.stops, curve = curveOf(tone);
    for (let p = 0, from = 0; p < 4 * width * height; p += 4, from += channels) {
      const r = value[data[from]] * scale, g = value[data[from + 1]] * scale, b = value[data[from + 2]] * scale;
      image.data[p] = 255 * displayed(curve, r, r, g, b, 0);
      image.data[p + 1] = 255 * displayed(curve, g, r, g, b, 1);
      image.data[p + 2] = 255 * displayed(curve, b, r, g, b, 2);
      image.data[p + 3] = 255;
    }
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext('2d').putImageData(image, 0, 0);
    return canvas;
  }
  draw(context, width, height, view) {
    context.imageSmoothingQuality = 'high';
    const put = (name) => context.drawImage(this.shown(view[name], view[name + 'Tone']), 0, 0, width, height);
    if (!view.difference) {
      put('b');
      if (view.wipe <= 0) return;
      context.save();
      context.beginPath();
      context.rect(0, 0, Math.round(view.wipe * width), height);
      context.clip();
      put('a');
      context.restore();
      return;
    }
    put('a');
    const left = context.getImageData(0, 0, width, height);
    put('b');
    const right = context.getImageData(0, 0, width, height);
    for (let p = 0; p < left.data.length; p += 4) {
      const apart = Math.max(...[0, 1, 2].map((c) => Math.abs(left.data[p + c] - right.data[p + c]))) / 255, t = Math.min(1, view.gain * apart);
      right.data[p] = 255 * heatRed(t);
      right.data[p + 1] = 255 * heatGreen(t);
      right.data[p + 2] = 255 * heatBlue(t);
    }
    context.putImageData(right, 0, 0);
  }
}

export class Display {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d', { willReadFrequently: false });
    this.painter = new Cpu();
    try { if (!new URLSearchParams(location.search).has('cpu')) this.painter = new Gpu(); } catch { /* 2D it is */ }
  }
  get kind() { return this.painter instanceof Gpu ? 'webgl2' : '2d'; }

  // `view`: {a, b: pictures, aTone, bTone: {stops, curve}, difference, gain, wipe: share of the width that shows a}.
  draw(width, height, view) {
    const { canvas, context } = this, all = { ...view, a: view.a ?? view.b, aTone: view.a ? view.aTone : view.bTone };
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    try {
      if (this.painter instanceof Gpu && Math.max(width, height, all.a.width, all.b.width, all.a.height, all.b.height) > this.painter.most) throw new Error('too large');
      this.painter.draw(context, width, height, all);
    } catch (error) {
      if (!(this.painter instanceof Gpu)) throw error;
      this.painter = new Cpu();
      this.painter.draw(context, width, height, all);
    }
    if (!view.a || view.difference || view.wipe <= 0) return;
    context.fillStyle = '#fff';
    context.fillRect(Math.round(view.wipe * width) - 1, 0, 2, height);
  }
}

// Root of the mean squared difference of two linear pictures of one size; null: they are not.
export function rmse(a, b) {
  if (!a?.data || !b?.data || a.width !== b.width || a.height !== b.height || a.channels !== b.channels) return null;
  const value = halves();
  let sum = 0, n = 0;
  for (let i = 0; i < a.data.length; ++i) {
    if (i % a.channels === 3) continue;
    sum += (value[a.data[i]] - value[b.data[i]]) ** 2;
    ++n;
  }
  return Math.sqrt(sum / n);
}
