// SPDX-License-Identifier: Apache-2.0
// The page: a scene, its picture, and what may be changed about it.
import { asked, getJson, postBytes, postJson, sceneCamera, setToken } from './api.js';
import { acceptMaps } from './blobs.js';
import { Live } from './live.js';
import { Orbit, steer } from './orbit.js';
import { Panel, filterRows } from './panel.js';

const $ = (id) => document.getElementById(id);
const canvas = $('picture'), context = canvas.getContext('2d'), body = document.body;
let schema, scene, orbit = null, edits = {}, present = null, kept = null, retry = 0, loaded = new Set();

function requestNow() {
  const [width, height] = $('size').value.split('x').map(Number);
  const request = structuredClone(edits);
  const camera = orbit?.settings();
  return { ...request, scene: scene.id, width, height, ...(camera ? { camera: { ...request.camera, ...camera } } : {}) };
}

function draw() {
  if (!present) return;
  const [width, height] = $('size').value.split('x').map(Number);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  context.imageSmoothingQuality = 'high';
  context.drawImage(present, 0, 0, width, height);
  const wipe = Number($('wipe').value);
  if (!kept || wipe <= 0) return;
  const edge = Math.round(wipe * width);
  context.drawImage(kept, 0, 0, kept.width * edge / width, kept.height, 0, 0, edge, height);
  context.fillStyle = '#fff';
  context.fillRect(edge - 1, 0, 2, height);
}

function showReply(reply, final) {
  const image = reply.images[0];
  const parts = [`${image.width} x ${image.height}`, `${reply.resolved.halt.spp} samples a pixel`, `${Math.round(reply.total_ms)} ms`,
    `${Number(reply.rays ?? 0).toLocaleString()} rays`, final ? reply.request_hash.slice(0, 8) : '...'];
  $('status').textContent = [parts.join(' \u00b7 '), ...(reply.warnings ?? [])].join(' \u2014 ');
  if (!final) return;
  $('plan').tBodies[0].replaceChildren(...(reply.plan ?? []).map((n) => {
    const row = document.createElement('tr');
    row.title = n.reason ?? '';
    for (const text of [n.node, n.state.toLowerCase(), (n.ms ?? 0).toFixed(1), Number(n.rays ?? 0).toLocaleString()]) row.insertCell().textContent = text;
    return row;
  }));
}

const live = new Live({
  start() { body.dataset.state = 'rendering'; },
  async picture(reply, bytes, final) {
    present = await createImageBitmap(new Blob([bytes], { type: 'image/jpeg' }));
    $('error').textContent = '';
    draw();
    showReply(reply, final);
    body.dataset.frames = Number(body.dataset.frames) + 1;
  },
  progress() {},
  idle() { body.dataset.state = 'done'; },
  error: fail,
});

function fail(error) {
  const offline = error.code === 'OFFLINE' || error.status === 503;
  body.dataset.state = offline ? 'offline' : 'error';
  $('error').textContent = offline ? `${error.message}; trying again` : error.message;
  $('token').hidden = error.status !== 401;
  clearTimeout(retry);
  if (offline) retry = setTimeout(scene ? changed : start, 1000);
}

const changed = () => { if (scene) live.ask(requestNow()); };

const find = () => { for (const id of ['lights', 'panel']) filterRows($(id), $('search').value); };

function build() {
  const panel = new Panel(schema, edits, changed);
  const lights = (scene.lights ?? []).map((light) => {
    const group = panel.group(`Light: ${light.name}`, panel.fields('LightEdit', ['lights', light.name], new Set(['kind', 'shadow'])));
    return group;
  });
  $('lights').replaceChildren(...lights);
  // What the page itself decides is left out.
  const skip = new Set(['scene', 'scene_hash', 'width', 'height', 'camera', 'encoding', 'scheduling', 'certificate', 'window', 'lights']);
  const fields = panel.fields(schema.root, [], skip);
  const plain = fields.filter((f) => f.classList.contains('field'));
  $('panel').replaceChildren(...fields.filter((f) => !plain.includes(f)), panel.group('picture', plain));
  find();
}

async function choose(id) {
  try {
    scene = loaded.has(id) ? await getJson('/v1/scenes/' + encodeURIComponent(id)) : await postJson('/v1/scenes', { source: id });
    loaded.add(scene.id);
    for (const key of Object.keys(edits)) delete edits[key];
    orbit = null;
    const vector = (v) => [v?.x ?? 0, v?.y ?? 0, v?.z ?? 0];
    const own = scene;
    build();
    // Before the first render: behind it the camera would come late, and so would the first drag.
    const matrix = await sceneCamera({ scene: own.id }).catch(() => null);
    if (scene !== own) return;
    orbit = new Orbit(matrix, { min: vector(own.bounds_min), max: vector(own.bounds_max) });
    changed();
  } catch (error) { fail(error); }
}

async function start() {
  try {
    schema = await getJson('/v1/schema');
    const list = await getJson('/v1/scenes');
    loaded = new Set((list.scenes ?? []).map((s) => s.id));
    const names = [...new Set([...loaded, ...(list.builtin ?? [])])];
    $('scene').replaceChildren(...names.map((name) => new Option(name)));
    $('token').hidden = true;
    $('error').textContent = '';
    const wanted = asked.get('scene') ?? names[0];
    if (!names.includes(wanted)) $('scene').append(new Option(wanted));
    $('scene').value = wanted;
    await choose(wanted);
  } catch (error) { fail(error); }
}

$('scene').addEventListener('change', () => choose($('scene').value));
$('size').addEventListener('change', changed);
$('search').addEventListener('input', find);
$('wipe').addEventListener('input', draw);
$('keep').addEventListener('click', () => {
  kept = present;
  $('wipe').disabled = !kept;
  if (kept && Number($('wipe').value) === 0) $('wipe').value = 0.5;
  draw();
});
$('reset').addEventListener('click', () => {
  for (const key of Object.keys(edits)) delete edits[key];
  orbit?.reset();
  build();
  changed();
});
$('save').addEventListener('click', async () => {
  try {
    const bytes = await postBytes('/v1/render', { ...requestNow(), encoding: { format: 'PNG' } });
    const link = Object.assign(document.createElement('a'), { href: URL.createObjectURL(new Blob([bytes], { type: 'image/png' })), download: `${scene.id}.png` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } catch (error) { fail(error); }
});
$('copy').addEventListener('click', async () => {
  const text = JSON.stringify(requestNow(), null, 1);
  await navigator.clipboard?.writeText(text).then(() => { $('status').textContent = 'The request was copied: gobo render --request FILE renders it.'; })
    .catch(() => { $('status').textContent = text; });
});
$('token').addEventListener('submit', (e) => {
  e.preventDefault();
  setToken(new FormData($('token')).get('token'));
  start();
});
// An .hdr or .exr that is dropped onto the page lights the scene.
acceptMaps(body, (digest) => {
  const { path, sky, constant, ...rest } = edits.environment ?? {};
  edits.environment = { ...rest, digest };
  build();
  changed();
}, fail);
steer(canvas, () => orbit, changed);
start();
