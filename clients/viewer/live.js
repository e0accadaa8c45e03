// SPDX-License-Identifier: Apache-2.0
// The latest edit wins: one render at a time; an edit ends it once it has shown a picture, and of edits meanwhile only the last is rendered.
import { ApiError, renderFrames } from './api.js';

const session = crypto.randomUUID?.() ?? String(Math.random());
const kSlowMs = 80;         // a picture of half floats that takes longer to come makes way for JPEG,
const kAgainMs = 15000;     // and is tried again after this

export class Live {
  // `on`: {start(), picture(reply, bytes, final), progress(p), error(ApiError), idle()}
  constructor(on) {
    this.on = on;
    this.running = null;
    this.next = null;
    this.frames = 'auto';  // or 'half', 'jpeg'
    this.slowUntil = 0;
  }

  // `linear`: whether the picture can come as linear half floats.
  ask(request, linear) {
    const half = linear && (this.frames === 'half' || (this.frames === 'auto' && performance.now() >= this.slowUntil));
    this.next = { ...request, scheduling: { ...request.scheduling, session, priority: 'INTERACTIVE' }, encoding: half ? { format: 'RAW_HALF' } : { format: 'JPEG', jpeg_quality: 90 } };
    if (!this.running) this.run();
    else if (this.running.shown) this.running.stop.abort();
  }

  // Whether what comes next is linear: of it a curve is drawn here, of a JPEG the server has drawn it.
  get linear() { return (this.next?.encoding.format ?? this.running?.format ?? 'RAW_HALF') === 'RAW_HALF'; }

  // Pictures as JPEG from now on, as a slow connection gets them.
  avoidHalf() { this.slowUntil = performance.now() + kAgainMs; }

  stop() {
    this.next = null;
    this.running?.stop.abort();
  }

  async run() {
    while (this.next) {
      const request = this.next, own = { stop: new AbortController(), shown: false, format: request.encoding.format };
      this.next = null;
      this.running = own;
      this.on.start();
      try {
        for await (const frame of renderFrames(request, own.stop.signal)) {
          if (frame.progress) this.on.progress(frame.progress);
          const reply = frame.snapshot ?? frame.reply;
          if (!reply) continue;
          if (request.encoding.format === 'RAW_HALF' && frame.ms > kSlowMs) this.avoidHalf();
          await this.on.picture(reply, frame.bytes, Boolean(frame.reply));
          own.shown = true;
          if (this.next) break;  // ends the stream, and with it the render
        }
      } catch (error) {
        if (error.name !== 'AbortError' && !(error.code === 'CANCELLED' && this.next)) {
          this.running = null;
          this.on.error(error instanceof ApiError ? error : new ApiError('UNKNOWN', String(error), 0));
          if (!this.next) return;
        }
      } finally { own.stop.abort(); }
    }
    this.running = null;
    this.on.idle();
  }
}
