// Tables with data-sortable: the last row of the head gets buttons that sort the body.
(() => {
  "use strict";
  const sortKey = (row, column) => {
    const cell = row.cells[column];
    const text = (cell?.dataset.sort ?? cell?.textContent ?? "").trim();
    const number = Number.parseFloat(text.replace("\u2212", "-"));
    return Number.isNaN(number) || !/^[-+\u2212.\d]/.test(text) ? text : number;
  };
  // Numbers first, then words; what is empty or a dash comes last either way.
  const rank = (key) => (typeof key === "number" ? 0 : /^[-\u2013\u2014]?$/.test(key) ? 2 : 1);
  const compare = (a, b, sign) => {
    if (rank(a) === 2 || rank(b) === 2) return rank(a) - rank(b);
    if (rank(a) !== rank(b)) return sign * (rank(a) - rank(b));
    return sign * (typeof a === "number" ? a - b : a.localeCompare(b, undefined, { numeric: true }));
  };
  const lastRow = (table) => table.tHead?.rows[table.tHead.rows.length - 1];

  function sort(table, column) {
    const heads = lastRow(table).cells, head = heads[column];
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of heads) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const body = table.tBodies[0];
    const keyed = [...body.rows].map((row) => [sortKey(row, column), row]);
    keyed.sort(([a], [b]) => compare(a, b, up ? 1 : -1));
    body.append(...keyed.map(([, row]) => row));
  }

  function makeSortable(table) {
    for (const [column, head] of [...(lastRow(table)?.cells ?? [])].entries()) {
      if (!head.textContent.trim()) continue;
      const button = document.createElement("button");
      Object.assign(button, { type: "button", className: "sort" });
      button.append(...head.childNodes);
      button.addEventListener("click", () => sort(table, column));
      head.append(button);
    }
  }

  const start = () => document.querySelectorAll("table[data-sortable]").forEach(makeSortable);
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
