// Follows the events of the farm and shows each picture as it converges. Text is only ever set as
// text; pictures are fetched with their ETag, so that an unchanged one costs no more than an answer.
'use strict';

const cards = new Map();
const main = document.getElementById('jobs');
const link = document.getElementById('link');
const login = document.getElementById('login');
let token = sessionStorage.getItem('brolly-token') || '';
let failures = 0;

function headers(more) {
  const all = Object.assign({}, more);
  if (token) all.Authorization = 'Bearer ' + token;
  return all;
}

function make(tag, name, parent) {
  const element = document.createElement(tag);
  element.className = name;
  parent.append(element);
  return element;
}

function card(id) {
  let known = cards.get(id);
  if (known) return known;
  const old = main.querySelector('[data-job="' + CSS.escape(id) + '"]');
  const box = document.createElement('article');
  box.className = 'job';
  box.dataset.job = id;
  const title = make('h2', '', box);
  known = {
    box, name: make('span', '', title), state: null, line: null, version: 0, shown: -1, etag: null, busy: false, url: null,
  };
  title.append(' ');
  known.state = make('span', 'state', title);
  known.line = make('p', 'line', box);
  known.progress = make('progress', '', box);
  known.progress.max = 1;
  known.why = make('p', 'why', box);
  known.picture = make('img', '', box);
  known.picture.hidden = true;
  const links = make('p', 'links', box);
  for (const [text, path] of [['PNG', '/image.png'], ['EXR', '/image.exr'], ['log', '/log']]) {
    const a = make('a', '', links);
    a.href = '/v1/jobs/' + id + path;
    a.textContent = text;
    links.append(' ');
  }
  if (old) old.replaceWith(box); else main.prepend(box);
  document.getElementById('empty')?.remove();
  cards.set(id, known);
  return known;
}

function seconds(value) {
  if (value < 100) return value.toFixed(1) + ' s';
  return value < 6000 ? (value / 60).toFixed(1) + ' min' : (value / 3600).toFixed(1) + ' h';
}

function show(job) {
  const c = card(job.id);
  c.name.textContent = job.name;
  c.state.textContent = job.state;
  c.state.className = 'state ' + job.state;
  const parts = [job.width + ' x ' + job.height, job.spp.toFixed(1) + ' spp'];
  if (job.error !== undefined) parts.push('error ' + job.error.toPrecision(3) + (job.error_kind === 'bound' ? ' at most' : ''));
  if (job.workers) parts.push(job.workers + (job.workers === 1 ? ' worker' : ' workers'));
  parts.push(seconds(job.render_seconds));
  if (job.eta_seconds !== undefined) parts.push('about ' + seconds(job.eta_seconds) + ' left');
  c.line.textContent = parts.join(', ');
  c.progress.hidden = job.state !== 'running';
  if (job.progress === undefined) c.progress.removeAttribute('value'); else c.progress.value = job.progress;
  c.why.className = job.problem ? 'problem' : 'why';
  c.why.textContent = job.problem ? (job.problem.detail || job.problem.title) : job.waiting_for ? 'waits for ' + job.waiting_for : '';
  c.picture.alt = job.name + ', as it stands';
  changed(job.id, job.image_version);
}

// The version only rises: what is older than what is shown is ignored.
function changed(id, version) {
  const c = card(id);
  if (version <= c.version) return;
  c.version = version;
  refresh(id, c);
}

async function refresh(id, c) {
  if (c.busy) return;
  c.busy = true;
  try {
    while (c.shown < c.version) {
      const version = c.version;
      const answer = await fetch('/v1/jobs/' + id + '/image.png', { headers: headers(c.etag ? { 'If-None-Match': c.etag } : {}), cache: 'no-store' });
      if (answer.status === 200) {
        const url = URL.createObjectURL(await answer.blob());
        await new Promise((done) => { c.picture.onload = c.picture.onerror = done; c.picture.src = url; });
        if (c.url) URL.revokeObjectURL(c.url);
        c.url = url;
        c.etag = answer.headers.get('ETag');
        c.picture.hidden = false;
      } else if (answer.status !== 304) {
        break;
      }
      c.shown = version;
      await new Promise((done) => setTimeout(done, 300));
    }
  } catch (error) {
    // The next event tries again.
  } finally {
    c.busy = false;
  }
}

function take(text) {
  let data = '';
  for (const line of text.split('\n')) {
    if (line.startsWith('data:')) data += line.slice(5).trimStart();
  }
  if (!data) return;
  const event = JSON.parse(data);
  if (event.event === 'job') show(event.job);
  else if (event.event === 'image') changed(event.job, event.image_version);
  else if (event.event === 'deleted') {
    cards.get(event.job)?.box.remove();
    cards.delete(event.job);
  }
}

// EventSource cannot send a token, so the stream is read by hand.
async function follow() {
  for (;;) {
    try {
      const answer = await fetch('/v1/events', { headers: headers({ Accept: 'text/event-stream' }), cache: 'no-store' });
      if (answer.status === 401 || answer.status === 403) {
        login.hidden = false;
        link.textContent = token ? 'this token may not watch' : 'a token is needed';
        return;
      }
      if (!answer.ok) throw new Error(answer.statusText);
      failures = 0;
      login.hidden = true;
      link.textContent = 'live';
      link.className = '';
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let rest = '';
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        const blocks = (rest + value).split('\n\n');
        rest = blocks.pop();
        blocks.forEach(take);
      }
    } catch (error) {
      failures += 1;
    }
    link.textContent = 'connection lost, trying again';
    link.className = 'lost';
    await new Promise((done) => setTimeout(done, Math.min(10000, 500 * 2 ** failures)));
  }
}

login.addEventListener('submit', (event) => {
  event.preventDefault();
  token = document.getElementById('token').value.trim();
  sessionStorage.setItem('brolly-token', token);
  login.hidden = true;
  follow();
});

follow();
