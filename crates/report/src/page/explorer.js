"use strict";
// Zooms into the rows of a flight: panels over time with one cursor and one window, next to the ground track.
(async () => {
  const box = document.getElementById("explorer"), source = document.getElementById("explorer-data");
  if (!box || !source) return;
  const given = JSON.parse(source.textContent), count = given.rows.rows;

  // Rows

  const bytes = new Uint8Array(await inflated(given.rows.data).arrayBuffer()), column = {};
  given.rows.columns.forEach(({ name, differences }, n) => {
    const plane = bytes.subarray(4 * n * count, 4 * (n + 1) * count), values = new Float64Array(count);
    let last = 0, slope = 0;
    for (let i = 0; i < count; i++) {
      const zigzag = plane[i] | plane[count + i] << 8 | plane[2 * count + i] << 16 | plane[3 * count + i] << 24, step = zigzag >>> 1 ^ -(zigzag & 1);
      if (step === -2147483648) { values[i] = NaN; continue; }
      const value = step + last + (differences === 2 ? slope : 0);
      slope = value - last;
      last = value;
      values[i] = value / (n === 0 ? 1e3 : 1e2);
    }
    column[name] = values;
  });
  const t = column.t, hasTruth = "truth_north" in column, gap = Math.max(given.rows.gap_s, 1e-3) * given.rows.extremes_of;
  const tracks = [["raw", "raw, newest fix held"], ["exact_async", "exact, p + ∫v"], ["pade_1_1", "Padé of the paper"],
    ["truth", "reference"]].filter(([name]) => `${name}_north` in column);
  const rowAt = (at) => {
    let low = 0, high = count - 1;
    while (low < high) { const mid = low + high >> 1; if (t[mid] < at) low = mid + 1; else high = mid; }
    return low > 0 && at - t[low - 1] < t[low] - at ? low - 1 : low;
  };

  // Derived from the rows: velocity from the exact positions, lead of exact over raw along it, errors, turn rate

  const series = () => new Float64Array(count);
  const speed = series(), turn = series(), lead = series(), leadMs = series(), truthLead = series(), truthLeadMs = series(),
    heading = series(), step = series(), errors = {};
  const north = column.exact_async_north, east = column.exact_async_east;
  const slopeOver = (half, of) => {
    for (let i = 0, a = 0, b = 0; i < count; i++) {
      while (t[a] < t[i] - half) a++;
      while (b + 1 < count && t[b + 1] <= t[i] + half) b++;
      of(i, a, b, t[b] - t[a]);
    }
  };
  slopeOver(0.25, (i, a, b, dt) => {
    const vn = (north[b] - north[a]) / dt, ve = (east[b] - east[a]) / dt;
    speed[i] = dt > 0 ? Math.hypot(vn, ve) : NaN;
    const moves = speed[i] > 1;
    heading[i] = moves ? Math.atan2(ve, vn) : NaN;
    // Computed at the first row of each fix and held until the next fix: the age of a held fix is not part of it.
    const isFix = i === 0 || column.raw_north[i] !== column.raw_north[i - 1] || column.raw_east[i] !== column.raw_east[i - 1] || t[i] - t[i - 1] > gap;
    if (!isFix && lead[i - 1] === lead[i - 1]) {
      for (const values of [lead, leadMs, truthLead, truthLeadMs]) values[i] = values[i - 1];
      if (north[i] !== north[i]) lead[i] = leadMs[i] = NaN;
      return;
    }
    const ahead = (n, e) => moves ? ((n - column.raw_north[i]) * vn + (e - column.raw_east[i]) * ve) / speed[i] : NaN;
    lead[i] = ahead(north[i], east[i]);
    leadMs[i] = 1e3 * lead[i] / speed[i];
    if (!hasTruth) return;
    truthLead[i] = ahead(column.truth_north[i], column.truth_east[i]);
    truthLeadMs[i] = 1e3 * truthLead[i] / speed[i];
  });
  slopeOver(0.5, (i, a, b, dt) => {
    const turned = heading[b] - heading[a];
    turn[i] = dt > 0 ? Math.atan2(Math.sin(turned), Math.cos(turned)) / dt * 180 / Math.PI : NaN;
  });
  // Jump of the compensated position when a fix arrives, held until the next fix: the part that was not predicted.
  for (let i = 0, last = NaN; i < count; i++) {
    if (i > 1 && (column.raw_north[i] !== column.raw_north[i - 1] || column.raw_east[i] !== column.raw_east[i - 1])) {
      const share = (t[i] - t[i - 1]) / (t[i - 1] - t[i - 2]), way = (of) => of[i] - of[i - 1] - share * (of[i - 1] - of[i - 2]);
      last = t[i] - t[i - 2] > gap ? NaN : Math.hypot(way(north), way(east));
    }
    step[i] = last;
  }
  if (hasTruth) {
    for (const [name] of tracks) {
      if (name === "truth") continue;
      const [n, e] = [column[`${name}_north`], column[`${name}_east`]];
      errors[name] = n.map((v, i) => Math.hypot(v - column.truth_north[i], e[i] - column.truth_east[i]));
    }
  }

  // Points of interest

  const largest = (of) => {
    let best = -1;
    for (let i = 0; i < count; i++) if (of(i) > (best < 0 ? -Infinity : of(best))) best = i;
    return best;
  };
  const whole = [t[0], t[count - 1]];
  const around = (at, half) => [Math.max(whole[0], at - half), Math.min(whole[1], at + half)];
  const clock = (s) => {
    // Rounded once, so that 59.96 s is 1:00.0 and not 0:60.0.
    const tenths = Math.round(10 * Math.abs(s)), two = (n) => String(n).padStart(2, "0");
    return `${s < 0 ? "−" : ""}${Math.floor(tenths / 36000)}:${two(Math.floor(tenths / 600) % 60)}:${two(Math.floor(tenths / 10) % 60)}.${tenths % 10}`;
  };
  const places = [["The whole flight", whole]], gaps = [], marks = [], presets = [];
  const offer = (name, row, key) => {
    if (row < 0) return;
    const window = around(t[row], 10);
    places.push([`${name}, ${clock(t[row])}`, window]);
    presets.push({ name, key, go: () => show(...window) });
  };
  offer("Hardest turn", largest((i) => Math.abs(turn[i]) * speed[i]), "t");
  if (hasTruth) offer("Largest error", largest((i) => errors.exact_async[i]), "e");
  else offer("Largest jump at a fix", largest((i) => step[i]), "e");
  offer("Largest lead", largest((i) => Math.abs(lead[i])), "l");
  // Ranges with nothing to draw: missing rows, and rows without a compensated position.
  for (let i = 1, begin = -1, started = !Number.isNaN(north[0]); i < count; i++) {
    if (t[i] - t[i - 1] > gap) gaps.push([t[i - 1], t[i], "no rows"]);
    // Before the first compensated position there is no gap.
    if (Number.isNaN(north[i]) && begin < 0 && started) begin = i;
    started ||= !Number.isNaN(north[i]);
    if (begin >= 0 && (!Number.isNaN(north[i]) || i === count - 1)) { gaps.push([t[begin], t[i], "no compensated position"]); begin = -1; }
  }
  const stops = [];
  for (const [from, to, what] of gaps) stops.push([`${what}, ${(to - from).toFixed(1)} s, ${clock(from)}`, around((from + to) / 2, 10 + (to - from) / 2)]);
  stops.sort((a, b) => a[1][0] - b[1][0]);
  const oddities = given.places.map(({ t_s, length_s, kind, what }) => {
    marks.push([t_s, t_s + length_s, kind]);
    return [`${what}, ${clock(t_s)}`, around(t_s + length_s / 2, 10 + length_s / 2)];
  });
  const next = (name, list, key) => {
    if (list.length === 0) return;
    let at = -1;
    presets.push({ name: `Next ${name} (${list.length})`, key, go: () => { at = (at + 1) % list.length; show(...list[at][1]); } });
    places.push(...list.slice(0, 20));
  };
  next("gap", stops, "g");
  next("anomaly", oddities, "a");

  // The frame

  const make = (name, parent, text, cls) => {
    const element = document.createElement(name);
    if (text) element.textContent = text;
    if (cls) element.className = cls;
    parent.append(element);
    return element;
  };
  const bar = make("div", box, "", "controls"), frame = make("div", box, "", "frame");
  const panels = make("div", frame, "", "panels"), side = make("div", frame, "", "side");
  panels.tabIndex = 0;
  panels.setAttribute("role", "group");
  panels.setAttribute("aria-label", "Panels over time: plus and minus zoom, arrows move, zero shows all");
  const choice = make("select", make("label", bar, "Go to "));
  places.forEach(([name], i) => { make("option", choice, name).value = i; });
  choice.addEventListener("change", () => show(...places[choice.value][1]));
  for (const { name, key, go } of presets) {
    const button = make("button", bar, name);
    button.type = "button";
    button.title = `key ${key}`;
    button.addEventListener("click", go);
  }
  const middle = () => (view[0] + view[1]) / 2, half = () => (view[1] - view[0]) / 2;
  for (const [name, words, go] of [["Zoom in", "key +", () => show(middle() - half() / 2, middle() + half() / 2)],
    ["Zoom out", "key −", () => show(middle() - 2 * half(), middle() + 2 * half())], ["All", "key 0", () => show(...whole)]]) {
    const button = make("button", bar, name);
    button.type = "button";
    button.title = words;
    button.addEventListener("click", go);
  }
  const visible = { raw: true, exact_async: true, pade_1_1: false, truth: true };
  for (const [name, words] of tracks) {
    const chip = make("button", bar, words, `line-${name}`);
    chip.type = "button";
    chip.setAttribute("aria-pressed", String(visible[name]));
    chip.addEventListener("click", () => {
      visible[name] = !visible[name];
      chip.setAttribute("aria-pressed", String(visible[name]));
      for (const plot of plots) {
        plot.names.forEach((n, i) => { if (n === name) plot.u.setSeries(i + 1, { show: visible[name] }); });
      }
      drawTrack();
    });
  }
  const readout = make("output", bar, "", "readout"), numbers = make("table", side, "", "window");
  make("caption", numbers, "In this window");
  // The track, with the cursor on a layer above it, so that moving the cursor does not redraw the track.
  const numbersBody = make("tbody", numbers), map = make("div", side, "", "map"), canvas = make("canvas", map), overlay = make("canvas", map);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Ground track, coloured by the lead of the compensated position over raw");
  const key = make("p", side, "", "note");

  // Panels

  const css = (name) => getComputedStyle(box).getPropertyValue(`--${name}`).trim();
  const pens = { raw: { width: 1 }, exact_async: { width: 2 }, pade_1_1: { width: 1.5, dash: [6, 3] }, truth: { width: 1.5, dash: [2, 3] } };
  const ofTracks = (axis) => tracks.map(([name, words]) => [name, words, column[`${name}_${axis}`]]);
  const leads = (ofExact, ofTruth) => [["exact_async", "compensated", ofExact], ...(hasTruth ? [["truth", "reference", ofTruth]] : [])];
  const wanted = [
    { title: "North (m)", series: ofTracks("north") },
    { title: "East (m)", series: ofTracks("east") },
    { title: "Lead over raw along the track, at the first row of each fix (m)", series: leads(lead, truthLead) },
    { title: "Lead over raw at the first row of each fix: delay and wait for that row (ms)", series: leads(leadMs, truthLeadMs) },
  ];
  if (given.delay.length) wanted.push({ title: `Delay against ${given.against}, this pair alone, ± U (ms)${given.removed_ms === null ? "" : "; removed: dashed"}`, series: [], delay: true });
  if (hasTruth) wanted.push({ title: "Error against the reference, 2‑D (m)", series: tracks.filter(([name]) => name in errors).map(([name, words]) => [name, words, errors[name]]) });
  else wanted.push({ title: "Jump of the compensated position at the last fix, with the velocity of that row (m)", series: [["exact_async", "step", step]] });
  wanted.push({ title: "Speed (m/s)", series: [["plain", "speed", speed]] }, { title: "Turn rate (°/s)", series: [["plain", "turn rate", turn]] },
    { title: "Rows; gaps (red), no compensated position (orange), anomalies (rings)", series: [], strip: true });
  const plots = [], sync = uPlot.sync("flight");
  let view = whole, cursorRow = 0;

  // Rows with the minimum and the maximum in blocks of 4, 16, 64, … rows of a series, built at first use.
  const pyramids = new Map();
  const pyramid = (values) => {
    if (pyramids.has(values)) return pyramids.get(values);
    const levels = [];
    let low = null, high = null, length = count;
    while (length > 4) {
      const above = Math.ceil(length / 4), lows = new Int32Array(above).fill(-1), highs = new Int32Array(above).fill(-1);
      for (let i = 0; i < length; i++) {
        const k = i >> 2, l = low ? low[i] : values[i] === values[i] ? i : -1, h = high ? high[i] : l;
        if (l >= 0 && (lows[k] < 0 || values[l] < values[lows[k]])) lows[k] = l;
        if (h >= 0 && (highs[k] < 0 || values[h] > values[highs[k]])) highs[k] = h;
      }
      levels.push({ lows, highs });
      [low, high, length] = [lows, highs, above];
    }
    pyramids.set(values, levels);
    return levels;
  };
  // Rows of the minimum and the maximum from row `a` to row `b` (exclusive); −1 if all values are missing.
  const extremes = (values, a, b) => {
    const levels = pyramid(values);
    let low = -1, high = -1;
    const take = (l, h) => {
      if (l >= 0 && (low < 0 || values[l] < values[low])) low = l;
      if (h >= 0 && (high < 0 || values[h] > values[high])) high = h;
    };
    const row = (i) => { if (values[i] === values[i]) take(i, i); };
    while (a < b) {
      let level = -1, width = 1;
      while (level + 1 < levels.length && a % (4 * width) === 0 && a + 4 * width <= b) { level++; width *= 4; }
      if (level < 0) row(a); else take(levels[level].lows[a / width], levels[level].highs[a / width]);
      a += width;
    }
    return [low, high];
  };
  const gapRows = [];
  for (let i = 1; i < count; i++) if (t[i] - t[i - 1] > gap) gapRows.push(i);
  const firstAt = (at) => {
    let low = 0, high = count;
    while (low < high) { const mid = low + high >> 1; if (t[mid] < at) low = mid + 1; else high = mid; }
    return low;
  };
  // Minimum and maximum of every pixel column in row order, so that a one-row spike shows at every zoom.
  const thinned = (series, [from, to], pixels) => {
    const first = Math.max(0, firstAt(from) - 1), last = Math.min(count, firstAt(to) + 2), width = (to - from) / pixels;
    const x = [], ys = series.map(() => []);
    const close = (a, b) => {
      if (b - a < 3) {
        for (let i = a; i < b; i++) { x.push(t[i]); ys.forEach((y, s) => y.push(Number.isNaN(series[s][i]) ? null : series[s][i])); }
        return;
      }
      x.push(t[a], t[b - 1]);
      ys.forEach((y, s) => {
        const [low, high] = extremes(series[s], a, b);
        if (low < 0) y.push(null, null); else y.push(series[s][Math.min(low, high)], series[s][Math.max(low, high)]);
      });
    };
    let g = gapRows.findIndex((row) => row > first);
    for (let a = first; a < last;) {
      const column = Math.floor((t[a] - from) / width);
      let b = Math.min(last, Math.max(a + 1, firstAt(from + (column + 1) * width)));
      const isGap = g >= 0 && g < gapRows.length && gapRows[g] <= b && gapRows[g] < last;
      if (isGap) b = gapRows[g++];
      if (b > a) close(a, b);
      if (isGap) { x.push((t[b] + t[b - 1]) / 2); ys.forEach((y) => y.push(null)); }
      a = b;
    }
    return [x, ...ys];
  };
  // The delay curve has its own times: its values are inserted between those of the rows.
  const withDelay = (data) => {
    const curve = given.delay;
    const at = (x, k) => {
      if (curve.length === 0 || x < curve[0][0] || x > curve[curve.length - 1][0]) return null;
      let i = 1;
      while (i < curve.length - 1 && curve[i][0] < x) i++;
      if (curve.length === 1) return curve[0][1] + k * curve[0][2];
      const [a, b] = [curve[i - 1], curve[i]], share = b[0] > a[0] ? (x - a[0]) / (b[0] - a[0]) : 0;
      return a[1] + k * a[2] + share * (b[1] + k * b[2] - a[1] - k * a[2]);
    };
    return [...data, data[0].map((x) => at(x, 0)), data[0].map((x) => at(x, -1)), data[0].map((x) => at(x, 1)), data[0].map(() => given.removed_ms)];
  };
  const dataOf = (plot) => {
    if (plot.strip) return [view, [0, 0]];
    const data = thinned(plot.series, view, Math.max(100, plot.width * devicePixelRatio));
    return plot.delay ? withDelay(data) : data;
  };
  const build = () => {
    plots.splice(0).forEach((plot) => plot.u.destroy());
    const width = panels.clientWidth, ink = css("ink"), soft = css("soft"), grid = { stroke: css("line"), width: 1 };
    wanted.forEach(({ title, series, delay, strip }, n) => {
      const isLast = n === wanted.length - 1, names = series.map(([name]) => name);
      const plot = { names, series: series.map(([, , values]) => values), delay, strip, width: width - 80 };
      const lines = series.map(([name, label]) => ({
        label, show: visible[name] !== false, stroke: name === "plain" ? ink : css(`line-${name}`), ...(pens[name] || { width: 1 }), points: { show: false },
      }));
      const bands = [], none = { points: { show: false }, value: () => "" };
      if (strip) lines.push({ ...none, stroke: "transparent" });
      if (delay) {
        const n = lines.length + 1, edge = { ...none, width: 0, stroke: "transparent" };
        lines.push({ ...none, stroke: css("line-truth"), width: 2 }, edge, { ...edge }, { ...none, stroke: css("line-pade_1_1"), width: 1, dash: [6, 3] });
        bands.push({ series: [n + 2, n + 1], fill: css("band-truth") });
      }
      const font = "12px system-ui, sans-serif", axis = { stroke: soft, grid, ticks: grid, font };
      plot.u = new uPlot({
        width, height: strip ? 96 : n < 2 ? 190 : 140, title, padding: [8, 30, isLast ? 0 : 6, 0], bands, legend: { show: false },
        scales: { x: { time: false, range: () => view } },
        axes: [{ ...axis, show: isLast, size: isLast ? 36 : 0, values: (u, at) => at.map((v) => v == null ? "" : clock(v)), space: 90 }, { ...axis, size: 64, values: (u, at) => at.map((v) => String(+v.toPrecision(6)).replace("-", "−")), ...(strip && { values: () => [], grid: { show: false }, ticks: { show: false } }) }],
        cursor: { sync: { key: sync.key }, drag: { x: true, y: false, setScale: false }, points: { size: 6 }, bind: { dblclick: () => () => { show(...whole); return null; }, mousedown: (u, target, zoom) => (event) => event.shiftKey ? pan(u, event) : zoom(event) } },
        series: [{}, ...lines],
        hooks: {
          setSelect: [(u) => {
            const { left, width: w } = u.select;
            if (w > 4) show(u.posToVal(left, "x"), u.posToVal(left + w, "x"));
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          }],
          draw: strip ? [drawStrip] : [],
          setCursor: [(u) => { if (u.cursor.left >= 0 && plots[0] && u === plots[0].u) point(rowAt(u.posToVal(u.cursor.left, "x"))); }],
        },
      }, dataOf(plot), make("div", panels));
      plots.push(plot);
    });
  };

  function drawStrip(u) {
    const { ctx, bbox: { left, top, width, height } } = u, x = (at) => Math.min(left + width, Math.max(left, u.valToPos(at, "x", true)));
    const bar = (from, to, colour, least) => {
      if (to < view[0] || from > view[1]) return;
      ctx.fillStyle = colour;
      ctx.fillRect(x(from), top + 0.3 * height, Math.max(least, x(to) - x(from)), 0.4 * height);
    };
    bar(...whole, css("pen-bars"), 1);
    for (const [from, to, what] of gaps) bar(from, to, css(what === "no rows" ? "pen-mark" : "span"), 2 * devicePixelRatio);
    ctx.strokeStyle = css("pen-mark");
    ctx.lineWidth = 2 * devicePixelRatio;
    for (const [from] of marks) {
      if (from < view[0] || from > view[1]) continue;
      ctx.beginPath();
      ctx.arc(x(from), top + 0.5 * height, 4 * devicePixelRatio, 0, 7);
      ctx.stroke();
    }
  }

  // Window and cursor

  function pan(u, event) {
    const { clientX } = event, [a, b] = view, perPixel = (b - a) / u.over.clientWidth;
    const move = (e) => {
      const by = Math.max(whole[0] - a, Math.min(whole[1] - b, (clientX - e.clientX) * perPixel));
      show(a + by, b + by);
    };
    document.addEventListener("mousemove", move);
    document.addEventListener("mouseup", () => document.removeEventListener("mousemove", move), { once: true });
  }
  function show(from, to) {
    const least = Math.max(4 * (whole[1] - whole[0]) / count, 0.05);
    let [a, b] = [Math.min(from, to), Math.max(from, to)];
    if (b - a < least) [a, b] = [(a + b - least) / 2, (a + b + least) / 2];
    if (Math.abs(a - view[0]) + Math.abs(b - view[1]) < 1e-9) return;
    choice.selectedIndex = places.findIndex(([, [c, d]]) => Math.abs(a - c) + Math.abs(b - d) < 1e-6);
    view = [Math.max(whole[0], a), Math.min(whole[1], b)];
    refresh();
  }
  function refresh() {
    plots.forEach((plot) => plot.u.setData(dataOf(plot), true));
    tell();
    drawTrack();
  }
  function point(row) {
    cursorRow = row;
    const fixed = (v, digits, unit) => Number.isNaN(v) ? "–" : `${v.toFixed(digits)} ${unit}`;
    readout.textContent = `${clock(t[row])}: lead ${fixed(lead[row], 2, "m")}, ${fixed(leadMs[row], 0, "ms")}; speed ${fixed(speed[row], 1, "m/s")}`
      + (hasTruth ? `; error raw ${fixed(errors.raw[row], 2, "m")}, exact ${fixed(errors.exact_async[row], 2, "m")}` : "");
    drawCursor();
  }
  // Count, sum and sum of squares of the values up to each block of 256 rows, for statistics of a window without a scan.
  const sums = new Map();
  const sumsOf = (values) => {
    if (sums.has(values)) return sums.get(values);
    const blocks = (count >> 8) + 1, upTo = new Float64Array(3 * (blocks + 1));
    for (let i = 0; i < count; i++) {
      const v = values[i], k = 3 * ((i >> 8) + 1);
      if (v === v) { upTo[k]++; upTo[k + 1] += v; upTo[k + 2] += v * v; }
    }
    for (let k = 3; k < upTo.length; k++) upTo[k] += upTo[k - 3];
    sums.set(values, upTo);
    return upTo;
  };
  const over = (values) => {
    const a = rowAt(view[0]), b = rowAt(view[1]) + 1, upTo = sumsOf(values), first = (a + 255) >> 8, last = Math.max(first, b >> 8);
    let [n, sum, squares] = [0, 1, 2].map((k) => upTo[3 * last + k] - upTo[3 * first + k]);
    const add = (from, to) => {
      for (let i = from; i < to; i++) { const v = values[i]; if (v === v) { n++; sum += v; squares += v * v; } }
    };
    add(a, Math.min(b, first << 8));
    if (b > first << 8) add(last << 8, b);
    const [low, high] = extremes(values, a, b);
    return { n, mean: sum / n, rms: Math.sqrt(squares / n), most: low < 0 ? NaN : Math.max(-values[low], values[high]) };
  };
  function tell() {
    const rows = rowAt(view[1]) - rowAt(view[0]) + 1, say = (v, digits, unit) => Number.isFinite(v) ? v.toFixed(digits).replace("-", "−") + (unit ? `\u00a0${unit}` : "") : "–";
    const [ofSpeed, ofTurn, ofLead] = [speed, turn, lead].map(over);
    const lines = [["From, to", `${clock(view[0])} – ${clock(view[1])}`], ["Rows with a compensated position", `${over(north).n} of ${rows}`],
      ["Speed, mean and most", `${say(ofSpeed.mean, 1)}, ${say(ofSpeed.most, 1, "m/s")}`], ["Turn rate, most", say(ofTurn.most, 1, "°/s")],
      ["Lead over raw, rms and most", `${say(ofLead.rms, 2)}, ${say(ofLead.most, 2, "m")}`], ["Lead over raw, mean: delay and wait for the next row", say(over(leadMs).mean, 0, "ms")]];
    if (hasTruth) lines.push(["Lead of the reference over raw, mean: the same", say(over(truthLeadMs).mean, 0, "ms")]);
    for (const [name, words] of tracks) {
      if (!(name in errors)) continue;
      const error = over(errors[name]);
      lines.push([`Error, ${words}, rms and most`, `${say(error.rms, 3)}, ${say(error.most, 2, "m")}`]);
    }
    if (!hasTruth) lines.push(["Jump at a fix with the velocity of that row, rms and most", `${say(over(step).rms, 2)}, ${say(over(step).most, 2, "m")}`]);
    numbersBody.replaceChildren();
    for (const [name, value] of lines) {
      const row = make("tr", numbersBody), head = make("th", row, name);
      head.scope = "row";
      make("td", row, value, "n");
    }
  }

  // Ground track

  const levels = 5, colourOf = (k) => css(`lead-${k}`);
  const sorted = Float64Array.from(lead.filter((v) => v === v).map(Math.abs)).sort();
  const quantile = (share) => sorted[Math.floor(share * (sorted.length - 1))] || 0;
  const fullLead = Math.max(quantile(0.98), 1e-3), leastLead = Math.min(quantile(0.02), 0.98 * fullLead);
  key.textContent = "Colour: lead over raw. Thin grey: raw, in windows below 3 min; below 1 min a line each second joins the two. Pale: outside of the window.";
  const niceStep = (span) => { const p = 10 ** Math.floor(Math.log10(span)); return [1, 2, 5, 10].map((k) => k * p).filter((v) => v <= span).pop() || p; };
  let place = null;
  function drawTrack() {
    const size = Math.max(200, Math.floor(side.clientWidth)), dpr = devicePixelRatio, g = canvas.getContext("2d");
    for (const layer of [canvas, overlay]) {
      layer.width = layer.height = size * dpr;
      layer.style.width = layer.style.height = `${size}px`;
    }
    g.scale(dpr, dpr);
    const isWhole = view[0] <= whole[0] && view[1] >= whole[1], [first, last] = [rowAt(view[0]), rowAt(view[1])];
    let [n0, n1, e0, e1] = [Infinity, -Infinity, Infinity, -Infinity];
    for (let i = first; i <= last; i++) {
      if (north[i] !== north[i]) continue;
      n0 = Math.min(n0, north[i]); n1 = Math.max(n1, north[i]); e0 = Math.min(e0, east[i]); e1 = Math.max(e1, east[i]);
    }
    if (!(n1 >= n0)) { place = null; return; }
    const span = Math.max(n1 - n0, e1 - e0, 1) * 1.1, scale = (size - 30) / span, [nc, ec] = [(n0 + n1) / 2, (e0 + e1) / 2];
    place = (n, e) => [size / 2 + (e - ec) * scale, size / 2 - (n - nc) * scale];
    const stroke = (rows, colour, width, ns, es) => {
      g.strokeStyle = colour;
      g.lineWidth = width;
      g.beginPath();
      let pen = false;
      for (const i of rows) {
        if (i < 0 || ns[i] !== ns[i]) { pen = false; continue; }
        const [x, y] = place(ns[i], es[i]);
        if (pen) g.lineTo(x, y); else g.moveTo(x, y);
        pen = true;
      }
      g.stroke();
    };
    const every = (from, to, most) => {
      const step = Math.max(1, Math.floor((to - from) / most)), rows = [];
      for (let i = from; i <= to; i += step) { if (i > from && t[i] - t[Math.max(from, i - step)] > gap * step) rows.push(-1); rows.push(i); }
      return rows;
    };
    if (!isWhole) stroke(every(0, count - 1, 8000), css("line"), 1.5, north, east);
    if (visible.raw && view[1] - view[0] < 180) stroke(every(first, last, 20000), css("line-raw"), 1, column.raw_north, column.raw_east);
    const rows = every(first, last, 12000), bins = Array.from({ length: levels }, () => []);
    for (let k = 1; k < rows.length; k++) {
      const i = rows[k];
      if (i < 0 || rows[k - 1] < 0) continue;
      const share = (Math.abs(lead[i]) - leastLead) / (fullLead - leastLead), bin = share !== share ? 0 : Math.max(0, Math.min(levels - 1, Math.floor(share * levels)));
      bins[bin].push(rows[k - 1], i, -1);
    }
    bins.forEach((of, k) => stroke(of, colourOf(k), 2.5, north, east));
    // In a short window, draw a line each second from raw to compensated: the delay as a length.
    if (view[1] - view[0] <= 60) {
      for (let s = Math.ceil(view[0]); s <= view[1]; s++) {
        const i = rowAt(s);
        if (north[i] !== north[i]) continue;
        const [x0, y0] = place(column.raw_north[i], column.raw_east[i]), [x1, y1] = place(north[i], east[i]);
        g.strokeStyle = css("line-pade_1_1");
        g.lineWidth = 1;
        g.beginPath();
        g.moveTo(x0, y0);
        g.lineTo(x1, y1);
        g.stroke();
      }
    }
    const length = niceStep(span / 3), ink = css("ink");
    g.strokeStyle = g.fillStyle = ink;
    g.lineWidth = 2;
    g.beginPath();
    g.moveTo(12, size - 12);
    g.lineTo(12 + length * scale, size - 12);
    g.moveTo(size - 16, 30);
    g.lineTo(size - 16, 8);
    g.lineTo(size - 20, 15);
    g.moveTo(size - 16, 8);
    g.lineTo(size - 12, 15);
    g.stroke();
    g.font = "12px system-ui, sans-serif";
    g.fillText(length >= 1000 ? `${length / 1000} km` : `${length} m`, 14, size - 17);
    g.fillText("N", size - 20, 43);
    bins.forEach((of, k) => { g.fillStyle = colourOf(k); g.fillRect(28 + 22 * k, 8, 22, 9); });
    g.fillStyle = ink;
    g.fillText(`${leastLead.toPrecision(2)} to ${fullLead.toPrecision(2)} m`, 32 + 22 * levels, 17);
    drawCursor();
  }
  function drawCursor() {
    const g = overlay.getContext("2d"), i = cursorRow;
    g.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    g.clearRect(0, 0, overlay.width, overlay.height);
    if (!place) return;
    for (const [ns, es, colour] of [[column.raw_north, column.raw_east, "line-raw"], [north, east, "line-exact_async"]]) {
      if (ns[i] !== ns[i]) continue;
      g.fillStyle = css(colour);
      g.beginPath();
      g.arc(...place(ns[i], es[i]), 5, 0, 7);
      g.fill();
    }
  }
  overlay.addEventListener("mousemove", (event) => {
    if (!place) return;
    let best = -1, least = 400;
    for (let i = rowAt(view[0]), step = Math.max(1, Math.floor((rowAt(view[1]) - i) / 5000)), end = rowAt(view[1]); i <= end; i += step) {
      const [x, y] = place(north[i], east[i]), d = (x - event.offsetX) ** 2 + (y - event.offsetY) ** 2;
      if (d < least) { least = d; best = i; }
    }
    if (best >= 0) plots[0].u.setCursor({ left: plots[0].u.valToPos(t[best], "x"), top: 10 });
  });

  // Keys, sizes, modes

  panels.addEventListener("keydown", (event) => {
    const [a, b] = view, span = b - a;
    const act = { "+": [a + span / 4, b - span / 4], "=": [a + span / 4, b - span / 4], "-": [a - span / 2, b + span / 2], 0: whole,
      ArrowLeft: [a - span / 4, b - span / 4], ArrowRight: [a + span / 4, b + span / 4] }[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const shift = Math.max(0, whole[0] - act[0]) - Math.max(0, act[1] - whole[1]);
    if (event.key.startsWith("Arrow")) show(act[0] + shift, act[1] + shift); else show(...act);
  });
  panels.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    const u = plots[0].u, at = u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x"), factor = event.deltaY < 0 ? 0.75 : 1 / 0.75;
    show(at - (at - view[0]) * factor, at + (view[1] - at) * factor);
  }, { passive: false });
  fingers(panels, whole, () => view, show);
  box.hidden = false;
  box.explorer = { plots, show, point, window: () => view, row: () => cursorRow };
  let width = 0;
  const rebuild = () => { build(); tell(); drawTrack(); };
  new ResizeObserver(() => requestAnimationFrame(() => {
    if (panels.clientWidth === width) return;
    width = panels.clientWidth;
    rebuild();
    box.dataset.ready = "yes";
  })).observe(frame);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", rebuild);
  const help = make("dialog", document.body), keys = [["j, k", "next flight, previous flight"], ["+ −", "zoom in, out"], ["← →", "move"], ["0", "the whole flight"],
    ...presets.map(({ name, key }) => [key, name]), ["drag", "zoom"], ["Shift-drag", "move"], ["Ctrl-wheel", "zoom at the pointer"], ["one finger, two", "move, zoom"], ["double-click", "the whole flight"], ["?", "this list"]];
  make("h2", help, "Keys");
  const list = make("dl", help), shut = make("button", make("form", help), "Close");
  for (const [key, words] of keys) { make("dt", list, key); make("dd", list, words); }
  shut.type = "button";
  shut.addEventListener("click", () => help.close());
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input,select,textarea")) return;
    const rel = { j: "next", k: "prev" }[event.key], link = rel && document.querySelector(`a[rel=${rel}]`), preset = presets.find(({ key }) => key === event.key);
    if (link) link.click();
    else if (event.key === "?") { if (help.open) help.close(); else help.showModal(); }
    else if (preset && !help.open) { preset.go(); box.scrollIntoView(); }
  });
  // A click on a time in the table of anomalies opens it here.
  document.addEventListener("click", (event) => {
    const link = event.target.closest("a[data-t]");
    if (!link) return;
    event.preventDefault();
    const at = Number(link.dataset.t), half = 10 + Number(link.dataset.length) / 2;
    show(...around(at + half - 10, half));
    box.scrollIntoView();
    panels.focus({ preventScroll: true });
  });
  // Figures with the same content are collapsed on screen, but printed.
  const twins = document.querySelector("details.twins");
  if (twins) {
    twins.open = false;
    addEventListener("beforeprint", () => { twins.open = true; });
  }
})();
