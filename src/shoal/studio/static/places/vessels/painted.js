/* What is painted is in the folder soon after the stroke: one file follows it until it is used. */
import { ask } from "../../shared/api.js";
import { guarded } from "../../shared/page.js";

const REST = 700; // milliseconds after a stroke

export function paintedFile() {
  let file = null; // { name, of: the map that was painted over, text: its cells }
  let writing = Promise.resolve(),
    waiting = 0;

  const holds = (cells, of) => file?.of === of && file.text === JSON.stringify(cells);

  /** One after another, so that there are no two files of the same strokes. */
  function write(cells, of) {
    const written = writing.then(async () => {
      if (holds(cells, of)) return file.name;
      const over = file?.of === of ? file.name : null;
      const { file: name } = await ask("sketch", { ...cells, name: of, over });
      file = { name, of, text: JSON.stringify(cells) };
      return name;
    });
    writing = written.catch(() => {});
    return written;
  }

  return {
    /** The name of the file, if it holds these cells. */
    nameOf: (cells, of) => (holds(cells, of) ? file.name : null),
    /** Write them when nothing was painted for a while; null: nothing is painted. */
    soon(cells, of, done) {
      clearTimeout(waiting);
      if (!cells || holds(cells, of)) return;
      waiting = setTimeout(
        guarded(async () => {
          await write(cells, of);
          done();
        }),
        REST,
      );
    },
    /** Write them now, into a file that stays as it is from then on. */
    async use(cells, of) {
      clearTimeout(waiting);
      const name = await write(cells, of);
      file = null;
      return name;
    },
  };
}
