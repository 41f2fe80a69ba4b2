"use strict";
// Zooms into the rows of a flight: panels over time with one cursor and one window, beside the ground track.
(async () => {
  const box = document.getElementById("explorer"), source = document.getElementById("explorer-data");
  if (!box || !source || typeof DecompressionStream === "undefined") return;
  const given = JSON.parse(source.textContent), count = given.rows.rows;

  // Rows

  const unpack = async (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  };
  const bytes = await unpack(given.rows.data), column = {};
  given.rows.columns.forEach(({ name, differences }, n) => {
    const plane = bytes.subarray(4 * n * count, 4 * (n + 1) * count), values = new Float64Array(count);
    let last = 0, slope = 0;
    for (let i = 0; i < count; i++) {
      const step = plane[i] | plane[count + i] << 8 | plane[2 * count + i] << 16 | plane[3 * count + i] << 24;
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

  // What follows from the rows: velocity from the exact positions, lead of exact over raw along it, errors, turn rate

  const speed = new Float64Array(count), turn = new Float64Array(count), lead = new Float64Array(count),
    leadMs = new Float64Array(count), heading = new Float64Array(count), errors = {};
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
    lead[i] = moves ? ((north[i] - column.raw_north[i]) * vn + (east[i] - column.raw_east[i]) * ve) / speed[i] : NaN;
    leadMs[i] = 1e3 * lead[i] / speed[i];
  });
  slopeOver(0.5, (i, a, b, dt) => {
    const turned = heading[b] - heading[a];
    turn[i] = dt > 0 ? Math.atan2(Math.sin(turned), Math.cos(turned)) / dt * 180 / Math.PI : NaN;
  });
  if (hasTruth) {
    for (const [name] of tracks) {
      if (name === "truth") continue;
      const [n, e] = [column[`${name}_north`], column[`${name}_east`]];
      errors[name] = n.map((v, i) => Math.hypot(v - column.truth_north[i], e[i] - column.truth_east[i]));
    }
  }

  // Places worth a look

  const largest = (of) => {
    let best = -1;
    for (let i = 0; i < count; i++) if (of(i) > (best < 0 ? -Infinity : of(best))) best = i;
    return best;
  };
  const whole = [t[0], t[count - 1]];
  const around = (at, half) => [Math.max(whole[0], at - half), Math.min(whole[1], at + half)];
  const clock = (s) => {
    const sign = s < 0 ? "−" : "", v = Math.abs(s), h = Math.floor(v / 3600), m = Math.floor(v / 60) % 60;
    return `${sign}${h}:${String(m).padStart(2, "0")}:${(v % 60).toFixed(1).padStart(4, "0")}`;
  };
  const places = [["The whole flight", whole]];
  const offer = (name, row) => { if (row >= 0) places.push([`${name}, ${clock(t[row])}`, around(t[row], 10)]); };
  offer("Hardest turn", largest((i) => Math.abs(turn[i]) * speed[i]));
  offer("Largest lead", largest((i) => Math.abs(lead[i])));
  if (hasTruth) offer("Largest error of exact", largest((i) => errors.exact_async[i]));
  let gaps = 0;
  for (let i = 1; i < count && gaps < 10; i++) {
    if (t[i] - t[i - 1] > gap) { places.push([`Gap of ${(t[i] - t[i - 1]).toFixed(1)} s, ${clock(t[i - 1])}`, around((t[i] + t[i - 1]) / 2, 10 + (t[i] - t[i - 1]) / 2)]); gaps++; }
    else if (Number.isNaN(north[i]) && !Number.isNaN(north[i - 1])) { offer("No compensated position", i); gaps++; }
  }
  for (const { t_s, what } of given.places) places.push([`${what}, ${clock(t_s)}`, around(t_s, 10)]);

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
  const numbersBody = make("tbody", numbers), canvas = make("canvas", side);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Ground track, coloured by the lead of the compensated position over raw");
  const key = make("p", side, "", "note");

  // Panels

  const css = (name) => getComputedStyle(box).getPropertyValue(`--${name}`).trim();
  const pens = { raw: { width: 1 }, exact_async: { width: 2 }, pade_1_1: { width: 1.5, dash: [6, 3] }, truth: { width: 1.5, dash: [2, 3] } };
  const ofTracks = (axis) => tracks.map(([name, words]) => [name, words, column[`${name}_${axis}`]]);
  const wanted = [
    { title: "North (m)", series: ofTracks("north") },
    { title: "East (m)", series: ofTracks("east") },
    { title: "Lead of exact over raw along the track (m)", series: [["exact_async", "lead", lead]] },
    { title: given.delay.length ? `Lead (ms, with the age of the held fix); removed (dashed); delay against ${given.against} ± U (green)` : "Lead (ms, with the age of the held fix)", series: [["exact_async", "lead", leadMs]], delay: true },
  ];
  if (hasTruth) wanted.push({ title: "Error against the reference, 2‑D (m)", series: tracks.filter(([name]) => name in errors).map(([name, words]) => [name, words, errors[name]]) });
  wanted.push({ title: "Speed (m/s)", series: [["plain", "speed", speed]] }, { title: "Turn rate (°/s)", series: [["plain", "turn rate", turn]] });
  const plots = [], sync = uPlot.sync("flight");
  let view = whole, cursorRow = 0;

  // Least and greatest value of every column of pixels, in their order: a spike of one row shows at every zoom.
  const thinned = (series, [from, to], pixels) => {
    const first = Math.max(0, rowAt(from) - 1), last = Math.min(count - 1, rowAt(to) + 1), width = (to - from) / pixels;
    const x = [], ys = series.map(() => []);
    let begin = first;
    const close = (end) => {
      const rows = end - begin;
      if (rows < 3) {
        for (let i = begin; i < end; i++) { x.push(t[i]); ys.forEach((y, s) => y.push(Number.isNaN(series[s][i]) ? null : series[s][i])); }
        return;
      }
      x.push(t[begin], t[end - 1]);
      ys.forEach((y, s) => {
        let low = -1, high = -1;
        for (let i = begin; i < end; i++) {
          const v = series[s][i];
          if (v !== v) continue;
          if (low < 0 || v < series[s][low]) low = i;
          if (high < 0 || v > series[s][high]) high = i;
        }
        if (low < 0) y.push(null, null); else y.push(series[s][Math.min(low, high)], series[s][Math.max(low, high)]);
      });
    };
    for (let i = first + 1; i <= last; i++) {
      const isGap = t[i] - t[i - 1] > gap;
      if (isGap || Math.floor((t[i] - from) / width) !== Math.floor((t[begin] - from) / width)) {
        close(i);
        begin = i;
        if (isGap) { x.push((t[i] + t[i - 1]) / 2); ys.forEach((y) => y.push(null)); }
      }
    }
    close(last + 1);
    return [x, ...ys];
  };
  // The delay curve has times of its own: its values are put between those of the rows.
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
    const data = thinned(plot.series, view, Math.max(100, plot.width * devicePixelRatio));
    return plot.delay ? withDelay(data) : data;
  };
  const build = () => {
    plots.splice(0).forEach((plot) => plot.u.destroy());
    const width = panels.clientWidth, ink = css("ink"), soft = css("soft"), grid = { stroke: css("line"), width: 1 };
    wanted.forEach(({ title, series, delay }, n) => {
      const isLast = n === wanted.length - 1, names = series.map(([name]) => name);
      const plot = { names, series: series.map(([, , values]) => values), delay: delay && given.delay.length > 0, width: width - 80 };
      const lines = series.map(([name, label]) => ({
        label, show: visible[name] !== false, stroke: name === "plain" ? ink : css(`line-${name}`), ...(pens[name] || { width: 1 }), points: { show: false },
      }));
      const bands = [], none = { points: { show: false }, value: () => "" };
      if (plot.delay) {
        const n = lines.length + 1, edge = { ...none, width: 0, stroke: "transparent" };
        lines.push({ ...none, stroke: css("line-truth"), width: 2 }, edge, { ...edge }, { ...none, stroke: css("line-pade_1_1"), width: 1, dash: [6, 3] });
        bands.push({ series: [n + 2, n + 1], fill: css("band-truth") });
      }
      const font = "12px system-ui, sans-serif", axis = { stroke: soft, grid, ticks: grid, font };
      plot.u = new uPlot({
        width, height: n < 2 ? 190 : 140, title, padding: [8, 8, isLast ? 0 : 6, 0], bands, legend: { show: false },
        scales: { x: { time: false, range: () => view } },
        axes: [{ ...axis, show: isLast, size: isLast ? 36 : 0, values: (u, at) => at.map((v) => v == null ? "" : clock(v)), space: 90 }, { ...axis, size: 64 }],
        cursor: { sync: { key: sync.key }, drag: { x: true, y: false, setScale: false }, points: { size: 6 }, bind: { dblclick: () => () => { show(...whole); return null; } } },
        series: [{}, ...lines],
        hooks: {
          setSelect: [(u) => {
            const { left, width: w } = u.select;
            if (w > 4) show(u.posToVal(left, "x"), u.posToVal(left + w, "x"));
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          }],
          setCursor: [(u) => { if (u.cursor.left >= 0 && plots[0] && u === plots[0].u) point(rowAt(u.posToVal(u.cursor.left, "x"))); }],
        },
      }, dataOf(plot), make("div", panels));
      plots.push(plot);
    });
  };

  // Window and cursor

  function show(from, to) {
    const least = Math.max(4 * (whole[1] - whole[0]) / count, 0.05);
    let [a, b] = [Math.min(from, to), Math.max(from, to)];
    if (b - a < least) [a, b] = [(a + b - least) / 2, (a + b + least) / 2];
    if (Math.abs(a - view[0]) + Math.abs(b - view[1]) < 1e-9) return;
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
  const over = (values, f) => {
    let n = 0, sum = 0, most = NaN;
    for (let i = rowAt(view[0]); i <= rowAt(view[1]); i++) {
      const v = values[i];
      if (v !== v) continue;
      n++;
      sum += f(v);
      if (!(Math.abs(v) <= most)) most = Math.abs(v);
    }
    return { n, mean: sum / n, most };
  };
  function tell() {
    const rms = (values) => Math.sqrt(over(values, (v) => v * v).mean), mean = (values) => over(values, (v) => v).mean;
    const rows = rowAt(view[1]) - rowAt(view[0]) + 1, say = (v, digits, unit) => Number.isFinite(v) ? v.toFixed(digits).replace("-", "−") + (unit ? `\u00a0${unit}` : "") : "–";
    const lines = [["From, to", `${clock(view[0])} – ${clock(view[1])}`], ["Rows with a compensated position", `${over(north, () => 0).n} of ${rows}`],
      ["Speed, mean and most", `${say(mean(speed), 1)}, ${say(over(speed, () => 0).most, 1, "m/s")}`], ["Turn rate, most", say(over(turn, () => 0).most, 1, "°/s")],
      ["Lead over raw, rms and most", `${say(rms(lead), 2)}, ${say(over(lead, () => 0).most, 2, "m")}`], ["Lead over raw, mean", say(mean(leadMs), 0, "ms")]];
    for (const [name, words] of tracks) {
      if (name in errors) lines.push([`Error, ${words}, rms and most`, `${say(rms(errors[name]), 3)}, ${say(over(errors[name], () => 0).most, 2, "m")}`]);
    }
    numbersBody.replaceChildren();
    for (const [name, value] of lines) {
      const row = make("tr", numbersBody), head = make("th", row, name);
      head.scope = "row";
      make("td", row, value, "n");
    }
  }

  // Ground track

  const viridis = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
  const sorted = Float64Array.from(lead.filter((v) => v === v).map(Math.abs)).sort();
  const fullLead = Math.max(sorted[Math.floor(0.98 * (sorted.length - 1))] || 0, 1e-3);
  key.textContent = `Colour: lead over raw, dark 0, bright ${fullLead.toPrecision(2)} m and more. Grey: outside of the window. Thin: raw.`;
  const niceStep = (span) => { const p = 10 ** Math.floor(Math.log10(span)); return [1, 2, 5, 10].map((k) => k * p).filter((v) => v <= span).pop() || p; };
  // The track as drawn, so that a moving cursor does not draw it again.
  const drawn = document.createElement("canvas");
  let place = () => [0, 0];
  function drawTrack() {
    const size = Math.max(200, Math.floor(side.clientWidth)), dpr = devicePixelRatio, g = canvas.getContext("2d");
    canvas.width = canvas.height = size * dpr;
    canvas.style.width = canvas.style.height = `${size}px`;
    g.scale(dpr, dpr);
    const isWhole = view[0] <= whole[0] && view[1] >= whole[1], [first, last] = [rowAt(view[0]), rowAt(view[1])];
    let [n0, n1, e0, e1] = [Infinity, -Infinity, Infinity, -Infinity];
    for (let i = first; i <= last; i++) {
      if (north[i] !== north[i]) continue;
      n0 = Math.min(n0, north[i]); n1 = Math.max(n1, north[i]); e0 = Math.min(e0, east[i]); e1 = Math.max(e1, east[i]);
    }
    if (!(n1 >= n0)) { drawn.width = 0; return; }
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
    const rows = every(first, last, 12000), bins = viridis.map(() => []);
    for (let k = 1; k < rows.length; k++) {
      const i = rows[k];
      if (i < 0 || rows[k - 1] < 0) continue;
      const share = Math.abs(lead[i]) / fullLead, bin = share !== share ? 0 : Math.min(viridis.length - 1, Math.floor(share * viridis.length));
      bins[bin].push(rows[k - 1], i, -1);
    }
    bins.forEach((of, k) => stroke(of, viridis[k], 2.5, north, east));
    // With few seconds in the window: a line each second from raw to compensated, the delay as a length.
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
    drawn.width = drawn.height = canvas.width;
    drawn.getContext("2d").drawImage(canvas, 0, 0);
    drawCursor();
  }
  function drawCursor() {
    if (drawn.width === 0) return;
    const g = canvas.getContext("2d"), i = cursorRow;
    g.save();
    g.resetTransform();
    g.drawImage(drawn, 0, 0);
    g.restore();
    for (const [ns, es, colour] of [[column.raw_north, column.raw_east, "line-raw"], [north, east, "line-exact_async"]]) {
      if (ns[i] !== ns[i]) continue;
      g.fillStyle = css(colour);
      g.beginPath();
      g.arc(...place(ns[i], es[i]), 5, 0, 7);
      g.fill();
    }
  }
  canvas.addEventListener("mousemove", (event) => {
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
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input,select,textarea")) return;
    const rel = { j: "next", k: "prev" }[event.key], link = rel && document.querySelector(`a[rel=${rel}]`);
    if (link) link.click();
  });
})();
