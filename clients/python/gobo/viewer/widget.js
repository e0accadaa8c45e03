// SPDX-License-Identifier: Apache-2.0
// The viewer in a notebook (gobo.widget): orbit and panel are the page's (clients/viewer), messages of the kernel stand where HTTP does.
import { Orbit, steer } from './orbit.js';
import { Panel, filterRows } from './panel.js';

const LAYOUT = `
.viewer { display: grid; grid-template-columns: minmax(0, 1fr) 350px; gap: 12px; font: 14px/1.4 system-ui, sans-serif; }
.viewer canvas { max-height: none; }
.viewer aside { max-height: 560px; }
@media (max-width: 760px) { .viewer { display: block; } }`;

export function render({ model, el }) {
  const view = globalThis.crypto?.randomUUID?.() ?? String(Math.random());
  const root = document.createElement('div');
  el.append(root);
  const shadow = root.attachShadow({ mode: 'open' });  // the page's styles stay inside
  shadow.innerHTML = `<style>${CSS}${LAYOUT}</style><div class="viewer"><main>
    <canvas tabindex="0" aria-label="The picture. Arrow keys orbit, with Shift they pan, plus and minus dolly, Home goes back to the scene's camera."></canvas>
    <p id="status" role="status" aria-live="polite"></p><p id="error" role="alert"></p></main>
    <aside aria-label="Request"><div class="bar"><input id="search" type="search" placeholder="Find a setting" aria-label="Find a setting">
    <button id="reset" type="button">Reset</button></div><div id="lights"></div><div id="panel"></div></aside></div>`;
  const $ = (selector) => shadow.querySelector(selector);
  const canvas = $('canvas'), context = canvas.getContext('2d'), edits = {};
  let orbit = null, start = null, latest = 0, steered = false;

  const changed = () => model.send({ type: 'edit', view, edits, camera: steered ? orbit.settings() : null });
  const find = () => { for (const id of ['#lights', '#panel']) filterRows($(id), $('#search').value); };

  function home() {  // where the scene's own camera stands
    orbit = new Orbit(start.matrix, start.bounds);
    steered = false;
  }

  function build() {
    const panel = new Panel(start.schema, edits, changed);
    $('#lights').replaceChildren(...start.lights.map((name) =>
      panel.group(`Light: ${name}`, panel.fields('LightEdit', ['lights', name], new Set(['kind', 'shadow'])))));
    const fields = panel.fields(start.schema.root, [], new Set(start.skip));
    const plain = fields.filter((f) => f.classList.contains('field'));
    $('#panel').replaceChildren(...fields.filter((f) => !plain.includes(f)), panel.group('picture', plain));
    find();
  }

  async function heard(message, buffers) {
    if (message.to !== undefined && message.to !== view) return;
    if (message.type === 'start') {
      start = message;
      Object.assign(edits, message.edits);
      home();
      build();
    } else if (message.type === 'picture') {
      const own = ++latest;
      model.send({ type: 'shown', view });
      const picture = await createImageBitmap(new Blob([buffers[0]], { type: 'image/jpeg' }));
      if (own < latest) return;  // a newer one came while this was decoded
      if (canvas.width !== message.width || canvas.height !== message.height) Object.assign(canvas, { width: message.width, height: message.height });
      context.imageSmoothingQuality = 'high';
      context.drawImage(picture, 0, 0, message.width, message.height);
      $('#status').textContent = message.text;
      $('#error').textContent = '';
    } else if (message.type === 'error') $('#error').textContent = message.message;
  }

  $('#search').addEventListener('input', find);
  $('#reset').addEventListener('click', () => {
    for (const key of Object.keys(edits)) delete edits[key];
    if (start) {
      home();
      build();
    }
    changed();
  });
  steer(canvas, {
    orbit: () => orbit,
    moved() {
      steered = true;
      changed();
    },
    home() {
      home();
      changed();
    },
    turnSky(degrees) {
      (edits.environment ??= {}).rotation_deg = (edits.environment?.rotation_deg ?? 0) + degrees;
      build();
      changed();
    },
    pick() {},
  });
  model.on('msg:custom', heard);
  model.send({ type: 'hello', view });
  return () => model.off('msg:custom', heard);
}
