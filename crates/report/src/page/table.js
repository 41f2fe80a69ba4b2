"use strict";
// Sorts, filters and saves the table of flights. Without this script it is a plain table.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0], rows = [...body.rows];
  const names = heads.map((head) => head.textContent.trim());
  const value = (row, i) => { const c = row.cells[i], v = c.dataset.v; return v === undefined ? c.textContent.trim() : v; };
  const isAbsent = (v) => v === "" || v === "\u2014";
  const words = new Intl.Collator("en", { numeric: true });
  const compare = (a, b) => {
    const x = Number(a), y = Number(b);
    return Number.isNaN(x) || Number.isNaN(y) ? words.compare(a, b) : x - y;
  };
  const make = (name, text, parent) => {
    const element = document.createElement(name);
    element.textContent = text;
    parent.append(element);
    return element;
  };
  const button = (text, parent, action) => {
    const element = make("button", text, parent);
    element.type = "button";
    element.addEventListener("click", action);
    return element;
  };
  const texts = new Map(rows.map((row) => [row, row.textContent.toLowerCase()]));
  const state = { q: "", sort: "", show: "" };
  const named = ["effect", "group", "data", "criteria", "kind"], places = Object.fromEntries(named.map((f) => [f, names.findIndex((n) => n.toLowerCase() === f)]));
  // A verdict is compared by its word only, without its sign and its count.
  const read1 = (row, f) => {
    const cell = row.cells[places[f]], text = cell ? cell.textContent.trim() : "";
    if (isAbsent(text) || !cell.classList.contains("w")) return isAbsent(text) ? "" : text;
    return text.replace(/^[^a-z]+|[^a-z]+$/gi, "").toLowerCase().replace("log damaged", "damaged");
  };
  const values = new Map(rows.map((row) => [row, Object.fromEntries(named.map((f) => [f, read1(row, f)]))]));
  const facets = named.filter((f) => new Set(rows.map((r) => values.get(r)[f])).size > 1);
  const bar = document.createElement("div");
  bar.className = "controls";
  const scroll = table.closest(".scroll");
  scroll.before(bar);
  const label = make("label", "Filter ", bar), input = document.createElement("input");
  input.type = "search";
  input.placeholder = "name, effect:harmed, lateness>300, alarm:leap-second";
  label.append(input);
  const count = make("output", "", bar);
  button("CSV of these rows", bar, () => save());
  button("All", bar, () => { Object.keys(state).forEach((k) => (state[k] = "")); chosen.forEach((set) => set.clear()); initial(); show(); });
  const help = make("p", "Keys: / filter, \u2193 \u2191 or j k next and previous flight, Enter open it, e its reasons, Esc leave the filter, ? this line.", bar);
  help.className = "note";
  help.hidden = true;
  // Length of the common leading words of long names: they do not distinguish the names.
  const start = (all) => {
    let length = 0;
    while (new Set(all).size > 1 && all.every((name) => name[length] === all[0][length])) length++;
    const word = (all[0] || "").lastIndexOf(" ", length) + 1;
    return word > 12 ? word : 0;
  };
  const chosen = new Map(facets.map((f) => [f, new Set()])), chips = [];
  for (const facet of facets) {
    const group = make("div", "", bar), tally = new Map();
    const common = start(rows.map((r) => values.get(r)[facet]).filter(Boolean));
    group.setAttribute("role", "group");
    group.setAttribute("aria-label", facet);
    make("span", facet + ": ", group);
    rows.forEach((r) => { const v = values.get(r)[facet]; tally.set(v, (tally.get(v) || 0) + 1); });
    for (const [name, n] of [...tally].sort((a, b) => b[1] - a[1]).slice(0, 12)) {
      const chip = button("", group, () => {
        const set = chosen.get(facet);
        set.has(name) ? set.delete(name) : set.add(name);
        apply();
      });
      const text = make("bdi", name ? (common ? "…" + name.slice(common) : name) : "none", chip), number = make("span", " " + n, chip);
      text.title = name;
      chips.push([chip, facet, name, number]);
    }
  }
  const chooser = make("details", "", bar);
  make("summary", "Columns", chooser);
  const usual = heads.map((head) => !head.classList.contains("more"));
  const boxes = heads.map((head, i) => {
    const label = make("label", "", chooser), box = document.createElement("input");
    box.type = "checkbox";
    box.disabled = i === 0;
    label.append(box, " " + names[i]);
    box.addEventListener("change", () => { state.show = shown(); apply(); });
    return box;
  });
  const columns = make("style", "", document.head);
  const shown = () => {
    const bits = (of) => of.map((b) => (b ? "1" : "0")).join(""), now = bits(boxes.map((b) => b.checked));
    return now === bits(usual) ? "" : now;
  };
  // Common terms for columns and facets that have other names here.
  const aliases = { delay: "lateness", late: "lateness", receiver: "group", rate: "position(hz", date: "flown", error: "errorafter" };
  const plainly = (n) => n.toLowerCase().replace(/[^a-z(]/g, "");
  const column = (word) => names.findIndex((n) => plainly(n).startsWith(aliases[word] || word));
  let unknown = [];
  const test = (token) => {
    const bounds = /^([a-z]+)([<>])(-?[0-9.]+)$/.exec(token), pair = /^([a-z]+):(.*)$/.exec(token);
    if (bounds) {
      const i = column(bounds[1]), scale = i >= 0 && names[i].includes("(ms)") ? 1e3 : 1, limit = Number(bounds[3]);
      if (i < 0) { unknown.push(bounds[1]); return () => true; }
      return (row) => {
        if (isAbsent(value(row, i))) return false;
        const v = scale * Number(value(row, i));
        return bounds[2] === ">" ? v > limit : v < limit;
      };
    }
    if (pair && pair[1] === "reason") return (row) => (row.dataset.reason || "").split(" ").includes(pair[2]);
    const facet = pair && (aliases[pair[1]] || pair[1]);
    if (pair && named.includes(facet)) return (row) => values.get(row)[facet].toLowerCase().includes(pair[2]);
    if (pair && pair[1] === "alarm") return (row) => (row.dataset.alarm || "").includes(pair[2]);
    if (pair && column(pair[1]) >= 0) return (row) => row.cells[column(pair[1])].textContent.toLowerCase().includes(pair[2]);
    if (pair && !rows.some((row) => texts.get(row).includes(token))) { unknown.push(pair[1]); return () => true; }
    return (row) => texts.get(row).includes(token);
  };
  const isIn = (row, facet) => chosen.get(facet).size === 0 || chosen.get(facet).has(values.get(row)[facet]);
  // Rows in sorted order, rows that match, and how many of these are in the document. More rows than a screen needs
  // would slow down every change.
  const CHUNK = 100;
  let sorted = rows, wanted = rows, drawn = rows.length;
  const more = (count = CHUNK) => {
    body.append(...wanted.slice(drawn, drawn + count));
    drawn = Math.min(drawn + count, wanted.length);
  };
  const all = () => more(wanted.length);
  scroll.addEventListener("scroll", () => {
    if (drawn < wanted.length && scroll.scrollTop + 2 * scroll.clientHeight > scroll.scrollHeight) more();
  });
  addEventListener("beforeprint", all);
  const apply = () => {
    unknown = [];
    const tests = state.q.toLowerCase().split(/\s+/).filter(Boolean).map(test);
    const found = rows.filter((row) => tests.every((t) => t(row))), kept = new Set(found.filter((row) => facets.every((f) => isIn(row, f))));
    wanted = sorted.filter((row) => kept.has(row));
    body.replaceChildren();
    drawn = 0;
    more();
    count.textContent = " " + kept.size + " of " + rows.length + " flights " + (unknown.length ? "(no column is called " + unknown.join(", ") + ") " : "");
    // Each count is the number of rows that a click would show, with the other facets still applied.
    const tallies = new Map(facets.map((f) => [f, new Map()]));
    for (const row of found) {
      const misses = facets.filter((f) => !isIn(row, f));
      for (const f of misses.length === 0 ? facets : misses.length === 1 ? misses : []) {
        const v = values.get(row)[f], tally = tallies.get(f);
        tally.set(v, (tally.get(v) || 0) + 1);
      }
    }
    chips.forEach(([chip, facet, name, number]) => {
      chip.setAttribute("aria-pressed", String(chosen.get(facet).has(name)));
      number.textContent = " " + (tallies.get(facet).get(name) || 0);
    });
    columns.textContent = boxes.map((box, i) => (box.checked ? "" : "#flights tr:not(.why)>:nth-child(" + (i + 1) + "){display:none}")).join("");
    const address = new URLSearchParams();
    Object.entries(state).forEach(([k, v]) => v && address.set(k, v));
    facets.forEach((f) => chosen.get(f).forEach((v) => address.append(f, v)));
    const text = address.toString();
    if (text || location.hash.startsWith("#?")) history.replaceState(null, "", text ? "#?" + text : "#all");
  };
  const initial = () => { heads.forEach((head) => head.removeAttribute("aria-sort")); sorted = rows; };
  const sortBy = (i, down) => {
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    heads[i].setAttribute("aria-sort", down > 0 ? "ascending" : "descending");
    const keyed = rows.map((row) => [value(row, i), row]);
    keyed.sort(([a], [b]) => isAbsent(a) || isAbsent(b) ? isAbsent(a) - isAbsent(b) : down * compare(a, b));
    sorted = keyed.map(([, row]) => row);
    state.sort = i + (down > 0 ? "+" : "-");
  };
  heads.forEach((head, i) => {
    const text = [...head.childNodes];
    button("", head, () => { sortBy(i, head.getAttribute("aria-sort") === "ascending" ? -1 : 1); apply(); }).append(...text);
  });
  // A small ground track: two letters for each point, steps from the left and from the top. A space lifts the pen.
  const letters = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_`{|}~";
  const picture = (packed, cell) => {
    if (!packed) return void (make("p", "No track to show: no position of this flight was compensated.", cell).className = "note");
    const d = packed.split(" ").map((piece) => "M" + piece.replace(/../g, (two) => letters.indexOf(two[0]) + " " + letters.indexOf(two[1]) + " ")).join("");
    cell.insertAdjacentHTML("beforeend", '<svg class="sketch" viewBox="-1 -1 90 35" width="160" height="60" role="img" aria-label="Ground track, north up"><path d="' + d + '"/></svg>');
  };
  // A row shows why it needs attention, and where it flew.
  const explain = (row) => {
    if (!row) return;
    const next = row.nextElementSibling;
    if (next && next.classList.contains("why")) return next.remove();
    const why = document.createElement("tr"), cell = make("td", "", why), list = make("ul", "", cell);
    why.className = "why";
    cell.colSpan = heads.length;
    const reasons = (row.dataset.reason || "").split(" ").filter(Boolean);
    reasons.forEach((slug) => {
      const text = document.querySelector('li[data-reason="' + slug + '"] .text');
      make("li", text ? text.textContent : slug.replaceAll("-", " "), list);
    });
    if (reasons.length === 0) make("li", "Nothing in this flight needs attention.", list);
    picture(row.dataset.track, cell);
    row.after(why);
  };
  let current = null;
  const go = (step) => {
    const at = wanted.indexOf(current), next = wanted[at < 0 ? 0 : Math.min(Math.max(at + step, 0), wanted.length - 1)];
    if (!next) return;
    if (!next.isConnected) more();
    if (current) current.classList.remove("current");
    current = next;
    next.classList.add("current");
    next.cells[0].querySelector("a").focus({ preventScroll: true });
    next.scrollIntoView({ block: "nearest" });
  };
  body.addEventListener("click", (e) => { if (!e.target.closest("a")) explain(e.target.closest("tr:not(.why)")); });
  input.addEventListener("input", () => { state.q = input.value; apply(); });
  input.addEventListener("keydown", (e) => {
    if (e.key === "Escape") input.blur();
    if (e.key === "ArrowDown") { e.preventDefault(); go(1); }
  });
  document.addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || /^(input|textarea|select)$/i.test(document.activeElement.tagName)) return;
    const inside = scroll.contains(document.activeElement);
    const act = {
      "/": () => input.focus(),
      "?": () => { help.hidden = !help.hidden; if (!help.hidden) bar.scrollIntoView({ block: "nearest" }); },
      j: () => go(1),
      k: () => go(-1),
      ArrowDown: inside && (() => go(1)),
      ArrowUp: inside && (() => go(-1)),
      e: inside && (() => explain(document.activeElement.closest("tbody tr"))),
    }[e.key];
    if (act) { e.preventDefault(); act(); }
  });
  const save = () => {
    // Text that a spreadsheet might evaluate is prefixed with an apostrophe. Numbers are unchanged.
    const cell = (v) => {
      const text = isAbsent(v) ? "" : v;
      const inert = Number.isNaN(Number(text)) && /^\s*[=+\-@]/.test(text) ? "'" + text : text;
      return /[",\n]/.test(inert) ? '"' + inert.replaceAll('"', '""') + '"' : inert;
    };
    const seen = heads.map((_, i) => i).filter((i) => boxes[i].checked);
    const plain = (n) => n.replace(" (ms)", " (s)"), isUncertain = (i) => rows.some((row) => row.cells[i].dataset.u !== undefined);
    const word = (row, i) => values.get(row)[names[i].toLowerCase()] ?? (row.cells[i].classList.contains("w") ? row.cells[i].textContent.trim() : value(row, i));
    // A value with an uncertainty is followed by the expanded uncertainty (k = 2).
    const line = (of, ofU) => seen.flatMap((i) => (isUncertain(i) ? [of(i), ofU(i)] : [of(i)])).map(cell).join(",");
    const lines = [line((i) => plain(names[i]), (i) => "U of " + plain(names[i])), ...wanted.map((r) => line((i) => word(r, i), (i) => r.cells[i].dataset.u || ""))];
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }));
    link.download = "flights-shown.csv";
    link.click();
  };
  const show = () => {
    input.value = state.q;
    const shows = state.show.length === boxes.length ? [...state.show].map((c) => c === "1") : usual;
    boxes.forEach((box, i) => (box.checked = i === 0 || shows[i]));
    const by = /^([0-9]+)([+-])$/.exec(state.sort);
    if (by && heads[Number(by[1])]) sortBy(Number(by[1]), by[2] === "+" ? 1 : -1);
    apply();
  };
  const read = () => {
    const address = new URLSearchParams(location.hash.startsWith("#?") ? location.hash.slice(2) : "");
    Object.keys(state).forEach((k) => (state[k] = address.get(k) || ""));
    facets.forEach((f) => chosen.set(f, new Set(address.getAll(f))));
    show();
  };
  const arrive = () => { if (location.hash.startsWith("#?")) { read(); bar.scrollIntoView(); } };
  for (const link of document.querySelectorAll("a.show")) {
    link.addEventListener("click", (e) => { e.preventDefault(); location.hash = "#?" + new URLSearchParams({ q: link.dataset.q }); });
  }
  addEventListener("hashchange", arrive);
  read();
}
