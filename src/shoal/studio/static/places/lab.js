/* Lab: sweeps of the folder's stores, a form for new ones, and the episodes of the folder. */
import { el, tabbed } from "../shared/page.js";
import { gallery } from "./lab/gallery.js";
import { drafting } from "./lab/new.js";
import { results } from "./lab/results.js";

export function lab({ remember }) {
  const shown = (what) => remember({ tab: current, ...what });
  const list = results({
    shown,
    change: (toml) => {
      stages.pick("new");
      draft.write(toml);
    },
  });
  const draft = drafting({
    shown,
    started: (store, sweep) => {
      stages.pick("sweeps");
      list.choose(store, sweep);
    },
  });
  const shelf = gallery();
  const rooms = { sweeps: list, new: draft, episodes: shelf };
  let current = "sweeps";
  const stages = tabbed(
    "Lab",
    [
      ["sweeps", "Sweeps", list.element],
      ["new", "New sweep", draft.element],
      ["episodes", "Episodes", shelf.element],
    ],
    {
      scrolls: true,
      chosen(name) {
        current = name;
        rooms[name].open();
      },
    },
  );

  return {
    element: el("div.lab", {}, stages.list, stages.panels),
    title: "Lab",
    get store() {
      return current === "new" ? draft.store : null;
    },
    async open(given) {
      if (given?.toml || given?.draft) draft.begin(given);
      if (given?.store) list.choose(given.store, given.sweep, given.measure);
      stages.pick(Object.hasOwn(rooms, given?.tab) ? given.tab : given?.draft ? "new" : current);
      if (given?.episode) await shelf.watch(given.episode);
    },
  };
}
