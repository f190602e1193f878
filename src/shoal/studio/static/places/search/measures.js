/* Lengths and areas as the plan view writes them. */
import { number } from "../../shared/page.js";

export const metres = (length) =>
  length >= 1000 ? `${number(length / 1000)} km` : `${number(length)} m`;
export const surface = (size) => (size >= 1e4 ? `${number(size / 1e4)} ha` : `${number(size)} m²`);
