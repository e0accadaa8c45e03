// SPDX-License-Identifier: Apache-2.0
// What is in the canvas: the present picture (B), a kept one or the reference (A), the wipe between them or their difference.
import { Display, rmse } from './display.js';
import { chosenExposure } from './tone_map.js';

// A picture out of a reply's bytes: the first image.
export async function pictureOf(reply, bytes) {
  const image = reply.images[0], { width, height } = image, own = bytes.slice(0, Number(image.bytes));
  if (image.format === 'RAW_HALF') return { width, height, channels: image.channels.length, data: new Uint16Array(own.buffer) };
  return { width, height, bitmap: await createImageBitmap(new Blob([own], { type: image.format === 'PNG' ? 'image/png' : 'image/jpeg' })) };
}

export class View {
  // `tone()`: the request's tone_map as it is now.
  constructor(canvas, tone) {
    this.display = new Display(canvas);
    this.tone = tone;
    this.size = [640, 480];
    this.present = this.kept = null;  // {picture, tone: fixed one, label}
    this.wipe = 0;
    this.difference = false;
    this.gain = 1;
  }

  // Stops and curve of the present picture. A picture whose exposure nobody gave gets the one that the server would choose.
  presentTone() {
    const { exposure, curve, auto_exposure: auto } = this.tone(), own = this.present;
    if (exposure === undefined && auto !== false && own?.picture.data && own.whole && own.chosen === undefined) own.chosen = chosenExposure(own.picture);
    return { stops: exposure ?? (auto === false ? 0 : own?.chosen ?? 0), curve };
  }

  show(picture, whole) { this.present = { picture, whole }; }

  // As A: the present picture as it looks now.
  keep() { if (this.present) this.kept = { picture: this.present.picture, tone: this.presentTone(), label: 'kept' }; }
  // As A: a picture that is shown as the present one is.
  hold(picture, label) { this.kept = { picture, tone: null, label }; }

  draw() {
    if (!this.present) return;
    const tone = this.presentTone();
    this.display.draw(...this.size, { a: this.kept?.picture, b: this.present.picture, aTone: this.kept?.tone ?? tone, bTone: tone, wipe: this.kept ? this.wipe : 0,
      difference: this.difference && Boolean(this.kept), gain: this.gain });
  }

  // Of A and B, linear; null: they cannot be compared.
  rmse() {
    const of = [this.kept?.picture, this.present?.picture];
    if (of.some((picture, i) => picture !== this.measured?.of[i])) this.measured = { of, rmse: rmse(...of) };
    return this.measured?.rmse ?? null;
  }
}
