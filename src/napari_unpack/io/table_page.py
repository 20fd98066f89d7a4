"""A web page with a table: sorted by a click on a column, searched, dark where the reader is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from typing import Any

STYLE = """
:root { color-scheme: light dark; --ground: #fbfbfc; --raised: #ffffff; --ink: #1c2128;
  --faint: #626b78; --line: #dfe3e8; --well: #14181f; --accent: #0b6bcb; }
@media (prefers-color-scheme: dark) {
  :root { --ground: #14171c; --raised: #1c2027; --ink: #e6e9ee; --faint: #98a2b1;
    --line: #2e343e; --well: #0d1014; --accent: #6cb2ff; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1400px; padding: 32px 20px 48px; background: var(--ground);
  color: var(--ink); font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; }
h1 { font-size: 26px; line-height: 1.2; margin: 0 0 4px; letter-spacing: -0.01em;
  overflow-wrap: anywhere; }
h2 { font-size: 18px; margin: 28px 0 10px; }
p, footer { color: var(--faint); margin: 0; }
header p { margin-bottom: 16px; }
figure { margin: 20px 0; max-width: 1040px; }
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
.long, .name { white-space: normal; overflow-wrap: anywhere; min-width: 180px; }
.name { min-width: 150px; }
a { color: var(--accent); }
th[data-kind=n], .n { text-align: right; font-variant-numeric: tabular-nums; }
th button { all: unset; cursor: pointer; }
th button:hover, th[aria-sort$=ending] button { color: var(--accent); }
th button:focus-visible { outline: 2px solid var(--accent); outline-offset: 3px; }
th[aria-sort=ascending] button::after { content: " \\2191"; }
th[aria-sort=descending] button::after { content: " \\2193"; }
.picture { width: 136px; }
.picture img { display: block; margin: 0 auto; max-width: 112px; max-height: 84px; }
.scan.picture img { max-width: 208px; max-height: 156px; }
tbody:not(:has(tr:not([hidden])))::after { content: "Nothing found."; display: block;
  padding: 8px 12px; white-space: nowrap; }
/* On paper too, where browsers leave grounds out. */
td.picture, td i { print-color-adjust: exact; }
td.picture { background: var(--well); }
td i { display: inline-block; width: 11px; height: 11px; border-radius: 3px;
  margin-right: 9px; }
tbody tr:hover td:not(.picture) { background: color-mix(in srgb, var(--accent) 8%, transparent); }
footer { margin-top: 20px; font-size: 13px; }
@media (max-width: 600px) { th, td { padding: 6px 8px; } .picture { width: 80px; }
  .picture img { max-width: 64px; max-height: 56px; } .long { min-width: 160px; }
  .name { min-width: 104px; } }
@media print { .search, footer { display: none; } .wide { overflow: visible; }
  td { padding: 4px; font-size: 11px; } th { padding: 4px; font-size: 10px; white-space: normal; }
  .long, .name { min-width: 88px; } .picture { width: 56px; }
  .picture img { max-width: 48px; max-height: 48px; } }
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
      if (x === "" || y === "") return (x === "") - (y === "");
      return (up ? 1 : -1) * (number ? x - y : texts.compare(x, y));
    });
    body.append(...rows);
  });
});
const found = heads.flatMap((head, column) => head.dataset.find ? [column] : []);
document.querySelector("[type=search]").addEventListener("input", event => {
  const wanted = event.target.value.trim().toLowerCase();
  const fits = (text, column) => heads[column].dataset.find === "whole"
    ? text === wanted : text.includes(wanted);
  for (const row of body.rows) {
    const seen = found.some(k => fits(row.cells[k].textContent.toLowerCase(), k));
    row.hidden = Boolean(wanted) && !seen;
  }
});
"""


@dataclass(frozen=True)
class PageColumn:
    """A column of a page's table.

    Parameters
    ----------
    title : str
    kind : {"", "n", "t"}
        Numbers and texts can be sorted by, others cannot.
    find : {"", "whole", "part"}
        Whether the search looks there, for the whole entry or a part of it.
    """

    title: str
    kind: str = "t"
    find: str = ""

    @property
    def html(self) -> str:
        """The column's head."""
        sort = " aria-sort=none" if self.kind else ""
        find = f' data-find="{self.find}"' if self.find else ""
        title = f"<button>{self.title}</button>" if self.kind else self.title
        return f'<th scope="col" data-kind="{self.kind}"{sort}{find}>{title}</th>'


@dataclass(frozen=True)
class PageParts:
    """What a page shows beside its table.

    Parameters
    ----------
    title : str
        Plain text.
    lead : str
        A sentence below it, HTML.
    sought : str
        What can be searched for, in words.
    figure : str
        Above the table, HTML.
    after : str
        Below the table, HTML.
    head : str
        More of the page's head, HTML.
    style : str
        More of its style sheet.
    """

    title: str
    lead: str
    sought: str
    figure: str = ""
    after: str = ""
    head: str = ""
    style: str = ""


def table_page(parts: PageParts, columns: Iterable[PageColumn], rows: Iterable[str]) -> str:
    """Return a whole page.

    Parameters
    ----------
    parts : PageParts
    columns : iterable of PageColumn
    rows : iterable of str
        HTML, `<tr>` each.
    """
    name, heads = escape(parts.title), "".join(column.html for column in columns)
    body = "\n".join(rows)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
{parts.head}<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{name}</title>
<style>{STYLE}{parts.style}</style>
</head>
<body>
<header>
<h1>{name}</h1>
<p>{parts.lead}</p>
</header>
{parts.figure}<label class="search">Search
<input type="search" autocomplete="off" placeholder="{parts.sought}"></label>
<div class="wide"><table>
<thead><tr>{heads}</tr></thead>
<tbody>
{body}
</tbody>
</table></div>
{parts.after}<footer>Made with napari-unpack.</footer>
<script>{SCRIPT}</script>
</body>
</html>
"""


def number_cell(value: Any, words: str) -> str:
    """Return a table's cell with a number, HTML.

    Parameters
    ----------
    value : float, optional
        By which it is sorted; what has none comes last in both orders.
    words : str
        What is shown.
    """
    known = value is not None and math.isfinite(value)
    # IDs may be long, and are all digits.
    told = format(value, "d" if isinstance(value, int) else ".9g") if known else ""
    return f'<td class="n" data-value="{told}">{words}</td>'
