// SPDX-License-Identifier: Apache-2.0
// The page: a scene, its picture, and what may be changed about it.
import { asked, cameraMatrices, getJson, postBytes, postJson, setToken } from './api.js';
import { acceptMaps } from './blobs.js';
import { command } from './command.js';
import { certificate, moment, reference, withoutNoise } from './compare.js';
import { Lights } from './lights.js';
import { Live } from './live.js';
import { Grip, Patches, showMaterial } from './object.js';
import { Orbit, moved, steer } from './orbit.js';
import { Panel, filterRows } from './panel.js';
import { pick } from './pick.js';
import { View, pictureOf } from './view.js';

const $ = (id) => document.getElementById(id);
const body = document.body, vector = (v) => [v?.x ?? 0, v?.y ?? 0, v?.z ?? 0];
const kRoots = ['lights', 'object', 'panel'].map($);
// Outputs that are light: they come linear and are exposed here.
const kRadiance = /^(beauty|emission|(in)?direct(_\w+)?|diffuse|specular|(group|unoccluded):.*)$/;
let schema, scene, panel, edits = {}, orbit = null, lens = null, cameraTurn = 0, steps = 0, stops = 0, pickTurn = 0, retry = 0, stopped = false, cleaning = null, loaded = new Set();

const view = new View($('picture'), () => [edits.curves, edits.expressions].some((of) => of && Object.keys(of).some((p) => p.startsWith('tone_map'))) ? lastReply?.resolved.tone_map ?? {} : edits.tone_map ?? {});
let lastReply = null;

// The request of the picture: without what only belongs to how it is asked for.
function requestNow() {
  const { certificate: c, encoding: e, scheduling: s, ...request } = structuredClone(edits);
  return { ...request, scene: scene.id };
}
const sizeNow = () => [edits.window?.width ?? edits.width ?? 640, edits.window?.height ?? edits.height ?? 480];

function draw() {
  view.draw();
  body.dataset.draws = Number(body.dataset.draws) + 1;
  body.dataset.painter = view.display.kind;
  const apart = view.kept && view.rmse();
  $('compared').textContent = view.kept ? `A: ${view.kept.label}${apart === null ? '' : `; RMSE of A and B, linear: ${Number(apart.toPrecision(3))}`}` : '';
}

function showReply(reply, final) {
  const image = reply.images[0], chosen = view.present.chosen;
  const parts = [`${image.width} x ${image.height}`, `${reply.resolved.halt.spp} samples a pixel`, `${Math.round(reply.total_ms)} ms`,
    `${Number(reply.rays ?? 0).toLocaleString()} rays`, final ? reply.request_hash.slice(0, 8) : '...'];
  if (chosen && edits.tone_map?.exposure === undefined) parts.push(`exposure ${chosen} was chosen`);
  $('status').textContent = [parts.join(' \u00b7 '), ...(reply.warnings ?? [])].join(' \u2014 ');
  if (!final) return;
  $('plan').tBodies[0].replaceChildren(...(reply.plan ?? []).map((n) => {
    const row = document.createElement('tr');
    row.title = n.reason ?? '';
    for (const text of [n.node, n.state.toLowerCase(), (n.ms ?? 0).toFixed(1), Number(n.rays ?? 0).toLocaleString()]) row.insertCell().textContent = text;
    return row;
  }));
}

function show(picture, reply, final) {
  view.size = sizeNow();
  view.show(picture, !edits.window);
  draw();
  showReply(reply, final);
}

function cleanNoMore() {
  cleaning?.abort();
  cleaning = null;
  if (body.dataset.clean === 'asked') body.dataset.clean = 'no';
}

// Stop is there for as long as something runs that it ends: the picture, or the one without noise.
const showStop = () => { $('stop').disabled = !live.running && !cleaning; };

// At rest a picture of light loses its noise, unless the request has a filter of its own. An edit or Stop ends it, and what has come stays if it fails.
async function clean() {
  cleanNoMore();
  body.dataset.clean = 'no';
  // Whoever stopped a picture does not want another one.
  if (stopped || !$('clean').checked || !lastReply || edits.denoise || !kRadiance.test(edits.outputs?.[0] ?? 'beauty')) return;
  const own = cleaning = new AbortController();
  body.dataset.clean = 'asked';
  try {
    const { reply, bytes } = await withoutNoise(requestNow(), lastReply, own.signal);
    const picture = await pictureOf(reply, bytes);
    if (own.signal.aborted) return;
    show(picture, reply, true);
    body.dataset.clean = 'yes';
  } catch (error) {
    if (!own.signal.aborted) body.dataset.clean = 'no';
  }
  if (cleaning !== own) return;
  cleaning = null;
  showStop();
}

const live = new Live({
  start() {
    body.dataset.state = 'rendering';
    stopped = false;
    cleanNoMore();
    showStop();
    $('progress').value = 0;
  },
  async picture(reply, bytes, final) {
    lastReply = reply;
    const picture = await pictureOf(reply, bytes);
    $('error').textContent = '';
    Panel.clearFaults(kRoots);
    show(picture, reply, final);
    body.dataset.frames = Number(body.dataset.frames) + 1;
    body.dataset.format = reply.images[0].format;
    if (final && !stopped && picture.data && (reply.warnings ?? []).some((w) => w.includes('clamped to 65504')) && live.frames === 'auto') {
      live.slowUntil = Infinity;  // brighter than halves can hold: the server exposes this scene
      ask();
    }
  },
  progress(p) {
    $('progress').value = p.fraction ?? 0;
    if (p.queued) $('status').textContent = `waiting; ${p.position ?? 0} before this one`;
  },
  idle() {
    body.dataset.state = 'done';
    $('progress').value = 0;
    clean();
    showStop();
  },
  error: fail,
});

const isAway = (error) => error.code === 'OFFLINE' || error.status === 503;

function fail(error) {
  const offline = isAway(error);
  body.dataset.state = offline ? 'offline' : 'error';
  showStop();
  $('error').textContent = offline ? `${error.message}; trying again` : error.message;
  if (!offline) panel?.fault(error.message, kRoots);
  $('token').hidden = error.status !== 401;
  clearTimeout(retry);
  if (offline) retry = setTimeout(() => choosing ? choose(choosing.id, choosing.first) : scene ? returned() : start(), 1000);
}

// A server that was started anew does not have the scene: it is opened again.
async function returned() {
  try {
    const here = await getJson('/v1/scenes/' + encodeURIComponent(scene.id)).catch((error) => { if (error.code !== 'NOT_FOUND') throw error; });
    if (!here) {
      await postJson('/v1/scenes', { source: scene.source || scene.id, name: scene.id });
      grip.hold();  // as in its file again
    }
    await findCamera();  // it may be what nobody answered: without it nothing can be steered
    ask();
  } catch (error) { fail(error); }
}

const ask = () => live.ask(requestNow(), kRadiance.test(edits.outputs?.[0] ?? 'beauty'));

// What the lights' handles are drawn by, and where the orbit begins: of the request's camera, asked for before the picture, behind which they would come late.
async function findCamera() {
  const own = scene, turn = ++cameraTurn, from = steps;
  body.dataset.camera = 'asked';
  const found = await cameraMatrices(moment(requestNow())).catch((error) => { if (isAway(error)) throw error; return null; });
  if (turn !== cameraTurn) return;  // a later question has been asked
  lens = found;
  body.dataset.camera = 'known';
  const steered = from !== steps;  // meanwhile: the answer is of where the camera stood, and of the lens that it still has
  if (!steered) orbit = new Orbit(lens?.worldToCamera, { min: vector(own.bounds_min), max: vector(own.bounds_max) });
  showHandles(edits.camera?.panorama || !lens?.worldToNDC ? null : steered ? moved(lens, orbit.matrix()) : lens);
}

// `matrices` null: nobody knows where anything is in the picture.
function showHandles(matrices) {
  lights.refresh(matrices);
  grip.refresh(matrices);
}

const kCameraFields = new Set(['camera', 'width', 'height', 'time_s', 'animation', 'curves', 'expressions']);

async function changed(path) {
  if (!scene) return;
  $('certified').textContent = '';
  if (path[0] === 'width' || path[0] === 'height') showSize();
  if (path[0] === 'lights') lights.refresh();
  if (path[0] === 'time_s' || path[0] === 'animation') grip.hold();  // it may be elsewhere now
  // Exposure and curve of a picture that is here in linear light.
  if (path[0] === 'tone_map' && view.present?.picture.data && live.linear && !edits.curves && !edits.expressions) return draw();
  const before = stops;
  try {
    if (kCameraFields.has(path[0])) await findCamera();
    if (before === stops) ask();  // else Stop was pressed meanwhile
  } catch (error) { fail(error); }
}

function orbited() {
  ++steps;
  for (const [name, value] of Object.entries(orbit.settings())) panel.put(['camera', name], value);
  if (lens?.worldToNDC && !edits.camera?.panorama) showHandles(moved(lens, orbit.matrix()));
  $('certified').textContent = '';
  ask();
}

function turnSky(degrees) {
  const now = edits.environment?.rotation_deg ?? 0, turned = ((now + degrees + 180) % 360 + 360) % 360 - 180;
  panel.put(['environment', 'rotation_deg'], Number(turned.toFixed(2)));
  changed(['environment', 'rotation_deg']);
}

const find = () => { for (const root of [$('light-fields'), $('panel')]) filterRows(root, $('search').value); };

const lights = new Lights($('lights'), $('handles'), $('lamp'), {
  changed,
  filter: find,
  place() {
    const size = Math.hypot(...vector(scene.bounds_max).map((v, i) => v - vector(scene.bounds_min)[i])) || 1, [x, y, z] = orbit?.target ?? [0, 0, 0];
    return { point: { x, y: y + 0.15 * size, z }, size };
  },
});

function showSize() {
  const text = `${edits.width ?? 640}x${edits.height ?? 480}`;
  $('size').value = [...$('size').options].some((o) => o.value === text) ? text : '';
}

function build() {
  panel = new Panel(schema, edits, changed);
  const fields = panel.fields(schema.root, [], new Set(['scene', 'lights']));  // these have their places above
  const plainOnes = fields.filter((f) => f.classList.contains('field')), groups = fields.filter((f) => !plainOnes.includes(f));
  const first = groups.find((g) => g.querySelector('summary')?.textContent === 'tone map');
  if (first) first.open = true;
  $('panel').replaceChildren(...(first ? [first] : []), ...groups.filter((g) => g !== first), panel.group('picture', plainOnes));
  lights.build(panel, scene);
  find();
}

// `first`: edits to begin with. What is being chosen is chosen again once a server that is away is back.
let choice = 0, choosing = null;
async function choose(id, first = {}) {
  const own = ++choice;
  choosing = { id, first };
  try {
    const load = () => postJson('/v1/scenes', { source: id });
    // One that was started anew does not have it any more.
    const found = loaded.has(id) ? await getJson('/v1/scenes/' + encodeURIComponent(id)).catch((error) => error.code === 'NOT_FOUND' ? load() : Promise.reject(error)) : await load();
    loaded.add(found.id);
    if (own !== choice) return;  // another one was chosen while this one was loaded
    scene = found;
    choosing = null;
    for (const key of Object.keys(edits)) delete edits[key];
    Object.assign(edits, first);
    cleanNoMore();
    [orbit, lens, view.kept, view.present] = [null, null, null, null];
    live.slowUntil = 0;
    grip.hold();
    for (const name of ['picked', 'certified', 'compared', 'object']) $(name).textContent = '';
    keptChanged();
    showSize();
    build();
    await findCamera();
    if (own === choice) ask();
  } catch (error) {
    if (own !== choice) return;
    if (!isAway(error)) {
      choosing = null;
      if (scene) $('scene').value = scene.id;  // it stays what is seen
    }
    fail(error);
  }
}

// What the address asks for: #scene=NAME&request={...}&frames=half.
function firstEdits() {
  if (asked.has('frames')) $('frames').value = live.frames = asked.get('frames');
  if (asked.has('clean')) $('clean').checked = asked.get('clean') !== '0';
  if (!asked.has('request')) return {};
  try {
    const { scene: ignored, ...request } = JSON.parse(asked.get('request'));
    return request;
  } catch (error) { throw new Error(`the address: request: ${error.message}`); }
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
    await choose(wanted, firstEdits());
  } catch (error) { fail(error); }
}

const patches = new Patches(() => ask(), (error) => {
  grip.hold();  // it would stand where the object is not
  fail(error);
}), grip = new Grip($('handles'), patches);

// Which light, object or material is in a pixel, 0 to 1 from the top left corner of the picture.
async function pickAt(x, y) {
  if (!scene) return;
  const [width, height] = sizeNow(), own = edits.window ?? {};
  const from = scene, turn = ++pickTurn;
  const inside = (t, n) => Math.min(n - 1, Math.max(0, Math.floor(t * n)));
  try {
    const found = await pick(requestNow(), scene, (own.x ?? 0) + inside(x, width), (own.y ?? 0) + inside(y, height));
    if (scene !== from || turn !== pickTurn) return;  // another scene, or a later click
    $('picked').textContent = found ? `Object: ${found.object || '(no name)'}; material: ${found.material || '(no name)'}` : 'The background';
    $('picked').dataset.object = found?.object ?? '';
    showMaterial($('object'), Panel, scene.id, found?.material, patches);
    grip.hold(scene.id, found?.object, found?.at, lights.matrices);
    // A lamp is the light of its name.
    const light = found && lights.all().find((l) => l.name === found.object || l.name === found.material);
    if (light) lights.select(light.name, true);
    else if (found) $('object').scrollIntoView({ block: 'nearest', behavior: matchMedia('(prefers-reduced-motion: reduce)').matches ? 'auto' : 'smooth' });
  } catch (error) { fail(error); }
}

function keptChanged() {
  const has = Boolean(view.kept);
  for (const id of ['wipe', 'difference']) $(id).disabled = !has;
  $('gain').disabled = !has || !$('difference').checked;
  if (has && Number($('wipe').value) === 0) $('wipe').value = 0.5;
  [view.wipe, view.difference, view.gain] = [Number($('wipe').value), $('difference').checked, 2 ** Number($('gain').value)];
  if (view.present) draw();
}

$('scene').addEventListener('change', () => choose($('scene').value));
$('size').addEventListener('change', () => {
  if (!$('size').value) return;
  const [width, height] = $('size').value.split('x').map(Number);
  panel.put(['width'], width);
  panel.put(['height'], height);
  changed(['width']);
});
$('frames').addEventListener('change', () => {
  live.frames = $('frames').value;
  live.slowUntil = 0;
  if (scene) ask();
});
$('clean').addEventListener('change', () => { if (scene) ask(); });
$('search').addEventListener('input', find);
for (const id of ['wipe', 'difference', 'gain']) $(id).addEventListener('input', keptChanged);
$('keep').addEventListener('click', () => {
  view.keep();
  keptChanged();
});

// A second press ends what the first began.
function toggled(button, work) {
  let stop = null;
  const text = button.textContent;
  button.addEventListener('click', async () => {
    if (stop) return stop.abort();
    stop = new AbortController();
    button.textContent = 'Stop';
    try { await work(stop.signal); } catch (error) { if (error.name !== 'AbortError') fail(error); }
    stop = null;
    button.textContent = text;
  });
}
toggled($('reference'), (signal) => {
  const own = choice;
  return reference(requestNow(), Math.max(1, Math.round(Number($('reference-spp').value)) || 256), signal, async (reply, bytes) => {
    if (own !== choice || reply.images[0].output !== 'beauty') return;
    view.hold(await pictureOf(reply, bytes), `reference, path traced, ${reply.resolved.halt.spp} samples`);
    keptChanged();
  });
});
toggled($('certify'), async (signal) => {
  $('certified').textContent = 'Measuring how wrong the picture is';
  const request = requestNow(), own = JSON.stringify(request);
  try {
    const text = await certificate(request, edits.certificate, signal);
    if (JSON.stringify(requestNow()) === own) $('certified').textContent = text;
  } catch (error) {
    $('certified').textContent = '';
    throw error;
  }
});

function stop() {
  stopped = true;
  ++stops;
  live.stop();
  cleanNoMore();
  showStop();
}
$('stop').addEventListener('click', stop);
addEventListener('keydown', (e) => { if (e.key === 'Escape') stop(); });
$('reset').addEventListener('click', () => {
  for (const key of Object.keys(edits)) delete edits[key];
  build();
  changed(['width']);
});
$('save').addEventListener('click', async () => {
  try {
    const format = edits.encoding?.format ?? 'PNG', ending = { PNG: 'png', JPEG: 'jpg', EXR: 'exr' }[format] ?? 'raw';
    const bytes = await postBytes('/v1/render', { ...requestNow(), encoding: { ...edits.encoding, format } });
    const link = Object.assign(document.createElement('a'), { href: URL.createObjectURL(new Blob([bytes])), download: `${scene.id}.${ending}` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } catch (error) { fail(error); }
});
async function copy(text, said) {
  Object.assign($('copied'), { value: text, hidden: false });
  const done = await navigator.clipboard?.writeText(text).then(() => true, () => false);
  $('status').textContent = done ? said : 'The browser keeps its clipboard to itself: copy from the field.';
}
const whole = () => ({ ...requestNow(), ...(edits.encoding ? { encoding: edits.encoding } : {}), ...(edits.certificate ? { certificate: edits.certificate } : {}) });
$('copy').addEventListener('click', () => copy(JSON.stringify(whole(), null, 1), 'The request was copied: gobo render --request FILE renders it.'));
$('copy-command').addEventListener('click', () => copy(command(schema, requestNow()), 'The command was copied.'));
$('token').addEventListener('submit', (e) => {
  e.preventDefault();
  setToken(new FormData($('token')).get('token'));
  start();
});
// An .hdr or .exr that is dropped onto the page lights the scene.
acceptMaps(body, (digest) => {
  for (const name of ['path', 'sky', 'constant']) panel.put(['environment', name], undefined);
  panel.put(['environment', 'digest'], digest);
  changed(['environment']);
}, fail);
steer($('picture'), {
  orbit: () => orbit,
  moved: orbited,
  home() {
    for (const name of ['position', 'look_at', 'up']) panel.put(['camera', name], undefined);
    changed(['camera']);
  },
  turnSky,
  pick: pickAt,
});
start();
