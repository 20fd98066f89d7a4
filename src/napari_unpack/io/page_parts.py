"""What every page of objects carries: its looks, light and dark, and how it sorts itself."""

STYLE = """
:root { color-scheme: light dark; --ground: #fbfbfc; --raised: #ffffff; --ink: #1c2128;
  --faint: #626b78; --line: #dfe3e8; --well: #14181f; --accent: #0b6bcb; }
@media (prefers-color-scheme: dark) {
  :root { --ground: #14171c; --raised: #1c2027; --ink: #e6e9ee; --faint: #98a2b1;
    --line: #2e343e; --well: #0d1014; --accent: #6cb2ff; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1080px; padding: 32px 20px 48px; background: var(--ground);
  color: var(--ink); font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; }
h1 { font-size: 26px; line-height: 1.2; margin: 0 0 4px; letter-spacing: -0.01em; }
p, footer { color: var(--faint); margin: 0; }
figure { margin: 20px 0; }
figure img { display: block; width: 100%; height: auto; border-radius: 10px; }
.search { display: block; color: var(--faint); margin: 0 0 12px; }
input { font: inherit; color: var(--ink); background: var(--raised); padding: 5px 10px;
  border: 1px solid var(--line); border-radius: 6px; margin-left: 8px; width: 240px; }
.wide { overflow-x: auto; border: 1px solid var(--line); border-radius: 10px;
  background: var(--raised); }
table { border-collapse: collapse; width: 100%; }
th, td { padding: 8px 12px; text-align: left; border-bottom: 1px solid var(--line);
  white-space: nowrap; }
tbody tr:last-child td { border-bottom: 0; }
th { font-weight: 600; font-size: 13px; color: var(--faint); position: sticky; top: 0;
  background: var(--raised); }
th[data-kind=n], .n { text-align: right; font-variant-numeric: tabular-nums; }
th button { all: unset; cursor: pointer; }
th button:hover, th[aria-sort$=ending] button { color: var(--accent); }
th button:focus-visible { outline: 2px solid var(--accent); outline-offset: 3px; }
th[aria-sort=ascending] button::after { content: " \\2191"; }
th[aria-sort=descending] button::after { content: " \\2193"; }
.picture { width: 136px; }
.picture img { display: block; margin: 0 auto; max-width: 112px; max-height: 84px; }
td.picture { background: var(--well); }
td i { display: inline-block; width: 11px; height: 11px; border-radius: 3px;
  margin-right: 9px; }
tbody tr:hover td:not(.picture) { background: color-mix(in srgb, var(--accent) 8%, transparent); }
footer { margin-top: 20px; font-size: 13px; }
@media print { .search, footer { display: none; } .wide { overflow: visible; } }
"""

SCRIPT = """
"use strict";
const body = document.querySelector("tbody");
const heads = [...document.querySelectorAll("th")];
const texts = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });
heads.forEach((head, column) => {
  const button = head.querySelector("button");
  if (!button) return;
  button.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    heads.forEach(other => other.dataset.kind && other.setAttribute("aria-sort", "none"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const number = head.dataset.kind === "n";
    const value = row => number ? row.cells[column].dataset.value : row.cells[column].textContent;
    const rows = [...body.rows].sort((a, b) => {
      const [x, y] = [value(a), value(b)];
      if (number && (x === "" || y === "")) return (x === "") - (y === "");
      return (up ? 1 : -1) * (number ? x - y : texts.compare(x, y));
    });
    body.append(...rows);
  });
});
document.querySelector("input").addEventListener("input", event => {
  const wanted = event.target.value.trim().toLowerCase();
  for (const row of body.rows) {
    const [id, name] = [row.cells[1].textContent, row.cells[2].textContent.toLowerCase()];
    row.hidden = Boolean(wanted) && id !== wanted && !name.includes(wanted);
  }
});
"""
