"use strict";
// Saves each table as CSV: numbers at full precision, uncertainties in separate columns.
for (const table of document.querySelectorAll(".scroll > table:not(.sortable)")) {
  const caption = table.caption, words = caption.textContent.trim();
  const clean = (text) => text.replace(/\s+/g, " ").trim();
  const number = (text) => {
    const plain = clean(text).replaceAll("\u2212", "-").replace(/(\d) (?=\d{3}\b)/g, "$1");
    return plain !== "" && Number.isFinite(Number(plain)) ? plain : null;
  };
  const cell = (of) => {
    const text = clean(of.textContent), data = of.querySelectorAll("data[value]"), parts = text.split("\u00b1");
    if (text === "\u2014") return [""];
    if (data.length !== 1 || number(parts[0]) === null && parts[0] !== "") return parts.length === 2 ? parts.map((p) => number(p) ?? clean(p)) : [number(text) ?? text];
    return [data[0].value, ...parts.slice(1).map((u) => number(u) ?? clean(u))];
  };
  const quoted = (text) => {
    const inert = !Number.isFinite(Number(text)) && /^\s*[=+\-@]/.test(text) ? "'" + text : text;
    return /[",\n]/.test(inert) ? '"' + inert.replaceAll('"', '""') + '"' : inert;
  };
  const save = () => {
    const rows = [...table.querySelectorAll("tr")].map((row) => ({ head: row.parentNode === table.tHead, cells: [...row.cells].map(cell) }));
    const wide = [];
    rows.forEach(({ cells }) => cells.forEach((c, i) => (wide[i] = Math.max(wide[i] || 1, c.length))));
    const line = ({ head, cells }) => cells.flatMap((c, i) => Array.from({ length: wide[i] }, (_, k) => c[k] ?? (head ? c[0] + ", \u00b1" : ""))).map(quoted).join(",");
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([rows.map(line).join("\n") + "\n"], { type: "text/csv" }));
    link.download = (words.toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "").slice(0, 60) || "table") + ".csv";
    link.click();
  };
  const button = document.createElement("button");
  button.type = "button";
  button.className = "csv";
  button.textContent = "CSV";
  button.setAttribute("aria-label", "CSV of this table: " + words);
  button.addEventListener("click", save);
  caption.append(" ", button);
}
