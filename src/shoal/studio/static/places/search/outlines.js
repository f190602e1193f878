/* What outlines a drawing has: polygons to search, their holes, and zones to keep out of. */
import { centreOf, inside } from "../../shared/geometry.js";

export const KINDS = ["parts", "holes", "zones"];

/** The holes of a polygon: those that lie in it. */
export const holesOf = (ring, holes) =>
  holes.filter((hole) => inside(/** @type {[number, number]} */ (centreOf(hole)), ring));
