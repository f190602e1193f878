/* Taking it along: a problem as Python, command and file; an episode as figure, film, page and file. */
import { ask, ended, fileAddress, run } from "./api.js";
import { el, guarded, openSheet, say, tabs, told } from "./page.js";

const WAYS = [["python", "As Python"], ["command", "As command"], ["file", "As file"]];
const HOW = {
  python: "Save the text as a script, and run the script in this folder.",
  command: "Enter the command in a terminal, in this folder.",
  file: "Commands take this file in place of a map, workspace or region.",
};
const FORMATS = [
  ["png", "Figure", "PNG"], ["svg", "Figure", "SVG"], ["mp4", "Film", "MP4"], ["gif", "Film", "GIF"], ["html", "Player page", "HTML"],
];

/** Show a problem as Python, as a command and as a file, ready to copy. */
export const showCopies = guarded(async (problem, seed) => {
  showForms(await ask("copies", { problem, seed }), el("button.second", {
    type: "button",
    onclick: guarded(async () => { const { file } = await ask("save", { problem, seed }); say(`Written into the folder: ${file}`); }),
  }, "Write the file into the folder"));
});

/** Show what is on the screen in its three forms; `more` are further buttons. */
export function showForms(copies, more = []) {
  const text = el("pre.code", { tabIndex: 0, "aria-label": "Text to copy" }), how = el("p.help", {});
  let shown = "python";
  const choice = tabs("Form of the copy", WAYS, (name) => {
    shown = name;
    text.textContent = copies[name];
    how.textContent = HOW[name];
  }, "panel-copies");
  openSheet("The same result elsewhere", choice.list, el("div", { id: "panel-copies", role: "tabpanel" }, how, text), el("div.actions", {},
    el("button.main", { type: "button", onclick: guarded(async () => { await copy(copies[shown]); say("Copied."); }) }, "Copy"), more,
    el("button.second", { type: "button", onclick: guarded(async () => { await copy(location.href); say("The link opens this page as it is now."); }) }, "Copy a link to this page")));
  choice.pick("python");
}

async function copy(text) {
  await navigator.clipboard.writeText(text);
}

/** Buttons that export an episode of the folder. */
export const exports = (episode) => exportsOf("export", { episode }, FORMATS, el("a.chip", { href: fileAddress(episode), download: "" }, "Episode"));

/** Buttons that write a file each, by a job of that kind. */
export function exportsOf(kind, spec, formats, more = []) {
  const buttons = formats.map(([format, what, word]) => {
    const button = el("button.chip", { type: "button", title: `${what} as ${word}`, "aria-label": `${what} as ${word}` }, word);
    button.addEventListener("click", guarded(async () => {
      button.disabled = true;
      button.classList.add("working");
      const free = () => {
        button.disabled = false;
        button.classList.remove("working");
      };
      try {
        await run(kind, { ...spec, format }, {
          done: ({ file }) => { free(); give(file); },
          failed: (job) => { free(); told(new Error(failure(job))); },
        });
      } catch (error) {
        free();
        throw error;
      }
    }));
    return button;
  });
  return el("div.exports", { role: "group", "aria-label": "Export" }, el("span.soft", {}, "Export"), buttons, more);
}

export const failure = (job) => job.result?.error ?? `The job was ${job.state}.`;

/** Hand a file of the folder to the browser, and say where it is. */
function give(file) {
  const link = el("a", { href: fileAddress(file), download: file });
  link.click();
  say(`Written into the folder: ${file}`);
}

export { ended };
