/* The photograph with what the sliders find on it: soon, and then as a run will find it. */
import { ask } from "../../shared/api.js";
import { el, guarded, number, percent } from "../../shared/page.js";

const REST = 700; // milliseconds until the sliders are at rest

async function imageOf(text, kind) {
  const image = new Image();
  image.src = `data:image/${kind};base64,${text}`;
  await image.decode();
  return image;
}

/** Returns functions that read and show it; `fields()` is the problem, `visible()` whether the
 *  photograph is still looked at, `said(...words)` and `complain(sentence)` show words, and
 *  `shown()` and `placed({ image, box })` hear of a photograph that is there, and of where the map
 *  is in one that was looked through. */
export function photographs({ editor, fields, visible, said, complain, placed, shown }) {
  let exact = 0,
    photograph = null;

  async function find(surely) {
    const began = performance.now(),
      asked = fields();
    const found = await ask("vessels", { problem: asked, exact: surely });
    const mask = await imageOf(found.mask, "png");
    if (asked.map !== fields().map || !visible()) return;
    if (surely && JSON.stringify(asked) !== JSON.stringify(fields())) return; // a newer one comes
    editor.setPhotograph(photograph.image, mask, surely);
    performance.measure("shoal-overlay", { start: began });
    if (surely) {
      complain(found.warning);
      placed({ image: photograph.image, box: found.box });
    }
    const confidence = surely ? `, confidence ${number(found.confidence, 2)} of 1` : "";
    const key = el("i.swatch", { "aria-hidden": "true" });
    key.style.background = editor.vesselColour;
    said(
      el("span", {}, key, `${percent(found.share)} of the pixels are vessel${confidence}`),
      ...(surely && found.box ? [framed(found)] : []),
    );
  }

  /** What of the photograph the map takes, and what of its vessels the map leaves out. */
  function framed({ box: [left, top, right, bottom], dropped: [parts, share] }) {
    const rest = parts
      ? `, without ${number(parts)} separate ${parts === 1 ? "part" : "parts"} (${percent(share)} of the vessels)`
      : "";
    return el(
      "span",
      {},
      el("i.swatch.frame", { "aria-hidden": "true" }),
      `the map: ${percent((right - left) * (bottom - top))} of the photograph${rest}`,
    );
  }

  /** The photograph of the form, read once. */
  async function read() {
    const file = fields().map;
    if (photograph?.file !== file) {
      const { picture, width, height } = await ask("photograph", { file });
      photograph = { file, image: await imageOf(picture, "jpeg"), width, height };
    }
    return photograph;
  }

  async function show() {
    await read();
    if (editor.photograph !== photograph.image) {
      editor.setPhotograph(photograph.image, null);
      shown();
      said("looking for vessels …");
    }
    clearTimeout(exact);
    await find(false);
    exact = setTimeout(
      guarded(() => find(true)),
      REST,
    );
  }

  return {
    read,
    show,
    /** Its height and width in pixels. */
    get sides() {
      return [photograph.height, photograph.width];
    },
  };
}
