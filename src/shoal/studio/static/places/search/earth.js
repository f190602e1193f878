/* Between metres and degrees around a place, by polynomials that the server fits to its
   projection. */
import { ask } from "../../shared/api.js";

const known = new Map(); // by place: a promise of its Earth

export const earthAt = (frame) => {
  const key = String(frame);
  if (!known.has(key))
    known.set(
      key,
      ask("earth", { frame }).then((told) => new Earth(told)),
    );
  return known.get(key);
};

const sum = (terms, x, y) =>
  terms.reduce(
    ([a, b], [i, j, u, v]) => {
      const power = x ** i * y ** j;
      return [a + u * power, b + v * power];
    },
    [0, 0],
  );

class Earth {
  constructor({ frame, reach, degrees, metres }) {
    this.frame = frame;
    this.reach = reach;
    this.forDegrees = degrees;
    this.forMetres = metres;
  }

  degrees([x, y]) {
    const [longitude, latitude] = sum(this.forDegrees, x / this.reach, y / this.reach);
    return [this.frame[0] + longitude, this.frame[1] + latitude];
  }

  metres([longitude, latitude]) {
    return sum(this.forMetres, longitude - this.frame[0], latitude - this.frame[1]).map(
      (x) => x * this.reach,
    );
  }
}

const near = (value, digits) => String(Number(value.toFixed(digits)));

const HAND = { degrees: 7, metres: 2 }; // digits of what a hand sets: a centimetre

/** A point as the fields of a search take it: longitude,latitude or metres. */
export const pointText = (point, earth, digits = HAND) =>
  (earth
    ? earth.degrees(point).map((x) => near(x, digits.degrees))
    : point.map((x) => near(x, digits.metres))
  ).join(",");

/** Points of such a text, in metres; null for what is no list of points. */
export function pointsOf(text, earth) {
  const words = String(text ?? "")
    .trim()
    .split(/[;\n]+/)
    .map((line) => line.trim())
    .filter(Boolean);
  const pairs = words.map((word) => word.split(/[\s,]+/).map(Number));
  if (
    !pairs.length ||
    pairs.some((pair) => pair.length !== 2 || pair.some((x) => !Number.isFinite(x)))
  )
    return null;
  return earth ? pairs.map((pair) => earth.metres(pair)) : pairs;
}
