/* Where the map comes from: a file that is dropped or in the folder, or a generated map. */
import { leftOut, on, state } from "../../shared/api.js";
import { fieldRow } from "../../shared/form.js";
import { el, filePicker, guarded, olderFiles } from "../../shared/page.js";

const BY_NAME =
  "A generated map, such as vessels:1000:7. Its kind comes first, then its size and, if it is random, its number.";
export const NO_MAPS = /^papers\/|-figure(-\d+)?\.png$/;

const CANVAS = "canvas";

/** `choose(name)` takes a map, `bring(file)` a file of the user's, `blank()` a canvas to paint on. */
export function chooser({ choose, bring, blank }) {
  const choices = el("select", {
    id: "vesselsFile",
    onchange: guarded(() => choices.value && choose(choices.value)),
  });
  const picker = filePicker(([file]) => bring(file));
  const kinds = el(
    "select",
    {
      "aria-label": "A new map",
      onchange: guarded(async () => {
        const kind = kinds.value;
        kinds.value = "";
        if (kind === CANVAS) await blank();
        else if (kind) await choose(kind);
      }),
    },
    el("option", { value: "" }, "a new map"),
    el("option", { value: CANVAS }, "empty – Paint the map by hand."),
    state.start.maps.map((one) =>
      el("option", { value: one.example, title: one.summary }, `${one.name} – ${one.summary}`),
    ),
  );
  const generated = el("input", {
    type: "text",
    spellcheck: false,
    autocomplete: "off",
    id: "vesselsMap",
    onchange: guarded(() => generated.value && choose(generated.value.trim())),
  });
  const drop = el(
    "button.drop",
    { type: "button", onclick: () => picker.click() },
    el("b", {}, "Drop a picture or volume here"),
    el("span.soft", {}, "PNG, JPEG, TIFF, NIfTI, .npy, .map, text"),
  );

  const row = fieldRow("map", "by name", { id: "vesselsMap", element: generated }, BY_NAME);

  function list() {
    const maps = state.files.filter((file) => file.kind === "map" && !NO_MAPS.test(file.name));
    const kept = choices.value;
    choices.replaceChildren(
      el("option", { value: "" }, maps.length ? "from the folder" : "no file yet"),
      ...maps.map((file) => el("option", { value: file.name }, file.name)),
      ...olderFiles(leftOut("map")),
    );
    choices.value = kept;
  }
  on("files", list);
  list();

  return {
    row,
    element: el(
      "section.chooser",
      { "aria-label": "Map" },
      drop,
      picker,
      el(
        "div.pair",
        {},
        el("label.unseen", { htmlFor: "vesselsFile" }, "A file in the folder"),
        choices,
        kinds,
      ),
      row.element,
    ),
    /** Show which one is chosen. */
    show(name) {
      choices.value = state.files.some((file) => file.name === name) ? name : "";
      generated.value = choices.value ? "" : name;
    },
  };
}
