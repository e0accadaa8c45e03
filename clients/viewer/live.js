// SPDX-License-Identifier: Apache-2.0
// The latest edit wins: one render at a time; an edit ends it once it has shown a picture, and of edits meanwhile only the last is rendered.
import { ApiError, renderFrames } from './api.js';

const session = crypto.randomUUID?.() ?? String(Math.random());

export class Live {
  // `on`: {start(), picture(reply, bytes, final), progress(p), error(ApiError), idle()}
  constructor(on) {
    this.on = on;
    this.running = null;
    this.next = null;
  }

  ask(request) {
    this.next = { ...request, scheduling: { session, priority: 'INTERACTIVE' }, encoding: { format: 'JPEG', jpeg_quality: 90 } };
    if (!this.running) this.run();
    else if (this.running.shown) this.running.stop.abort();
  }

  async run() {
    while (this.next) {
      const request = this.next, own = { stop: new AbortController(), shown: false };
      this.next = null;
      this.running = own;
      this.on.start();
      try {
        for await (const frame of renderFrames(request, own.stop.signal)) {
          if (frame.progress) this.on.progress(frame.progress);
          const reply = frame.snapshot ?? frame.reply;
          if (!reply) continue;
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
