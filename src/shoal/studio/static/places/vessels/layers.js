/* The photograph under its map and under the player: whether it is seen, and how much of it. */
import { el, percent } from "../../shared/page.js";

const SHARE = 0.5; // at first

/** How much of the photograph the map has, if not all of it. */
function cut([left, top, right, bottom]) {
  const share = (right - left) * (bottom - top);
  return share < 0.995 ? `${percent(share)} of it is on the map` : "";
}

/** `changed(below)` is told what lies below: { image, box, share }, or null; `look` keeps it over a
 *  reload. */
export function photographBelow({ changed, look }) {
  let photograph = null; // { image, box }
  const seen = el("input.switch", { type: "checkbox", checked: true, onchange: tell });
  const share = el("input", {
    type: "range",
    min: 0.05,
    max: 0.95,
    step: 0.05,
    value: SHARE,
    "aria-label": "How much of the photograph shows through",
    oninput: tell,
  });
  const part = el("span.part", {});
  const element = el(
    "div.layer",
    { hidden: true },
    el("label", {}, seen, el("span", {}, "Photograph below")),
    share,
    part,
  );

  function below() {
    return photograph && seen.checked ? { ...photograph, share: Number(share.value) } : null;
  }

  function tell() {
    share.disabled = !seen.checked;
    look({ below: { seen: seen.checked, share: share.value } });
    changed(below());
  }

  return {
    element,
    below,
    get known() {
      return !!photograph;
    },
    /** Where the map is in a photograph, in shares of its sides; null: not known. */
    boxIn: (image) => (photograph?.image === image ? photograph.box : null),
    /** Another photograph, or none. */
    set(found) {
      photograph = found;
      part.textContent = found?.box ? cut(found.box) : "";
      changed(below());
    },
    revive(kept) {
      if (!kept) return;
      seen.checked = kept.seen;
      share.value = kept.share;
      share.disabled = !kept.seen;
    },
  };
}
