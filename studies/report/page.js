// One pose, everywhere on the page: what carries the same data-pose stands out together (class `highlight`).
// Speaks with the figures by the event `posecal:pose` on document, detail {pose, source, pinned}.
(() => {
  "use strict";
  const SOURCE = "page";
  const of = new Map(); // pose -> its elements
  let pinned = null, hovered = null, highlight = null;

  function light(pose) {
    if (pose === highlight) return;
    for (const element of of.get(highlight) ?? []) element.classList.remove("highlight");
    for (const element of of.get(pose) ?? []) element.classList.add("highlight");
    highlight = pose;
  }
  const tell = (pose, isPinned) =>
    document.dispatchEvent(new CustomEvent("posecal:pose", { detail: { pose, source: SOURCE, pinned: isPinned } }));
  const poseAt = (target) => target?.closest?.("[data-pose]")?.dataset.pose ?? null;

  function over(pose) {
    if (pose === hovered) return; // what a figure itself lights stays highlighted
    hovered = pose;
    light(pose ?? pinned);
    tell(pose, false);
  }

  // Beside the pointer stands what the figure of the arm says of the pose, else its name.
  const tip = document.createElement("div");
  Object.assign(tip, { className: "tip", hidden: true });
  tip.setAttribute("aria-hidden", "true"); // those who do not point read the same in table and figure
  function point(event) {
    const pose = event.pointerType === "mouse" ? poseAt(event.target) : null;
    tip.hidden = pose === null;
    if (pose === null) return;
    const told = [...document.querySelectorAll(".arm-now")].find((now) => now.firstElementChild?.textContent === pose);
    const words = told ? [...told.children].map((part) => part.textContent).filter(Boolean) : [pose];
    tip.replaceChildren(...words.map((text, i) => Object.assign(document.createElement(i ? "span" : "b"), { textContent: text })));
    const { clientWidth: wide, clientHeight: high } = document.documentElement, box = tip.getBoundingClientRect();
    tip.style.left = `${Math.max(4, Math.min(event.clientX + 14, wide - box.width - 4))}px`;
    tip.style.top = `${event.clientY + 18 + box.height > high ? event.clientY - box.height - 10 : event.clientY + 18}px`;
  }
  function pin(pose) {
    pinned = pose;
    light(pose);
    tell(pose, true);
  }

  document.addEventListener("posecal:pose", ({ detail }) => {
    if (detail.source === SOURCE) return;
    if (detail.pinned) pinned = detail.pose;
    light(detail.pose ?? pinned);
  });
  for (const type of ["pointerover", "focusin"]) document.addEventListener(type, (event) => over(poseAt(event.target)));
  document.addEventListener("pointermove", point);
  document.addEventListener("focusout", () => over(null));
  document.documentElement.addEventListener("pointerleave", () => { over(null); tip.hidden = true; });
  document.addEventListener("click", (event) => {
    const pose = poseAt(event.target);
    if (pose !== null && !event.target.closest("a, button, summary, select, input")) pin(pose === pinned ? null : pose);
  });
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && pinned !== null) pin(null);
    if ((event.key === "Enter" || event.key === " ") && event.target.matches("[data-pose]")) {
      event.preventDefault();
      const { pose } = event.target.dataset;
      pin(pose === pinned ? null : pose);
    }
  });

  // ---- tables with data-sortable: the last row of the head gets buttons that sort the body

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

  function start() {
    document.body.append(tip);
    for (const element of document.querySelectorAll("[data-pose]")) {
      const { pose } = element.dataset;
      if (!of.has(pose)) of.set(pose, []);
      of.get(pose).push(element);
    }
    document.querySelectorAll("table[data-sortable]").forEach(makeSortable);
  }
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
