/* What Ctrl Z takes back: the states of a place, whatever was done between them. */
import { el, symbol } from "./page.js";

const MOST_STEPS = 300, MOST_CHARACTERS = 40_000_000; // of all kept states together: painted maps are long

/** One step for each thing that was done. A state is what JSON can hold: all that is set in a place, and nothing that follows from it. */
export class History {
  /** `restore(state)` sets all that is set, at once; it may ask the server for what follows from it. */
  constructor(restore) {
    Object.assign(this, { restore, now: null, done: [], undone: [], gesture: null, restoring: false });
    const button = (word, key, path, act) => el("button.tool", { type: "button", disabled: true, title: `${word} (${key})`, "aria-label": word, onclick: act }, symbol(path));
    this.back = button("Undo", "Ctrl Z", "M9 5L4 10l5 5M4 10h10a5 5 0 0 1 0 10h-3", () => this.undo());
    this.forth = button("Redo", "Ctrl Shift Z", "M15 5l5 5-5 5M20 10H10a5 5 0 0 0 0 10h3", () => this.redo());
    this.buttons = el("div.group", {}, this.back, this.forth);
  }

  /** Note the state after something was done. What one gesture does, such as typing in one field, is one step. */
  note(state, gesture = null) {
    const text = JSON.stringify(state);
    if (this.restoring || this.now === null) this.now = text;
    if (text === this.now) return;
    const goesOn = gesture !== null && gesture === this.gesture;
    if (!goesOn) this.done.push(this.now);
    else if (this.done.at(-1) === text) this.done.pop(); // typed, and deleted again
    this.now = text;
    this.gesture = this.done.length ? gesture : null;
    this.undone = [];
    for (let length = this.done.reduce((sum, one) => sum + one.length, 0); length > MOST_CHARACTERS || this.done.length > MOST_STEPS;) length -= this.done.shift().length;
    this.show();
  }

  /** The state has another form, although nothing was done: what was painted is a file now. */
  amend(state) {
    this.now = JSON.stringify(state);
  }

  /** Forget the last steps as long as `part(state)` holds: they are parts of what is noted next. */
  fold(part) {
    while (this.done.length && part(JSON.parse(this.now))) this.now = this.done.pop();
  }

  /** The gesture has ended: the same one is a new step. */
  end() {
    this.gesture = null;
  }

  undo() {
    this.step(this.done, this.undone);
  }

  redo() {
    this.step(this.undone, this.done);
  }

  step(from, to) {
    if (!from.length) return;
    to.push(this.now);
    this.now = from.pop();
    this.gesture = null;
    this.restoring = true;
    try {
      this.restore(JSON.parse(this.now));
    } finally {
      this.restoring = false;
      this.show();
    }
  }

  show() {
    this.back.disabled = !this.done.length;
    this.forth.disabled = !this.undone.length;
  }
}
