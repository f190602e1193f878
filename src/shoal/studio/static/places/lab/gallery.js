/* The episodes of the folder, with pictures; one that is chosen is played. */
import { ask, listed, loadFiles, newest, on } from "../../shared/api.js";
import { el, guarded, number, say } from "../../shared/page.js";
import { PlayerFrame } from "../../shared/player.js";
import { exports, PLACES, placeOf } from "../../shared/share.js";

const AT_ONCE = 24;

export function gallery() {
  const grid = el("ul.gallery", { "aria-label": "Episodes of the folder" }),
    more = el(
      "button.second",
      {
        type: "button",
        hidden: true,
        onclick: () => {
          most += AT_ONCE;
          draw();
        },
      },
      "More",
    );
  const search = el("input", {
      type: "text",
      id: "episodeName",
      spellcheck: false,
      autocomplete: "off",
      placeholder: "part of a name",
      oninput: () => {
        most = AT_ONCE;
        draw();
      },
    }),
    word = el("p.soft", { role: "status" }, "Reading the episodes of the folder …");
  const head = el("div.stageHead", {}),
    stage = el("section.watching", { "aria-label": "Episode", hidden: true }, head),
    frames = {},
    cards = new Map();
  let most = AT_ONCE;
  const seen = new IntersectionObserver(
    (entries) => {
      for (const { isIntersecting, target } of entries) {
        if (!isIntersecting) continue;
        seen.unobserve(target);
        /** @type {any} */ (target).fetch();
      }
    },
    { rootMargin: "200px" },
  );

  function card(file) {
    const picture = el("div.picture", {}),
      words = el("span", {}, "");
    const made = el(
      "li",
      {},
      el(
        "button.card",
        { type: "button", onclick: guarded(() => watch(file.name)) },
        picture,
        el("b", {}, file.name),
        words,
      ),
    );
    made.fetch = async () => {
      try {
        const found = await ask("picture", { file: file.name, slow: true });
        picture.replaceChildren(
          el("img", { src: `data:image/png;base64,${found.picture}`, alt: "" }),
        );
        words.textContent = found.sentence;
      } catch (error) {
        words.textContent = error.message;
      }
    };
    return made;
  }

  /** The newest episodes with the name that is looked for: as many as were asked for, a page at
   *  a time. */
  const draw = newest(
    guarded(async () => {
      const name = search.value.trim(),
        found = [];
      let all = 0;
      do {
        const { files, counts } = await listed("episode", { skip: found.length, name });
        all = counts.episode ?? 0;
        found.push(...files);
        if (!files.length) break;
      } while (found.length < Math.min(most, all));
      const shown = found.slice(0, most).map((file) => {
        const key = `${file.name} ${file.time}`;
        if (!cards.has(key)) cards.set(key, card(file));
        return cards.get(key);
      });
      grid.replaceChildren(...shown);
      for (const one of shown) if (!one.querySelector("img")) seen.observe(one);
      more.hidden = all <= most;
      word.textContent =
        all > shown.length
          ? `The newest ${number(shown.length, 9)} of ${number(all, 9)} episodes.`
          : all
            ? `${number(all, 9)} ${all === 1 ? "episode" : "episodes"}.`
            : "";
      if (!all)
        grid.replaceChildren(
          el(
            "li.empty",
            {},
            name
              ? "No episode has such a name."
              : "No episode in this folder yet. The pages Vessels, Steering and Search save every episode that they play.",
          ),
        );
    }),
  );

  /** Take the settings of an episode to the page of its problem. */
  async function change(file) {
    const { problem, seed, written, note, ...more } = await ask("settings", { file, slow: true });
    if (note) say(note);
    if (written) {
      await loadFiles();
      say(`This folder has another map or none of this name: its cells are in ${written} now.`);
    }
    location.hash = placeOf(problem.kind, problem, seed, more);
  }

  async function watch(file) {
    stage.hidden = false;
    head.replaceChildren(el("p.soft", { role: "status" }, `Reading ${file} …`));
    const { part, data, sentence, problem } = await ask("page", { file }).catch((error) => {
      stage.hidden = true;
      throw error;
    });
    if (!frames[part]) {
      // a frame that leaves the page would load anew: each stays where it is
      frames[part] = new PlayerFrame(part, { title: "The episode" });
      stage.append(frames[part].element);
    }
    for (const [name, frame] of Object.entries(frames)) if (name !== part) frame.close();
    head.replaceChildren(
      el("h2", {}, file),
      el("p", {}, sentence),
      el(
        "button.quiet.icon",
        {
          type: "button",
          "aria-label": "Close",
          onclick: () => {
            stage.hidden = true;
            frames[part].close();
          },
        },
        "×",
      ),
      el(
        "div.actions",
        {},
        exports(file),
        PLACES[problem.kind]
          ? el(
              "button.second.small",
              { type: "button", onclick: guarded(() => change(file)) },
              "Change and run again …",
            )
          : [],
      ),
    );
    await frames[part].open(data);
    stage.scrollIntoView({ block: "start" });
    frames[part].play();
  }

  on("files", () => {
    if (grid.checkVisibility()) draw();
  });
  return {
    element: el(
      "div.shelf",
      {},
      stage,
      el("div.actions", {}, el("label", { htmlFor: search.id }, "Find"), search, word),
      grid,
      more,
    ),
    open: () => draw(),
    watch,
  };
}
