// SPDX-License-Identifier: Apache-2.0
// The farm's page: who renders, and what is to be rendered. Looks every second, as long as somebody looks at it.
import { getJson, setToken } from './api.js';

const $ = (id) => document.getElementById(id);
const kPeriod = 1000; // ms
const moment = (unix) => (unix ? new Date(unix * 1000).toLocaleString() : '-');

// Cells are texts or elements; numbers stand to the right. A row of the same key stays the element that it was, so that a selection survives the next look.
function fill(table, rows) {
  const body = table.tBodies[0], old = new Map([...body.rows].map((row) => [row.dataset.key, row]));
  table.hidden = rows.length === 0;
  body.replaceChildren(...rows.map(({ key, state, cells }) => {
    const row = old.get(key) ?? document.createElement('tr');
    row.dataset.key = key;
    row.dataset.state = state;
    cells.forEach((value, i) => {
      const cell = row.cells[i] ?? row.insertCell();
      if (value instanceof Node) {
        cell.replaceChildren(value);
        return;
      }
      const text = String(value);
      if (cell.textContent !== text || cell.firstElementChild) cell.textContent = text;
      cell.className = typeof value === 'number' ? 'number' : '';
    });
    return row;
  }));
}

function showWorkers(workers) {
  fill($('workers'), workers.map((w) => ({
    key: w.id, state: w.attending ? 'attends' : 'left',
    cells: [w.info?.name ?? '', w.attending ? 'attends' : 'left', moment(w.since_unix_s), w.info?.threads ?? 0, (w.frames ?? []).join(', '), Number(w.done ?? 0), Number(w.failed ?? 0)],
  })));
  $('no-workers').textContent = workers.length ? '' : 'No worker attends: frames are rendered by the daemon itself.';
}

function bar(job) {
  const progress = document.createElement('progress'), cell = document.createElement('span');
  progress.max = 1;
  progress.value = job.progress ?? 0;
  progress.setAttribute('aria-label', `Progress of ${job.id}`);
  cell.append(progress, ` ${Math.floor(100 * progress.value)} %`);
  return cell;
}

function showJobs(jobs, more) {
  fill($('jobs'), jobs.map((job) => {
    const state = (job.state ?? '').toLowerCase();
    return {
      key: job.id, state,
      cells: [job.id, job.spec?.name ?? '', state, bar(job), `${job.frames_done ?? 0} of ${job.frames_total ?? 0}`, Number(job.frames_failed ?? 0), (job.waits_for ?? []).join(', '), job.error?.message ?? ''],
    };
  }));
  $('no-jobs').textContent = jobs.length === 0 ? 'No jobs.' : more ? `The newest ${jobs.length}.` : '';
}

// One part of the page: a fault of one is no reason to show nothing of the other.
async function part(path, show, note) {
  try {
    show(await getJson(path));
    return null;
  } catch (error) {
    if (error.code !== 'PERMISSION_DENIED') return error;
    note.textContent = error.message;
    return null;
  }
}

async function look() {
  const faults = await Promise.all([
    part('/v1/workers', (reply) => showWorkers(reply.workers ?? []), $('no-workers')),
    part('/v1/jobs', (reply) => showJobs(reply.jobs ?? [], Boolean(reply.next_page_token)), $('no-jobs')),
  ]);
  const fault = faults.find((f) => f !== null);
  $('error').textContent = fault ? fault.message : '';
  $('token').hidden = fault?.code !== 'UNAUTHENTICATED';
  document.body.dataset.looks = Number(document.body.dataset.looks) + 1;
}

$('token').addEventListener('submit', (event) => {
  event.preventDefault();
  setToken(new FormData(event.target).get('token'));
  look();
});

for (;;) {
  if (!document.hidden) await look();
  await new Promise((done) => setTimeout(done, kPeriod));
}
