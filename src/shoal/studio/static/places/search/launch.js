/* Launch points: in the form's field, as text. */
import { say } from "../../shared/page.js";
import { pointText, pointsOf } from "./earth.js";

/** `earth()` is the place of the canvas on Earth, or null; `quietly()` shows points that are still
 *  being moved, `done()` takes them up. */
export function launchPoints({ form, robots, earth, quietly, done }) {
  const count = () => Number(form.values().robots ?? robots);
  const at = (point) => ({ point, text: pointText(point, earth()) });

  /** Each launch point once, with its text as it was entered. */
  function read() {
    const words = String(form.values().launch ?? "")
      .split(/[;\n]+/)
      .map((text) => text.trim());
    const texts = [...new Set(words.filter(Boolean))];
    const points = pointsOf(texts.join(";"), earth()) ?? [];
    return points.map((point, k) => ({ point, text: texts[k] }));
  }

  /** One point is for all; several are shared out among the robots. */
  function write(some, { quiet = false } = {}) {
    const all =
      some.length < 2
        ? some
        : Array.from({ length: Math.max(count(), some.length) }, (_, k) => some[k % some.length]);
    if (some.length > count()) form.row("robots").write(some.length);
    form.row("launch").write(all.map(({ text }) => text).join(";") || undefined);
    if (quiet) quietly();
    else done();
  }

  let shared = null; // the points before a number of robots was typed
  form.element.addEventListener("change", () => {
    const left = (shared?.length ?? 0) - read().length;
    shared = null;
    const [are, them] = left === 1 ? ["point is", "it"] : ["points are", "them"];
    if (left > 0)
      say(`${left} launch ${are} left out: a robot has one. Ctrl Z brings ${them} back.`);
  });

  return {
    read,
    write,
    add: (point) => write([...read(), at(point)]),
    move: (k, to) =>
      write(
        read().map((one, i) => (i === k ? at(to) : one)),
        { quiet: true },
      ),
    remove: (k) => write(read().filter((_, i) => i !== k)),
    /** Share the points out among another number of robots. The "1" of a "12" that is being typed
     *  takes none away. */
    spread() {
      shared ??= read();
      if (shared.length > 1 && count() >= 1) write(shared.slice(0, count()), { quiet: true });
    },
    forget() {
      shared = null;
    },
  };
}
