/* The first page: examples to begin with, and a place for any file. */
import { ask, uploadTogether } from "../shared/api.js";
import { acceptDrops, el, filePicker, guarded } from "../shared/page.js";

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
