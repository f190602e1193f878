/* The player in a frame: its page is loaded beforehand, an episode is given to it, also while it
   is being played. */
import { el } from "./page.js";

const theme = () => document.documentElement.dataset.theme;

export class PlayerFrame {
  /** `part`: whose player. A page is kept ready, so that an episode shows at once. */
  constructor(part, { title = "The player", bare = null } = {}) {
    this.part = part;
    this.title = title;
    this.bare = bare;
    this.element = el("div.frames", {});
    this.shown = null;
    this.spare = this.make("");
    this.opening = Promise.resolve();
    document.addEventListener("shoal-theme", () =>
      this.shown?.contentWindow.shoalPlayer?.setTheme(theme()),
    );
  }

  make(options) {
    const frame = el("iframe", {
      title: this.title,
      src: `/play/${this.part}${options}`,
      hidden: true,
    });
    frame.ready = new Promise((resolve) =>
      frame.addEventListener("load", () => resolve(frame), { once: true }),
    );
    frame.options = options;
    this.element.append(frame);
    return frame;
  }

  /** Show an episode, given as the data of its player, after those that are still opening; returns
   *  the window of the frame. */
  open(data) {
    const opened = this.opening.then(() => this.show(data));
    this.opening = opened.catch(() => {});
    return opened;
  }

  async show(data) {
    const options =
      this.part !== "swarm"
        ? ""
        : data.shape?.length === 3
          ? "?volume"
          : "moments" in data
            ? "?recorded"
            : "";
    if (this.spare.options !== options) {
      this.spare.remove();
      this.spare = this.make(options);
    }
    const frame = this.spare;
    await frame.ready;
    this.spare = this.make(options);
    this.shown?.remove();
    this.shown = frame;
    frame.hidden = false;
    const inside = frame.contentWindow;
    if (this.bare) inside.document.documentElement.classList.add("bare", this.bare);
    inside.shoalOpen(data);
    inside.shoalPlayer?.setTheme(theme());
    inside.addEventListener("keydown", (event) => {
      // undo is the page's, also while the film has the keyboard
      if ((event.ctrlKey || event.metaKey) && ["z", "y"].includes(event.key.toLowerCase()))
        document.body.dispatchEvent(new KeyboardEvent("keydown", event));
    });
    return inside;
  }

  get player() {
    return this.shown?.contentWindow.shoalPlayer ?? null;
  }

  /** Play what is shown, unless the user wants no motion. */
  play() {
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) this.player?.play();
  }

  /** Show a photograph under the map: { image, box, share }; or none. A volume has none. */
  setBelow(below) {
    this.player?.setBelow?.(below);
  }

  /** What of the map is looked at: see Picture; undefined: no plane map is shown. */
  look() {
    return this.player?.picture?.view;
  }

  lookAt(view) {
    if (view !== undefined) this.player?.lookAt(view);
  }

  focus() {
    this.shown?.contentWindow.focus();
  }

  close() {
    this.shown?.remove();
    this.shown = null;
  }
}
