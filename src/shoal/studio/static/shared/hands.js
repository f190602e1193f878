/* Hands on a canvas: the wheel, two fingers and keys zoom, a drag and the arrow keys pan. */
const SLIP = 5; // pixels that a click may move
const WHEEL = 0.0015,
  LINE = 16; // how fast a pixel of the wheel zooms; pixels of one of its lines
const STEP = 60; // pixels of an arrow key
const NEARER = 1.5; // by one key
const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [1, 0], ArrowRight: [-1, 0] };

/** The place of a pointer on an element, in pixels.
 *
 *  @returns {[number, number]} */
export function spotOf(element, event) {
  const box = element.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

/** `view` has `zoom(factor, spot)`, `pan(right, down)` and `fit()`; it may have `tap(spot, event)`
 *  for
 *  a click that is no drag, `over(spot)` as the pointer moves (null when it leaves), `arrow(step,
 *  event)`, which tells whether it took an arrow key, and `take(spot)`, which may take the first
 *  finger for itself: an object with `move(spot)`, `end()` and, for when a second finger comes,
 *  `cancel()`. */
export function hands(element, view) {
  const held = new Map();
  let from = null,
    own = null;
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    element.setPointerCapture(event.pointerId);
    const spot = spotOf(element, event);
    held.set(event.pointerId, spot);
    from = null;
    if (held.size > 1) own = own?.cancel() ?? null;
    else {
      from = spot;
      own = view.take?.(spot) ?? null;
    }
  });
  element.addEventListener("pointermove", (event) => {
    const here = spotOf(element, event),
      last = held.get(event.pointerId);
    view.over?.(here);
    if (!last) return;
    const apart = ([x, y]) => Math.hypot(here[0] - x, here[1] - y);
    if (from && apart(from) > SLIP) from = null;
    const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const before = Math.max(1, Math.hypot(last[0] - other[0], last[1] - other[1]));
      view.zoom(Math.max(1, apart(other)) / before, [
        (here[0] + other[0]) / 2,
        (here[1] + other[1]) / 2,
      ]);
      view.pan((here[0] - last[0]) / 2, (here[1] - last[1]) / 2);
    } else if (own) own.move(here);
    else if (!from) view.pan(here[0] - last[0], here[1] - last[1]);
    if (!from) held.set(event.pointerId, here);
  });
  const up = (event) => {
    if (!held.delete(event.pointerId)) return;
    if (own) own.end();
    else if (from && event.type === "pointerup") view.tap?.(from, event);
    own = from = null;
  };
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("pointerleave", () => view.over?.(null));
  element.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode === 1 ? LINE : 1);
      view.zoom(Math.exp(-pixels * WHEEL), spotOf(element, event));
    },
    { passive: false },
  );
  element.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    // What lies on the canvas has arrow keys of its own.
    const step = event.target === element ? ARROWS[event.key] : null;
    const factor = { "+": NEARER, "=": NEARER, "-": 1 / NEARER }[event.key];
    if (!step && !factor && event.key !== "0") return;
    event.preventDefault();
    if (factor) view.zoom(factor, [element.clientWidth / 2, element.clientHeight / 2]);
    else if (!step) view.fit();
    else if (!view.arrow?.(step, event)) view.pan(STEP * step[0], STEP * step[1]);
  });
}
