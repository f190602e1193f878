/* Map tiles below the canvas: squares of the Web Mercator projection, each a picture that the
   canvas turns and stretches like any other (docs/adr/0020-map-tiles.md says how exact that is). */
import { svg } from "../../shared/page.js";

const SIDE = 256; // pixels of a tile
// pixels of the page by which tiles overlap, so that no line shows between them
const OVERLAP = 0.5;
const MOST = 200; // tiles at once
const AROUND = 40_075_016.7; // metres of the equator
const REACH = 100_000; // metres around the place of the canvas within which its degrees hold
const NOWHERE =
  "Tiles have places on Earth, and the region has none. Draw the region, or bring a file with longitude and latitude.";
const radians = (x) => (x * Math.PI) / 180;

/** Column and row of a place at a zoom, as fractions. */
const spotOf = ([longitude, latitude], zoom) => [
  ((longitude + 180) / 360) * 2 ** zoom,
  ((1 - Math.asinh(Math.tan(radians(latitude))) / Math.PI) / 2) * 2 ** zoom,
];

/** Longitude and latitude of the north-western corner of a tile. */
const cornerOf = (column, row, zoom) => [
  (column / 2 ** zoom) * 360 - 180,
  (Math.atan(Math.sinh(Math.PI * (1 - (2 * row) / 2 ** zoom))) * 180) / Math.PI,
];

export class Tiles {
  /** `told(sentence)` says why no tile is seen, or nothing. */
  constructor(canvas, told) {
    this.canvas = canvas;
    this.told = told;
    this.layer = svg("g", { class: "tiles" });
    this.source = null;
    this.earth = null; // by which the shown tiles were placed
    /** @type {Map<string, SVGImageElement>} */
    this.shown = new Map();
    canvas.viewed = () => this.draw();
  }

  /** Show the tiles of a file or folder, of which `about` says the zooms and bounds; null: none. */
  open(file, about) {
    this.source = file && { file, ...about };
    this.layer.replaceChildren();
    this.shown.clear();
    this.draw();
  }

  get middle() {
    const [west, south, east, north] = this.source.bounds;
    return [(west + east) / 2, (south + north) / 2].map((x) => Math.round(x * 1e6) / 1e6);
  }

  draw() {
    const { canvas, source } = this;
    if (!source) return;
    this.layer.style.display = canvas.earth ? "" : "none";
    if (!canvas.earth) {
      this.told(NOWHERE);
      return;
    }
    if (this.earth !== canvas.earth) {
      // the canvas lies somewhere else: so does each tile
      this.earth = canvas.earth;
      this.layer.replaceChildren();
      this.shown.clear();
    }
    const [wide, high] = canvas.size,
      edges = [
        [0, 0],
        [wide, high],
      ].map((spot) => canvas.back(spot).map((x) => Math.max(-REACH, Math.min(REACH, x)))),
      [[west, north], [east, south]] = edges;
    const there = [
      [west, north],
      [east, north],
      [west, south],
      [east, south],
    ].map((corner) => canvas.earth.degrees(corner));
    const latitude = radians(canvas.earth.frame[1]),
      fitting = Math.round(Math.log2((AROUND * Math.cos(latitude) * canvas.scale) / SIDE)),
      zoom = Math.max(source.zooms[0], Math.min(source.zooms[1], fitting));
    const spots = there.map((place) => spotOf(place, zoom)),
      [left, bottom, right, top] = source.bounds,
      ends = [spotOf([left, top], zoom), spotOf([right, bottom], zoom)];
    const from = [0, 1].map((axis) =>
        Math.floor(Math.max(ends[0][axis] + 1e-6, Math.min(...spots.map((spot) => spot[axis])))),
      ),
      to = [0, 1].map((axis) =>
        Math.floor(Math.min(ends[1][axis] - 1e-6, Math.max(...spots.map((spot) => spot[axis])))),
      );
    const count = Math.max(0, to[0] - from[0] + 1) * Math.max(0, to[1] - from[1] + 1);
    this.told(
      count > MOST
        ? "There are too many tiles here: zoom in."
        : count
          ? ""
          : `No tile lies here: they cover ${left.toFixed(3)} to ${right.toFixed(3)}° E, ${bottom.toFixed(3)} to ${top.toFixed(3)}° N.`,
    );
    const wanted = new Set();
    if (count <= MOST)
      for (let column = from[0]; column <= to[0]; column++)
        for (let row = from[1]; row <= to[1]; row++) {
          const key = `${zoom}/${column}/${row}`;
          wanted.add(key);
          if (!this.shown.has(key)) this.add(key, zoom, column, row);
        }
    this.wanted = wanted;
    this.tidy();
  }

  add(key, zoom, column, row) {
    const { earth } = this.canvas;
    const [nw, ne, sw, se] = [
      [column, row],
      [column + 1, row],
      [column, row + 1],
      [column + 1, row + 1],
    ].map(([c, r]) => earth.metres(cornerOf(c, r, zoom)));
    // its middle and the means of its sides: what fits all four corners best
    const across = [0, 1].map((axis) => (ne[axis] - nw[axis] + se[axis] - sw[axis]) / 2 / SIDE),
      down = [0, 1].map((axis) => (sw[axis] - nw[axis] + se[axis] - ne[axis]) / 2 / SIDE),
      [x, y] = [0, 1].map(
        (axis) =>
          (nw[axis] + ne[axis] + sw[axis] + se[axis]) / 4 -
          (SIDE / 2) * (across[axis] + down[axis]),
      );
    const pixel = Math.hypot(...across) * this.canvas.scale,
      side = SIDE + OVERLAP / Math.max(1 / SIDE, pixel);
    const image = svg("image", {
      href: `/tiles/${key}/${this.source.file.split("/").map(encodeURIComponent).join("/")}`,
      width: side,
      height: side,
      preserveAspectRatio: "none",
      transform: `matrix(${[...across, ...down, x, y].join(" ")})`,
    });
    image.dataset.tile = key;
    for (const kind of ["load", "error"])
      image.addEventListener(kind, () => {
        image.dataset.came = kind;
        this.tidy();
      });
    this.shown.set(key, image);
    this.layer.append(image);
  }

  /** Tiles of another zoom stay until those that are wanted have come. */
  tidy() {
    const waits = [...this.shown].some(
      ([key, image]) => this.wanted.has(key) && !image.dataset.came,
    );
    if (waits && this.shown.size < 2 * MOST) return;
    for (const [key, image] of this.shown)
      if (!this.wanted.has(key)) {
        image.remove();
        this.shown.delete(key);
      }
  }
}
