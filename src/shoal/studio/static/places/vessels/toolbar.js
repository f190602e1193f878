/* The tools beside the map. */
import { el, symbol } from "../../shared/page.js";
import { stepButtons } from "../../shared/store.js";
import { FREE, INLET, LOOK, WALL } from "./editor.js";

const TOOLS = [
  [
    LOOK,
    "Look",
    "M4 12s3-6 8-6 8 6 8 6-3 6-8 6-8-6-8-6zM12 10a2 2 0 1 0 .01 0z",
    "Move and zoom the map",
  ],
  [FREE, "Paint", "M5 19l2-6L16 4l4 4-9 9zM14 6l4 4", "Paint free cells"],
  [WALL, "Erase", "M4 15l8-9 7 6-7 7H8zM9 10l7 6", "Erase cells: they become walls"],
  [INLET, "Inlet", "M12 4v10M8 10l4 4 4-4M5 19h14", "Paint the cells where particles enter"],
];

/** The tools beside the map: what the pointer does, how wide, undo, and painting by numbers. */
export function toolbar(editor, store) {
  const buttons = TOOLS.map(([name, words, path, help]) =>
    el(
      "button.tool",
      {
        type: "button",
        title: help,
        "aria-pressed": String(name === LOOK),
        onclick: () => pick(name),
      },
      symbol(path),
      el("span", {}, words),
    ),
  );
  function pick(name) {
    editor.tool = name;
    buttons.forEach((button, i) =>
      button.setAttribute("aria-pressed", String(TOOLS[i][0] === name)),
    );
    width.hidden = name === LOOK;
    editor.redraw();
  }
  const size = el("input", {
    type: "range",
    min: 1,
    max: 25,
    value: 3,
    "aria-label": "Width of the brush, cells",
    oninput: () => {
      editor.brush = Number(size.value);
      editor.redraw();
    },
  });
  const width = el("label.width", { hidden: true }, el("span", {}, "Width"), size);
  const cells = ["row", "column", "rows", "columns"].map((name, i) =>
    el(
      "label",
      {},
      name,
      el("input.short", { type: "number", min: i > 1 ? 1 : 0, value: i > 1 ? 5 : 0, name }),
    ),
  );
  const what = el(
    "select",
    { "aria-label": "What to paint" },
    TOOLS.slice(1).map(([name, words]) => el("option", { value: name }, words)),
  );
  const form = el(
    "form.numbers",
    {
      onsubmit: (event) => {
        event.preventDefault();
        editor.fill(what.value, ...cells.map((cell) => Number(cell.querySelector("input").value)));
        pick(editor.tool);
      },
    },
    what,
    cells,
    editor.applying,
  );
  const byNumbers = el("details.by", {}, el("summary", {}, "By numbers"), form);
  const element = el(
    "div.toolbar",
    { role: "toolbar", "aria-label": "Painting" },
    el("div.group", {}, buttons),
    width,
    stepButtons(store),
    el(
      "div.group",
      {},
      el(
        "button.tool",
        {
          type: "button",
          title: "Fit the map",
          "aria-label": "Fit the map",
          onclick: () => editor.fit(),
        },
        symbol("M4.5 9V4.5H9M15 4.5h4.5V9M19.5 15v4.5H15M9 19.5H4.5V15"),
      ),
    ),
    byNumbers,
  );
  return { element, pick };
}
