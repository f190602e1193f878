/* Where the region comes from: files that are dropped or in the folder, a name, or a drawing. */
import { leftOut, on, state } from "../../shared/api.js";
import { fieldRow } from "../../shared/form.js";
import { el, filePicker, guarded, olderFiles } from "../../shared/page.js";

const FORMATS = "GeoJSON, KML, GeoPackage, Shapefile (its files or a zip), CSV";

/** `choose(name)` takes a region, `bring(files)` files of the user's, `blank()` begins a drawing
 *  and `loosen()` makes one of what a file holds; `region()` is the name of the region, and `file()`
 *  that of the file that has it, also of a drawing. */
export function chooser({ choose, bring, blank, loosen, region, file }) {
  const choices = el("select", {
    id: "searchFile",
    onchange: guarded(() => choices.value && choose(choices.value)),
  });
  const picker = filePicker(bring, { multiple: true });
  const typed = el("input", {
    type: "text",
    spellcheck: false,
    autocomplete: "off",
    id: "searchRegion",
    placeholder: "square:400",
    onchange: guarded(() => typed.value && choose(typed.value.trim())),
  });
  const { description } = state.start.schemas.search.properties.region;
  const row = fieldRow("region", "by name", { id: "searchRegion", element: typed }, description);
  const drop = el(
    "button.drop",
    { type: "button", onclick: () => picker.click() },
    el("b", {}, "Drop a region here"),
    el("span.soft", {}, FORMATS),
  );

  /** The fields that say where the region comes from, as they are. */
  function show() {
    typed.value = region() ?? "";
    list();
  }

  function list() {
    const found = state.files.filter(
      ({ kind, name }) => (kind === "region" || /\.csv$/i.test(name)) && !/^papers\//.test(name),
    );
    choices.replaceChildren(
      el("option", { value: "" }, found.length ? "from the folder" : "no file yet"),
      ...found.map((file) => el("option", { value: file.name }, file.name)),
      ...olderFiles(leftOut("region")),
    );
    mark();
  }

  /** The file of the region is the one that is chosen. */
  function mark() {
    const name = file() ?? "";
    choices.value = [...choices.options].some(({ value }) => value === name) ? name : "";
  }
  on("files", list);
  list();

  return {
    row,
    show,
    mark,
    element: el(
      "section.chooser",
      { "aria-label": "Region" },
      drop,
      picker,
      el("label.unseen", { htmlFor: "searchFile" }, "A file in the folder"),
      choices,
      row.element,
      el(
        "div.pair",
        {},
        el("button.second", { type: "button", onclick: guarded(blank) }, "Draw a region"),
        el(
          "button.second",
          {
            type: "button",
            title: "Turn the region into a drawing with movable corners",
            onclick: guarded(loosen),
          },
          "Edit its corners",
        ),
      ),
    ),
  };
}
