// The live page: state in by server-sent events, words and plots out. It loads nothing but its own files.
'use strict';
(() => {
  const $ = id => document.getElementById(id);
  const token = new URLSearchParams(location.search).get('token');
  const query = token ? '?token=' + encodeURIComponent(token) : '';
  const make = (name, attributes, ...children) => {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes || {})) element.setAttribute(key, value);
    element.append(...children);
    return element;
  };
  const pretty = text => text.replaceAll('^2', '²').replaceAll('^3', '³');
  const set = (element, text) => { if (element.textContent !== text) element.textContent = text; };
  const color = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  let run = null;        // the whole state, with what came since
  let cards = [];        // of the quantities, in their order
  let joints = [];       // plots of the signals
  let heard = 0;         // when the last event came
  let span = 0;          // seconds shown, 0 for all
  let dirty = false;

  // ---- plots

  const inView = new IntersectionObserver(entries => {
    for (const entry of entries) entry.target.plot.visible = entry.isIntersecting;
    paint();
  }, { rootMargin: '200px' });

  function marks(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.strokeStyle = color('--orange');
    ctx.setLineDash([4, 4]);
    for (const t of run.view.changes) {
      const x = Math.round(u.valToPos(t, 'x', true));
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }

  const tick = value => {
    if (value === 0) return '0';
    const size = Math.abs(value);
    if (size >= 1e5 || size < 1e-3) return value.toExponential(1).replace('e+', 'e');
    return String(+value.toPrecision(6));
  };

  class Plot {
    constructor(element, options) {
      this.element = element;
      this.options = options;
      this.visible = false;
      this.dirty = true;
      element.plot = this;
      inView.observe(element);
    }

    build(data) {
      if (this.u) this.u.destroy();
      const axis = { stroke: color('--soft'), grid: { stroke: color('--line'), width: 1 }, ticks: { show: false }, font: '12px system-ui,sans-serif' };
      const seconds = (u, values) => values.map(v => +v.toFixed(3) + (v === values[values.length - 1] ? ' s' : ''));
      this.u = new uPlot({
        width: this.element.clientWidth,
        height: this.element.clientHeight,
        legend: { show: false },
        cursor: { y: false, drag: { x: true, y: false }, points: { size: 6 }, sync: { key: this.options.sync } },
        scales: { x: { time: false }, y: { range: this.options.range } },
        axes: [{ ...axis, size: 26, space: 70, values: seconds }, { ...axis, size: (u, values) => 14 + 7 * Math.max(3, ...(values || []).map(text => text.length)), space: 19, values: (u, values) => values.map(tick) }],
        series: [{}, ...this.options.series()],
        bands: this.options.bands ? [{ series: [2, 1], fill: color('--band') }] : [],
        hooks: { drawClear: [marks, u => this.options.under?.(u)], setCursor: [u => this.options.hover(u.cursor.idx)] },
      }, data, this.element);
    }

    draw() {
      if (!this.visible || !this.dirty || !this.element.clientWidth) return;
      this.dirty = false;
      const data = this.options.data();
      if (this.u) this.u.setData(data);
      else this.build(data);
    }

    forget() {
      inView.unobserve(this.element);
      if (this.u) this.u.destroy();
    }
  }

  const plots = () => [...cards.filter(c => c.derived), ...cards.filter(c => !c.derived)].map(card => card.plot).concat(joints);

  function shown(points) {
    if (!span || !points.length) return points;
    const from = points[points.length - 1].t - span;
    return points.slice(points.findIndex(point => point.t >= from));
  }

  // What is known sets the scale: the first blocks know nothing, and would hide all that follows.
  function valueRange(index) {
    const points = shown(run.points);
    const known = points.filter(p => p.s[index] !== null && 3 * p.s[index] < 0.05 * Math.abs(p.v[index]));
    const all = known.length ? known : points.slice(-Math.ceil(points.length / 2));
    let low = Infinity, high = -Infinity;
    const take = v => { if (v !== null && v !== undefined) { low = Math.min(low, v); high = Math.max(high, v); } };
    for (const p of all) {
      take(p.v[index]);
      if (known.length) { take(p.v[index] - 2 * p.s[index]); take(p.v[index] + 2 * p.s[index]); }
    }
    for (const p of points) take(p.w[index]);
    if (low > high) return [0, 1];
    const margin = Math.max((high - low) * 0.15, Math.abs(high) * 1e-4, 1e-12);
    [low, high] = [low - margin, high + margin];
    // A bound that is near is shown; far ones would make everything else flat.
    const near = bounds(index).filter(b => b > low - 0.3 * (high - low) && b < high + 0.3 * (high - low));
    const edge = 0.04 * (high - low);
    return [Math.min(low, ...near.map(b => b - edge)), Math.max(high, ...near.map(b => b + edge))];
  }

  const bounds = index => [run.quantities[index].lower, run.quantities[index].upper].filter(b => b !== null);

  function boundLines(u, index) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.strokeStyle = color('--soft');
    ctx.lineWidth = 1.5 * devicePixelRatio;
    ctx.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
    for (const bound of bounds(index)) {
      const y = Math.round(u.valToPos(bound, 'y', true));
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  function valuePlot(element, index) {
    const header = element.parentElement.querySelector('.meaning');
    return new Plot(element, {
      sync: 'values',
      bands: true,
      range: () => valueRange(index),
      under: u => boundLines(u, index),
      series: () => [
        { width: 0, points: { show: false } },
        { width: 0, points: { show: false } },
        { stroke: color('--blue'), width: 1.8, points: { show: run.points.length < 40, size: 4, fill: color('--blue') } },
        { stroke: color('--ink'), width: 1.2, dash: [6, 4], points: { show: false } },
      ],
      data: () => {
        const points = shown(run.points);
        const value = p => p.v[index];
        const off = (p, k) => p.s[index] === null || p.v[index] === null ? null : p.v[index] + k * p.s[index];
        return [points.map(p => p.t), points.map(p => off(p, -2)), points.map(p => off(p, 2)), points.map(value), points.map(p => p.w[index] ?? null)];
      },
      hover: at => {
        const p = at === null || at === undefined ? null : shown(run.points)[at];
        const text = p && p.v[index] !== null ? `${p.t.toFixed(3)} s: ${+p.v[index].toPrecision(6)}` + (p.s[index] === null ? '' : ` ± ${+p.s[index].toPrecision(2)}`) : pretty(run.quantities[index].meaning);
        set(header, text);
      },
    });
  }

  function signalPlot(element, columns, header, unit) {
    const rest = header.textContent;
    return new Plot(element, {
      sync: 'signals',
      range: (u, low, high) => {
        if (low === null || high === null) return [0, 1];
        const margin = Math.max((high - low) * 0.08, Math.abs(high) * 1e-4, 1e-9);
        return [low - margin, high + margin];
      },
      series: () => columns.map((column, n) => n === 0
        ? { stroke: color('--blue'), width: 1.6, points: { show: false } }
        : { stroke: color('--orange'), width: 1.2, dash: [5, 3], points: { show: false } }),
      data: () => [0, ...columns].map(column => run.signals.map(row => row[column])),
      hover: at => {
        const row = at === null || at === undefined ? null : run.signals[at];
        set(header, row ? `${row[0].toFixed(3)} s: ` + columns.map(c => row[c] === null ? '–' : +row[c].toPrecision(5)).join(', ') + ' ' + unit : rest);
      },
    });
  }

  // ---- what there is to show

  function build() {
    for (const plot of plots()) plot.forget();
    const { about, quantities } = run;
    document.title = `${about.robot} – thetabus`;
    set($('about'), `${about.robot} · ${about.model.replaceAll('_', ' ')} · domain ${about.domain}`);
    const control = run.control && token;
    $('control').hidden = !control;
    cards = quantities.map((quantity, index) => {
      const row = run.view.rows[index];
      const note = make('small'), value = make('p', { class: 'value' }), plot = make('div', { class: 'plot' });
      const card = make('article', { class: 'card', 'data-name': quantity.name },
        make('h3', {}, quantity.name, note), value, make('p', { class: 'meaning', title: pretty(quantity.meaning) }, pretty(quantity.meaning) || ' '), plot);
      const entry = { card, note, value };
      if (control && !row.derived) {
        entry.input = make('input', { type: 'number', step: 'any', placeholder: 'at its estimate', 'aria-label': `value to fix ${quantity.name} at` });
        entry.button = make('button', { type: 'submit' }, 'Fix');
        const form = make('form', {}, entry.input, entry.button);
        form.addEventListener('submit', event => {
          event.preventDefault();
          const fixed = run.view.rows[index].fixed;
          const at = entry.input.value === '' ? undefined : Number(entry.input.value);
          send(fixed ? { command: 'free', name: quantity.name } : { command: 'fix', name: quantity.name, value: at });
        });
        card.append(form);
      }
      entry.plot = null;
      entry.place = plot;
      entry.derived = row.derived;
      return entry;
    });
    const ordered = [...cards.filter(c => c.derived), ...cards.filter(c => !c.derived)];
    $('values').replaceChildren(...ordered.map(c => c.card));
    cards.forEach((card, index) => { card.plot = valuePlot(card.place, index); });
    $('signals').replaceChildren();
    joints = [];
    for (let joint = 0; joint < about.joints; joint++) {
      const at = 1 + 4 * joint;
      for (const [title, columns, unit, words] of [
        ['position', [at, at + 1], about.position_unit, 'line: position, dashed: setpoint'],
        run.predicts
          ? ['input', [at + 2, at + 3], about.input_unit, 'line: measured, dashed: predicted']
          : ['input', [at + 2], about.input_unit, 'measured'],
      ]) {
        const plot = make('div', { class: 'plot' }), header = make('p', { class: 'meaning' }, words);
        $('signals').append(make('article', { class: 'card' }, make('h3', {}, `joint ${joint + 1}, ${title}`, make('small', {}, unit)), header, plot));
        joints.push(signalPlot(plot, columns, header, unit));
      }
    }
    $('signals').parentElement.hidden = !run.signals.length;
    document.body.dataset.ready = 'yes';
  }

  const arrows = { unknown: '', steady: '→', rising: '↑', falling: '↓' };
  const known = row => row.std !== null && 3 * row.std < Math.abs(row.value);
  const note = row => row.fixed ? ['fixed', 'wait'] : row.usable ? ['usable', 'good'] : row.value === null ? ['', ''] : row.excited || known(row) ? ['uncertain', 'warn'] : ['not excited', 'warn'];

  function words() {
    const view = run.view;
    set($('headline'), view.headline);
    set($('words'), view.lacks ? `${view.words}. The model lacks something: ${view.lacks}` : view.words);
    const truth = run.points.length && run.points[run.points.length - 1].w.length;
    set($('legend'), 'Line: estimate. Band: ± 2 standard deviations. Vertical: a change that was found.' + (truth ? ' Dashed: what the simulator really has.' : '') +
      (run.quantities.some((_, index) => bounds(index).length) ? ' Dotted: a bound, if it is near.' : ''));
    const state = $('state');
    state.className = `pill ${view.health}` + (view.alive ? ' live' : '');
    set(state.lastElementChild, view.alive || view.state === 'ended' ? view.state.replaceAll('_', ' ') : 'no identifier');
    const facts = [
      [view.usable + ' of ' + view.parameters, 'usable'],
      [view.block, view.t_s === null ? 'blocks' : `blocks, ${view.t_s.toFixed(2)} s`],
      [view.samples_per_s === null ? '–' : Math.round(view.samples_per_s), 'samples/s'],
      [view.missing, 'missing'],
      [view.rejected, 'rejected'],
      [view.changes.length, view.changes.length === 1 ? 'change' : 'changes'],
    ];
    $('facts').replaceChildren(...facts.map(([value, what]) => make('li', {}, make('b', {}, String(value)), ' ' + what)));
    view.rows.forEach((row, index) => {
      const card = cards[index];
      if (!card) return;
      card.card.dataset.value = row.value;
      card.card.dataset.std = row.std;
      card.card.dataset.block = view.block;
      card.card.classList.toggle('unsure', !row.usable && !row.fixed);
      const unit = row.unit ? ' ' + row.unit : '';
      card.value.replaceChildren(row.value_text, make('i', {}, (row.std_text ? ` ± ${row.std_text}` : '') + unit + ' ' + arrows[row.trend]));
      const [text, kind] = note(row);
      set(card.note, text);
      card.note.className = kind;
      if (card.button) {
        set(card.button, row.fixed ? 'Free' : 'Fix');
        card.input.hidden = row.fixed;
      }
    });
    const number = (v, digits) => v === null ? '–' : v.toFixed(digits);
    const time = us => us === null ? '–' : us < 1e4 ? number(us, us < 100 ? 1 : 0) + ' µs' : us < 1e7 ? number(us / 1e3, us < 1e5 ? 1 : 0) + ' ms' : number(us / 1e6, 1) + ' s';
    const times = t => `${time(t.mean_us)} on average, ${time(t.p99_us)} at the 99th percentile, ${time(t.max_us)} at most`;
    const health = [
      ['last heartbeat', view.heartbeat_s === null ? 'none' : number(view.heartbeat_s, 1) + ' s ago'],
      ['fit of each equation (1 if it fits)', view.fit.map(f => number(f, 2)).join(', ') || '–'],
      ['probability of such residuals', view.fit_probability === null ? '–' : view.fit_probability.toPrecision(2)],
      ['time for a sample', times(view.step)],
      ['time for a block', times(view.block_step)],
      ['samples accepted', String(view.accepted)],
      ['blocks without an estimate', String(view.lost_estimates)],
      ['memory, process', view.resident_bytes ? (view.resident_bytes / 1048576).toFixed(1) + ' MiB, ' + view.pid : '–'],
      ['last error', view.error || 'none'],
    ];
    const list = $('health');
    if (list.children.length !== health.length) list.replaceChildren(...health.map(([name]) => make('div', {}, make('dt', {}, name), make('dd'))));
    health.forEach(([, text], n) => set(list.children[n].lastElementChild, text));
    for (const button of $('control').querySelectorAll('button')) {
      const command = button.dataset.command;
      button.disabled = !view.alive || (command === 'pause' && view.paused) || (command === 'resume' && !view.paused);
    }
  }

  function paint() {
    if (dirty) return;
    dirty = true;
    requestAnimationFrame(() => {
      dirty = false;
      if (!run) return;
      for (const plot of plots()) plot.draw();
    });
  }

  function stale() {
    for (const plot of plots()) plot.dirty = true;
    paint();
  }

  function rebuild() {
    for (const plot of plots()) if (plot.u) { plot.u.destroy(); plot.u = null; }
    stale();
  }

  // ---- events in

  function alive() {
    heard = Date.now();
    $('gone').hidden = true;
  }

  function whole(data) {
    const kind = state => JSON.stringify([state.about, state.quantities, state.control]);
    const same = run && kind(run) === kind(data);
    run = data;
    if (!same) build();
    words();
    stale();
    // What is on the first screen is drawn at once.
    if (!same) for (const plot of plots().slice(0, 6)) { plot.visible = true; plot.draw(); }
  }

  function update(data) {
    if (!run) return;
    run.view = data.view;
    const last = run.points.length ? run.points[run.points.length - 1].b : 0;
    const fresh = data.points.filter(p => p.b > last);
    run.points.push(...fresh);
    // As the server does: the older half becomes thinner.
    while (run.points.length > run.limit) {
      const half = run.points.length >> 1;
      run.points = run.points.filter((p, n) => n >= half || n % 2 === 0);
    }
    const time = run.signals.length ? run.signals[run.signals.length - 1][0] : -1;
    const rows = data.signals.filter(row => row[0] > time);
    run.signals.push(...rows);
    if (run.signals.length) {
      const from = run.signals[run.signals.length - 1][0] - 10;
      while (run.signals[0][0] < from) run.signals.shift();
    }
    $('signals').parentElement.hidden = !run.signals.length;
    words();
    if (fresh.length) for (const card of cards) card.plot.dirty = true;
    if (rows.length) for (const plot of joints) plot.dirty = true;
    if (fresh.length || rows.length) paint();
  }

  let source = null;
  function connect() {
    source = new EventSource('events' + query);
    source.addEventListener('whole', event => { alive(); whole(JSON.parse(event.data)); });
    source.addEventListener('update', event => { alive(); update(JSON.parse(event.data)); });
  }
  // The page comes with the state as it was then.
  const first = $('first');
  if (first) { alive(); whole(JSON.parse(first.textContent)); }
  connect();

  setInterval(() => {
    const silent = (Date.now() - heard) / 1000;
    if (!heard || silent < 3) return;
    $('gone').hidden = false;
    set($('gone'), `The monitor has been silent for ${silent.toFixed(0)} s: it has ended, or the connection is lost. These are its last values.`);
    const state = $('state');
    state.className = 'pill bad';
    set(state.lastElementChild, 'no monitor');
    if (source.readyState === EventSource.CLOSED) connect();
  }, 1000);

  // ---- commands out

  async function send(command) {
    set($('answer'), '…');
    try {
      const reply = await fetch('control' + query, { method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(command) });
      set($('answer'), (await reply.text()).trim());
    } catch (error) {
      set($('answer'), 'no answer from the monitor');
    }
  }

  $('control').addEventListener('click', event => {
    const command = event.target.closest('button')?.dataset.command;
    if (!command) return;
    if (command === 'reset' && !confirm('Reset: forget everything learned and go back to the start values?')) return;
    send({ command });
  });

  $('window').addEventListener('change', event => {
    span = Number(event.target.value);
    stale();
  });

  document.addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches('input:not([type=radio])')) return;
    const button = { p: 'pause', r: 'resume' }[event.key];
    if (button && !$('control').hidden) $('control').querySelector(`[data-command=${button}]`).click();
    const radio = { 1: 0, 2: 1, 3: 2 }[event.key];
    if (radio !== undefined) $('window').querySelectorAll('input')[radio].click();
  });

  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', rebuild);
  let width = innerWidth;
  addEventListener('resize', () => {
    if (innerWidth === width) return;
    width = innerWidth;
    rebuild();
  });
})();
