/* The ways of robots on the canvas; of several layers one is shown at a time, or all. */
import { distance } from "../../shared/geometry.js";
import { el, number, svg } from "../../shared/page.js";

const line = (points) => points.map((point, k) => `${k ? "L" : "M"}${point.join(" ")}`).join("");

export class Ways {
  /** `changed()` is called when another layer is chosen. */
  constructor(changed) {
    this.layer = 0; // -1: all of them
    this.layers = [];
    this.choice = el("select", {
      id: "searchLayer",
      onchange: () => {
        this.layer = Number(this.choice.value);
        changed();
      },
    });
    this.element = el(
      "span.slider",
      { hidden: true },
      el("label", { htmlFor: "searchLayer" }, "Ways of the layer"),
      this.choice,
    );
    this.ways = svg("g", { class: "ways" });
  }

  /** The pieces of a way in the layer that is shown. */
  pieces(way) {
    return way.filter((piece) => this.layer < 0 || piece.layer === this.layer);
  }

  show(plan, chosen) {
    this.list(plan?.layers ?? []);
    this.ways.replaceChildren(
      ...(plan?.robots ?? []).map((robot, k) =>
        svg("path", {
          class: `way r${k % 12}${chosen >= 0 && chosen !== k ? " dim" : ""}`,
          d: this.pieces(robot.way)
            .map((piece) => line(piece.points))
            .join(""),
        }),
      ),
    );
  }

  list(layers) {
    if (String(layers) === String(this.layers)) return;
    this.layers = layers;
    this.layer = 0;
    this.choice.replaceChildren(
      ...layers.map((height, k) => el("option", { value: k }, `at ${number(height)} m`)),
      el("option", { value: -1 }, "all together"),
    );
    this.element.hidden = layers.length < 2;
  }

  /** The middle of the longest leg of a robot's way, for its number: corners are elsewhere. Null
   *  where it is in other layers. */
  head(robot) {
    let middle = null,
      longest = 0;
    for (const { points } of this.pieces(robot.way))
      for (let k = 1; k < points.length; k += 1) {
        const length = distance(points[k - 1], points[k]);
        if (length <= longest) continue;
        longest = length;
        middle = points[k].map((x, axis) => (x + points[k - 1][axis]) / 2);
      }
    return middle;
  }
}
