// Let a click on a heading sort a table by the `data-value` of its cells. Those that have none come last either way.
function sortable(table) {
  const heads = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  const value = (row, column) => {
    const cell = row.cells[column];
    if (!cell || !cell.hasAttribute("data-value")) return null;
    const text = cell.getAttribute("data-value");
    return cell.classList.contains("number") || cell.classList.contains("rank") ? Number(text) : text;
  };
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.append(...head.childNodes);
    head.append(button);
    head.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const falling = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.setAttribute("aria-sort", "none"));
      head.setAttribute("aria-sort", falling ? "descending" : "ascending");
      const rows = [...body.rows].map((row) => [value(row, column), row]);
      rows.sort(([p], [q]) => {
        if (p === q) return 0;
        if (p === null) return 1;
        if (q === null) return -1;
        return (p < q ? -1 : 1) * (falling ? -1 : 1);
      });
      body.append(...rows.map(([, row]) => row));
    });
  });
}
document.querySelectorAll("table.sortable").forEach(sortable);
