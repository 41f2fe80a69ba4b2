"use strict";
// Shifts the reference of a bench record by hand: panels over time with one cursor and one window, and residuals.
(() => {
  const box = document.getElementById("shift"), source = document.getElementById("shift-data");
  if (!box || !source) return;
  const given = JSON.parse(source.textContent), all = given.panels, whole = given.view;

  // Numbers

  const minus = (text) => text.replace("-", "−");
  const number = (v, digits) => v === null || !Number.isFinite(v) ? "–" : minus(v.toPrecision(digits)).replace(/e\+?/, "·10^");
  const between = ({ t, y }, at) => {
    if (t.length < 2 || at < t[0] || at > t[t.length - 1]) return null;
    let low = 0, high = t.length - 1;
    while (high - low > 1) { const mid = low + high >> 1; if (t[mid] <= at) low = mid; else high = mid; }
    return y[low] + (at - t[low]) / (t[high] - t[low]) * (y[high] - y[low]);
  };
  // Cubic through the four nearest values of the record, computed on squares, which are smooth at the minimum.
  const residual = ({ shifts }, ms) => {
    const at = (ms - shifts.from_ms) / shifts.step_ms, last = shifts.rms.length - 1;
    if (!(at >= -1e-9 && at <= last + 1e-9) || last < 3) return null;
    const first = Math.min(Math.max(Math.floor(at) - 1, 0), last - 3);
    let sum = 0;
    for (let i = 0; i < 4; i++) {
      let weight = 1;
      for (let j = 0; j < 4; j++) if (j !== i) weight *= (at - first - j) / (i - j);
      sum += weight * shifts.rms[first + i] ** 2;
    }
    return Math.sqrt(Math.max(sum, 0));
  };
  const least = ({ shifts }) => {
    const square = shifts.rms.map((v) => v * v), i = square.indexOf(Math.min(...square));
    const [a, b, c] = [square[i - 1], square[i], square[i + 1]], bend = a - 2 * b + c;
    return shifts.from_ms + shifts.step_ms * (i + (bend > 0 ? 0.5 * (a - c) / bend : 0));
  };

  // Frame

  const make = (name, parent, text, cls) => {
    const element = document.createElement(name);
    if (text) element.textContent = text;
    if (cls) element.className = cls;
    parent.append(element);
    return element;
  };
  const button = (parent, words, action, cls) => {
    const made = make("button", parent, words, cls);
    made.type = "button";
    made.addEventListener("click", () => action(made));
    return made;
  };
  const bar = make("div", box, "", "controls"), row = make("label", make("div", bar, "", "slide"), "Reference late by ");
  const slider = make("input", row), shown = make("output", row);
  Object.assign(slider, { type: "range", min: -given.reach_ms, max: given.reach_ms, step: 1 });
  slider.setAttribute("list", "shift-found");
  const marks = make("datalist", bar);
  marks.id = "shift-found";
  all.forEach(({ found_ms }) => { if (found_ms !== null) make("option", marks).value = Math.round(found_ms); });
  const visible = [true, true, true];
  ["reference at the true time", "reference, shifted", "measured"].forEach((words, n) => {
    const chip = button(bar, words, () => {
      visible[n] = !visible[n];
      chip.setAttribute("aria-pressed", String(visible[n]));
      plots.forEach((u) => u.setSeries(n + 1, { show: visible[n] }));
    }, ["line-truth", "line-pade_1_1", "line-raw"][n]);
    chip.setAttribute("aria-pressed", "true");
  });
  const middle = () => (view[0] + view[1]) / 2;
  button(bar, "One swing", () => show(middle() - given.period_s / 2, middle() + given.period_s / 2));
  button(bar, "All", () => show(...whole));
  const readout = make("output", bar, "", "readout"), frame = make("div", box, "", "frame");
  const panels = make("div", frame, "", "panels"), table = make("table", make("div", frame, "", "side"));
  panels.tabIndex = 0;
  panels.setAttribute("role", "group");
  panels.setAttribute("aria-label", "Panels over time: plus and minus zoom, arrows move, zero shows all");
  make("caption", table, "Residual: rms over the whole record, and measured − shifted reference at the cursor");
  const head = make("tr", make("thead", table));
  ["Panel", "At this shift", "At the cursor", "Least", "Delay found"].forEach((words, n) => { make("th", head, words, n ? "n" : "").scope = "col"; });
  const body = make("tbody", table);
  const rows = all.map((panel) => {
    const line = make("tr", body), name = make("th", line, panel.name);
    name.scope = "row";
    const [now, there, best, go] = [0, 1, 2, 3].map(() => make("td", line, "", "n"));
    const at = least(panel);
    best.textContent = `${number(residual(panel, at), 3)} ${panel.unit} at ${minus(String(Math.round(at) || 0))} ms`;
    if (panel.found_ms !== null) button(go, panel.found, () => shift(panel.found_ms)).title = "Shift the reference by it";
    return { now, there };
  });

  // Panels

  const css = (name) => getComputedStyle(box).getPropertyValue(`--${name}`).trim();
  const sync = uPlot.sync("bench"), plots = [];
  let view = whole, late = 0;
  // Every timestamp of a panel has both references. Measured values exist only at their own timestamps.
  const dataOf = ({ reference, measured, gain }) => {
    const inside = reference.t.filter((t) => t >= whole[0] && t <= whole[1]);
    const x = [...new Set([...inside, ...measured.t])].sort((a, b) => a - b), values = new Map(measured.t.map((t, i) => [t, measured.y[i]]));
    const shifted = x.map((t) => { const v = between(reference, t - late / 1e3); return v === null ? null : gain * v; });
    return [x, x.map((t) => between(reference, t)), shifted, x.map((t) => values.get(t) ?? null)];
  };
  const build = () => {
    plots.splice(0).forEach((u) => u.destroy());
    const soft = css("soft"), grid = { stroke: css("line"), width: 1 }, font = "12px system-ui, sans-serif";
    all.forEach((panel, n) => {
      const isLast = n === all.length - 1, axis = { stroke: soft, grid, ticks: grid, font }, none = { points: { show: false }, spanGaps: true };
      const dots = { label: "measured", stroke: css("ink"), paths: () => null, points: { show: true, size: panel.measured.t.length > 400 ? 3 : 5, fill: css("ink"), width: 0 } };
      plots.push(new uPlot({
        width: panels.clientWidth, height: isLast ? 156 : 120, title: `${panel.name} (${panel.unit})`, padding: [8, 30, isLast ? 0 : 6, 0], legend: { show: false },
        scales: { x: { time: false, range: () => view } },
        axes: [{ ...axis, show: isLast, size: isLast ? 36 : 0, values: (u, at) => at.map((v) => `${+v.toFixed(3)} s`) }, { ...axis, size: 64, values: (u, at) => at.map((v) => minus(String(+v.toPrecision(6)))) }],
        cursor: { sync: { key: sync.key }, drag: { x: true, y: false, setScale: false }, points: { size: 6 }, bind: { dblclick: () => () => { show(...whole); return null; } } },
        series: [{}, { ...none, label: "reference", show: visible[0], stroke: css("pen-true"), width: 5 }, { ...none, label: "shifted", show: visible[1], stroke: css("line-pade_1_1"), width: 2, dash: [7, 4] }, { ...dots, show: visible[2] }],
        hooks: {
          setSelect: [(u) => {
            const { left, width } = u.select;
            if (width > 4) show(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          }],
          setCursor: [(u) => { if (u.cursor.left >= 0 && u === plots[0]) point(u.posToVal(u.cursor.left, "x")); }],
        },
      }, dataOf(panel), make("div", panels)));
    });
  };

  // Shift, window, cursor

  function shift(ms) {
    late = Math.min(Math.max(ms, -given.reach_ms), given.reach_ms);
    slider.value = late;
    shown.textContent = `${minus(late.toFixed(late % 1 ? 1 : 0))} ms`;
    plots.forEach((u, n) => u.setData(dataOf(all[n]), true));
    all.forEach((panel, n) => { rows[n].now.textContent = `${number(residual(panel, late), 3)} ${panel.unit}`; });
  }
  function show(from, to) {
    const span = Math.max(to - from, 0.1), start = Math.min(Math.max(from, whole[0]), Math.max(whole[0], whole[1] - span));
    const next = [start, Math.min(start + span, whole[1])];
    if (next[0] === view[0] && next[1] === view[1]) return;
    view = next;
    plots.forEach((u, n) => u.setData(dataOf(all[n]), true));
  }
  function point(t) {
    // Keep this on one line: if it grew, it would move the panels away from under the pointer.
    readout.textContent = `Cursor at ${t.toFixed(3)} s`;
    all.forEach((panel, n) => {
      const measured = between(panel.measured, t), reference = between(panel.reference, t - late / 1e3);
      const differs = measured === null || reference === null ? null : measured - panel.gain * reference;
      rows[n].there.textContent = `${number(differs, 2)} ${panel.unit}`;
    });
  }
  slider.addEventListener("input", () => shift(+slider.value));
  panels.addEventListener("keydown", (event) => {
    const [from, to] = view, span = to - from, centre = middle();
    const moves = { "+": [centre - span / 4, centre + span / 4], "-": [centre - span, centre + span], ArrowLeft: [from - span / 4, to - span / 4], ArrowRight: [from + span / 4, to + span / 4], 0: whole }[event.key];
    if (!moves || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    show(...moves);
  });
  fingers(panels, whole, () => view, show);
  box.hidden = false;
  build();
  shift(all[0].found_ms ?? 0);
  let width = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; build(); } });
  matchMedia("(prefers-color-scheme:dark)").addEventListener("change", build);
  document.getElementById("fig-4")?.classList.add("twin");
  box.bench = { plots, shift, show, residual: (n) => residual(all[n], late), late: () => late, window: () => view, panels: all };
  box.dataset.ready = "yes";
})();
