/* A picture of the user's own under the canvas, placed by two points of it whose coordinates are
   known, or map tiles, which have their places. */
import { ask, on, state, upload } from "../../shared/api.js";
import { el, guarded, say, svg } from "../../shared/page.js";
import { earthAt } from "./earth.js";
import { Tiles } from "./tiles.js";

const PICTURES = /\.(png|jpe?g|bmp|tiff?)$/i;
/** @type {{ file: string | null, spots: (number | null)[][], places: (number[] | null)[],
 *  degrees: boolean, opacity: number }} */
const EMPTY = {
  file: null,
  spots: [
    [null, null],
    [null, null],
  ],
  places: [null, null],
  degrees: false,
  opacity: 0.7,
};

export class Underlay {
  /** `frame()` is the place on Earth of the canvas, or null; `setFrame(frame)` gives it one, and
   *  tells whether it could; `changed()` is called when the picture moves. */
  constructor(canvas, { frame, setFrame, changed }) {
    this.canvas = canvas;
    this.frame = frame;
    this.setFrame = setFrame;
    this.changed = changed;
    /** @type {typeof EMPTY} */
    this.told = structuredClone(EMPTY);
    this.picking = -1;
    this.size = null;
    this.image = svg("image", { preserveAspectRatio: "none" });
    this.tiles = new Tiles(canvas, (sentence) => {
      this.note.textContent = sentence;
    });
    canvas.under.append(this.tiles.layer, this.image);
    this.element = this.makeForm();
  }

  async load(told) {
    this.told = { ...structuredClone(EMPTY), ...structuredClone(told ?? {}) };
    await this.open();
  }

  async open() {
    this.image.removeAttribute("href");
    this.canvas.element.classList.remove("pictured");
    this.size = null;
    this.tiles.open(null);
    this.note.textContent = "";
    this.fill();
    if (!this.told.file) return;
    if (this.tiled) {
      await this.openTiles();
      return;
    }
    const { picture, width, height } = await ask("photograph", { file: this.told.file });
    this.size = [width, height];
    for (const [name, value] of Object.entries({
      href: `data:image/jpeg;base64,${picture}`,
      width,
      height,
    }))
      this.image.setAttribute(name, value);
    await this.draw();
  }

  get tiled() {
    const { file } = this.told;
    return state.files.some((one) => one.name === file && one.kind === "tiles");
  }

  async openTiles() {
    const { file } = this.told;
    const about = await ask("tiles", { file });
    if (file !== this.told.file) return;
    this.tiles.open(file, about);
    this.tiles.layer.setAttribute("opacity", String(this.told.opacity));
    this.canvas.element.classList.add("pictured");
    this.thanks.textContent = about.attribution;
    if (this.frame()) return;
    if (!this.setFrame(this.tiles.middle)) return;
    if (this.canvas.bounds)
      say(
        "The drawing had no place on Earth: it lies now in the middle of the tiles. Ctrl Z takes that back.",
      );
    const [west, south, east, north] = about.bounds;
    const earth = await earthAt(this.frame());
    if (!this.canvas.bounds)
      this.canvas.show([earth.metres([west, south]), earth.metres([east, north])]);
    this.changed({ placed: true });
  }

  /** Pixels to metres: a turn, a scale and a shift; y of the picture goes down. Before two points
   *  are known it lies in the middle. */
  async transform() {
    const [wide, high] = this.size,
      spots = this.told.spots,
      places = this.told.places;
    if (spots.flat().includes(null) || places.includes(null)) {
      const [left, low, right, top] = this.canvas.bounds ?? [-250, -150, 250, 150],
        scale = Math.max((right - left) / wide, (top - low) / high);
      return [
        scale,
        0,
        (left + right) / 2 - (scale * wide) / 2,
        (low + top) / 2 + (scale * high) / 2,
      ];
    }
    let there = places;
    if (this.told.degrees) {
      if (!this.frame()) this.setFrame(places[0].map((x) => Math.round(x * 1e6) / 1e6));
      const earth = await earthAt(this.frame());
      there = places.map((place) => earth.metres(place));
    }
    // With pixels as complex numbers q = column - i row: place = a q + b.
    const [q1, q2] = spots.map(([column, row]) => [column, -row]),
      dq = [q2[0] - q1[0], q2[1] - q1[1]],
      dp = [there[1][0] - there[0][0], there[1][1] - there[0][1]];
    const norm = dq[0] ** 2 + dq[1] ** 2;
    if (!norm || !(dp[0] ** 2 + dp[1] ** 2))
      throw new Error(
        "The two points of the picture must differ, and their coordinates must differ.",
      );
    const a = [(dp[0] * dq[0] + dp[1] * dq[1]) / norm, (dp[1] * dq[0] - dp[0] * dq[1]) / norm];
    return [
      a[0],
      a[1],
      there[0][0] - (a[0] * q1[0] - a[1] * q1[1]),
      there[0][1] - (a[1] * q1[0] + a[0] * q1[1]),
    ];
  }

  async draw() {
    if (!this.size) return;
    const [a, b, x, y] = (this.matrix = await this.transform());
    this.image.setAttribute("transform", `matrix(${a} ${b} ${b} ${-a} ${x} ${y})`);
    this.image.setAttribute("opacity", this.told.opacity);
    this.canvas.element.classList.add("pictured");
    this.fill();
  }

  /** A click on the canvas while a point of the picture is looked for; whether it was one. */
  tap([x, y]) {
    if (this.picking < 0 || !this.size) return false;
    const [a, b, left, top] = this.matrix,
      norm = a * a + b * b,
      east = x - left,
      north = y - top;
    // pixels of the picture
    const spot = [(a * east + b * north) / norm, (b * east - a * north) / norm];
    this.told.spots[this.picking] = spot.map((one) => Math.round(one * 10) / 10);
    this.picking = -1;
    this.fill();
    return true;
  }

  makeForm() {
    const choice = el("select", {
      id: "underlayFile",
      onchange: guarded(async () => {
        await this.load({ file: choice.value || null });
        this.changed();
      }),
    });
    const picked = el("input", {
      type: "file",
      accept: "image/*,.pmtiles",
      hidden: true,
      onchange: guarded(async () => {
        if (picked.files[0]) {
          await this.load({ file: await upload(picked.files[0]) });
          this.changed();
        }
      }),
    });
    const unit = el(
      "select",
      { id: "underlayUnit" },
      el("option", { value: "metres" }, "x, y in metres"),
      el("option", { value: "degrees" }, "longitude, latitude"),
    );
    const rows = [0, 1].map((k) => {
      const inputs = ["first", "second"].map((word) =>
        el("input", {
          type: "number",
          step: "any",
          "aria-label": `Point ${k + 1}, ${word} coordinate`,
        }),
      );
      const pick = el(
        "button.second.small",
        {
          type: "button",
          "aria-pressed": "false",
          onclick: () => {
            this.picking = this.picking === k ? -1 : k;
            this.fill();
          },
        },
        `Point ${k + 1}`,
      );
      return { inputs, pick };
    });
    const spotInputs = [0, 1].map((k) =>
      ["column", "row"].map((word) =>
        el("input", {
          type: "number",
          step: "any",
          "aria-label": `Point ${k + 1}, ${word} of the picture`,
          placeholder: word,
          oninput: (event) => {
            this.told.spots[k][word === "row" ? 1 : 0] =
              event.target.value === "" ? null : Number(event.target.value);
          },
        }),
      ),
    );
    const seen = el("input", {
      type: "range",
      min: 0.1,
      max: 1,
      step: 0.05,
      id: "underlayOpacity",
      oninput: () => {
        this.told.opacity = Number(seen.value);
        this.image.setAttribute("opacity", seen.value);
        this.tiles.layer.setAttribute("opacity", seen.value);
        this.changed({ gesture: "opacity" });
      },
    });
    const apply = el(
      "button.second",
      {
        type: "button",
        onclick: guarded(async () => {
          const places = rows.map(({ inputs }) =>
            inputs.map((input) => (input.value === "" ? NaN : Number(input.value))),
          );
          if (places.flat().some(Number.isNaN) || this.told.spots.flat().includes(null))
            throw new Error(
              "Each of the two points needs a place in the picture and two coordinates.",
            );
          this.told = { ...this.told, places, degrees: unit.value === "degrees" };
          await this.draw();
          this.changed({ placed: true });
        }),
      },
      "Place the picture",
    );
    const word = el("p.help", {});
    this.note = el("p.help", { role: "status" });
    this.thanks = el("p.soft", {});
    const points = el(
      "div.placing",
      {},
      el("label", { htmlFor: "underlayUnit" }, "Coordinates"),
      unit,
      rows.map(({ inputs, pick }, k) => el("div.point", {}, pick, spotInputs[k], inputs)),
      word,
      apply,
    );
    const placing = el(
      "div.placing",
      {},
      points,
      this.note,
      this.thanks,
      el("label", { htmlFor: "underlayOpacity" }, "How strong"),
      seen,
    );
    this.fill = () => {
      const { file, spots, places } = this.told;
      const pictures = state.files.filter(
        (one) =>
          one.kind === "tiles" ||
          (PICTURES.test(one.name) && !/^papers\/|-figure(-\d+)?\.png$/.test(one.name)),
      );
      choice.replaceChildren(
        el("option", { value: "" }, "no picture"),
        ...pictures.map((one) =>
          el(
            "option",
            { value: one.name },
            one.kind === "tiles" ? `${one.name}: map tiles` : one.name,
          ),
        ),
      );
      if (file && !pictures.some((one) => one.name === file))
        choice.append(el("option", { value: file }, file));
      choice.value = file ?? "";
      placing.hidden = !file;
      points.hidden = this.tiled;
      this.thanks.hidden = !this.tiled;
      this.canvas.element.classList.toggle("picks", this.picking >= 0);
      unit.value = this.told.degrees ? "degrees" : unit.value;
      seen.value = this.told.opacity;
      rows.forEach(({ inputs, pick }, k) => {
        pick.setAttribute("aria-pressed", String(this.picking === k));
        spotInputs[k].forEach((input, axis) => {
          input.value = spots[k][axis] ?? "";
        });
        if (places[k])
          inputs.forEach((input, axis) => {
            input.value = places[k][axis];
          });
      });
      word.textContent =
        this.picking >= 0
          ? `Click point ${this.picking + 1} in the picture.`
          : "Press Point 1, click a point of the picture, and enter the coordinates of this point. Then do the same for Point 2.";
    };
    on("files", () => this.fill());
    return el(
      "details.section",
      { ontoggle: () => this.fill() },
      el("summary", {}, "A picture below", el("span.soft", {}, "or map tiles")),
      el(
        "div.pair",
        {},
        el("label.unseen", { htmlFor: "underlayFile" }, "Picture below the canvas"),
        choice,
        el("button.second", { type: "button", onclick: () => picked.click() }, "Bring a picture"),
        picked,
      ),
      placing,
    );
  }
}
