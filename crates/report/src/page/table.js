"use strict";
// Sorts, filters and saves the table of flights. Without this script it is a table.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0], rows = [...body.rows];
  const names = heads.map((head) => head.textContent.trim());
  const value = (row, i) => { const c = row.cells[i], v = c.dataset.v; return v === undefined ? c.textContent.trim() : v; };
  const isAbsent = (v) => v === "" || v === "\u2014";
  const compare = (a, b) => {
    const x = Number(a), y = Number(b);
    return Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, "en", { numeric: true }) : x - y;
  };
  const make = (name, text, parent) => {
    const element = document.createElement(name);
    element.textContent = text;
    parent.append(element);
    return element;
  };
  const state = { q: "", sort: "", show: "" };
  const facets = ["effect", "kind", "group", "data"].filter((f) => new Set(rows.map((r) => r.dataset[f])).size > 1);
  const bar = document.createElement("div");
  bar.className = "controls";
  table.closest(".scroll").before(bar);
  const label = make("label", "Filter ", bar), input = document.createElement("input");
  input.type = "search";
  input.placeholder = "name, effect:harmed, lateness>300, alarm:leap-second";
  label.append(input);
  const count = make("output", "", bar), csv = make("button", "CSV of these rows", bar);
  csv.type = "button";
  const chosen = new Map(facets.map((f) => [f, new Set()])), chips = [];
  for (const facet of facets) {
    const group = make("div", "", bar);
    group.setAttribute("role", "group");
    group.setAttribute("aria-label", facet);
    make("span", facet + ": ", group);
    const tally = new Map();
    rows.forEach((r) => tally.set(r.dataset[facet], (tally.get(r.dataset[facet]) || 0) + 1));
    for (const [name, n] of [...tally].sort((a, b) => b[1] - a[1]).slice(0, 12)) {
      const chip = make("button", (name || "none") + " " + n, group);
      chip.type = "button";
      chip.setAttribute("aria-pressed", "false");
      chip.addEventListener("click", () => {
        const set = chosen.get(facet), on = !set.has(name);
        on ? set.add(name) : set.delete(name);
        apply();
      });
      chips.push([chip, facet, name]);
    }
  }
  const chooser = make("details", "", bar);
  make("summary", "Columns", chooser);
  const boxes = heads.map((head, i) => {
    const label = make("label", "", chooser), box = document.createElement("input");
    box.type = "checkbox";
    box.checked = !head.classList.contains("more");
    box.disabled = i === 0;
    label.append(box, " " + names[i]);
    box.addEventListener("change", () => { state.show = shown(); apply(); });
    return box;
  });
  const usual = boxes.map((b) => b.checked);
  const shown = () => {
    const now = boxes.map((b) => (b.checked ? "1" : "0")).join("");
    return now === usual.map((b) => (b ? "1" : "0")).join("") ? "" : now;
  };
  const column = (word) => names.findIndex((n) => n.toLowerCase().replace(/[^a-z]/g, "").startsWith(word));
  const fits = (row, token) => {
    const bounds = /^([a-z]+)([<>])(-?[0-9.]+)$/.exec(token), pair = /^([a-z]+):(.*)$/.exec(token);
    if (bounds) {
      const i = column(bounds[1]), v = i < 0 || isAbsent(value(row, i)) ? NaN : Number(value(row, i));
      const scaled = i >= 0 && names[i].includes("(ms)") ? 1e3 * v : v;
      return bounds[2] === ">" ? scaled > Number(bounds[3]) : scaled < Number(bounds[3]);
    }
    const has = (text) => (text || "").toLowerCase().includes(pair ? pair[2] : token);
    return pair && row.dataset[pair[1]] !== undefined ? has(row.dataset[pair[1]]) : has(row.textContent);
  };
  const apply = () => {
    const tokens = state.q.toLowerCase().split(/\s+/).filter(Boolean);
    let left = 0;
    for (const row of rows) {
      const keep = tokens.every((t) => fits(row, t)) &&
        facets.every((f) => chosen.get(f).size === 0 || chosen.get(f).has(row.dataset[f]));
      row.hidden = !keep;
      left += keep;
    }
    count.textContent = " " + left + " of " + rows.length + " flights ";
    chips.forEach(([chip, facet, name]) => chip.setAttribute("aria-pressed", String(chosen.get(facet).has(name))));
    boxes.forEach((box, i) => {
      if (heads[i].hidden !== !box.checked) [heads[i], ...rows.map((r) => r.cells[i])].forEach((c) => (c.hidden = !box.checked));
    });
    const address = new URLSearchParams();
    Object.entries(state).forEach(([k, v]) => v && address.set(k, v));
    facets.forEach((f) => chosen.get(f).forEach((v) => address.append(f, v)));
    const text = address.toString();
    if (text || location.hash.startsWith("#?")) history.replaceState(null, "", text ? "#?" + text : "#all");
  };
  const sortBy = (i, down) => {
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    heads[i].setAttribute("aria-sort", down > 0 ? "ascending" : "descending");
    const keyed = rows.map((row) => [value(row, i), row]);
    keyed.sort(([a], [b]) => isAbsent(a) || isAbsent(b) ? isAbsent(a) - isAbsent(b) : down * compare(a, b));
    body.append(...keyed.map(([, row]) => row));
    state.sort = i + (down > 0 ? "+" : "-");
  };
  heads.forEach((head, i) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => { sortBy(i, head.getAttribute("aria-sort") === "ascending" ? -1 : 1); apply(); });
  });
  input.addEventListener("input", () => { state.q = input.value; apply(); });
  document.addEventListener("keydown", (e) => {
    if (e.key === "/" && !/^(input|textarea)$/i.test(document.activeElement.tagName)) { e.preventDefault(); input.focus(); }
  });
  csv.addEventListener("click", () => {
    // A text that a spreadsheet would take for a formula gets an apostrophe; numbers stay as they are.
    const cell = (v) => {
      const text = isAbsent(v) ? "" : v;
      const inert = Number.isNaN(Number(text)) && /^\s*[=+\-@]/.test(text) ? "'" + text : text;
      return /[",\n]/.test(inert) ? '"' + inert.replaceAll('"', '""') + '"' : inert;
    };
    const seen = heads.map((_, i) => i).filter((i) => boxes[i].checked);
    const plain = (n) => n.replace(" (ms)", " (s)");
    const word = (row, i) => (row.cells[i].classList.contains("w") ? row.cells[i].textContent.trim() : value(row, i));
    const line = (of) => seen.map((i) => cell(of(i))).join(",");
    const lines = [line((i) => plain(names[i])), ...[...body.rows].filter((r) => !r.hidden).map((r) => line((i) => word(r, i)))];
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }));
    link.download = "flights-shown.csv";
    link.click();
  });
  const read = () => {
    const address = new URLSearchParams(location.hash.startsWith("#?") ? location.hash.slice(2) : "");
    Object.keys(state).forEach((k) => (state[k] = address.get(k) || ""));
    input.value = state.q;
    facets.forEach((f) => chosen.set(f, new Set(address.getAll(f))));
    const shows = state.show.length === boxes.length ? [...state.show].map((c) => c === "1") : usual;
    boxes.forEach((box, i) => (box.checked = shows[i]));
    const sorted = /^([0-9]+)([+-])$/.exec(state.sort);
    if (sorted && heads[Number(sorted[1])]) sortBy(Number(sorted[1]), sorted[2] === "+" ? 1 : -1);
    apply();
  };
  addEventListener("hashchange", () => { if (location.hash.startsWith("#?")) { read(); table.scrollIntoView(); } });
  read();
}
