/* The ways of robots on the canvas; of several layers one is shown at a time, or all. */
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
    this.tour = svg("g", { class: "tour" });
    this.ways = svg("g", { class: "ways" });
  }

  /** The pieces of a way in the layer that is shown. */
  pieces(way) {
    return way.filter((piece) => this.layer < 0 || piece.layer === this.layer);
  }

  show(plan, chosen) {
    this.list(plan?.layers ?? []);
    this.tour.replaceChildren(
      svg("path", {
        d: this.pieces(plan?.closed ?? [])
          .map((piece) => line(piece.points))
          .join(""),
      }),
    );
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

  /** A point on a robot's way for its number; null where it is in other layers. */
  head(robot) {
    const longest = this.pieces(robot.way).reduce(
      (most, piece) => (piece.points.length > (most?.points.length ?? 0) ? piece : most),
      null,
    )?.points;
    if (!longest) return null;
    const k = longest.length >> 1,
      [from, to] = [longest[k - 1], longest[k]];
    return [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
  }
}
