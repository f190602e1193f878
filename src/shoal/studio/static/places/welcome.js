/* The first page: examples to begin with, and a place for any file. */
import { ask, on, state, uploadTogether } from "../shared/api.js";
import { acceptDrops, el, filePicker, guarded } from "../shared/page.js";
import { NO_MAPS } from "./vessels/chooser.js";

const EXAMPLES = [
  [
    "eye",
    "An eye",
    "The photograph of a retina. 300 particles map its vessels, moved by one command.",
  ],
  ["leaf", "A leaf", "5000 cells of veins, as in a leaf. 100 particles find them all."],
  ["tree", "A tree in space", "Vessels in three dimensions. Turn the tree while it is mapped."],
  [
    "field",
    "A field with a zone",
    "Four drones search a field on Earth, and stay out of a no-go zone.",
  ],
  [
    "dying",
    "Dying robots",
    "Two of six robots die, and a third of the messages is lost. The search is completed.",
  ],
  ["race", "A race", "Move a swarm with the arrow keys, against a policy."],
];

const MOST_SHOWN = 6;
/** What of the folder a page opens, in words. */
const KINDS = {
  episode: "episode",
  missions: "missions",
  store: "sweep with its results",
  sweep: "sweep",
  problem: "JSON",
  region: "region",
  workspace: "workspace",
  map: "map",
};

/** Go to a place with what it opens. */
const go = ({ place, given }) => {
  location.hash = `${place}?${encodeURIComponent(JSON.stringify(given))}`;
};

export function welcome({ remember }) {
  const cards = EXAMPLES.map(([name, title, words]) =>
    el(
      "li",
      {},
      el(
        "button.card",
        {
          type: "button",
          onclick: guarded(async (event) => {
            const card = event.currentTarget;
            card.classList.add("working");
            try {
              go(await ask("example", { name }));
            } finally {
              card.classList.remove("working");
            }
          }),
        },
        el("img", {
          src: `/static/places/welcome/${name}.png`,
          alt: "",
          width: 320,
          height: 200,
          loading: "lazy",
        }),
        el("b", {}, title),
        el("span", {}, words),
      ),
    ),
  );

  const recent = el("ul.recent", { "aria-label": "Files of the folder" }),
    ofFolder = el("section", { hidden: true }, el("h3", {}, "In this folder"), recent);
  /** The newest files of the folder that a page opens. */
  function list() {
    const found = state.files
      .filter((file) => KINDS[file.kind] && !(file.kind === "map" && NO_MAPS.test(file.name)))
      .sort((a, b) => b.time - a.time)
      .slice(0, MOST_SHOWN);
    ofFolder.hidden = !found.length;
    recent.replaceChildren(
      ...found.map((file) =>
        el(
          "li",
          {},
          el(
            "button.file",
            {
              type: "button",
              onclick: guarded(async () => go(await ask("open", { file: file.name }))),
            },
            el("b", {}, file.name),
            el("span", {}, KINDS[file.kind]),
          ),
        ),
      ),
    );
  }
  on("files", list);
  list();

  const bring = async (files) => go(await ask("open", { file: await uploadTogether(files) }));
  const picker = filePicker(bring, { multiple: true });
  const drop = el(
    "button.drop",
    { type: "button", onclick: () => picker.click() },
    el("b", {}, "Open a file"),
    el(
      "span.soft",
      {},
      "or drop it here: a photograph, a volume, a map, a region, a workspace, a problem, an episode, a sweep or missions",
    ),
  );

  const element = el(
    "div.welcome",
    {},
    el(
      "div.lead",
      {},
      el("h2", {}, "Bodies that explore a space together"),
      el(
        "p",
        {},
        "Begin with an example, or with a file of your own. Everything stays on this computer, in the folder of the studio.",
      ),
    ),
    drop,
    picker,
    ofFolder,
    el("h3", {}, "Examples"),
    el("ul.gallery", { "aria-label": "Examples" }, cards),
  );
  acceptDrops(element, bring);
  return {
    element,
    title: "Start",
    open() {
      remember({});
    },
  };
}
