/* Pointers: dragging along the chart; wheel, pinch and drag on the picture. */
"use strict";

const ShoalHands = (() => {
  const WHEEL_RATE = 0.0015; // how fast a pixel of wheel zooms

  /** Call seek(x) for clicks and drags on an element, hover(x) for the mouse above it and
   *  hover(null) when it leaves. */
  function seekOn(element, seek, hover) {
    const xOf = (event) => event.clientX - element.getBoundingClientRect().left;
    element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      element.setPointerCapture(event.pointerId);
      seek(xOf(event));
    });
    element.addEventListener("pointermove", (event) => {
      if (element.hasPointerCapture(event.pointerId)) seek(xOf(event));
      hover(xOf(event));
    });
    element.addEventListener("pointerleave", () => hover(null));
  }

  /** Zoom about the pointer with the wheel, about the middle of two fingers with a pinch; pan
   *  with a drag. `view` has zoom(factor, x, y), pan(x, y), zoomed(), held(on). */
  function zoomOn(element, view) {
    const down = new Map(); // the pointers held, and where each was last
    const place = (event) => {
      const box = element.getBoundingClientRect();
      return { x: event.clientX - box.left, y: event.clientY - box.top };
    };
    element.addEventListener(
      "wheel",
      (event) => {
        const root = document.scrollingElement;
        // Where the page itself scrolls, a plain wheel must go on scrolling it.
        if (!event.ctrlKey && root.scrollHeight > root.clientHeight) return;
        event.preventDefault();
        const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : 1) * (event.ctrlKey ? 5 : 1);
        const { x, y } = place(event);
        view.zoom(Math.exp(-pixels * WHEEL_RATE), x, y);
      },
      { passive: false },
    );
    element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      element.setPointerCapture(event.pointerId);
      down.set(event.pointerId, place(event));
      view.held(view.zoomed());
    });
    element.addEventListener("pointermove", (event) => {
      const last = down.get(event.pointerId);
      if (!last) return;
      const here = place(event),
        other = [...down].find(([id]) => id !== event.pointerId)?.[1];
      if (other) pinch(last, here, other);
      else if (view.zoomed()) view.pan(here.x - last.x, here.y - last.y);
      down.set(event.pointerId, here);
    });
    const release = (event) => {
      down.delete(event.pointerId);
      view.held(down.size > 0 && view.zoomed());
    };
    element.addEventListener("pointerup", release);
    element.addEventListener("pointercancel", release);

    function pinch(last, here, other) {
      const apart = (point) => Math.max(1, Math.hypot(point.x - other.x, point.y - other.y));
      view.zoom(apart(here) / apart(last), (here.x + other.x) / 2, (here.y + other.y) / 2);
      if (view.zoomed()) view.pan((here.x - last.x) / 2, (here.y - last.y) / 2);
    }
  }

  return { seekOn, zoomOn };
})();
