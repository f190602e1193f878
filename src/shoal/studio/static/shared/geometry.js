/* Outlines that are being drawn: measures, shapes, and whether they cross themselves. */

const side = ([ax, ay], [bx, by], [cx, cy]) =>
  Math.sign((bx - ax) * (cy - ay) - (by - ay) * (cx - ax));

/** Whether two segments have a point in common, their ends included. */
function meet(a, b, c, d) {
  const [first, second, third, fourth] = [
    side(a, b, c),
    side(a, b, d),
    side(c, d, a),
    side(c, d, b),
  ];
  if (first !== second && third !== fourth) return true;
  const within = (p, q, r) =>
    [0, 1].every((k) => Math.min(p[k], q[k]) <= r[k] && r[k] <= Math.max(p[k], q[k]));
  return (
    (first === 0 && within(a, b, c)) ||
    (second === 0 && within(a, b, d)) ||
    (third === 0 && within(c, d, a)) ||
    (fourth === 0 && within(c, d, b))
  );
}

/** Whether the line from the last corner of an open outline to `next` meets the outline; `closes`
 *  if `next` is its first corner. */
export function crosses(corners, next, { closes = false } = {}) {
  const last = corners.at(-1);
  return corners
    .slice(closes ? 1 : 0, -2)
    .some((corner, i) => meet(corner, corners[i + (closes ? 2 : 1)], last, next));
}

export const CROSSES =
  "The outline would cross itself there. Put the corner elsewhere, or take corners back with Ctrl Z.";
export const CROSSES_CLOSED =
  "The last side would cross the outline. Add corners around it, or take corners back with Ctrl Z.";

/** @type {(from: number[], to: number[]) => number} */
export const distance = ([ax, ay], [bx, by]) => Math.hypot(bx - ax, by - ay);

export const perimeter = (ring) =>
  ring.reduce((sum, point, i) => sum + distance(point, ring[(i + 1) % ring.length]), 0);

/** The area inside a ring, which may go around in either sense. */
export const area = (ring) =>
  Math.abs(
    ring.reduce((sum, [x, y], i) => {
      const [nextX, nextY] = ring[(i + 1) % ring.length];
      return sum + x * nextY - nextX * y;
    }, 0),
  ) / 2;

/** Degrees clockwise from the north, or from above, at which b is seen from a.
 *
 *  @type {(from: number[], to: number[]) => number} */
export const bearing = ([ax, ay], [bx, by]) =>
  ((Math.atan2(bx - ax, by - ay) * 180) / Math.PI + 360) % 360;

/** Whether a point lies inside a ring. */
export const inside = ([x, y], ring) =>
  ring.reduce((odd, [ax, ay], i) => {
    const [bx, by] = ring[(i + 1) % ring.length];
    return ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax) ? !odd : odd;
  }, false);

export const centreOf = (ring) =>
  [0, 1].map((axis) => ring.reduce((sum, point) => sum + point[axis], 0) / ring.length);

/** A ring turned about a point by so many radians, counter-clockwise.
 *
 *  @param {number[][]} ring
 *  @param {number[]} centre
 *  @param {number} angle */
export function turned(ring, [cx, cy], angle) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return ring.map(([x, y]) => [
    cx + cos * (x - cx) - sin * (y - cy),
    cy + sin * (x - cx) + cos * (y - cy),
  ]);
}

export const rectangle = ([ax, ay], [bx, by]) => [
  [ax, ay],
  [bx, ay],
  [bx, by],
  [ax, by],
];

const SIDES = 48; // of a circle
/** A polygon around a centre, whose corners are as far from it as `rim`. */
export function circle([cx, cy], rim) {
  const radius = distance([cx, cy], rim);
  return Array.from({ length: SIDES }, (_, k) => {
    const angle = (2 * Math.PI * k) / SIDES;
    return [cx + radius * Math.cos(angle), cy + radius * Math.sin(angle)];
  });
}

/** The corner of the rings that is nearer than `near`, or else the nearest such point of a side;
 *  without one, the point itself. */
export function snapped(point, rings, near) {
  let best = null,
    least = near;
  const offer = (place) => {
    const apart = distance(point, place);
    if (apart < least) [best, least] = [place, apart];
  };
  rings.flat().forEach(offer);
  if (best) return best;
  for (const ring of rings)
    ring.forEach((a, i) => {
      const b = ring[(i + 1) % ring.length],
        long = distance(a, b) ** 2 || 1,
        along = ((point[0] - a[0]) * (b[0] - a[0]) + (point[1] - a[1]) * (b[1] - a[1])) / long,
        share = Math.max(0, Math.min(1, along));
      offer([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]);
    });
  return best ?? point;
}
